"""The LCM types of `tactopose.lcm` in Python: a hand's senses, the object's pose by vision, and the belief.

They encode to the same bytes as the types that lcm-gen makes of that file, and can be used with `lcm`, and with Drake's
`LcmSubscriberSystem.Make` and `LcmPublisherSystem.Make`.
"""

import dataclasses
from collections.abc import Iterable, Mapping
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from tactopose_drake.core.validation import FloatArray, instance_of, number_array, whole_number
from tactopose_drake.drivers.lcm_codec import LcmReader, LcmWriter
from tactopose_drake.errors import ProtocolError

_BACK = 1_000_000  # a message that is older than the one before by more, microseconds, is of a restarted sender


@dataclasses.dataclass(kw_only=True, eq=False)
class HandSensesMessage:
    """`lcmt_hand_senses`: the measurements of a hand's sensors at one time.

    Attributes:
        utime: time of the measurement, microseconds of the sender's clock.
        sequence: number of the sender's message, from 0; -1 for a message that was never sent.
        joints: joint positions by the joint's name in the hand's model, rad, or m for prismatic joints; NaN if unknown.
        wrenches: wrench F_S on the fingertip by the finger's name, each (6,), N m and N; NaN if unknown.
        pressures: pressures of the cells by the pad's name, each (n,), Pa; NaN if unknown.

    Raises:
        InvalidInputError: if a value is of another type or shape.
    """

    utime: int = 0
    sequence: int = -1
    joints: dict[str, float] = dataclasses.field(default_factory=dict)
    wrenches: dict[str, FloatArray] = dataclasses.field(default_factory=dict)
    pressures: dict[str, FloatArray] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        _check_integers(self, ("utime", "sequence"))
        joints = _arrays("HandSensesMessage.joints", self.joints, ())
        self.joints = {name: float(position) for name, position in joints.items()}
        self.wrenches = _arrays("HandSensesMessage.wrenches", self.wrenches, (6,))
        self.pressures = _arrays("HandSensesMessage.pressures", self.pressures, (None,))

    def is_late_after(self, utime: int, sequence: int) -> bool:
        """Whether it is the message of this time and number once more, or was overtaken by it.

        It is not if its sender has begun anew: a sender's first message has the number 0.
        """
        return 0 < self.sequence <= sequence and 0 <= utime - self.utime < _BACK

    def encode(self) -> bytes:
        """The message as LCM sends it."""
        out = LcmWriter(_HAND_SENSES)
        out.integers(self.utime, self.sequence)
        out.counts(len(self.joints))
        out.texts(*self.joints)
        out.numbers(list(self.joints.values()))
        out.counts(len(self.wrenches))
        out.texts(*self.wrenches)
        out.numbers(np.reshape(list(self.wrenches.values()), (-1, 6)))
        out.counts(len(self.pressures))
        out.texts(*self.pressures)
        cells = [len(pressure) for pressure in self.pressures.values()]
        out.counts(*cells, sum(cells))
        out.numbers(np.concatenate([np.zeros(0), *self.pressures.values()]))
        return out.message()

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """The message that was sent.

        Raises:
            ProtocolError: if it is of another type, or damaged, or names a joint, a finger or a pad twice.
        """
        read = LcmReader(data, _HAND_SENSES, "lcmt_hand_senses")
        utime, sequence = read.integers(2)
        names = read.names(*read.counts(1))
        joints = dict(zip(names, read.numbers((len(names),)).tolist(), strict=True))
        names = read.names(*read.counts(1))
        wrenches = dict(zip(names, read.numbers((len(names), 6)), strict=True))
        names = read.names(*read.counts(1))
        *cells, total = read.counts(len(names) + 1)
        if sum(cells) != total:
            raise ProtocolError(f"LCM message: a lcmt_hand_senses must have its pads' {sum(cells)} cells, not {total}.")
        parts = np.split(read.numbers((total,)), np.cumsum(cells)[:-1]) if names else []
        read.end()
        return cls(
            utime=utime,
            sequence=sequence,
            joints=joints,
            wrenches=wrenches,
            pressures=dict(zip(names, parts, strict=True)),
        )


@dataclasses.dataclass(kw_only=True, eq=False)
class ObjectPoseMessage:
    """`lcmt_object_pose`: the object's pose by vision.

    Attributes:
        utime: time of the picture, microseconds of the clock that the senses use.
        position: p_PO, shape (3,), m.
        quaternion_wxyz: quaternion of R_PO, shape (4,).
        covariance: covariance of the increment (w, v) from it to the true pose, shape (6, 6), rad and m.

    Raises:
        InvalidInputError: if a value is of another type or shape.
    """

    utime: int = 0
    position: FloatArray = dataclasses.field(default_factory=lambda: np.zeros(3))
    quaternion_wxyz: FloatArray = dataclasses.field(default_factory=lambda: np.array([1.0, 0.0, 0.0, 0.0]))
    covariance: FloatArray = dataclasses.field(default_factory=lambda: np.zeros((6, 6)))

    def __post_init__(self) -> None:
        _check_integers(self, ("utime",))
        for name, shape in _POSE_SHAPES.items():
            setattr(self, name, number_array(f"ObjectPoseMessage.{name}", getattr(self, name), shape))

    def encode(self) -> bytes:
        """The message as LCM sends it."""
        out = LcmWriter(_OBJECT_POSE)
        out.integers(self.utime)
        for name, shape in _POSE_SHAPES.items():
            out.numbers(np.reshape(getattr(self, name), shape))
        return out.message()

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """The message that was sent.

        Raises:
            ProtocolError: if it is of another type, or damaged.
        """
        read = LcmReader(data, _OBJECT_POSE, "lcmt_object_pose")
        (utime,) = read.integers(1)
        position, quaternion, covariance = (read.numbers(shape) for shape in _POSE_SHAPES.values())
        read.end()
        return cls(utime=utime, position=position, quaternion_wxyz=quaternion, covariance=covariance)


