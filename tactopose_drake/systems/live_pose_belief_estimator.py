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

# A belief older than this many periods is late: the thread is busy for up to one, and waits up to one for its input.
_PUNCTUAL = 2.5


class _Exchange:
    """The data that the control loop and the thread exchange, under a lock.

    Attributes:
        wakened: the condition variable that guards all other attributes and wakes the thread.
        newest: the newest reading that the thread has not started to process; None if there is none.
        finished: the last belief that the thread finished.
        error: the exception that ended the thread; None while it runs.
        is_told: whether that exception has been raised in the control loop.
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
    """A `PoseBeliefEstimator` that computes its updates in a thread of its own.

    At each period the inputs are passed to the thread, which processes the newest ones when it is free and skips older
    ones. The outputs show the last belief that it finished. The control loop therefore never waits, but the results
    depend on the speed of the machine: use `PoseBeliefEstimator` in simulation. While the thread falls behind, the
    status gives the belief's age; a belief older than `PoseTrackerParams.lost_time` gets the status "lost". The belief
    is stored outside the context, so a system serves only one context.

    An exception in the thread ends it, and is raised by the next update of the system or by `close`. If the loop
    continues nevertheless, the belief's status is "lost" and names the exception. `close` ends the thread, and so does
    freeing an unused diagram.
    """

    def __init__(
        self, model: ObjectModel, params: PoseBeliefParams | None = None, collision: HandCollision | None = None
    ) -> None:
        """Starts the thread; `close` ends it.

        Args:
            model: the object.
            params: period and assumptions; `latency` is ignored, as the real one counts.
            collision: as in `PoseBeliefEstimator`.
        """
        super().__init__(model, dataclasses.replace(params_of(PoseBeliefParams, params), latency=0.0), collision)
        self._exchange = _Exchange(TimedBelief(self._tracker.start()))
        # A strong reference from the thread would keep the system and its diagram alive for ever.
        own = weakref.ref(self), self._exchange
        weakref.finalize(self, self._exchange.close).atexit = False
        # A daemon thread, so that a system that was not closed does not keep the program from ending.
        self._thread = threading.Thread(target=_work, args=own, name="pose belief", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Ends the thread after its current update, and raises the exception that may have ended it before."""
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
        """The belief with the status and remarks that its age calls for."""
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
    """The thread: updates the belief with the newest reading, as long as the system exists."""
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
        except BaseException as error:  # The control loop raises it.
            with exchange.wakened:
                exchange.error = error
            return
        del system
        with exchange.wakened:
            exchange.finished = finished
