"""What options that are objects are for click."""

import os
from pathlib import Path
from typing import Any

import click

from tactopose_drake.errors import InvalidInputError
from tactopose_drake.resources import model_path, shipped_objects


class _ObjectName(click.ParamType[str]):
    """An object of the package by name, or a file of an object by path."""

    name = "object"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """The name or path.

        Raises:
            InvalidInputError: a bare word that is no name, and no file either.
        """
        is_word = Path(value).name == value and not Path(value).suffix
        if is_word and value not in shipped_objects() and not os.path.exists(value):
            raise InvalidInputError(
                f"--object: is {value!r}; allowed are the package's objects, {', '.join(shipped_objects())}, and a "
                "mesh or model by its path, ending included."
            )
        return str(value)


OBJECT = _ObjectName()
OBJECT_HELP = "An object of the package by name, such as mug, or its mesh, SDF, URDF or MJCF by path"


def object_file(name_or_path: str) -> Path:
    """The mesh of an object of the package, or the file itself."""
    return model_path("objects", f"{name_or_path}.obj") if name_or_path in shipped_objects() else Path(name_or_path)
