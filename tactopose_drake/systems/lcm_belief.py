"""The belief of the object's pose as an LCM message."""

import bisect
import dataclasses
import time
from typing import NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, EventStatus, State

from tactopose_drake.core.tracking.pose_belief import PoseBelief
from tactopose_drake.core.validation import whole_number
from tactopose_drake.drivers.lcm_messages import HandSensesMessage, ObjectBeliefMessage
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.systems.collectable_system import CollectableSystem, SharedState
from tactopose_drake.systems.ports import eval_input, eval_optional_input

_REMEMBERED = 10.0  # s; a belief that is this late is lost


class _Heard(NamedTuple):
    """The diagram's time at which a senses message arrived, s, and the message's own time and number."""

    time: float
    utime: int
    sequence: int


@dataclasses.dataclass(frozen=True, eq=False)
class _Remembered(SharedState):
    """The senses that were heard, oldest first."""

    heard: tuple[_Heard, ...] = ()

    def between(self, after: float, until: float) -> tuple[_Heard, ...]:
        """The senses of the times above `after` and up to `until`, s."""
        first, end = (bisect.bisect_right(self.heard, time, key=lambda each: each.time) for time in (after, until))
        return self.heard[first:end]


class LcmBelief(CollectableSystem):
    """Converts an estimate or a belief to messages `lcmt_object_belief`, for an `LcmPublisherSystem`.

    .. pydrake_system::

        name: LcmBelief
        input_ports:
        - hypotheses
        - status
        - senses
        - belief
        output_ports:
        - message

    - hypotheses: `PoseEstimate`, or None where there is none yet.
    - status: str.
    - senses: the newest `HandSensesMessage`; may stay unconnected: `utime` is then the belief's time and `sequence` -1.
    - belief: `PoseBelief`, for its time; may stay unconnected if it has no latency.
    - message: `ObjectBeliefMessage`, with `utime` and `sequence` of the newest senses that had arrived by the belief's
      time, 0 and -1 where there were none; changes with the inputs. Senses are remembered for 10 s.
    """

    def __init__(self, max_modes: int = 8) -> None:
        """Declares the ports.

        Args:
            max_modes: largest number of modes in a message; the most probable ones are sent.

        Raises:
            InvalidInputError: if `max_modes` is not an integer above 0.
        """
        super().__init__()
        self._max_modes, self._session = whole_number("max_modes", max_modes, least=1), time.time_ns()
        self._hypotheses = self.DeclareAbstractInputPort("hypotheses", AbstractValue.Make(None))
        self._status = self.DeclareAbstractInputPort("status", AbstractValue.Make(""))
        self._senses = self.DeclareAbstractInputPort("senses", AbstractValue.Make(HandSensesMessage()))
        self._belief = self.DeclareAbstractInputPort("belief", AbstractValue.Make(None))
        self._remembered = self.DeclareAbstractState(AbstractValue.Make(_Remembered()))
        self.DeclarePerStepUnrestrictedUpdateEvent(self._hear)
        self.declare_output("message", ObjectBeliefMessage(), self._message, {self.all_sources_ticket()})

    def _message(self, context: Context) -> ObjectBeliefMessage:
        message = belief_message(
            eval_optional_input(self._hypotheses, context, PoseEstimate),
            eval_input(self._status, context, str),
            self._max_modes,
        )
        message.session = self._session
        senses = eval_optional_input(self._senses, context, HandSensesMessage)
        belief = eval_optional_input(self._belief, context, PoseBelief)
        known_by = context.get_time() if belief is None else belief.time
        if senses is None:
            message.utime, message.sequence = round(1e6 * known_by), -1
        elif belief is None:
            message.utime, message.sequence = senses.utime, senses.sequence
        else:
            known = self._remembered_in(context).between(-np.inf, known_by)
            message.utime, message.sequence = known[-1][1:] if known else (0, -1)
        return message

    def _hear(self, context: Context, state: State) -> EventStatus:
        """Remembers the newest senses, which a later belief may be based on."""
        senses, now = eval_optional_input(self._senses, context, HandSensesMessage), context.get_time()
        if senses is None or senses.sequence < 0:
            return EventStatus.DidNothing()
        # If the clock went back, messages with a later time are dropped.
        kept = self._remembered_in(context).between(now - _REMEMBERED, now)
        if kept and ((senses.utime, senses.sequence) == kept[-1][1:] or senses.is_late_after(*kept[-1][1:])):
            return EventStatus.DidNothing()
        remembered = _Remembered((*kept, _Heard(now, senses.utime, senses.sequence)))
        state.get_mutable_abstract_state(self._remembered).set_value(remembered)
        return EventStatus.Succeeded()

    def _remembered_in(self, context: Context) -> _Remembered:
        remembered: _Remembered = context.get_abstract_state(self._remembered).get_value()
        return remembered


def belief_message(estimate: PoseEstimate | None, status: str, max_modes: int) -> ObjectBeliefMessage:
    """A message of the most probable hypotheses, without time, sequence number and session.

    Args:
        estimate: the estimate; None where there is none yet.
        status: the status as text.
        max_modes: largest number of hypotheses in the message.
    """
    modes = () if estimate is None else estimate.hypotheses[:max_modes]
    if not modes:
        return ObjectBeliefMessage(status=status)
    return ObjectBeliefMessage(
        status=status,
        probability=np.array([mode.probability for mode in modes]),
        position=np.array([mode.X_PO.translation() for mode in modes]),
        quaternion_wxyz=np.array([mode.X_PO.rotation().ToQuaternion().wxyz() for mode in modes]),
        covariance=np.array([mode.covariance for mode in modes]),
    )
