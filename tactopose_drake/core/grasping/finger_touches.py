"""Ways for one finger to touch an object."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.validation import FloatArray


@dataclass(frozen=True, eq=False)
class FingerTouches:
    """Ways for one finger to touch; n of them.

    Attributes:
        q: joint positions in contact, shape (n, m), rad.
        closing: change of the joint command that presses with 1 N along the object's normal, shape (n, m), rad/N.
        q_open: joint positions with the finger lifted off, shape (n, m), rad.
        p_PC: contact points, shape (n, 3), m.
        n_PC: the object's outward normals, shape (n, 3).
        cost: deviation from a clean touch, shape (n,); 0 is best.
    """

    q: FloatArray
    closing: FloatArray
    q_open: FloatArray
    p_PC: FloatArray
    n_PC: FloatArray
    cost: FloatArray

    def __len__(self) -> int:
        return len(self.q)

    def take(self, index: NDArray[np.intp]) -> Self:
        """A subset of the touches."""
        return type(self)(*(getattr(self, name)[index] for name in self.__dataclass_fields__))

    @classmethod
    def joined(cls, some: Sequence[Self]) -> Self:
        """Concatenates touches."""
        return cls(*(np.concatenate([getattr(part, name) for part in some]) for name in cls.__dataclass_fields__))
