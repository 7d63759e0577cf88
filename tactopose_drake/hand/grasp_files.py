"""Files of recorded grasps: a folder with one YAML or JSON file for each grasp."""

import dataclasses
from pathlib import Path

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import either, finite_array, told_of
from tactopose_drake.errors import InvalidFileError, InvalidInputError
from tactopose_drake.hand.recorded_grasps import RecordedGrasp
from tactopose_drake.resources import load_typed_yaml

GRASP_ENDINGS = (".json", ".yaml", ".yml")


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
        raise InvalidFileError(f"{folder} must hold grasps, files that end in {either(GRASP_ENDINGS)}, but has none.")
    return tuple(load_grasp(path, model) for path in paths)
