"""Rotations that map an object onto itself."""

from __future__ import annotations

from dataclasses import dataclass

from tactopose_drake.core.validation import FloatArray


@dataclass(frozen=True, eq=False)
class RotationalSymmetry:
    """An axis about which the object may be turned without a change.

    Attributes:
        axis: unit vector in O, shape (3,).
        point: a point on the axis, in O, shape (3,), m.
        order: the object is unchanged by turns of 2 pi / order; 0: by every turn.
    """

    axis: FloatArray
    point: FloatArray
    order: int
