"""How the simulated world differs from what the estimation is told, as data: given in numbers, or drawn."""

import dataclasses
import math
from collections.abc import Iterable

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from tactopose_drake.core.poses import exp_so3
from tactopose_drake.core.validation import FloatArray, limited, positive_number
from tactopose_drake.errors import InvalidInputError, UnknownNameError
from tactopose_drake.hand.hand_config import HandConfig, HandUncertainty
from tactopose_drake.hand.tactile_pads import load_tactile_pad

_MOST_OFFSET = 90.0  # deg
_MOST_SHIFT = 0.05  # m
_MOST_LOAD = 1e3  # N and N m, and of a second of drift
_LEAST_SCALE, _MOST_SCALE = 0.5, 2.0
_LEAST_RADIUS = 0.2  # of a fingertip's half-width, that an error must leave


@dataclasses.dataclass(kw_only=True, slots=True)
class FingerErrors:
    """How one finger with a force-torque sensor differs from what its hand's description says."""

    radius: float | None = None  # by which the fingertip is thicker, m; null: drawn, or 0
    # Where its sensor sits, with the fingertip, in S, (3,), m; empty: drawn, or 0.
    mounting: list[float] = dataclasses.field(default_factory=list)
    # How it is turned there, a rotation vector in S, (3,), deg; empty: drawn, or 0.
    mounting_deg: list[float] = dataclasses.field(default_factory=list)
    # Bias at the start, whether the sensor was tared or not, in S, (3,), N; empty: 0, or drawn where it was not tared.
    sensor_force: list[float] = dataclasses.field(default_factory=list)
    sensor_moment: list[float] = dataclasses.field(default_factory=list)  # likewise, N m
    drift_force: list[float] = dataclasses.field(default_factory=list)  # of the bias, in S, (3,), N/s; empty: 0
    drift_moment: list[float] = dataclasses.field(default_factory=list)  # of the bias, in S, (3,), N m/s; empty: 0


@dataclasses.dataclass(kw_only=True, slots=True)
class PadErrors:
    """How one tactile pad differs from what its hand's description says."""

    # Where it sits, with its array, in T, (3,), m; empty: drawn, or 0.
    mounting: list[float] = dataclasses.field(default_factory=list)
    # How it is turned about the middle of its cells, a rotation vector in T, (3,), deg; empty: drawn, or 0.
    mounting_deg: list[float] = dataclasses.field(default_factory=list)


@dataclasses.dataclass(kw_only=True, slots=True)
class SimulatedErrors:
    """How simulated hand, object and camera differ from what the estimation is told; by default in nothing.

    The hand is another one than its files say, the same in every grasp; its grasp is planned, and its pose estimated,
    by the files.
    """

    # Whether each joint's offset, and what is not given of a finger or a pad, is drawn from the `uncertainty` that the
    # hand's file declares, one of a Gaussian each.
    drawn: bool = False
    seed: int = 0  # of what is drawn, and of the bumps
    # By joint, what its encoder shows too much, deg; of one that slides, 1 deg counts as 1 mm.
    joint_offsets_deg: dict[str, float] = dataclasses.field(default_factory=dict)
    # Whether the force-torque sensors are tared at the start, while nothing touches them: no bias is drawn then, and
    # drift counts from there. False: as some minutes after a tare, when they have drifted by what is declared.
    tared: bool = True
    encoder_noise_deg: float = 0.0  # standard deviation of each reading, deg
    encoder_step_deg: float = 0.0  # quantisation, deg; 0: none
    fingers: dict[str, FingerErrors] = dataclasses.field(default_factory=dict)  # by finger
    pads: dict[str, PadErrors] = dataclasses.field(default_factory=dict)  # by pad
    object_scale: float = 1.0  # of the object that is held, about its centre of mass, in units of its mesh
    object_surface_sigma: float = 0.0  # root mean square of smooth bumps on it, m
    vision_degrees_of_freedom: float | None = None  # of Student's t, whose tails the camera's errors have; null: none

    def validate(self, hand: HandConfig) -> None:
        """Raises InvalidInputError if a value is out of its range, or a name not one of the hand's."""
        name = "SimulatedErrors"
        if self.drawn and hand.uncertainty is None:
            raise InvalidInputError(
                f"{name}.drawn: is true, but the hand's file declares no `uncertainty` to draw from; allowed is false."
            )
        joints = {joint for finger in hand.fingers for joint in finger.joints}
        for joint, offset in self.joint_offsets_deg.items():
            if joint not in joints:
                raise UnknownNameError(f"{name}.joint_offsets_deg", joint, sorted(joints))
            limited(f"{name}.joint_offsets_deg[{joint}]", offset, (), most=_MOST_OFFSET)
        for key in ("encoder_noise_deg", "encoder_step_deg"):
            positive_number(f"{name}.{key}", getattr(self, key), allow_zero=True, most=_MOST_OFFSET)
        known = {finger.name: finger for finger in hand.fingers if finger.sensor_frame}
        for finger, errors in self.fingers.items():
            if finger not in known:
                raise UnknownNameError(f"{name}.fingers", finger, sorted(known))
            _check_finger(f"{name}.fingers[{finger}]", errors, known[finger].surface.make().half_width)
        for pad, of_pad in self.pads.items():
            if pad not in (names := [config.name for config in hand.pads]):
                raise UnknownNameError(f"{name}.pads", pad, sorted(names))
            _check_vectors(f"{name}.pads[{pad}]", of_pad, ("mounting", "mounting_deg"))
        positive_number(f"{name}.object_scale", self.object_scale, least=_LEAST_SCALE, most=_MOST_SCALE)
        positive_number(f"{name}.object_surface_sigma", self.object_surface_sigma, allow_zero=True, most=_MOST_SHIFT)
        if self.vision_degrees_of_freedom is not None:
            positive_number(f"{name}.vision_degrees_of_freedom", self.vision_degrees_of_freedom, least=0.5)


