"""The option `--symmetry`: axes of rotational symmetry of an object."""

from collections.abc import Sequence

import numpy as np

from tactopose_drake.core.shape.symmetry import RotationalSymmetry
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.errors import InvalidInputError

SYMMETRY_HELP = (
    "auto, none, or an axis through the object's middle, with the number of turns that leave it unchanged: z for "
    "every turn, z:4, or 0,0.6,0.8:2. May be given several times."
)
_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def parse_symmetries(texts: Sequence[str], middle: FloatArray) -> tuple[RotationalSymmetry, ...]:
    """The symmetries that the option names, with axes through the object's centre of mass, shape (3,), m, in O.

    Raises:
        InvalidInputError: if an axis or its order is invalid, or auto or none is combined with other values.
    """
    for name in ("auto", "none"):
        if name in texts:
            raise InvalidInputError(
                f"--symmetry must be {name} alone, or axes such as z, z:4 or 0,0.6,0.8:2, not {name} and "
                f"{len(texts) - 1} more."
            )
    return tuple(_parse(text, middle) for text in texts)


def _parse(text: str, middle: FloatArray) -> RotationalSymmetry:
    name, _, order = text.partition(":")
    try:
        axis = np.array(_AXES[name] if name in _AXES else [float(part) for part in name.split(",")])
        length = float(np.linalg.norm(axis))
        if axis.shape != (3,) or not 0.0 < length < np.inf:
            raise ValueError
        return RotationalSymmetry(axis / length, middle, int(order) if order else 0)
    except ValueError:
        raise InvalidInputError(
            f"--symmetry must be auto, none, or axes such as z, z:4 or 0,0.6,0.8:2, not {text!r}."
        ) from None