@dataclasses.dataclass(kw_only=True, eq=False)
class ObjectBeliefMessage:
    """`lcmt_object_belief`: the belief over the object's pose in the palm; n modes in order of falling probability.

    Attributes:
        utime: time of the senses that it is based on, microseconds of their sender's clock.
        sequence: sequence number of those senses; -1 before the first.
        session: a number that differs for each start of the estimator.
        received: number of messages of the senses received since its start.
        lost: number of messages missing in their sequence.
        passed_over: number of received messages that were not used, because a newer one had been received.
        status: "ok", "ambiguous", "slipping", "no_contact" or "lost"; remarks after a colon.
        probability: probability of each mode, shape (n,).
        position: p_PO, shape (n, 3), m.
        quaternion_wxyz: quaternions of R_PO, shape (n, 4).
        covariance: covariances of the increments (w, v), shape (n, 6, 6), rad and m.

    Raises:
        InvalidInputError: if a value is of another type or shape.
    """

    utime: int = 0
    sequence: int = -1
    session: int = 0
    received: int = 0
    lost: int = 0
    passed_over: int = 0
    status: str = ""
    probability: FloatArray = dataclasses.field(default_factory=lambda: np.zeros(0))
    position: FloatArray = dataclasses.field(default_factory=lambda: np.zeros((0, 3)))
    quaternion_wxyz: FloatArray = dataclasses.field(default_factory=lambda: np.zeros((0, 4)))
    covariance: FloatArray = dataclasses.field(default_factory=lambda: np.zeros((0, 6, 6)))

    def __post_init__(self) -> None:
        _check_integers(self, ("utime", "sequence", "session", "received", "lost", "passed_over"))
        instance_of("ObjectBeliefMessage.status", self.status, str)
        self.probability = number_array("ObjectBeliefMessage.probability", self.probability, (None,))
        for name, shape in _POSE_SHAPES.items():
            shapes = (len(self.probability), *shape)
            setattr(self, name, number_array(f"ObjectBeliefMessage.{name}", getattr(self, name), shapes))

    def encode(self) -> bytes:
        """The message as LCM sends it."""
        out, count = LcmWriter(_OBJECT_BELIEF), len(self.probability)
        out.integers(self.utime, self.sequence, self.session, self.received, self.lost, self.passed_over)
        out.texts(self.status)
        out.counts(count)
        out.numbers(self.probability)
        for name, shape in _POSE_SHAPES.items():
            out.numbers(np.reshape(getattr(self, name), (count, *shape)))
        return out.message()

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """The message that was sent.

        Raises:
            ProtocolError: if it is of another type, or damaged.
        """
        read = LcmReader(data, _OBJECT_BELIEF, "lcmt_object_belief")
        utime, sequence, session, received, lost, passed_over = read.integers(6)
        (status,) = read.texts(1)
        (count,) = read.counts(1)
        arrays = [read.numbers((count, *shape)) for shape in ((), *_POSE_SHAPES.values())]
        read.end()
        return cls(
            utime=utime,
            sequence=sequence,
            session=session,
            received=received,
            lost=lost,
            passed_over=passed_over,
            status=status,
            probability=arrays[0],
            position=arrays[1],
            quaternion_wxyz=arrays[2],
            covariance=arrays[3],
        )


def _check_integers(message: object, names: Iterable[str]) -> None:
    """Raises InvalidInputError if one of a message's fields is not an integer of 64 bits."""
    for name in names:
        value = getattr(message, name)
        whole_number(f"{type(message).__name__}.{name}", value, least=-(2**63), most=2**63 - 1)


def _arrays(what: str, given: Mapping[str, ArrayLike], shape: tuple[int | None, ...]) -> dict[str, FloatArray]:
    """Arrays of one shape by name; raises InvalidInputError if they are invalid."""
    instance_of(what, given, Mapping)
    for name in given:
        instance_of(f"{what}: the name {name!r}", name, str)
    return {name: number_array(f"{what}[{name}]", values, shape) for name, values in given.items()}


def _fingerprint(number: int) -> bytes:
    """Fingerprint of a type without nested types: lcm-gen's hash, rotated left by one bit."""
    return ((number << 1 | number >> 63) & 0xFFFF_FFFF_FFFF_FFFF).to_bytes(8, "big")


_POSE_SHAPES: dict[str, tuple[int, ...]] = {"position": (3,), "quaternion_wxyz": (4,), "covariance": (6, 6)}

# As computed by lcm-gen from `tactopose.lcm`.
_HAND_SENSES = _fingerprint(0xB95DA6B012AA2FEF)
_OBJECT_POSE = _fingerprint(0x9DAD27A955770D43)
_OBJECT_BELIEF = _fingerprint(0xD9BA3C0199BCDA3F)
