"""Checks of the content of YAML files; an `InvalidFileError` names the file, the place in it, and what is allowed."""

import contextlib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tactopose_drake.core.poses import make_poses, matrix_from_quaternion
from tactopose_drake.core.validation import FloatArray, finite_array, told_of
from tactopose_drake.errors import InvalidFileError, InvalidInputError
from tactopose_drake.resources.yaml_files import plain_data, read_yaml, shown


def read_data(path: Path) -> Any:
    """Reads a YAML file as plain data."""
    root = read_yaml(path)
    with told_of(f"{path}: ", InvalidFileError):
        return plain_data(root)


def fault_in(path: Path, where: str, error: InvalidInputError, places: Mapping[str, str]) -> InvalidFileError:
    """Converts an error about a value that was built from a file into one that names the place in the file.

    Args:
        path: path of the file.
        where: the mapping in it that holds the value; empty for the whole file.
        error: an error whose message begins with the name of a value, possibly with a row in brackets.
        places: places in that mapping by the names of values, if they differ; `{}` in a place stands for the row.
    """
    value = str(error).split("[")[0].split()[0]
    fault = str(error).removeprefix(value)
    row, fault = fault[1:].split("]", 1) if fault.startswith("[") else ("", fault)
    place = places.get(value, f"{value}[{{}}]").format(row.split(",")[0]).replace("[]", "")
    return InvalidFileError(f"{path}: {f'{where}.{place}'.lstrip('.')}{fault}")


@contextlib.contextmanager
def naming_contacts_of(path: Path) -> Iterator[None]:
    """Converts errors about `contacts` that only the estimate finds into errors that name the file.

    Raises:
        InvalidFileError: in place of an InvalidInputError about `contacts`.
    """
    try:
        yield
    except InvalidInputError as error:
        if not str(error).startswith("contacts "):
            raise
        raise InvalidFileError(f"{path}: {error}") from None


def check_mapping(
    path: Path, where: str, value: Any, required: Iterable[str], optional: Iterable[str] = ()
) -> dict[str, Any]:
    """Checks that a value is a mapping with all required keys and no unknown ones.

    Args:
        path: path of the file, for messages.
        where: the place in it; empty for the whole file.
        value: the value at that place.
        required: keys that must be present.
        optional: keys that may be present.
    """
    with told_of(f"{path}: ", InvalidFileError):
        return check_keys(where or "the content", value, required, optional)


def check_keys(where: str, value: Any, required: Iterable[str], optional: Iterable[str] = ()) -> dict[str, Any]:
    """The same for a value that is not of one file alone.

    Raises:
        InvalidInputError: if it is no mapping, lacks a key, or has another one.
    """
    required, known = list(required), [*required, *optional]
    if not isinstance(value, dict):
        raise InvalidInputError(f"{where} must be a mapping with the keys {', '.join(known)}, not {shown(value)}.")
    for key in value:
        if key not in known:
            raise InvalidInputError(f"{where} must have only the keys {', '.join(known)}, not {shown(key)}.")
    for key in required:
        if key not in value:
            raise InvalidInputError(f"{where} must have the key {key!r}, but lacks it.")
    return value


def check_list(path: Path, where: str, value: Any, what: str) -> list[Any]:
    """Checks that a value is a list that is not empty; `what` names its items in messages."""
    if not isinstance(value, list) or not value:
        raise InvalidFileError(f"{path}: {where} must be a list of at least one {what}, not {shown(value)}.")
    return value


def check_vector(path: Path, where: str, value: Any, length: int) -> FloatArray:
    """Checks that a value is a list of finite numbers of this length; returns shape (length,)."""
    return _numbers(path, where, value, (length,))


def check_number(path: Path, where: str, value: Any) -> float:
    """Checks that a value is a finite number."""
    return float(_numbers(path, where, value, ()))


def check_pose(path: Path, where: str, value: Any) -> FloatArray:
    """A pose of `translation` (m) and `quaternion_wxyz`, shape (3, 4)."""
    pose = check_mapping(path, where, value, required=("translation", "quaternion_wxyz"))
    translation = check_vector(path, f"{where}.translation", pose["translation"], 3)
    quaternion = check_vector(path, f"{where}.quaternion_wxyz", pose["quaternion_wxyz"], 4)
    length = float(np.linalg.norm(quaternion))
    if abs(length - 1.0) > 1e-3:
        raise InvalidFileError(
            f"{path}: {where}.quaternion_wxyz must have the length 1 within 0.001, not {length:.6g}."
        )
    return make_poses(matrix_from_quaternion(quaternion), translation)


def _numbers(path: Path, where: str, value: Any, shape: tuple[int, ...]) -> FloatArray:
    with told_of(f"{path}: ", InvalidFileError):
        return finite_array(where, value, shape)


def check_column(path: Path, rows: list[dict[str, Any]], key: str) -> FloatArray | None:
    """The vectors at a key of all contacts, shape (k, 3); None if no contact has the key."""
    given = [i for i, row in enumerate(rows) if row.get(key) is not None]
    if not given:
        return None
    if len(given) < len(rows):
        missing = next(i for i in range(len(rows)) if i not in given)
        raise InvalidFileError(
            f"{path}: contacts must all have a {key}, or none, but contacts[{given[0]}] has one and "
            f"contacts[{missing}] has none."
        )
    return np.stack([check_vector(path, f"contacts[{i}].{key}", row[key], 3) for i, row in enumerate(rows)])
