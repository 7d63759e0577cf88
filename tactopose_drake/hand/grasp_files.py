"""Files of recorded grasps: a folder with one YAML or JSON file for each grasp."""

import dataclasses
from pathlib import Path

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import finite_array
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
    try:
        for key, wrenches in (("wrenches", file.wrenches), ("out_of_touch", file.out_of_touch)):
            for finger, wrench in wrenches.items():
                finite_array(f"{key}.{finger}", wrench, (6,))
        if not file.joint_positions:
            raise InvalidInputError("joint_positions: is empty; allowed is a number for each joint.")
        if not file.wrenches and not file.out_of_touch:
            raise InvalidInputError("wrenches: is empty; allowed are six numbers for each finger that touches.")
        if both := file.wrenches.keys() & file.out_of_touch.keys():
            raise InvalidInputError(
                f"out_of_touch: has {', '.join(sorted(both))}, as has wrenches; a finger must be in only one of them. "
                "Give a reading from before the touch as a grasp of its own, without wrenches."
            )
    except InvalidInputError as error:
        raise InvalidFileError(f"{path}: {error}") from None
    return RecordedGrasp(model, file.joint_positions, file.wrenches, file.out_of_touch, time=file.time, name=str(path))


def load_grasps(folder: Path, model: ObjectModel) -> tuple[RecordedGrasp, ...]:
    """Reads all grasps of a folder, in the order of their files' names.

    Raises:
        InvalidFileError: if there is no such folder or no grasp in it, or a file cannot be used.
    """
    if not folder.is_dir():
        raise InvalidFileError(f"{folder}: there is no such folder; allowed is one that holds a file for each grasp.")
    paths = sorted(path for path in folder.iterdir() if path.suffix.lower() in GRASP_ENDINGS and path.is_file())
    if not paths:
        raise InvalidFileError(f"{folder}: holds no grasp; allowed are files that end in {', '.join(GRASP_ENDINGS)}.")
    return tuple(load_grasp(path, model) for path in paths)
