"""The files of the command line: contacts and priors in YAML, results in JSON.

Invalid content raises an `InvalidFileError` that names the file, the place in it, and what is allowed.
"""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from tactopose_drake.core.evidence.contacts import SIGMA_LIMITS, Contacts
from tactopose_drake.core.evidence.gaussian_prior import PRIOR_SIGMA_LIMITS
from tactopose_drake.core.validation import positive_number, told_of
from tactopose_drake.errors import InvalidFileError, InvalidInputError
from tactopose_drake.estimation.data_checks import (
    check_column,
    check_list,
    check_mapping,
    check_number,
    check_pose,
    check_vector,
    fault_in,
    read_data,
)
from tactopose_drake.estimation.identities import Identification
from tactopose_drake.estimation.output_files import written_beside
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.estimation.results import PoseEstimate

SIGMA_KEYS = ("sigma_position", "sigma_normal_deg")
"""The keys of contacts.yaml that hold for all contacts."""
# Places in the files of the values that messages of core classes name.
_OF_CONTACTS = {
    "p_PC": "contacts[{}].position",
    "n_PC": "contacts[{}].normal",
    "f_PC": "contacts[{}].force",
}


def load_contacts(path: Path) -> Contacts:
    """Reads contacts.yaml: `contacts`, a list of `position`, `normal` and `force` in the palm frame, m and N.

    Normals must be given for all contacts or for none, and so must forces. `sigma_position` (m) and `sigma_normal_deg`
    are optional.

    Raises:
        InvalidFileError: if the file cannot be read or does not fit the format. Files with patches are read by
            `hand.load_touch`.
    """
    data = check_mapping(path, "", read_data(path), required=("contacts",), optional=SIGMA_KEYS)
    return contacts_in(path, data)


def contacts_in(path: Path, data: dict[str, Any]) -> Contacts:
    """The contacts in the data of a contacts.yaml whose keys have been checked.

    Raises:
        InvalidFileError: if they do not fit the format.
    """
    entries = check_list(path, "contacts", data["contacts"], "contact")
    rows = [
        check_mapping(path, f"contacts[{i}]", entry, ("position",), ("normal", "force"))
        for i, entry in enumerate(entries)
    ]
    sigmas: dict[str, Any] = {}
    if "sigma_position" in data:
        sigmas["sigma_position"] = check_number(path, "sigma_position", data["sigma_position"])
    if "sigma_normal_deg" in data:
        limits = SIGMA_LIMITS["sigma_normal"][:2]
        sigmas["sigma_normal"] = _check_degrees(path, "sigma_normal_deg", data["sigma_normal_deg"], *limits)
    position = [check_vector(path, f"contacts[{i}].position", row["position"], 3) for i, row in enumerate(rows)]
    normal, force = (check_column(path, rows, key) for key in ("normal", "force"))
    try:
        return Contacts(np.stack(position), normal, force, **sigmas)
    except InvalidInputError as error:
        raise fault_in(path, "", error, _OF_CONTACTS) from None


def load_prior(path: Path) -> PosePrior:
    """Reads prior.yaml: `X_PO` with `translation` (m) and `quaternion_wxyz`, `sigma_translation`, `sigma_rotation_deg`.

    The sigmas are optional.

    Raises:
        InvalidFileError: if the file cannot be read or does not fit the format.
    """
    data = check_mapping(path, "", read_data(path), ("X_PO",), ("sigma_translation", "sigma_rotation_deg"))
    sigmas: dict[str, Any] = {}
    if "sigma_translation" in data:
        sigmas["sigma_translation"] = check_number(path, "sigma_translation", data["sigma_translation"])
    if "sigma_rotation_deg" in data:
        limits = PRIOR_SIGMA_LIMITS["sigma_rotation"]
        sigmas["sigma_rotation"] = _check_degrees(path, "sigma_rotation_deg", data["sigma_rotation_deg"], *limits)
    X_PO = check_pose(path, "X_PO", data["X_PO"])
    try:
        return PosePrior(X_PO, **sigmas)
    except InvalidInputError as error:
        raise fault_in(path, "", error, {}) from None


def _check_degrees(path: Path, key: str, value: Any, least: float, most: float) -> float:
    """Checks that an angle in degrees is within limits in radians, and returns it in radians."""
    number = check_number(path, key, value)
    with told_of(f"{path}: ", InvalidFileError):
        positive_number(key, number, least=math.degrees(least), most=math.degrees(most), unit="deg")
    return min(max(math.radians(number), least), most)


def save_result(path: Path, estimate: PoseEstimate) -> None:
    """Writes result.json: status, duration (s), noise scale, log evidence, and the hypotheses by falling probability.

    Raises:
        InvalidFileError: if the file cannot be written.
    """
    result = {
        "status": estimate.status,
        "duration": estimate.duration,
        "noise_scale": estimate.noise_scale,
        "log_evidence": estimate.log_evidence if math.isfinite(estimate.log_evidence) else None,
        "hypotheses": hypotheses_data(estimate),
    }
    with written_beside(path) as beside:
        beside.write_text(json.dumps(result, indent=1, allow_nan=False) + "\n")


def save_identification(path: Path, found: Identification) -> None:
    """Writes the result of `tactopose identify`: status, unknown, duration (s), and objects by falling probability.

    Each object has name, rank, probability, likelihood, log evidence (null if the index ruled it out) and hypotheses.

    Raises:
        InvalidFileError: if the file cannot be written.
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
    """The hypotheses as data for JSON, by falling probability."""
    return [
        {
            "translation": hypothesis.X_PO.translation().tolist(),
            "quaternion_wxyz": hypothesis.X_PO.rotation().ToQuaternion().wxyz().tolist(),
            "cost": hypothesis.cost,
            "probability": hypothesis.probability,
            "covariance": hypothesis.covariance.tolist(),
            "free_directions": hypothesis.free_directions.tolist(),
            "inlier_probability": hypothesis.inlier_probability.tolist(),
        }
        for hypothesis in estimate.hypotheses
    ]
