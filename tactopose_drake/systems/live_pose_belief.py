"""The belief of a held object's pose, computed beside the control loop: for hardware."""

from __future__ import annotations

import threading
from types import TracebackType
from typing import Self

from pydrake.systems.framework import Context, EventStatus, State

from tactopose_drake.core.objects import ObjectModel
from tactopose_drake.core.tracking.frame import Frame
from tactopose_drake.systems.pose_belief import PoseBeliefEstimator, PoseBeliefParams, TimedBelief


class LivePoseBeliefEstimator(PoseBeliefEstimator):
    """`PoseBeliefEstimator` whose updates are computed in a thread of its own.

    At each period the inputs are handed to the thread, which takes the newest when it is free; what it has not begun by
    then is passed over. The outputs show the last belief that it finished. So the control loop never waits, and what
    comes out depends on how fast the machine is: simulate with the other one. The belief lives in the thread, not in
    the context: a system serves one context.

    An exception in the thread is raised by the next update of the system, or by `close`.
    """

    def __init__(self, model: ObjectModel, params: PoseBeliefParams | None = None) -> None:
        """Starts the thread; `close` ends it.

        Args:
            model: the object.
            params: the period, and what is assumed; the latency is what it is.
        """
        super().__init__(model, params)
        self._wakened = threading.Condition()
        self._newest: Frame | None = None
        self._finished = TimedBelief(self._tracker.start())
        self._error: BaseException | None = None
        self._closing = False
        # A daemon, so that a diagram that nobody closed does not keep the program from ending.
        self._thread = threading.Thread(target=self._work, name="pose belief", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Ends the thread after the update that it is at, and raises what it may have failed with."""
        with self._wakened:
            self._closing = True
            self._wakened.notify()
        self._thread.join()
        self._raise()

    def _update(self, context: Context, state: State) -> EventStatus:
        frame = self._read(context, state)
        with self._wakened:
            self._newest = frame
            finished = self._finished
            self._wakened.notify()
        self._raise()
        state.get_mutable_abstract_state(self._shown).set_value(finished)
        return EventStatus.Succeeded()

    def _show(self, context: Context, state: State) -> EventStatus:
        return EventStatus.Succeeded()

    def _raise(self) -> None:
        with self._wakened:
            error, self._error = self._error, None
        if error is not None:
            raise error

    def _work(self) -> None:
        """The thread: updates with the newest frame, again and again."""
        while True:
            with self._wakened:
                self._wakened.wait_for(lambda: self._closing or self._newest is not None)
                if self._closing:
                    return
                frame, self._newest = self._newest, None
                before = self._finished
            assert frame is not None
            try:
                finished = self._step(before, frame)
            except BaseException as error:  # Nothing is lost: the control loop raises it.
                with self._wakened:
                    self._error = error
                return
            with self._wakened:
                self._finished = finished
