"""The file of a touch, contacts.yaml: contacts at points, patches, and planes that the object rests on."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.plane_contact import PlaneContact
from tactopose_drake.core.poses import identity_poses, transform_points
from tactopose_drake.core.sensing.patches import Patch, describe_patch
from tactopose_drake.core.validation import FloatArray, path_of, told_of
from tactopose_drake.errors import InvalidFileError, InvalidInputError
from tactopose_drake.estimation.data_checks import (
    check_list,
    check_mapping,
    check_number,
    check_pose,
    check_vector,
    fault_in,
    read_data,
)
from tactopose_drake.estimation.files import SIGMA_KEYS, contacts_in
from tactopose_drake.resources.yaml_files import shown

if TYPE_CHECKING:
    from tactopose_drake.hand.tactile_pads import TactilePad

_PARTS = {"patches": "patch", "planes": "plane"}
_LIMITS = ("threshold", "saturation")
# Places in the file of the values that messages of core classes name.
_OF_PLANE = {"p_PQ": "point", "n_P": "normal"}
_OF_PATCH = {"p_PT": "points[{}]", "n_PT": "normals[{}]", "pressure": "pressures[{}]"}


class LoadedTouch(NamedTuple):
    """What is felt at one instant, in the palm frame.

    Attributes:
        contacts: the touch at single points.
        patches: patches of tactile arrays, including those that feel nothing.
        planes: planes that the object is known to touch.
    """

    contacts: Contacts
    patches: tuple[Patch, ...]
    planes: tuple[PlaneContact, ...] = ()


class _Pad(NamedTuple):
    """Cells (n, 3), m, and their normals (n, 3); the array if it has a file."""

    points: FloatArray
    normals: FloatArray
    array: "TactilePad | None" = None


def load_touch(path: Path) -> LoadedTouch:
    """Reads contacts.yaml: `contacts` or `patches` or both, and `planes`; in P, in m, N and Pa.

    Contacts, `sigma_position` and `sigma_normal_deg` are as in `load_contacts`. Each patch has

    - `points`: the pad's cells, and `normals`, which point out of the finger, unless all are z; or `array`: a tactile
      array of the package by name, or a file by its path relative to this one's folder;
    - `X_PT`: pose of the pad's frame T, in which the cells are given, as `translation` and `quaternion_wxyz`; absent if
      they are given in the palm frame;
    - `pressures`: the pressure of each cell, Pa, null for a dead cell. With `array` they must be within its range, and
      cells that its file lists as dead are ignored;
    - `alpha`: depth over pressure of the soft pad, m/Pa, as for `describe_patch`;
    - `threshold`: pressure above which a cell is active, Pa, by default 0;
    - `saturation`: pressure at which a cell saturates, Pa, by default infinite or the range of `array`.

    Each plane has a `point`, its `normal` towards the object, and `sigma`, m, 1 mm by default: see `PlaneContact`.

    Raises:
        InvalidInputError: if `path` is not a path.
        InvalidFileError: if the file, or that of an array, cannot be read or does not fit the format.
    """
    path = path_of("path", path)
    data = check_mapping(path, "", read_data(path), (), ("contacts", "patches", "planes", *SIGMA_KEYS))
    if "contacts" not in data and "patches" not in data:
        raise InvalidFileError(f"{path} must have contacts, patches or both, but has neither.")
    contacts = contacts_in(path, data) if "contacts" in data else Contacts.empty()
    patches, planes = (check_list(path, key, data[key], one) if key in data else [] for key, one in _PARTS.items())
    return LoadedTouch(
        contacts,
        tuple(_patch(path, f"patches[{i}]", entry) for i, entry in enumerate(patches)),
        tuple(_plane(path, f"planes[{i}]", entry) for i, entry in enumerate(planes)),
    )


def _plane(path: Path, where: str, entry: Any) -> PlaneContact:
    given = check_mapping(path, where, entry, ("point", "normal"), ("sigma",))
    point, normal = (check_vector(path, f"{where}.{key}", given[key], 3) for key in ("point", "normal"))
    sigma = {"sigma": check_number(path, f"{where}.sigma", given["sigma"])} if "sigma" in given else {}
    try:
        return PlaneContact(point, normal, **sigma)
    except InvalidInputError as error:
        raise fault_in(path, where, error, _OF_PLANE) from None


def _patch(path: Path, where: str, entry: Any) -> Patch:
    is_array = isinstance(entry, dict) and "array" in entry
    own, optional = (("array",), ()) if is_array else (("points",), ("normals",))
    given = check_mapping(path, where, entry, (*own, "pressures", "alpha"), (*optional, "X_PT", *_LIMITS))
    pad = _array_pad(path, where, given) if is_array else _own_pad(path, where, given)
    X_PT = check_pose(path, f"{where}.X_PT", given["X_PT"]) if "X_PT" in given else identity_poses(1)[0]
    alpha = check_number(path, f"{where}.alpha", given["alpha"])
    limits = {key: check_number(path, f"{where}.{key}", given[key]) for key in _LIMITS if key in given}
    pressure = _pressures(path, f"{where}.pressures", given["pressures"])
    if len(pressure) != len(pad.points):
        raise InvalidFileError(
            f"{path}: {where}.pressures must be {len(pad.points)}, one for each cell of the pad, not {len(pressure)}."
        )
    if pad.array is not None:
        limits.setdefault("saturation", pad.array.model.range)
        pressure = _known(path, f"{where}.pressures", pad.array, pressure)
    try:
        return describe_patch(
            transform_points(X_PT, pad.points),
            pressure,
            alpha=alpha,
            n_PT=pad.normals @ X_PT[:, :3].T,
            threshold=limits.get("threshold", 0.0),
            saturation=limits.get("saturation"),
        )
    except InvalidInputError as error:
        raise fault_in(path, where, error, _OF_PATCH) from None


def _own_pad(path: Path, where: str, given: dict[str, Any]) -> _Pad:
    """Cells that the file lists one by one."""
    points = _rows(path, f"{where}.points", given["points"])
    if "normals" not in given:
        return _Pad(points, np.tile([0.0, 0.0, 1.0], (len(points), 1)))
    return _Pad(points, _rows(path, f"{where}.normals", given["normals"]))


def _array_pad(path: Path, where: str, given: dict[str, Any]) -> _Pad:
    """The cells of an array that has a file of its own."""
    # Imported only here, since files with contacts alone do not need it.
    from tactopose_drake.hand.tactile_pads import load_tactile_pad

    array = given["array"]
    if not isinstance(array, str):
        raise InvalidFileError(f"{path}: {where}.array must be a name or a path, not {shown(array)}.")
    with told_of(f"{path}: {where}.array: ", InvalidFileError):
        pad = load_tactile_pad(path.parent / array if Path(array).suffix else array)
    return _Pad(pad.layout.p_TC, pad.layout.n_T, pad)


def _known(path: Path, where: str, array: "TactilePad", pressure: FloatArray) -> FloatArray:
    """The pressures of an array's cells, checked against its range; NaN for cells that its file lists as dead."""
    known, beyond = array.known_pressures(pressure)
    if beyond.any():
        i = int(np.argmax(beyond))
        raise InvalidFileError(
            f"{path}: {where}[{i}] must be a number up to the array's range, {array.model.range:g} Pa, or null for a "
            f"cell that is dead, not {pressure[i]:g}."
        )
    return known


def _rows(path: Path, where: str, value: Any) -> FloatArray:
    """Points or normals, shape (n, 3)."""
    rows = check_list(path, where, value, "row of three numbers")
    return np.stack([check_vector(path, f"{where}[{i}]", row, 3) for i, row in enumerate(rows)])


def _pressures(path: Path, where: str, value: Any) -> FloatArray:
    """Pressures of cells, Pa, shape (n,); NaN for null."""
    cells = check_list(path, where, value, "pressure")
    known = [i for i, cell in enumerate(cells) if cell is not None]
    pressure = np.full(len(cells), np.nan)
    for i in known:
        pressure[i] = check_number(path, f"{where}[{i}]", cells[i])
    return pressure
