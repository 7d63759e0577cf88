"""One polling round of Barrett's BH8-280 hand: its replies make one sample."""

import collections
import dataclasses
from collections.abc import Sequence

import can
import numpy as np

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.drivers import barrett_joints as joints
from tactopose_drake.drivers import barrett_protocol as protocol
from tactopose_drake.drivers import barrett_tactile as tactile
from tactopose_drake.drivers.barrett_protocol import Property, Puck, ReplyGroup
from tactopose_drake.drivers.device import OK
from tactopose_drake.errors import ProtocolError

FINGERS = (Puck.F1, Puck.F2, Puck.F3)
ARRAYS = ("F1", "F2", "F3", "palm")  # the tactile arrays, in the order of their pucks
# A position without the joint's encoder may be a truncated frame. It is accepted from the third one on, if the puck has
# never sent the encoder's counts.
_BELIEVED = 3
Answer = tuple[Puck, str]  # a puck, and the requested quantity: "position", "torque" or "pressures"


@dataclasses.dataclass(frozen=True, eq=False)
class HandSample:
    """The measurements of one polling round. Missing and invalid values are NaN.

    Attributes:
        time: arrival of the round's last frame, s since the epoch.
        joint_positions: in the order of `barrett_joints.JOINTS`, shape (7,), rad; relative to the position at which the
            hand was initialized, or else switched on. NaN after a restart, until the joint is initialized.
        pressures: of the 24 cells of each array, in the order of `ARRAYS`, shape (4, 24), Pa. A short reading has the
            ten highest cells, and NaN for the others.
        fingertip_torques: about the outer joints of F1 to F3, shape (3,), N m.
        status: "ok"; or the missing, invalid and saturated values, separated by "; ".
    """

    time: float
    joint_positions: FloatArray
    pressures: FloatArray
    fingertip_torques: FloatArray
    status: str


class EncoderState:
    """The state of the encoders: which fingers have one at the inner link, by their replies, and which pucks restarted.

    Attributes:
        restarted: pucks that have restarted, and whose positions have no known zero until the joint is initialized.
    """

    def __init__(self) -> None:
        self.restarted: set[int] = set()
        self._present: set[Puck] = set()
        self._without: collections.Counter[Puck] = collections.Counter()

    def check(self, puck: Puck, joint: int | None) -> None:
        """Takes a puck's position reply; `joint` is the counts of the inner link's encoder, if the reply has them.

        Raises:
            ProtocolError: if the zero of the position is unknown, or the reply lacks an encoder that the finger has, or
                may have.
        """
        if puck in self.restarted:
            raise ProtocolError("position counts from where the puck restarted, until the joint is initialized.")
        if puck not in FINGERS:
            return
        if joint is not None:
            self._present.add(puck)
            return
        self._without[puck] += 1
        if puck in self._present:
            raise ProtocolError("position lacks the joint's encoder, which the puck has.")
        if self._without[puck] < _BELIEVED:
            raise ProtocolError("position lacks the joint's encoder, and it is not yet sure that the puck has none.")


