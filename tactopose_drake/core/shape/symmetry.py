"""Rotational symmetries of an object, and the group that they generate."""

from __future__ import annotations

import functools
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.geometry_checks import FARTHEST, unit_vectors
from tactopose_drake.core.plain_values import PlainValue
from tactopose_drake.core.poses import compose, exp_so3, identity_poses, make_poses
from tactopose_drake.core.validation import FloatArray, limited, whole_number
from tactopose_drake.errors import InvalidInputError

CONTINUOUS = 0
"""The order of an axis about which every rotation leaves the object unchanged."""

# The order of the largest finite rotation group that is not cyclic or dihedral, the icosahedral one; twelve-fold prisms
# have 24.
_LARGEST_GROUP = 60
_TURNS = 12  # number of equally spaced rotations that stand for all about an axis


@dataclass(frozen=True, eq=False)
class RotationalSymmetry(PlainValue):
    """An axis about which the object may be turned without a change.

    Attributes:
        axis: unit vector in O, shape (3,).
        point: a point on the axis, in O, shape (3,), m.
        order: the object is unchanged by rotations by 2 pi / order; 0 for every rotation (continuous).

    Raises:
        InvalidInputError: if the axis is not a unit vector, the point not finite, or the order 1, negative or above 60.
    """

    axis: FloatArray
    point: FloatArray
    order: int

    def __post_init__(self) -> None:
        axis = unit_vectors("axis", self.axis, (3,))
        point = limited("point", self.point, (3,), most=FARTHEST)
        order = whole_number("order", self.order, least=0, most=_LARGEST_GROUP)
        if order == 1:
            raise InvalidInputError("order must be 0 (continuous) or an integer >= 2, not 1.")
        for name, array in (("axis", axis), ("point", point)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @property
    def is_continuous(self) -> bool:
        """Whether every rotation about the axis leaves the object unchanged."""
        return self.order == CONTINUOUS

    @functools.cached_property
    def moment(self) -> FloatArray:
        """The velocity of O's origin per rad/s about the axis, point x axis, in O, shape (3,), m."""
        return np.cross(self.point, self.axis)

    @functools.cached_property
    def half_turn(self) -> FloatArray:
        """A half turn about an axis across this one, which inverts it, shape (3, 3)."""
        across = np.cross(self.axis, np.eye(3)[np.argmin(np.abs(self.axis))])
        return np.asarray(2.0 * np.outer(across, across) / (across @ across) - np.eye(3))

    def seen_from(self, p_OC: FloatArray) -> RotationalSymmetry:
        """The same symmetry in a frame C with O's axes, at p_OC, shape (3,), m."""
        return RotationalSymmetry(self.axis, self.point - p_OC, self.order)

    def poses(self) -> FloatArray:
        """The rotations of a finite order as poses X_OO', shape (order, 3, 4); the identity alone if continuous."""
        count = max(self.order, 1)
        R = exp_so3(np.linspace(0.0, 2 * np.pi, count, endpoint=False)[:, None] * self.axis)
        return make_poses(R, self.point - R @ self.point)

    def turns(self) -> FloatArray:
        """The same as `poses`, with 12 rotations that stand for all about a continuous axis."""
        return RotationalSymmetry(self.axis, self.point, self.order or _TURNS).poses()


def symmetry_group(symmetries: Iterable[RotationalSymmetry]) -> FloatArray:
    """All poses X_OO' that the symmetries of finite order generate, the identity first, shape (g, 3, 4).

    Continuous symmetries are not included.

    Raises:
        InvalidInputError: if this makes more than 60 poses, which no finite group of rotations of order up to 12 has.
    """
    group = identity_poses(1)
    generators = np.empty((0, 3, 4))
    for symmetry in symmetries:
        generator = symmetry.poses()[-1:]
        if not np.any(are_alike(group, generator)):
            generators = np.concatenate([generators, generator])
            group = _closure(group, generators)
    return group


def sampled_turns(group: FloatArray, symmetries: Iterable[RotationalSymmetry]) -> FloatArray:
    """A group of poses (g, 3, 4), combined with some rotations about each continuous axis, shape (n, 3, 4).

    Args:
        group: of the finite symmetries, see `symmetry_group`.
        symmetries: of which the continuous ones are used.
    """
    for symmetry in symmetries:
        if symmetry.is_continuous:
            group = compose(group[:, None], symmetry.turns()[None]).reshape(-1, 3, 4)
    return group


def _closure(group: FloatArray, generators: FloatArray) -> FloatArray:
    """The closure of the group (g, 3, 4) under multiplication by the generators (n, 3, 4)."""
    new = group
    while len(new):
        products = compose(new[:, None], generators[None]).reshape(-1, 3, 4)
        products = products[~np.any(are_alike(group, products), axis=0)]
        new = products[~np.any(np.triu(are_alike(products, products), k=1), axis=0)]
        group = np.concatenate([group, new])
        if len(group) > _LARGEST_GROUP:
            raise InvalidInputError(
                f"symmetry must have axes that generate a group of at most {_LARGEST_GROUP} rotations, not more."
            )
    return group


def are_alike(X_a: FloatArray, X_b: FloatArray) -> NDArray[np.bool_]:
    """Which rotations of poses (n, 3, 4) and (m, 3, 4) are at most 5 degrees apart, shape (n, m)."""
    trace = np.einsum("aij,bij->ab", X_a[..., :3], X_b[..., :3])
    same: NDArray[np.bool_] = trace >= 1.0 + 2.0 * np.cos(np.radians(5.0))
    return same
