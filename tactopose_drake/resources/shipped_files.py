"""Paths of the package's models and diagrams."""

import os
from collections.abc import Iterable
from pathlib import Path

from tactopose_drake.core.validation import path_of
from tactopose_drake.errors import InvalidFileError


def resource_root() -> Path:
    """The folder that holds `models/` and `diagrams/`: the package itself when installed, the checkout otherwise."""
    package = Path(__file__).resolve().parents[1]
    return package if (package / "models").is_dir() else package.parent


def model_path(*parts: str) -> Path:
    """The path of a shipped model, e.g. `model_path("objects", "mug.obj")`."""
    return resource_root().joinpath("models", *parts)


def shipped_objects() -> list[str]:
    """The names of the package's objects."""
    return sorted(path.stem for path in model_path("objects").glob("*.sdf"))


def named_file(name_or_path: str | Path, files: str, shipped: Iterable[Path], ending: str) -> Path:
    """The path of a YAML file, given as the name of one of the package's files, or as a path.

    Args:
        name_or_path: name or path of the file.
        files: what the files describe, in the plural, for messages.
        shipped: paths of the package's files.
        ending: the part of their file names that follows the name.

    Raises:
        InvalidInputError: if `name_or_path` is neither a string nor a path.
        InvalidFileError: if there is no such file, or it is a folder; the message lists the package's names.
    """
    known = {path.name.removesuffix(ending): path for path in shipped}
    path = known.get(str(name_or_path), path_of("name_or_path", name_or_path))
    if os.path.isdir(path) or not os.path.exists(path):
        allowed = f"a YAML file, or one of the package's {files}, {', '.join(sorted(known))}"
        given = "not a folder" if os.path.isdir(path) else "but there is no such file"
        raise InvalidFileError(f"{path} must be {allowed}, {given}.")
    return path


def sensor_file(name_or_path: str | Path, key: str) -> Path:
    """The path of a sensor's file, given as the name of one of the package's sensors, or as a path.

    Args:
        name_or_path: name of the sensor, or path of its file.
        key: the key that marks files of this kind of sensor.

    Raises:
        InvalidFileError: if there is no such file, or it is a sensor of the package of another kind; the message lists
            the package's sensors of this kind.
    """
    files = list(model_path("sensors").glob("*.yaml"))
    of_kind = [file for file in files if f"\n{key}:" in file.read_text(encoding="utf-8")]
    if str(name_or_path) in {file.stem for file in files} - {file.stem for file in of_kind}:
        known = ", ".join(sorted(file.stem for file in of_kind))
        raise InvalidFileError(f"{name_or_path} must be one of the package's sensors of this kind, {known}.")
    return named_file(name_or_path, "sensors of this kind", of_kind, ".yaml")
