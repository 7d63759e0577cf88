"""One pose that explains a touch, and how far it can be trusted."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, Self

import numpy as np
from pydrake.math import RigidTransform

from tactopose_drake.core.geometry_checks import pose_matrix
from tactopose_drake.core.plain_values import PlainValue, numbers
from tactopose_drake.core.validation import FloatArray, finite_array, flag, instance_of
from tactopose_drake.estimation.plain_data import (
    Readers,
    read_covariance,
    read_fields,
    read_number,
    read_share,
    read_shares,
)

_ARRAYS = ("covariance", "free_directions", "inlier_probability")
_OF_HYPOTHESIS: Readers = {
    "X_PO": lambda name, value: RigidTransform(pose_matrix(name, value)),
    "cost": read_number,
    "probability": read_share,
    "covariance": read_covariance,
    "free_directions": lambda name, value: finite_array(name, value, (None, 6), (0,)).reshape(-1, 6),
    "explains_touch": flag,
    "inlier_probability": read_shares,
}


@dataclasses.dataclass(frozen=True, eq=False)
class PoseHypothesis(PlainValue):
    """One pose that explains the touch; its arrays are read-only.

    Attributes:
        X_PO: the object's pose in the palm frame: the mean of its mode, as far as that explains the touch about as
            well as the mode's minimum does (its cost is higher by 0.3 at the most). Each time a new one, which is not
            the hypothesis' own.
        cost: its negative log likelihood up to a constant: half the sum of squared whitened residuals.
        probability: posterior weight among the hypotheses.
        covariance: (6, 6) of the increment (w, v): R_PO = R_hat exp(w), p_PO = p_hat + v; rad, m (v in P).
        free_directions: increments that the touch does not determine, orthonormal rows (f, 6); f = 0 where the pose is
            determined. Along them the pose is the prior's, or arbitrary.
        explains_touch: whether noise may leave the contacts' residuals as large as this pose does, those of as many
            false contacts as there may well be left out.
        inlier_probability: the probability of each contact, shape (k,), to be what it claims to be if this is the pose,
            then that of each patch; 1 for a pad that feels nothing.
    """

    X_PO: RigidTransform
    cost: float
    probability: float
    covariance: FloatArray
    free_directions: FloatArray
    explains_touch: bool = True
    inlier_probability: FloatArray = dataclasses.field(default_factory=lambda: np.ones(0))

    def __post_init__(self) -> None:
        for name in _ARRAYS:
            array = getattr(self, name)
            if isinstance(array, np.ndarray) and array.flags.writeable:
                array = array.view()  # Whoever has made it may go on writing.
                array.setflags(write=False)
                object.__setattr__(self, name, array)

    def __repr__(self) -> str:
        wxyz = numbers(self.X_PO.rotation().ToQuaternion().wxyz(), 3)
        turn, move = whole_sigmas(self.covariance)
        free = f", {len(self.free_directions)} free directions" if len(self.free_directions) else ""
        return (
            f"<PoseHypothesis {self.probability:.1%}: p_PO {numbers(1e3 * self.X_PO.translation(), 1)} mm, "
            f"quaternion wxyz {wxyz}, ± {1e3 * move:.1f} mm, ± {math.degrees(turn):.1f} deg{free}>"
        )

    def in_world(self, X_WP: RigidTransform) -> tuple[RigidTransform, FloatArray]:
        """The object's pose X_WO and its covariance (6, 6) in the world, where the palm is known to be at X_WP.

        The covariance is of the increment (w, v) as here, but with v in W: R_WO = R_hat exp(w), p_WO = p_hat + v.

        Raises:
            InvalidInputError: a pose of another type.
        """
        instance_of("X_WP", X_WP, RigidTransform)
        turn = np.eye(6)
        turn[3:, 3:] = X_WP.rotation().matrix()
        return X_WP @ self.X_PO, turn @ self.covariance @ turn.T

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """What `to_dict` has made it of, to the last bit.

        Raises:
            InvalidInputError: for an unknown or missing name, or a value that cannot be one.
        """
        return super().from_dict(read_fields(cls, data, _OF_HYPOTHESIS))


# A transform can be changed: who asks for it gets a copy. As a field it is part of the value all the same.
setattr(  # noqa: B010 (a field has a type of its own)
    PoseHypothesis,
    "X_PO",
    property(
        lambda told: RigidTransform(vars(told)["X_PO"]),
        lambda told, X_PO: vars(told).update(X_PO=X_PO),
        doc="The object's pose in the palm frame; a new one.",
    ),
)


def whole_sigmas(covariance: FloatArray) -> tuple[float, float]:
    """Standard deviations of a rotation and a translation over all directions together, rad and m."""
    variance = np.diag(covariance)
    return math.sqrt(float(variance[:3].sum())), math.sqrt(float(variance[3:].sum()))
