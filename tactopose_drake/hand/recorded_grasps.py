"""Recorded readings of a hand during grasps, and checks of them."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike
from pydrake.multibody.plant import MultibodyPlant

from tactopose_drake.core.sensing.contact_noise import NANO17_SIGMA_FORCE, NANO17_SIGMA_MOMENT
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import MOST_MEASURED_FORCE, finite_array, instance_of, known_name
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.hand_errors import HandErrors
from tactopose_drake.hand.hand_in_plant import Hand, measured_joints
from tactopose_drake.hand.joint_matrices import joint_matrix
from tactopose_drake.hand.joint_paths import JointPaths
from tactopose_drake.hand.named_joints import NamedJoints, check_near_limits

READING_NOISE = np.repeat([NANO17_SIGMA_MOMENT, NANO17_SIGMA_FORCE], 3)
"""Standard deviations of a reading, N m and N, shape (6,)."""
_MOST_WRENCH = np.repeat([100.0, MOST_MEASURED_FORCE], 3)  # N m and N; larger values are in other units
_MOST_BIAS = 6.0  # largest bias, in standard deviations; larger readings are touches


@dataclasses.dataclass(frozen=True, eq=False)
class RecordedGrasp:
    """A hand's readings at one instant at which it held a known object still.

    Attributes:
        model: the object.
        joint_positions: readings by the joints' names, rad; of prismatic joints, m. Coupled joints may be left out.
        wrenches: wrenches of only the fingers that touch the object: [m_x, m_y, m_z, f_x, f_y, f_z] on the fingertip
            about its sensor's origin, in S, without the fingertip's weight, N m and N.
        out_of_touch: likewise the readings of fingers that touched nothing at about that time.
        time: time of the grasp, s; None if biases do not drift.
        name: name of the grasp in messages.
    """

    model: ObjectModel
    joint_positions: Mapping[str, float]
    wrenches: Mapping[str, ArrayLike]
    out_of_touch: Mapping[str, ArrayLike] = dataclasses.field(default_factory=dict)
    time: float | None = None
    name: str = ""


def check_grasps(plant: MultibodyPlant, hand: Hand, grasps: Sequence[RecordedGrasp]) -> None:
    """Raises InvalidInputError if a grasp has unknown names, invalid readings, or the readings of another grasp."""
    named, paths = NamedJoints(plant, hand), JointPaths(plant, hand.palm_frame)
    for i, grasp in enumerate(grasps):
        instance_of(f"grasps[{i}]", grasp, RecordedGrasp)
        where = grasp.name or f"grasps[{i}]"
        instance_of(f"{where}: model", grasp.model, ObjectModel)
        q = named.positions(f"{where}: joint_positions", dict(grasp.joint_positions))
        check_near_limits(f"{where}: joint_positions", grasp.joint_positions, plant, hand)
        named.check_couplings(f"{where}: joint_positions", grasp.joint_positions)
        bodies = [int(frame.body().index()) for frame in hand.sensor_frames.values()]
        needed = sorted({int(place) for body in bodies for place in paths.between(body)})
        if np.isnan(q[needed]).any():
            joints = measured_joints(plant, hand)
            moves = (joint_matrix(plant, hand, joints)[needed] != 0.0).any(axis=0)
            lacking = [
                joint for joint, k in zip(joints, moves, strict=True) if k and joint not in grasp.joint_positions
            ]
            raise InvalidInputError(
                f"{where}: joint_positions must have a number for each joint, but lack {', '.join(lacking)}."
            )
        for key, wrenches in (("wrenches", grasp.wrenches), ("out_of_touch", grasp.out_of_touch)):
            for finger, wrench in wrenches.items():
                known_name(f"{where}: each name in {key}", finger, hand.sensor_frames)
                _check_wrench(f"{where}: {key}.{finger}", wrench)
        if grasp.time is not None:
            finite_array(f"{where}: time", [grasp.time], (1,))
    _check_different(grasps)


def check_silence(errors: HandErrors, grasps: Sequence[RecordedGrasp]) -> None:
    """Raises InvalidInputError if a sensor out of touch reads more than its bias can be.

    Args:
        errors: the hand's errors; a sensor whose bias has the standard deviation 0 is not checked.
        grasps: the recorded grasps, which `check_grasps` has checked.
    """
    for i, grasp in enumerate(grasps):
        for finger, reading in grasp.out_of_touch.items():
            wrench, bias = np.asarray(reading, dtype=float), errors.sigma[errors.place(finger, "bias")]
            most = _MOST_BIAS * np.hypot(bias, READING_NOISE)
            for part, unit, rows in (("moment", "N m", slice(0, 3)), ("force", "N", slice(3, 6))):
                if bias[rows].any() and np.any(np.abs(wrench[rows]) > most[rows]):
                    raise InvalidInputError(
                        f"{grasp.name or f'grasps[{i}]'}: out_of_touch.{finger} must be a {part} up to "
                        f"{most[rows][0]:.3g} {unit}, {_MOST_BIAS:g} times the `sensor_{part}` of the hand's "
                        f"`uncertainty`, not {wrench[rows].tolist()} {unit}. Either the finger touches something, its "
                        "fingertip's weight is not subtracted, or its bias is larger than the hand's file says."
                    )


def _check_wrench(name: str, wrench: ArrayLike) -> None:
    """Raises InvalidInputError if the value is no wrench, or so large that it must be in other units."""
    values = finite_array(name, wrench, (6,))
    if np.any(np.abs(values) > _MOST_WRENCH):
        raise InvalidInputError(
            f"{name} must be moments up to {_MOST_WRENCH[0]:g} N m, then forces up to {_MOST_WRENCH[-1]:g} N, not "
            f"{values.tolist()}."
        )


def _check_different(grasps: Sequence[RecordedGrasp]) -> None:
    """Raises InvalidInputError if a grasp occurs twice, or a sensor has identical readings in two grasps."""
    seen: dict[object, str] = {}
    for i, grasp in enumerate(grasps):
        wrenches = (
            tuple(sorted((finger, *np.asarray(wrench, dtype=float).tolist()) for finger, wrench in of_kind.items()))
            for of_kind in (grasp.wrenches, grasp.out_of_touch)
        )
        readings = (grasp.time, tuple(sorted(grasp.joint_positions.items())), *wrenches)
        where = grasp.name or f"grasps[{i}]"
        if readings in seen:
            raise InvalidInputError(f"{where} must be another grasp than {seen[readings]}, not have its readings.")
        seen[readings] = where
        for finger, wrench in grasp.wrenches.items():
            touch = (finger, tuple(np.asarray(wrench, dtype=float).tolist()))
            if touch in seen:
                raise InvalidInputError(
                    f"{where}: wrenches.{finger} must differ from that of {seen[touch]}, not be identical. A sensor "
                    "whose reading never changes is frozen."
                )
            seen[touch] = where
