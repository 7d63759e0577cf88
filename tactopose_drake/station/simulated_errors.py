"""Errors of the simulated world relative to the models of the estimation: as a scenario gives them, and as drawn."""

import dataclasses
import math
from collections.abc import Iterable

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from tactopose_drake.core.poses import exp_so3
from tactopose_drake.core.validation import FloatArray, known_name, limited, positive_number
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.hand_config import HandConfig, HandUncertainty
from tactopose_drake.hand.tactile_pads import load_tactile_pad

_MOST_OFFSET = 90.0  # deg
_MOST_SHIFT = 0.05  # m
_MOST_LOAD = 1e3  # N and N m; of drift, per second
_LEAST_SCALE, _MOST_SCALE = 0.5, 2.0
_LEAST_RADIUS = 0.2  # least share of a fingertip's half-width that must remain


@dataclasses.dataclass(kw_only=True, slots=True)
class FingerErrors:
    """Errors of one finger with a force-torque sensor, relative to the hand's description."""

    radius: float | None = None  # increase of the fingertip's radius, m; null: drawn, or 0
    # Displacement of its sensor with the fingertip, in S, (3,), m; empty: drawn, or 0.
    mounting: list[float] = dataclasses.field(default_factory=list)
    # Rotation of its sensor with the fingertip, as a rotation vector in S, (3,), deg; empty: drawn, or 0.
    mounting_deg: list[float] = dataclasses.field(default_factory=list)
    # Bias at the start, whether the sensor was tared or not, in S, (3,), N; empty: 0, or drawn if it was not tared.
    sensor_force: list[float] = dataclasses.field(default_factory=list)
    sensor_moment: list[float] = dataclasses.field(default_factory=list)  # likewise, N m
    drift_force: list[float] = dataclasses.field(default_factory=list)  # of the bias, in S, (3,), N/s; empty: 0
    drift_moment: list[float] = dataclasses.field(default_factory=list)  # of the bias, in S, (3,), N m/s; empty: 0


@dataclasses.dataclass(kw_only=True, slots=True)
class PadErrors:
    """Errors of one tactile pad, relative to the hand's description."""

    # Displacement of the pad with its array, in T, (3,), m; empty: drawn, or 0.
    mounting: list[float] = dataclasses.field(default_factory=list)
    # Rotation about the middle of its cells, as a rotation vector in T, (3,), deg; empty: drawn, or 0.
    mounting_deg: list[float] = dataclasses.field(default_factory=list)


