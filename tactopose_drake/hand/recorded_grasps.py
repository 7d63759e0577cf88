"""Recorded readings of a hand during grasps, their files, and checks of them."""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from pydrake.multibody.plant import MultibodyPlant

from tactopose_drake.core.sensing.contact_noise import NANO17_SIGMA_FORCE, NANO17_SIGMA_MOMENT
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import MOST_MEASURED_FORCE, either, finite_array, instance_of, known_name, told_of
from tactopose_drake.errors import InvalidFileError, InvalidInputError
from tactopose_drake.hand.hand_errors import HandErrors
from tactopose_drake.hand.hand_in_plant import Hand, measured_joints
from tactopose_drake.hand.joint_matrices import joint_matrix
from tactopose_drake.hand.kinematics import JointPaths
from tactopose_drake.hand.named_joints import NamedJoints, check_near_limits
from tactopose_drake.resources import load_typed_yaml

READING_NOISE = np.repeat([NANO17_SIGMA_MOMENT, NANO17_SIGMA_FORCE], 3)
"""Standard deviations of a reading, N m and N, shape (6,)."""
_MOST_WRENCH = np.repeat([100.0, MOST_MEASURED_FORCE], 3)  # N m and N; larger values are in other units
GRASP_ENDINGS = (".json", ".yaml", ".yml")
_MOST_NAMED = 3  # files that a message names
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


@dataclasses.dataclass(kw_only=True, slots=True)
class GraspFile:
    """One recorded grasp: the hand's readings at an instant at which it held the object still."""

    # Readings by the joints' names in the model, rad; of prismatic joints, m. Coupled joints may be left out, and must
    # not contradict their couplings.
    joint_positions: dict[str, float] = dataclasses.field(default_factory=dict)
    # [m_x, m_y, m_z, f_x, f_y, f_z] of only the fingers that touch the object: on the fingertip about its sensor's
    # origin, in the sensor's frame, without the fingertip's weight, N m and N.
    wrenches: dict[str, list[float]] = dataclasses.field(default_factory=dict)
    # Likewise the readings of fingers that touched nothing at about that time, which show the sensors' biases.
    out_of_touch: dict[str, list[float]] = dataclasses.field(default_factory=dict)
    time: float | None = None  # time of the grasp by any clock, s; biases may drift if all grasps have one


def load_grasp(path: Path, model: ObjectModel) -> RecordedGrasp:
    """Reads one grasp.

    Raises:
        InvalidFileError: if the file cannot be read or does not fit the format; the message names file and key.
    """
    file = load_typed_yaml(GraspFile, path)
    with told_of(f"{path}: ", InvalidFileError):
        for key, wrenches in (("wrenches", file.wrenches), ("out_of_touch", file.out_of_touch)):
            for finger, wrench in wrenches.items():
                finite_array(f"{key}.{finger}", wrench, (6,))
        if not file.joint_positions:
            raise InvalidInputError("joint_positions must have a number for each joint, but has none.")
        if not file.wrenches and not file.out_of_touch:
            raise InvalidInputError("wrenches must have six numbers for each finger that touches, but has none.")
        if both := file.wrenches.keys() & file.out_of_touch.keys():
            raise InvalidInputError(
                f"out_of_touch must not have {', '.join(sorted(both))}, as a finger must be in only one of it and "
                "wrenches. Give a reading from before the touch as a grasp of its own, without wrenches."
            )
    return RecordedGrasp(model, file.joint_positions, file.wrenches, file.out_of_touch, time=file.time, name=str(path))


def load_grasps(folder: Path, model: ObjectModel) -> tuple[RecordedGrasp, ...]:
    """Reads all grasps of a folder, in the order of their files' names.

    Raises:
        InvalidFileError: if there is no such folder or no grasp in it, or a file cannot be used.
    """
    if not folder.is_dir():
        raise InvalidFileError(f"{folder} must hold a file for each grasp, but there is no such folder.")
    paths = sorted(path for path in folder.iterdir() if path.suffix.lower() in GRASP_ENDINGS and path.is_file())
    if not paths:
        raise InvalidFileError(
            f"{folder} must itself hold a file for each grasp, which ends in {either(GRASP_ENDINGS)} and has "
            "joint_positions, rad by joint, and wrenches, six numbers by finger, N m and N, or for `tactopose "
            "calibrate` a folder for each recording of `tactopose run --record`, with its manifest.yaml, but has "
            f"{_content(folder)}."
        )
    return tuple(load_grasp(path, model) for path in paths)


def _content(folder: Path) -> str:
    """What a folder holds, in a few words."""
    names = sorted(f"the folder {path.name}" if path.is_dir() else path.name for path in folder.iterdir())
    more = [f"{len(names) - _MOST_NAMED} more"] if len(names) > _MOST_NAMED else []
    return f"only {', '.join(names[:_MOST_NAMED] + more)}" if names else "nothing"