def _check_finger(name: str, errors: FingerErrors, half_width: float) -> None:
    if errors.radius is not None:
        limited(f"{name}.radius", errors.radius, (), most=_MOST_SHIFT)
        if errors.radius < (_LEAST_RADIUS - 1.0) * half_width:
            raise InvalidInputError(
                f"{name}.radius: is {errors.radius:g}, of a fingertip with a half-width of {half_width:g} m; allowed "
                f"are numbers >= {(_LEAST_RADIUS - 1.0) * half_width:g}."
            )
    _check_vectors(name, errors, _VECTORS)


def _check_vectors(name: str, errors: FingerErrors | PadErrors, keys: Iterable[str]) -> None:
    for key in keys:
        if getattr(errors, key):
            limited(f"{name}.{key}", getattr(errors, key), (3,), most=_VECTORS[key])


_VECTORS = {
    "mounting": _MOST_SHIFT,
    "mounting_deg": _MOST_OFFSET,
    "sensor_force": _MOST_LOAD,
    "sensor_moment": _MOST_LOAD,
    "drift_force": _MOST_LOAD,
    "drift_moment": _MOST_LOAD,
}


@dataclasses.dataclass(frozen=True, eq=False)
class DrawnErrors:
    """What a simulated hand errs, in numbers.

    Attributes:
        offsets: what the encoder of each measured joint shows too much, by joint, rad; of one that slides, 1 degree
            counts as 1 mm.
        radius: by which each fingertip is thicker, by finger, m.
        X_SM: where each sensor sits in truth, M, with its fingertip, of where its file has it, by finger.
        X_TM: likewise each tactile array, with its pad, by pad.
        bias: of each sensor at the start, by finger, shape (6,), N m and N.
        drift: of the bias, by finger, shape (6,), N m/s and N/s.
    """

    offsets: dict[str, float]
    radius: dict[str, float]
    X_SM: dict[str, RigidTransform]
    X_TM: dict[str, RigidTransform]
    bias: dict[str, FloatArray]
    drift: dict[str, FloatArray]


def hand_errors(errors: SimulatedErrors, hand: HandConfig) -> DrawnErrors:
    """The errors of a hand: those that are given, and the others drawn, or none; `errors` is valid."""
    generator = np.random.default_rng(errors.seed)
    sigma = hand.uncertainty if errors.drawn else None
    if sigma is None:
        sigma = HandUncertainty(**dict.fromkeys((field.name for field in dataclasses.fields(HandUncertainty)), 0.0))
    joints = dict.fromkeys(joint for finger in hand.fingers for joint in finger.joints)  # fingers may share one
    drawn_offsets = {joint: sigma.encoder_offset_deg * generator.normal() for joint in joints}
    found = DrawnErrors({}, {}, {}, {}, {}, {})
    for joint, offset in (drawn_offsets | errors.joint_offsets_deg).items():
        found.offsets[joint] = math.radians(offset)
    for finger in (finger.name for finger in hand.fingers if finger.sensor_frame):
        given = errors.fingers.get(finger, FingerErrors())
        radius = sigma.fingertip_radius * generator.normal()
        found.radius[finger] = radius if given.radius is None else given.radius
        found.X_SM[finger] = _mounted(given, sigma, generator)
        # Drawn in any case, so that a tare changes nothing else of the hand.
        moment, force = sigma.sensor_moment * generator.normal(size=3), sigma.sensor_force * generator.normal(size=3)
        moment = _given(given.sensor_moment, np.zeros(3) if errors.tared else moment)
        force = _given(given.sensor_force, np.zeros(3) if errors.tared else force)
        found.bias[finger] = np.concatenate([moment, force])
        drifts = (given.drift_moment, given.drift_force)
        found.drift[finger] = np.concatenate([_given(drift, np.zeros(3)) for drift in drifts])
    for pad in hand.pads:
        middle = RigidTransform(load_tactile_pad(pad.array).layout.p_TC.mean(axis=0))
        turned = _mounted(errors.pads.get(pad.name, PadErrors()), sigma, generator)
        found.X_TM[pad.name] = middle @ turned @ middle.inverse()
    return found


def _mounted(given: FingerErrors | PadErrors, sigma: HandUncertainty, generator: np.random.Generator) -> RigidTransform:
    """Where something sits, of where it is told to."""
    moved, turned = sigma.mounting * generator.normal(size=3), sigma.mounting_deg * generator.normal(size=3)
    rotation = RotationMatrix(exp_so3(np.radians(_given(given.mounting_deg, turned))))
    return RigidTransform(rotation, _given(given.mounting, moved))


def _given(value: list[float], otherwise: FloatArray) -> FloatArray:
    return np.asarray(value, dtype=np.float64) if value else otherwise