@dataclasses.dataclass(kw_only=True, slots=True)
class SimulatedErrors:
    """Errors of the simulated hand, object and camera relative to the estimation's models; by default none.

    The simulated hand differs from its files in the same way in every grasp. Grasps are planned, and poses estimated,
    with the files.
    """

    # Whether joint offsets, and errors of fingers and pads that are not given, are drawn from Gaussians with the
    # `uncertainty` that the hand's file declares.
    drawn: bool = False
    seed: int = 0  # of the drawn errors, and of the bumps
    # Offset of each joint's encoder (reading minus position), deg; for a prismatic joint, 1 deg stands for 1 mm.
    joint_offsets_deg: dict[str, float] = dataclasses.field(default_factory=dict)
    # Whether the force-torque sensors are tared at the start without a touch: no bias is drawn then, and drift starts
    # from there. False: they have drifted since an earlier tare, and biases are drawn.
    tared: bool = True
    encoder_noise_deg: float = 0.0  # standard deviation of each reading, deg
    encoder_step_deg: float = 0.0  # quantisation, deg; 0: none
    fingers: dict[str, FingerErrors] = dataclasses.field(default_factory=dict)  # by finger
    pads: dict[str, PadErrors] = dataclasses.field(default_factory=dict)  # by pad
    object_scale: float = 1.0  # scale of the held object relative to its mesh, about its centre of mass
    object_surface_sigma: float = 0.0  # root mean square of smooth bumps on it, m
    # Of heavy tails: the camera's errors, whose length follows from what is hidden, are multiplied by the factor that
    # turns a Gaussian error into one of Student's t; null: they are as long as the camera's model says.
    vision_degrees_of_freedom: float | None = None

    def validate(self, hand: HandConfig) -> None:
        """Raises InvalidInputError if a value is out of its range, or the hand lacks a name."""
        name = "SimulatedErrors"
        if self.drawn and hand.uncertainty is None:
            raise InvalidInputError(
                f"{name}.drawn must be false, not true, as the hand's file declares no `uncertainty` to draw from."
            )
        for joint, offset in self.joint_offsets_deg.items():
            known_name(f"each name in {name}.joint_offsets_deg", joint, sorted(hand.driven))
            limited(f"{name}.joint_offsets_deg[{joint}]", offset, (), most=_MOST_OFFSET)
        for key in ("encoder_noise_deg", "encoder_step_deg"):
            positive_number(f"{name}.{key}", getattr(self, key), allow_zero=True, most=_MOST_OFFSET)
        for finger, errors in self.fingers.items():
            known_name(f"each name in {name}.fingers", finger, sorted(hand.sensing))
            _check_finger(f"{name}.fingers[{finger}]", errors, hand.finger(finger).surface.make().half_width)
        for pad, of_pad in self.pads.items():
            known_name(f"each name in {name}.pads", pad, sorted(config.name for config in hand.pads))
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
                f"{name}.radius must be a number >= {(_LEAST_RADIUS - 1.0) * half_width:g} for a fingertip with a "
                f"half-width of {half_width:g} m, not {errors.radius:g}."
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
    """The errors of a simulated hand as numbers.

    Attributes:
        offsets: offset of each measured joint's encoder, by joint, rad; for a prismatic joint, 1 degree stands for
            1 mm.
        radius: increase of each fingertip's radius, by finger, m.
        X_SM: pose of each true sensor frame M, with its fingertip, in the nominal frame S, by finger.
        X_TM: pose of each true array frame M, with its pad, in the nominal frame T, by pad.
        bias: bias of each sensor at the start, by finger, shape (6,), N m and N.
        drift: rate of change of the bias, by finger, shape (6,), N m/s and N/s.
    """

    offsets: dict[str, float]
    radius: dict[str, float]
    X_SM: dict[str, RigidTransform]
    X_TM: dict[str, RigidTransform]
    bias: dict[str, FloatArray]
    drift: dict[str, FloatArray]


def hand_errors(errors: SimulatedErrors, hand: HandConfig) -> DrawnErrors:
    """The errors of a hand: those given, and all others drawn or zero; `errors` must be valid."""
    generator = np.random.default_rng(errors.seed)
    sigma = hand.uncertainty if errors.drawn else None
    if sigma is None:
        sigma = HandUncertainty(**dict.fromkeys((field.name for field in dataclasses.fields(HandUncertainty)), 0.0))
    drawn_offsets = {joint: sigma.encoder_offset_deg * generator.normal() for joint in hand.driven}
    found = DrawnErrors({}, {}, {}, {}, {}, {})
    for joint, offset in (drawn_offsets | errors.joint_offsets_deg).items():
        found.offsets[joint] = math.radians(offset)
    for finger in hand.sensing:
        given = errors.fingers.get(finger, FingerErrors())
        radius = sigma.fingertip_radius * generator.normal()
        found.radius[finger] = radius if given.radius is None else given.radius
        found.X_SM[finger] = _mounted(given, sigma, generator)
        # Always drawn, so that `tared` does not change the hand's other errors.
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
    """The true pose of a sensor or array in its nominal frame."""
    moved, turned = sigma.mounting * generator.normal(size=3), sigma.mounting_deg * generator.normal(size=3)
    rotation = RotationMatrix(exp_so3(np.radians(_given(given.mounting_deg, turned))))
    return RigidTransform(rotation, _given(given.mounting, moved))


def _given(value: list[float], otherwise: FloatArray) -> FloatArray:
    return np.asarray(value, dtype=np.float64) if value else otherwise
