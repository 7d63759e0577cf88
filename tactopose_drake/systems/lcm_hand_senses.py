"""A hand's senses from LCM messages, as a replacement for simulated senses."""

import copy
import dataclasses
from collections.abc import Mapping

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, EventStatus, State

from tactopose_drake.core.validation import FloatArray, positive_number
from tactopose_drake.drivers.device import stale
from tactopose_drake.drivers.lcm_messages import HandSensesMessage
from tactopose_drake.hand.hand_config import HandConfig
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.hand.named_joints import NamedJoints
from tactopose_drake.hand.tactile_pads import load_tactile_pad
from tactopose_drake.systems.collectable_system import CollectableSystem, SharedState
from tactopose_drake.systems.ports import eval_input

_NO_MESSAGE = "no message yet"


@dataclasses.dataclass(frozen=True, eq=False)
class _Received(SharedState):
    """The last message, the diagram's time at which it arrived, s, and its current status."""

    message: HandSensesMessage
    time: float
    status: str
    is_used: bool = False


class LcmHandSenses(CollectableSystem):
    """Outputs a hand's senses from messages `lcmt_hand_senses`, and their age.

    .. pydrake_system::

        name: LcmHandSenses
        input_ports:
        - message
        output_ports:
        - wrench_<finger>
        - pressures_<pad>
        - joint_positions
        - age
        - status

    - message: `HandSensesMessage`, of an `LcmSubscriberSystem`; read once a period. Of several messages that arrive
      between two reads only the last one counts; one that was overtaken by the message before it is ignored.
    - wrench_<finger>: F_S on each fingertip with a force-torque sensor, shape (6,), N m and N. NaN where the message
      has none, or is older than `max_age`.
    - pressures_<pad>: of each pad's cells, Pa; NaN likewise.
    - joint_positions: of the hand's own plant, shape (nq,), rad; coupled joints follow. NaN likewise.
    - age: time since the last message arrived, s, shape (1,); infinite before the first. A message with the `utime` of
      the one before, unless that is 0, repeats its measurement, and does not make it younger.
    - status: str, "ok", "no message yet", "stale: " and its age, or what in the message does not fit the hand.

    All outputs change once a period.
    """

    def __init__(self, hand: HandConfig, period: float = 0.0025, max_age: float = 0.1) -> None:
        """Declares the ports by the hand's names.

        Args:
            hand: the hand.
            period: time between two reads of the message, s.
            max_age: messages older than this are stale, s.
        """
        super().__init__()
        plant, parts = make_hand_plant(hand)
        self._joints = NamedJoints(plant, parts)
        self._max_age = positive_number("max_age", max_age)
        self._message = self.DeclareAbstractInputPort("message", AbstractValue.Make(HandSensesMessage()))
        nothing = _Received(HandSensesMessage(), -np.inf, _NO_MESSAGE)
        self._received = self.DeclareAbstractState(AbstractValue.Make(nothing))
        self._age = self.DeclareDiscreteState([np.inf])
        self.DeclarePeriodicUnrestrictedUpdateEvent(positive_number("period", period), 0.0, self._look)
        self._cells = {pad.name: len(load_tactile_pad(pad.array).layout) for pad in hand.pads}
        for finger in parts.sensor_frames:
            self._declare(f"wrench_{finger}", 6, "wrenches", finger)
        for pad, count in self._cells.items():
            self._declare(f"pressures_{pad}", count, "pressures", pad)
        self._fingers = tuple(parts.sensor_frames)
        ticket = {self.abstract_state_ticket(self._received)}
        self.declare_output("joint_positions", plant.num_positions(), self._joint_positions, ticket)
        self.DeclareStateOutputPort("age", self._age)
        self.declare_output("status", "", lambda context: self._last(context).status, ticket)

    def _declare(self, name: str, size: int, kind: str, part: str) -> None:
        def reading(context: Context) -> FloatArray:
            received = self._last(context)
            values: Mapping[str, FloatArray] = getattr(received.message, kind) if received.is_used else {}
            told = values.get(part)
            return np.full(size, np.nan) if told is None or len(told) != size else told

        self.declare_output(name, size, reading, {self.abstract_state_ticket(self._received)})

    def _last(self, context: Context) -> _Received:
        received: _Received = context.get_abstract_state(self._received).get_value()
        return received

    def _look(self, context: Context, state: State) -> EventStatus:
        message = eval_input(self._message, context, HandSensesMessage)
        before, now = self._last(context), context.get_time()
        last = before.message.utime, before.message.sequence
        is_new = (message.utime, message.sequence) != last and not message.is_late_after(*last)
        # Copied, because a sender may reuse one message object, which would then be compared with itself.
        message = copy.deepcopy(message) if is_new else before.message
        is_repeated = message.utime == last[0] != 0 and before.message.sequence >= 0  # 0: its sender has no clock.
        came = now if is_new and message.sequence >= 0 and not is_repeated else before.time
        age = now - came
        status = "; ".join(misfits(message, self._joints.names, self._fingers, self._cells)) or "ok"
        if not np.isfinite(came):
            status = _NO_MESSAGE
        elif abs(age) > self._max_age:  # A message from the future, after the clock went back, is stale, too.
            status = stale(age, self._max_age)
        received = _Received(message, came, status, is_used=abs(age) <= self._max_age)
        state.get_mutable_abstract_state(self._received).set_value(received)
        state.get_mutable_discrete_state(self._age).SetFromVector([age])
        return EventStatus.Succeeded()

    def _joint_positions(self, context: Context) -> FloatArray:
        received = self._last(context)
        joints = received.message.joints if received.is_used else {}
        known = {name: value for name, value in joints.items() if name in self._joints.names}
        return self._joints.positions("joints", known)


def misfits(
    message: HandSensesMessage, joints: tuple[str, ...], fingers: tuple[str, ...], cells: Mapping[str, int]
) -> list[str]:
    """Lists what in a message does not fit a hand, in a few words each.

    Args:
        message: message of the hand's senses.
        joints: names of the hand's joints.
        fingers: names of its fingers with a force-torque sensor.
        cells: number of cells of each of its pads, by pad.
    """
    wrong = [
        f"the hand has no {what} {name!r}"
        for what, given, known in (
            ("joint", message.joints, joints),
            ("finger", message.wrenches, fingers),
            ("pad", message.pressures, cells),
        )
        for name in given
        if name not in known
    ]
    for pad, pressure in message.pressures.items():
        if pad in cells and len(pressure) != cells[pad]:
            wrong.append(f"the pad {pad!r} has {cells[pad]} cells and not {len(pressure)}")
    return wrong
