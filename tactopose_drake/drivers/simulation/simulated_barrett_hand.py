"""A simulated Barrett BH8-280 hand with given joint angles, pressures and torques."""

import dataclasses
from collections.abc import Callable

import can
import numpy as np

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.drivers import barrett_joints as joints
from tactopose_drake.drivers import barrett_protocol as protocol
from tactopose_drake.drivers import barrett_tactile as tactile
from tactopose_drake.drivers.barrett_cycle import ARRAYS, FINGERS
from tactopose_drake.drivers.barrett_protocol import Property, Puck, PuckStatus, ReplyGroup, TactileMode
from tactopose_drake.drivers.frames import data_frame
from tactopose_drake.drivers.simulation.simulated_device import SimulatedDevice


@dataclasses.dataclass(frozen=True, eq=False)
class HandState:
    """The quantities that the hand measures at one time.

    Attributes:
        joint_positions: in the order of `barrett_joints.JOINTS`, shape (7,), rad.
        pressures: on the 24 cells of F1, F2, F3 and the palm, shape (4, 24), Pa.
        fingertip_torques: of F1 to F3, shape (3,), N m.
    """

    joint_positions: FloatArray
    pressures: FloatArray
    fingertip_torques: FloatArray

    @classmethod
    def from_row(cls, row: FloatArray) -> "HandState":
        """The state from one row of a file: 7 positions, 96 pressures, 3 torques."""
        return cls(row[:7], row[7:103].reshape(4, 24), row[103:106])


class SimulatedBarrettHand(SimulatedDevice):
    """A hand whose four pucks sleep until they are woken.

    Attributes:
        moves: each value that was written to the property that moves the hand, with its puck.
        disturbed: whether any frame but a wake-up was sent while a puck was waking up.
        absent: pucks that do not reply.
    """

    wake_time = 0.9  # s

    def __init__(self, state: Callable[[float], HandState], *, awake: bool = False) -> None:
        """Keeps its arguments.

        Args:
            state: the state at a time in s since the epoch.
            awake: whether the pucks are awake from the start.
        """
        super().__init__()
        self._state = state
        self._status = dict.fromkeys(Puck, PuckStatus.READY if awake else PuckStatus.MONITOR)
        self._mode = dict.fromkeys(Puck, TactileMode.OFF)
        self._awake_at = dict.fromkeys(Puck, 0.0)
        self._zero = np.zeros((len(ARRAYS), tactile.CELLS))
        self.moves: list[tuple[Puck, int]] = []
        self.disturbed = False
        self.absent: set[Puck] = set()

    def _answer(self, arbitration_id: int, data: bytes, time: float) -> list[can.Message] | None:
        wakes = data[:1] == bytes([0x80 | Property.STATUS])
        self.disturbed |= any(time < at for at in self._awake_at.values()) and not wakes
        if arbitration_id != protocol.HAND_GROUP and arbitration_id not in {*Puck}:
            return None
        addressed = [puck for puck in Puck if arbitration_id in (puck, protocol.HAND_GROUP) and puck not in self.absent]
        number, value = protocol.decode_request(data)
        if number not in {*Property} or not addressed:
            return None
        name = Property(number)
        answer = []
        for puck in addressed:
            if time >= self._awake_at[puck]:
                answer += self._get(puck, name, time) if value is None else self._set(puck, name, value, time)
        return answer

    def _forget(self) -> None:
        self._status = dict.fromkeys(Puck, PuckStatus.MONITOR)
        self._mode = dict.fromkeys(Puck, TactileMode.OFF)

    def _get(self, puck: Puck, name: Property, time: float) -> list[can.Message]:
        if self._status[puck] is PuckStatus.MONITOR and name is not Property.STATUS:
            return []
        state = self._state(time)
        if name is Property.POSITION:
            return [_reply(puck, ReplyGroup.POSITION, _position(puck, state.joint_positions))]
        if name is Property.TACTILE and self._mode[puck] is not TactileMode.OFF:
            return self._reading(puck, state.pressures)
        torque = 0.0 if puck is Puck.SPREAD else state.fingertip_torques[puck - Puck.F1]
        values: dict[Property, int] = {
            Property.ROLE: protocol.ROLE_HAND | protocol.ROLE_STRAIN | protocol.ROLE_TACTILE,
            Property.STATUS: self._status[puck],
            Property.STRAIN: joints.strain_of(torque),
            Property.COMMAND: 0,
            Property.TACTILE: TactileMode.OFF,
            Property.TACTILE_ID: 1,
        }
        return [_reply(puck, ReplyGroup.ORDINARY, protocol.encode_value(name, values[name]))]

    def _set(self, puck: Puck, name: Property, value: int, time: float) -> list[can.Message]:
        if name is Property.STATUS:
            if value == PuckStatus.READY and self._status[puck] is PuckStatus.MONITOR:
                self._status[puck] = PuckStatus.READY
                self._awake_at[puck] = time + self.wake_time
        elif self._status[puck] is PuckStatus.MONITOR:
            pass
        elif name is Property.COMMAND:
            self.moves.append((puck, value))
        elif name is Property.TACTILE and value == TactileMode.TARE:
            self._zero[puck - Puck.F1] = self._state(time).pressures[puck - Puck.F1]
        elif name is Property.TACTILE:
            self._mode[puck] = TactileMode(value)
            if self._mode[puck] is not TactileMode.OFF:
                return self._reading(puck, self._state(time).pressures)
        return []

    def _reading(self, puck: Puck, pressures: FloatArray) -> list[can.Message]:
        row = puck - Puck.F1
        raw = np.clip(np.rint((pressures[row] - self._zero[row]) / tactile.PASCALS_PER_RAW), 0, tactile.RAW_MAX)
        if self._mode[puck] is TactileMode.FULL:
            frames = tactile.encode_full(raw.astype(np.int64))
            return [_reply(puck, ReplyGroup.TACTILE_FULL, frame) for frame in frames]
        levels = np.minimum(raw.astype(np.int64) // 256, 15)
        top = np.argsort(-raw, kind="stable")[: tactile.TOP_CELLS]
        data = tactile.encode_top({int(cell): int(levels[cell]) for cell in top})
        return [_reply(puck, ReplyGroup.TACTILE_TOP, data)]


def _position(puck: Puck, positions: FloatArray) -> bytes:
    if puck not in FINGERS:
        return protocol.encode_position(joints.spread_counts(positions[6]))
    finger = puck - Puck.F1
    return protocol.encode_position(*joints.finger_counts(positions[finger], positions[3 + finger]))


def _reply(puck: Puck, group: ReplyGroup, data: bytes) -> can.Message:
    return data_frame(protocol.reply_identifier(puck, group), data)
