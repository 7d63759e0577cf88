"""What a hand read at quiet instants of grasps, and whether such readings can be."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike
from pydrake.multibody.plant import MultibodyPlant

from tactopose_drake.core.sensing.contact_noise import NANO17_SIGMA_FORCE, NANO17_SIGMA_MOMENT
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import MOST_MEASURED_FORCE, finite_array, instance_of
from tactopose_drake.errors import InvalidInputError, UnknownNameError
from tactopose_drake.hand.hand_errors import HandErrors
from tactopose_drake.hand.hand_in_plant import Hand, measured_joints
from tactopose_drake.hand.joint_matrices import joint_matrix
from tactopose_drake.hand.joint_paths import JointPaths
from tactopose_drake.hand.named_joints import NamedJoints, check_near_limits

READING_NOISE = np.repeat([NANO17_SIGMA_MOMENT, NANO17_SIGMA_FORCE], 3)
"""Standard deviations of a reading, N m and N, shape (6,)."""
_MOST_WRENCH = np.repeat([100.0, MOST_MEASURED_FORCE], 3)  # N m and N: more is in other units
_MOST_BIAS = 6.0  # standard deviations: what a sensor reads beyond that is a touch


@dataclasses.dataclass(frozen=True, eq=False)
class RecordedGrasp:
    """What a hand read at one quiet instant of a grasp of a known object.

    Attributes:
        model: the object.
        joint_positions: readings by the joints' names, rad, of sliding joints m; joints that follow others may be left
            out.
        wrenches: of the fingers that touch the object, and no others: [m_x, m_y, m_z, f_x, f_y, f_z] on the fingertip
            about its sensor's origin, in S, without the fingertip's weight, N m and N.
        out_of_touch: the same of fingers that touched nothing at about that time: what their sensors read all the same.
        time: when it was, s; None where biases do not drift.
        name: for messages.
    """

    model: ObjectModel
    joint_positions: Mapping[str, float]
    wrenches: Mapping[str, ArrayLike]
    out_of_touch: Mapping[str, ArrayLike] = dataclasses.field(default_factory=dict)
    time: float | None = None
    name: str = ""


def check_grasps(plant: MultibodyPlant, hand: Hand, grasps: Sequence[RecordedGrasp]) -> None:
    """Raises InvalidInputError if a grasp holds what the hand has not, what is no reading, or what another holds."""
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
                f"{where}: joint_positions: lack {', '.join(lacking)}; allowed is a number of each."
            )
        for key, wrenches in (("wrenches", grasp.wrenches), ("out_of_touch", grasp.out_of_touch)):
            for finger, wrench in wrenches.items():
                if finger not in hand.sensor_frames:
                    raise UnknownNameError(f"{where}: {key}", finger, hand.sensor_frames)
                _check_wrench(f"{where}: {key}.{finger}", wrench)
        if grasp.time is not None:
            finite_array(f"{where}: time", [grasp.time], (1,))
    _check_different(grasps)


def check_silence(errors: HandErrors, grasps: Sequence[RecordedGrasp]) -> None:
    """Raises InvalidInputError if a sensor that is said to touch nothing reads more than a bias can be.

    Args:
        errors: which errors the hand may have; of a sensor that is said to have no bias nothing is checked.
        grasps: what was recorded; checked already, see `check_grasps`.
    """
    for i, grasp in enumerate(grasps):
        for finger, reading in grasp.out_of_touch.items():
            wrench, bias = np.asarray(reading, dtype=float), errors.sigma[errors.place(finger, "bias")]
            most = _MOST_BIAS * np.hypot(bias, READING_NOISE)
            for part, unit, rows in (("moment", "N m", slice(0, 3)), ("force", "N", slice(3, 6))):
                if bias[rows].any() and np.any(np.abs(wrench[rows]) > most[rows]):
                    raise InvalidInputError(
                        f"{grasp.name or f'grasps[{i}]'}: out_of_touch.{finger}: the {part} is "
                        f"{wrench[rows].tolist()} {unit}; allowed is up to {most[rows][0]:.3g} {unit}, {_MOST_BIAS:g} "
                        f"times the `sensor_{part}` of the hand's `uncertainty`. Either the finger touches something, "
                        "its fingertip's weight is not taken off, or its bias is larger than the hand's file says."
                    )


def _check_wrench(name: str, wrench: ArrayLike) -> None:
    """Raises InvalidInputError if it is no wrench, or so large that it is of other units."""
    values = finite_array(name, wrench, (6,))
    if np.any(np.abs(values) > _MOST_WRENCH):
        raise InvalidInputError(
            f"{name}: is {values.tolist()}; allowed are moments up to {_MOST_WRENCH[0]:g} N m, then forces up to "
            f"{_MOST_WRENCH[-1]:g} N."
        )


def _check_different(grasps: Sequence[RecordedGrasp]) -> None:
    """Raises InvalidInputError if a grasp is there twice, or a sensor reads the very same numbers of two touches."""
    seen: dict[object, str] = {}
    for i, grasp in enumerate(grasps):
        wrenches = (
            tuple(sorted((finger, *np.asarray(wrench, dtype=float).tolist()) for finger, wrench in of_kind.items()))
            for of_kind in (grasp.wrenches, grasp.out_of_touch)
        )
        readings = (grasp.time, tuple(sorted(grasp.joint_positions.items())), *wrenches)
        where = grasp.name or f"grasps[{i}]"
        if readings in seen:
            raise InvalidInputError(f"{where}: has the readings of {seen[readings]}; allowed is each grasp once.")
        seen[readings] = where
        for finger, wrench in grasp.wrenches.items():
            touch = (finger, tuple(np.asarray(wrench, dtype=float).tolist()))
            if touch in seen:
                raise InvalidInputError(
                    f"{where}: wrenches.{finger}: is to the last digit that of {seen[touch]}; allowed are different "
                    "ones. A sensor that goes on to say the same is frozen."
                )
            seen[touch] = where
