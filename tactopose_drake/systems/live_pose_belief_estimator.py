"""The belief of a held object's pose, computed beside the control loop: for hardware."""

from __future__ import annotations

import dataclasses
import threading
import weakref
from collections.abc import Iterable
from types import TracebackType
from typing import Any, Self

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, EventStatus, State

from tactopose_drake.core.parameter_checks import params_of
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.hand.collision import HandCollision
from tactopose_drake.systems.belief_inputs import Reading
from tactopose_drake.systems.collectable_system import declare_cache
from tactopose_drake.systems.pose_belief_estimator import PoseBeliefEstimator, PoseBeliefParams, TimedBelief

# A belief older than this many periods is late: the thread is busy for up to one, and waits up to one for its input.
_PUNCTUAL = 2.5


class _Exchange:
    """The data that the control loop and the thread of one context exchange, under a lock.

    Attributes:
        wakened: the condition variable that guards all other attributes and wakes the thread.
        newest: the newest reading that the thread has not started to process; None if there is none.
        finished: the last belief that the thread finished.
        error: the exception that ended the thread; None while it runs.
        is_told: whether that exception has been raised in the control loop.
        closing: whether the thread is to end.
        thread: the thread; None before the first reading.
    """

    def __init__(self, begun: TimedBelief) -> None:
        self.wakened = threading.Condition()
        self.newest: Reading | None = None
        self.finished = begun
        self.error: BaseException | None = None
        self.is_told = False
        self.closing = False
        self.thread: threading.Thread | None = None

    def close(self) -> None:
        """Tells the thread to end."""
        with self.wakened:
            self.closing = True
            self.wakened.notify()

    def raise_error(self) -> None:
        """Raises the exception that ended the thread, unless it has been raised before."""
        with self.wakened:
            error = None if self.is_told else self.error
            self.is_told = error is not None or self.is_told
        if error is not None:
            raise error


class _OfContext:
    """Holds the exchange of one context; the thread ends when the context is freed.

    A copy is for another context, and goes on from the last finished belief with a thread of its own.
    """

    def __init__(self, begun: TimedBelief) -> None:
        self.exchange = _Exchange(begun)
        weakref.finalize(self, self.exchange.close).atexit = False

    def __deepcopy__(self, memo: Any) -> _OfContext:
        return _OfContext(self.exchange.finished)


class LivePoseBeliefEstimator(PoseBeliefEstimator):
    """A `PoseBeliefEstimator` that computes its updates in a thread of its own, one for each context.

    At each period the inputs are passed to the thread, which processes the newest ones when it is free and skips older
    ones. The outputs show the last belief that it finished. The control loop therefore never waits, but the results
    depend on the speed of the machine: use `PoseBeliefEstimator` in simulation. While the thread falls behind, the
    status gives the belief's age; a belief older than `PoseTrackerParams.lost_time` gets the status "lost".

    The thread starts with the first update of a context. It continues from its own last belief: setting the context's
    state does not change that. A clone of a context continues from the same belief with another thread.

    An exception in a thread ends it, and is raised by the next update of its context or by `close`. If the loop
    continues nevertheless, the belief's status is "lost" and names the exception. `close` ends all threads, and so does
    freeing an unused diagram; freeing a context ends its own.
    """

    def __init__(
        self, model: ObjectModel, params: PoseBeliefParams | None = None, collision: HandCollision | None = None
    ) -> None:
        """As `PoseBeliefEstimator`.

        Args:
            model: the object.
            params: period and assumptions; `latency` is ignored, as the real one counts.
            collision: as in `PoseBeliefEstimator`.
        """
        super().__init__(model, dataclasses.replace(params_of(PoseBeliefParams, params), latency=0.0), collision)
        self._own = declare_cache(
            self,
            "exchange with the thread",
            AbstractValue.Make(_OfContext(TimedBelief(self._tracker.start()))).Clone,
            lambda context, value: None,
            {self.nothing_ticket()},
        )
        self._exchanges: weakref.WeakSet[_Exchange] = weakref.WeakSet()  # of the contexts that have a thread
        self._is_closed = False
        weakref.finalize(self, _close_all, self._exchanges).atexit = False

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Ends all threads after their current updates, and raises the exception that may have ended one before."""
        self._is_closed = True
        exchanges = list(self._exchanges)
        _close_all(exchanges)
        for exchange in exchanges:
            assert exchange.thread is not None
            exchange.thread.join()
        for exchange in exchanges:
            exchange.raise_error()

    def _update(self, context: Context, state: State) -> EventStatus:
        reading = self._read(context, state)
        exchange = self._own.Eval(context).exchange
        if exchange.thread is None and not self._is_closed:
            self._start(exchange)
        with exchange.wakened:
            exchange.newest = _after_skipped(exchange.newest, reading)
            finished = exchange.finished
            exchange.wakened.notify()
        exchange.raise_error()
        aged = self._aged(finished, context.get_time(), exchange.error)
        state.get_mutable_abstract_state(self._shown).set_value(aged)
        return EventStatus.Succeeded()

    def _start(self, exchange: _Exchange) -> None:
        """Starts the thread of a context."""
        # A strong reference from the thread would keep the system and its diagram alive for ever.
        own = weakref.ref(self), exchange
        # A daemon thread, so that a system that was not closed does not keep the program from ending.
        exchange.thread = threading.Thread(target=_work, args=own, name="pose belief", daemon=True)
        self._exchanges.add(exchange)
        exchange.thread.start()

    def _aged(self, timed: TimedBelief, now: float, error: BaseException | None) -> TimedBelief:
        """The belief with the status and remarks that its age calls for."""
        belief, age = timed.belief, now - timed.belief.time
        if error is None and 0.0 <= age <= _PUNCTUAL * self._params.period:
            return timed
        remarks = (f"the belief is {age:.2f} s old", *belief.remarks)
        if error is not None:
            remarks = (f"its thread ended with {error!r}", *remarks)
        is_late = error is not None or not 0.0 <= age <= self._params.tracker.lost_time
        belief = dataclasses.replace(belief, status="lost" if is_late else belief.status, remarks=remarks)
        return dataclasses.replace(timed, belief=belief)


def _after_skipped(skipped: Reading | None, reading: Reading) -> Reading:
    """The reading that replaces one that is skipped: a palm that was unknown or jumped there stays unknown in it.

    Otherwise the jump would count as a motion of the palm, away from an object that nothing touches.
    """
    if skipped is None or skipped.frame.X_WP is not None:
        return reading
    return dataclasses.replace(reading, frame=dataclasses.replace(reading.frame, X_WP=None))


def _close_all(exchanges: Iterable[_Exchange]) -> None:
    """Tells the threads of all contexts to end."""
    for exchange in exchanges:
        exchange.close()


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
