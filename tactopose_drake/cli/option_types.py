"""Types of the arguments and options that name paths, hands and objects."""

import os
from pathlib import Path
from typing import Any

import click

from tactopose_drake.errors import InvalidInputError
from tactopose_drake.resources import model_path, shipped_objects


class _Path(click.Path):
    """A path; an empty one, as of a shell's variable that is not set, would be the current folder."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path; fails if it is empty."""
        if value == "":
            self.fail("It must be a path, not empty.", param, ctx)
        return super().convert(value, param, ctx)


PATH = _Path(path_type=Path)


_SHORT = {"shadow": "shadow_like", "barrett": "barrett_like"}


class _HandName(click.ParamType[str]):
    """A hand of the package by its name or short name, or a hand's YAML file by path."""

    name = "hand"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """The name or path for `load_hand_config`; fails if it is empty."""
        if value == "":
            self.fail("It must be a hand's name or path, not empty.", param, ctx)
        return _SHORT.get(value, str(value))


HAND = _HandName()
HAND_HELP = "A hand of the package by name, such as shadow or barrett, or a hand's YAML file by its path"


class _ObjectName(click.ParamType[str]):
    """An object of the package by name, or a file of an object by path."""

    name = "object"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """The name or path.

        Raises:
            InvalidInputError: if a plain word is neither an object's name nor a file.
        """
        is_word = Path(value).name == value and not Path(value).suffix
        if is_word and value not in shipped_objects() and not os.path.exists(value):
            raise InvalidInputError(
                f"--object must be one of the package's objects, {', '.join(shipped_objects())}, or a mesh or model by "
                f"its path, including the suffix, not {value!r}."
            )
        return str(value)


OBJECT = _ObjectName()
OBJECT_HELP = "An object of the package by name, such as mug, or its mesh, SDF, URDF or MJCF by path"


def object_file(name_or_path: str) -> Path:
    """Path of the mesh of an object of the package, or of the given file."""
    return model_path("objects", f"{name_or_path}.obj") if name_or_path in shipped_objects() else Path(name_or_path)
