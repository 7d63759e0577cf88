"""The options with which an object's model is made from its mesh, validated."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from tactopose_drake.core.geometry_checks import FARTHEST
from tactopose_drake.core.shape.symmetry import RotationalSymmetry
from tactopose_drake.core.validation import FloatArray, flag, instance_of, limited, positive_number, whole_number
from tactopose_drake.errors import InvalidInputError, UnknownNameError

_MOST_SAMPLES, _MOST_BYTES = 10**6, 2**40  # More would exhaust the memory.

NUMBERS: Mapping[str, Callable[[str, float], float]] = {
    "scale": partial(positive_number, least=1e-6, most=1e6),
    "mass": partial(positive_number, least=1e-6, most=1e4),
    "surface_sigma": partial(positive_number, allow_zero=True, most=0.1),
    "scale_sigma": partial(positive_number, allow_zero=True, most=0.5),
}
"""Checks of those options that files have too: called with the option's name and value, each returns a float."""


@dataclass(frozen=True, kw_only=True)
class ModelOptions:
    """The options of `ObjectModel.from_mesh`, which documents them.

    Attributes:
        name: of the object.
        scale: the mesh's unit, m.
        mass: kg; None if unknown.
        center_of_mass: in O, shape (3,), m; None for the volume's centroid.
        symmetry: "auto", "none", or the symmetries.
        symmetry_tolerance: how far a turned surface may be off, as a share of the size.
        samples: number of surface samples.
        spacing: of the distance grid, m; None to choose it from the mesh.
        max_grid_bytes: size limit of the distance grid.
        surface_sigma: standard deviation of the surface along its normal, m.
        scale_sigma: relative standard deviation of the scale.
        is_kept: whether the model is cached on disk.

    Raises:
        UnknownNameError: an unknown symmetry.
        InvalidInputError: an option out of its range.
    """

    name: str
    scale: float
    mass: float | None
    center_of_mass: ArrayLike | None
    symmetry: Literal["auto", "none"] | Sequence[RotationalSymmetry]
    symmetry_tolerance: float
    samples: int
    spacing: float | None
    max_grid_bytes: int
    surface_sigma: float
    scale_sigma: float
    is_kept: bool

    def __post_init__(self) -> None:
        checked: dict[str, object] = {
            **{name: NUMBERS[name](name, getattr(self, name)) for name in ("scale", "surface_sigma", "scale_sigma")},
            "samples": whole_number("samples", self.samples, least=100, most=_MOST_SAMPLES),
            "max_grid_bytes": whole_number("max_grid_bytes", self.max_grid_bytes, least=1, most=_MOST_BYTES),
            "symmetry_tolerance": positive_number("symmetry_tolerance", self.symmetry_tolerance),
        }
        if self.mass is not None:
            checked["mass"] = NUMBERS["mass"]("mass", self.mass)
        if self.center_of_mass is not None:
            checked["center_of_mass"] = limited("center_of_mass", self.center_of_mass, (3,), most=FARTHEST)
        if self.spacing is not None:
            checked["spacing"] = positive_number("spacing", self.spacing)
        _ = self.symmetries  # Evaluated to check them.
        checked["is_kept"] = flag("cache", self.is_kept)
        instance_of("name", self.name, str)
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    def check_fit(self, vertices: FloatArray) -> None:
        """Checks the options that depend on the mesh, by its vertices (v, 3), m.

        Raises:
            InvalidInputError: a grid coarser than the object is large, or a centre of mass far outside of it.
        """
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        size = float(np.linalg.norm(high - low))
        if self.spacing is not None and self.spacing > size:
            raise InvalidInputError(f"spacing must be at most the object's size, {size:.3g} m, not {self.spacing:g} m.")
        if self.center_of_mass is not None:
            center = np.asarray(self.center_of_mass)
            off = float(np.linalg.norm(center - np.clip(center, low, high)))
            if off > size:
                raise InvalidInputError(
                    f"center_of_mass must be at most the object's size, {size:.3g} m, outside of its bounding box, not "
                    f"{off:.3g} m, at {center.tolist()}."
                )

    @cached_property
    def symmetries(self) -> tuple[RotationalSymmetry, ...] | None:
        """The symmetries that are given; None for "auto" and "none"."""
        given: object = self.symmetry
        if isinstance(given, str) and given in ("auto", "none"):
            return None
        if isinstance(given, str) or not isinstance(given, Sequence):
            raise UnknownNameError("symmetry", given, ("auto", "none", "or a list of RotationalSymmetry"))
        for i, one in enumerate(given):
            instance_of(f"symmetry[{i}]", one, RotationalSymmetry)
        return tuple(given)

    @property
    def tolerance(self) -> float | None:
        """Tolerance of the symmetry detection; None if it is off."""
        return self.symmetry_tolerance if self.symmetries is None and self.symmetry == "auto" else None
