"""The belief of a held object's pose, computed beside the control loop: for hardware."""

from __future__ import annotations

import dataclasses
import threading
import weakref
from types import TracebackType
from typing import Self

from pydrake.systems.framework import Context, EventStatus, State

from tactopose_drake.core.parameter_checks import params_of
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.hand.collision import HandCollision
from tactopose_drake.systems.belief_inputs import Reading
from tactopose_drake.systems.pose_belief_estimator import PoseBeliefEstimator, PoseBeliefParams, TimedBelief

# A belief is late that is older than so many periods: one is what the thread has, another what it waits for.
_PUNCTUAL = 2.5


class _Exchange:
    """What the loop and the thread hand each other, under a lock.

    Attributes:
        wakened: the lock, and what the thread waits for.
        newest: the last reading that the thread has not begun with; None where there is none.
        finished: the last belief.
        error: what the thread has failed with; None while it runs.
        is_told: whether somebody has raised that.
        closing: whether the thread is to end.
    """

    def __init__(self, begun: TimedBelief) -> None:
        self.wakened = threading.Condition()
        self.newest: Reading | None = None
        self.finished = begun
        self.error: BaseException | None = None
        self.is_told = False
        self.closing = False

    def close(self) -> None:
        """Tells the thread to end."""
        with self.wakened:
            self.closing = True
            self.wakened.notify()


class LivePoseBeliefEstimator(PoseBeliefEstimator):
    """`PoseBeliefEstimator` whose updates are computed in a thread of its own.

    At each period the inputs are handed to the thread, which takes the newest when it is free; what it has not begun by
    then is passed over. The outputs show the last belief that it finished. So the control loop never waits, and what
    comes out depends on how fast the machine is: simulate with the other one. While the thread falls behind, the status
    tells the belief's age; one older than `PoseTrackerParams.lost_time` is called lost. The belief lives in the thread,
    not in the context: a system serves one context.

    An exception in the thread ends it, and is raised by the next update of the system, or by `close`; whoever goes on
    all the same is told it by the status, of a belief that is lost. The thread ends by `close`, too, or when a diagram
    that nobody uses any more is freed.
    """

    def __init__(
        self, model: ObjectModel, params: PoseBeliefParams | None = None, collision: HandCollision | None = None
    ) -> None:
        """Starts the thread; `close` ends it.

        Args:
            model: the object.
            params: the period, and what is assumed; the latency is what it is.
            collision: as of `PoseBeliefEstimator`.
        """
        super().__init__(model, dataclasses.replace(params_of(PoseBeliefParams, params), latency=0.0), collision)
        self._exchange = _Exchange(TimedBelief(self._tracker.start()))
        # A thread that held the system would keep its diagram for ever.
        own = weakref.ref(self), self._exchange
        weakref.finalize(self, self._exchange.close).atexit = False
        # A daemon, so that a diagram that nobody closed does not keep the program from ending.
        self._thread = threading.Thread(target=_work, args=own, name="pose belief", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Ends the thread after the update that it is at, and raises what it may have failed with."""
        self._exchange.close()
        self._thread.join()
        self._raise()

    def _update(self, context: Context, state: State) -> EventStatus:
        reading = self._read(context, state)
        exchange = self._exchange
        with exchange.wakened:
            exchange.newest = reading
            finished = exchange.finished
            exchange.wakened.notify()
        self._raise()
        state.get_mutable_abstract_state(self._shown).set_value(self._aged(finished, context.get_time()))
        return EventStatus.Succeeded()

    def _aged(self, timed: TimedBelief, now: float) -> TimedBelief:
        """What is to be said of a belief some time after it."""
        belief, age, error = timed.belief, now - timed.belief.time, self._exchange.error
        if error is None and 0.0 <= age <= _PUNCTUAL * self._params.period:
            return timed
        remarks = (f"the belief is {age:.2f} s old", *belief.remarks)
        if error is not None:
            remarks = (f"its thread ended with {error!r}", *remarks)
        is_late = error is not None or not 0.0 <= age <= self._params.tracker.lost_time
        belief = dataclasses.replace(belief, status="lost" if is_late else belief.status, remarks=remarks)
        return dataclasses.replace(timed, belief=belief)

    def _raise(self) -> None:
        with self._exchange.wakened:
            error = None if self._exchange.is_told else self._exchange.error
            self._exchange.is_told = error is not None or self._exchange.is_told
        if error is not None:
            raise error


def _work(of: weakref.ref[LivePoseBeliefEstimator], exchange: _Exchange) -> None:
    """The thread: updates with the newest frame, again and again, as long as there is the system."""
    while True:
        with exchange.wakened:
            exchange.wakened.wait_for(lambda: exchange.closing or exchange.newest is not None)
            if exchange.closing:
                return
            reading, exchange.newest = exchange.newest, None
            before = exchange.finished
        assert reading is not None
        system = of()
        if system is None:
            return
        try:
            finished = system._step(before, reading)
        except BaseException as error:  # Nothing is lost: the control loop raises it.
            with exchange.wakened:
                exchange.error = error
            return
        del system
        with exchange.wakened:
            exchange.finished = finished
