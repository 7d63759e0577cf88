"""Contacts of the hand with the object at one instant, in the palm frame."""

import dataclasses
import math
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactopose_drake.core.plain_values import PlainValue
from tactopose_drake.core.validation import FloatArray, limited, points_near, positive_numbers, unit_vectors

# What a sigma may be: m, rad, N. Beyond, the information of a contact and of the rest do not fit into one double.
_SIGMAS = {"sigma_position": (1e-7, 1e6), "sigma_normal": (1e-5, 1e6), "sigma_force": (1e-6, 1e6)}
_MOST_FORCE = 1e6


@dataclasses.dataclass(frozen=True, eq=False)
class Contacts(PlainValue):
    """Measured contacts, in the palm frame P.

    Attributes:
        p_PC: contact points, shape (k, 3), m; coordinates up to 10 m, for larger ones must be millimetres.
        n_PC: outward unit normals of the object's surface at the contacts, shape (k, 3), or None. They point out of
            the object into the finger, which is the direction of the normal force on the fingertip.
        f_PC: forces on the fingertips, shape (k, 3), N, up to 1e6; or None.
        sigma_position: standard deviation of each coordinate of p_PC, a number or shape (k,), m, from 1e-7 to 1e6.
        sigma_normal: standard deviation of a small rotation of n_PC about each axis, a number or shape (k,),
            rad, from 1e-5 to 1e6.
        sigma_force: standard deviation of each component of f_PC, a number or shape (k,), N, from 1e-6 to 1e6.

    Raises:
        InvalidInputError: what is not of finite numbers, a shape that does not fit, a normal whose length differs from
            1 by more than 1e-3, or a number out of its range.
    """

    p_PC: FloatArray
    n_PC: FloatArray | None = None
    f_PC: FloatArray | None = None
    sigma_position: FloatArray | float = 0.0009
    sigma_normal: FloatArray | float = math.radians(5.0)
    sigma_force: FloatArray | float = 0.05

    def __post_init__(self) -> None:
        p_PC = points_near("p_PC", self.p_PC, (None, 3))
        shape, count = (len(p_PC), 3), len(p_PC)
        values: dict[str, FloatArray | None] = {
            "p_PC": p_PC,
            "n_PC": None if self.n_PC is None else unit_vectors("n_PC", self.n_PC, shape),
            "f_PC": None if self.f_PC is None else limited("f_PC", self.f_PC, shape, most=_MOST_FORCE),
            **{name: _sigmas(name, getattr(self, name), count, *limits) for name, limits in _SIGMAS.items()},
        }
        for name, value in values.items():
            if value is not None:
                value.setflags(write=False)
            object.__setattr__(self, name, value)

    def __setstate__(self, state: dict[str, Any]) -> None:
        # Copies, and those in other processes, are read-only too: kernels may round otherwise for writable arrays.
        for value in state.values():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)
        self.__dict__.update(state)

    def __len__(self) -> int:
        return len(self.p_PC)

    def chosen(self, index: NDArray[np.intp]) -> Self:
        """Some of the contacts, in the order of the index."""
        normals, forces = (None if rows is None else rows[index] for rows in (self.n_PC, self.f_PC))
        sigmas = (np.asarray(getattr(self, name))[index] for name in _SIGMAS)
        return type(self)(self.p_PC[index], normals, forces, *sigmas)

    def __repr__(self) -> str:
        known = [
            "points",
            *(["normals"] if self.n_PC is not None else []),
            *(["forces"] if self.f_PC is not None else []),
        ]
        sigmas = "".join(
            f", {name} {_span(scale * np.asarray(getattr(self, name)))} {unit}"
            for name, scale, unit, is_known in (
                ("sigma_position", 1e3, "mm", True),
                ("sigma_normal", math.degrees(1.0), "deg", self.n_PC is not None),
                ("sigma_force", 1.0, "N", self.f_PC is not None),
            )
            if is_known and len(self)
        )
        return f"<Contacts: {len(self)} {', '.join(known)}{sigmas}>"

    @classmethod
    def empty(cls) -> Self:
        """No contact at all."""
        return cls(np.zeros((0, 3)))


def _span(values: FloatArray) -> str:
    """A number, or the least and the largest of several."""
    least, most = f"{values.min():.3g}", f"{values.max():.3g}"
    return least if least == most else f"{least} to {most}"


def _sigmas(name: str, value: ArrayLike, count: int, least: float, most: float) -> FloatArray:
    is_one = not isinstance(value, list | tuple) and np.ndim(value) == 0
    return np.full(count, positive_numbers(name, value, () if is_one else (count,), least=least, most=most))