class HandCycle:
    """Collects the answers of one round.

    Attributes:
        missing: expected answers that have not arrived; invalid ones count as arrived.
    """

    def __init__(
        self,
        expected: set[Answer],
        awaited: set[Answer],
        strain_polynomials: Sequence[Sequence[float]],
        joint_encoders: EncoderState,
    ) -> None:
        """Begins a round.

        Args:
            expected: all answers of a complete sample.
            awaited: the expected answers that the round waits for.
            strain_polynomials: calibration of the strain gauges of F1 to F3.
            joint_encoders: state of the encoders, which the answers update.
        """
        self.missing = set(expected)
        self._awaited = set(awaited)
        self._polynomials, self._joint_encoders = strain_polynomials, joint_encoders
        self._time = 0.0
        self._positions = np.full(len(joints.JOINTS), np.nan)
        self._pressures = np.full((len(ARRAYS), tactile.CELLS), np.nan)
        self._highest = np.full(len(ARRAYS), np.inf)  # saturation pressure of each array's reading
        self._torques = np.full(len(FINGERS), np.nan)
        self._readings = {puck: tactile.FullReading() for puck in Puck}
        self._errors: dict[Answer, str] = {}
        self._overloads: list[str] = []

    def collect(self, frame: can.Message) -> bool:
        """Takes a frame; returns whether the round is complete."""
        sender, group = protocol.split_reply(frame.arbitration_id)
        if sender not in {*Puck}:
            return False
        puck = Puck(sender)
        answer = puck, _MEANING[group]
        try:
            complete = self._decode(puck, group, bytes(frame.data))
        except ProtocolError as error:
            self._errors.setdefault(answer, str(error).removesuffix("."))
            self._values(answer)[...] = np.nan
            complete = True
        if complete:
            self._time = frame.timestamp
            self.missing.discard(answer)
            self._awaited.discard(answer)
        return not self._awaited

    def sample(self, time: float, remarks: Sequence[str]) -> HandSample:
        """The sample.

        Args:
            time: time of the sample if no reply arrived.
            remarks: further remarks for the status.
        """
        missing = [f"{puck.name}: no {what}" for puck, what in sorted(self.missing)]
        errors = [f"{puck.name}: {error}" for (puck, _), error in self._errors.items()]
        status = "; ".join([*remarks, *missing, *errors, *self._overloads, *self._saturated()])
        return HandSample(self._time or time, self._positions, self._pressures, self._torques, status or OK)

    def _decode(self, puck: Puck, group: ReplyGroup, data: bytes) -> bool:
        """Takes a reply; returns whether it completes an answer."""
        values = self._values((puck, _MEANING[group]))
        if group is ReplyGroup.POSITION:
            motor, joint = protocol.decode_position(data)
            self._joint_encoders.check(puck, joint)
            if puck in FINGERS:
                values[...] = joints.finger_angles(motor, joint)
            else:
                values[...] = joints.spread_angle(motor)
        elif group is ReplyGroup.TACTILE_FULL:
            raw = self._readings[puck].add(data)
            if raw is None:
                return False
            values[...] = tactile.full_pressures(raw)
            self._highest[puck - Puck.F1] = tactile.PASCALS_PER_RAW * tactile.RAW_MAX
        elif group is ReplyGroup.TACTILE_TOP:
            values[...] = tactile.top_pressures(tactile.decode_top(data))
            self._highest[puck - Puck.F1] = tactile.PASCALS_PER_TOP * tactile.TOP_MAX
        else:
            name, strain = protocol.decode_value(data)
            if name != Property.STRAIN:
                return False
            if puck in FINGERS:  # The reading of the spread's puck is meaningless. [O]
                values[...] = joints.fingertip_torque(strain, self._polynomials[puck - Puck.F1])
                if not joints.STRAIN_LIMITS[0] <= strain <= joints.STRAIN_LIMITS[1]:
                    self._overloads.append(f"{puck.name}: fingertip torque beyond its limit")
        return True

    def _values(self, answer: Answer) -> FloatArray:
        """The array elements of an answer, as a view."""
        puck, what = answer
        row = puck - Puck.F1
        if what == "pressures":
            values: FloatArray = self._pressures[row]
        elif what == "torque":
            values = self._torques[row : row + 1]
        else:
            values = self._positions[row:6:3] if puck in FINGERS else self._positions[6:]
        return values

    def _saturated(self) -> list[str]:
        remarks = []
        for name, pressures, highest in zip(ARRAYS, self._pressures, self._highest, strict=True):
            cells = np.flatnonzero(pressures == highest)
            if len(cells):
                remarks.append(f"saturated: {name} " + ", ".join(str(cell) for cell in cells))
        return remarks


_MEANING = {
    ReplyGroup.POSITION: "position",
    ReplyGroup.ORDINARY: "torque",
    ReplyGroup.TACTILE_FULL: "pressures",
    ReplyGroup.TACTILE_TOP: "pressures",
}
