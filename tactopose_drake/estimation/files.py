"""The files of the command line: contacts and priors in YAML, results in JSON.

Every fault of a file is one `InvalidFileError` that says the file, the place in it, and what is allowed.
"""

import json
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.poses import make_poses, matrix_from_quaternion
from tactopose_drake.core.validation import FloatArray, finite_array
from tactopose_drake.errors import InvalidFileError, InvalidInputError
from tactopose_drake.estimation.identities import Identification
from tactopose_drake.estimation.output_files import written_beside
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.resources.yaml_files import plain_data, read_yaml, shown


def load_contacts(path: Path) -> Contacts:
    """Reads contacts.yaml: `contacts`, a list of `position`, `normal` and `force` in the palm frame, m and N.

    Normals, and forces, must be given for all contacts or for none. `sigma_position` (m) and `sigma_normal_deg` keep
    their defaults where they are absent.

    Raises:
        InvalidFileError: the file cannot be read, or does not fit.
    """
    data = _mapping(path, "", _read(path), required=("contacts",), optional=("sigma_position", "sigma_normal_deg"))
    entries = data["contacts"]
    if not isinstance(entries, list) or not entries:
        raise InvalidFileError(f"{path}: contacts: is {shown(entries)}; allowed is a list of at least one contact.")
    rows = [
        _mapping(path, f"contacts[{i}]", entry, required=("position",), optional=("normal", "force"))
        for i, entry in enumerate(entries)
    ]
    sigmas: dict[str, Any] = {}
    if "sigma_position" in data:
        sigmas["sigma_position"] = _number(path, "sigma_position", data)
    if "sigma_normal_deg" in data:
        sigmas["sigma_normal"] = math.radians(_number(path, "sigma_normal_deg", data))
    position = [_vector(path, f"contacts[{i}].position", row["position"], 3) for i, row in enumerate(rows)]
    normal, force = (_column(path, rows, key) for key in ("normal", "force"))
    try:
        return Contacts(np.stack(position), normal, force, **sigmas)
    except InvalidInputError as error:
        raise InvalidFileError(f"{path}: {error}") from None


def load_prior(path: Path) -> PosePrior:
    """Reads prior.yaml: `X_PO` with `translation` (m) and `quaternion_wxyz`, `sigma_translation`, `sigma_rotation_deg`.

    The sigmas keep their defaults where they are absent.

    Raises:
        InvalidFileError: the file cannot be read, or does not fit.
    """
    data = _mapping(path, "", _read(path), required=("X_PO",), optional=("sigma_translation", "sigma_rotation_deg"))
    pose = _mapping(path, "X_PO", data["X_PO"], required=("translation", "quaternion_wxyz"), optional=())
    sigmas: dict[str, Any] = {}
    if "sigma_translation" in data:
        sigmas["sigma_translation"] = _number(path, "sigma_translation", data)
    if "sigma_rotation_deg" in data:
        sigmas["sigma_rotation"] = math.radians(_number(path, "sigma_rotation_deg", data))
    translation = _vector(path, "X_PO.translation", pose["translation"], 3)
    quaternion = _vector(path, "X_PO.quaternion_wxyz", pose["quaternion_wxyz"], 4)
    length = float(np.linalg.norm(quaternion))
    if abs(length - 1.0) > 1e-3:
        raise InvalidFileError(f"{path}: X_PO.quaternion_wxyz: has length {length:.6g}; allowed is 1 within 0.001.")
    try:
        return PosePrior(make_poses(matrix_from_quaternion(quaternion), translation), **sigmas)
    except InvalidInputError as error:
        raise InvalidFileError(f"{path}: {error}") from None


def save_result(path: Path, estimate: PoseEstimate) -> None:
    """Writes result.json: status, duration (s), and the hypotheses by falling probability.

    Raises:
        InvalidFileError: the file cannot be written.
    """
    result = {"status": estimate.status, "duration": estimate.duration, "hypotheses": hypotheses_data(estimate)}
    with written_beside(path) as beside:
        beside.write_text(json.dumps(result, indent=1, allow_nan=False) + "\n")


