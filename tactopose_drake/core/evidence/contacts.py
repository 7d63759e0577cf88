"""Contacts of the hand with the object at one instant, in the palm frame."""

import dataclasses
import math
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from tactopose_drake.core.validation import FloatArray, finite_array, unit_vectors
from tactopose_drake.errors import InvalidInputError


@dataclasses.dataclass(frozen=True, eq=False)
class Contacts:
    """Measured contacts, in the palm frame P.

    Attributes:
        p_PC: contact points, shape (k, 3), m.
        n_PC: outward unit normals of the object's surface at the contacts, shape (k, 3), or None. They point out of
            the object into the finger, which is the direction of the normal force on the fingertip.
        f_PC: forces on the fingertips, shape (k, 3), N, or None.
        sigma_position: standard deviation of each coordinate of p_PC, a number or shape (k,), m.
        sigma_normal: standard deviation of a small rotation of n_PC about each axis, a number or shape (k,), rad.
        sigma_force: standard deviation of each component of f_PC, a number or shape (k,), N.

    Raises:
        InvalidInputError: a number that is not finite, a shape that does not fit, a normal whose length differs from 1
            by more than 1e-3, or a sigma that is not positive.
    """

    p_PC: FloatArray
    n_PC: FloatArray | None = None
    f_PC: FloatArray | None = None
    sigma_position: FloatArray | float = 0.0009
    sigma_normal: FloatArray | float = math.radians(5.0)
    sigma_force: FloatArray | float = 0.05

    def __post_init__(self) -> None:
        p_PC = finite_array("p_PC", self.p_PC, (None, 3))
        shape = (len(p_PC), 3)
        values: dict[str, FloatArray | None] = {
            "p_PC": p_PC,
            "n_PC": None if self.n_PC is None else unit_vectors("n_PC", self.n_PC, shape),
            "f_PC": None if self.f_PC is None else finite_array("f_PC", self.f_PC, shape),
            "sigma_position": _sigmas("sigma_position", self.sigma_position, len(p_PC)),
            "sigma_normal": _sigmas("sigma_normal", self.sigma_normal, len(p_PC)),
            "sigma_force": _sigmas("sigma_force", self.sigma_force, len(p_PC)),
        }
        for name, value in values.items():
            if value is not None:
                value = np.array(value)
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

    @classmethod
    def empty(cls) -> Self:
        """No contact at all."""
        return cls(np.zeros((0, 3)))


def _sigmas(name: str, value: ArrayLike, count: int) -> FloatArray:
    sigma = finite_array(name, value, () if np.ndim(value) == 0 else (count,))
    if np.any(sigma <= 0):
        raise InvalidInputError(f"{name}: is {float(sigma.min()):g}; allowed are numbers > 0.")
    return np.full(count, sigma)