def save_identification(path: Path, found: Identification) -> None:
    """Writes what `tactopose identify` says: status, unknown, duration (s), and the objects by falling probability.

    Of each object name, rank, probability, likelihood, log evidence (null where the index ruled it out) and hypotheses.

    Raises:
        InvalidFileError: the file cannot be written.
    """
    objects = [
        {
            "name": identity.name,
            "rank": identity.rank,
            "probability": identity.probability,
            "likelihood": identity.likelihood,
            "log_evidence": None if identity.estimate is None else identity.log_evidence,
            "hypotheses": [] if identity.estimate is None else hypotheses_data(identity.estimate),
        }
        for identity in found
    ]
    result = {"status": found.status, "unknown": found.unknown, "duration": found.duration, "objects": objects}
    with written_beside(path) as beside:
        beside.write_text(json.dumps(result, indent=1, allow_nan=False) + "\n")


def hypotheses_data(estimate: PoseEstimate) -> list[dict[str, Any]]:
    """The hypotheses as JSON has them, by falling probability."""
    return [
        {
            "translation": hypothesis.X_PO.translation().tolist(),
            "quaternion_wxyz": hypothesis.X_PO.rotation().ToQuaternion().wxyz().tolist(),
            "cost": hypothesis.cost,
            "probability": hypothesis.probability,
            "covariance": hypothesis.covariance.tolist(),
            "free_directions": hypothesis.free_directions.tolist(),
        }
        for hypothesis in estimate.hypotheses
    ]


def _read(path: Path) -> Any:
    _, root = read_yaml(path)
    try:
        return plain_data(root)
    except InvalidFileError as error:
        raise InvalidFileError(f"{path}: {error}") from None


def _mapping(path: Path, where: str, value: Any, required: Iterable[str], optional: Iterable[str]) -> dict[str, Any]:
    required, known = list(required), [*required, *optional]
    place = f"{path}: {where}: " if where else f"{path}: "
    if not isinstance(value, dict):
        raise InvalidFileError(f"{place}is {shown(value)}; allowed is a mapping with the keys {', '.join(known)}.")
    for key in value:
        if key not in known:
            raise InvalidFileError(f"{place}key {shown(key)} is unknown; allowed are {', '.join(known)}.")
    for key in required:
        if key not in value:
            raise InvalidFileError(f"{place}key {key!r} is missing.")
    return value


def _vector(path: Path, where: str, value: Any, length: int) -> FloatArray:
    return _numbers(path, where, value if isinstance(value, list) else [value], (length,))


def _number(path: Path, key: str, data: dict[str, Any]) -> float:
    return float(_numbers(path, key, [data[key]], (1,))[0])


def _numbers(path: Path, where: str, values: list[Any], shape: tuple[int]) -> FloatArray:
    for i, value in enumerate(values):
        # NumPy would take a boolean and the text of a number for one.
        if not isinstance(value, float | int) or isinstance(value, bool):
            place = where if len(values) == 1 else f"{where}[{i}]"
            raise InvalidFileError(f"{path}: {place}: is {shown(value)}; allowed are numbers.")
    try:
        return finite_array(where, values, shape)
    except InvalidInputError as error:
        raise InvalidFileError(f"{path}: {error}") from None


def _column(path: Path, rows: list[dict[str, Any]], key: str) -> FloatArray | None:
    """One vector of every contact, shape (k, 3); None where no contact has it."""
    given = [i for i, row in enumerate(rows) if row.get(key) is not None]
    if not given:
        return None
    if len(given) < len(rows):
        missing = next(i for i in range(len(rows)) if i not in given)
        raise InvalidFileError(
            f"{path}: contacts[{missing}]: has no {key}, but contacts[{given[0]}] has; allowed is one for all or none."
        )
    return np.stack([_vector(path, f"contacts[{i}].{key}", row[key], 3) for i, row in enumerate(rows)])
