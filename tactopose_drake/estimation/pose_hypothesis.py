"""One pose that explains a touch, with its probability and covariance."""

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
        X_PO: the object's pose in the palm frame: the mean of its mode, or a pose nearer to the mode's minimum if the
            mean's cost is higher than the minimum by more than 0.3. Each access returns a new copy.
        cost: its negative log likelihood up to a constant: half the sum of squared whitened residuals.
        probability: posterior weight among the hypotheses.
        covariance: (6, 6) of the increment (w, v): R_PO = R_hat exp(w), p_PO = p_hat + v; rad, m (v in P).
        free_directions: increments that the touch does not determine, orthonormal rows (f, 6); f = 0 if the pose is
            determined. Along them the pose is the prior's, or arbitrary.
        explains_touch: whether noise plausibly explains the contacts' residuals at this pose, apart from a plausible
            number of false contacts.
        inlier_probability: probability of each contact, shape (k,), and then of each patch, that it is as measured if
            this is the pose; 1 for a pad that feels nothing.
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
                array = array.view()  # The caller's own array stays writable.
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
        """The object's pose X_WO and its covariance (6, 6) in the world, for a known pose X_WP of the palm.

        The covariance is that of the increment (w, v) with v in W: R_WO = R_hat exp(w), p_WO = p_hat + v.

        Raises:
            InvalidInputError: if X_WP is no RigidTransform.
        """
        instance_of("X_WP", X_WP, RigidTransform)
        turn = np.eye(6)
        turn[3:, 3:] = X_WP.rotation().matrix()
        return X_WP @ self.X_PO, turn @ self.covariance @ turn.T

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Restores the value that `to_dict` converted, to the last bit.

        Raises:
            InvalidInputError: for an unknown or missing name, or an invalid value.
        """
        return super().from_dict(read_fields(cls, data, _OF_HYPOTHESIS))


# RigidTransform is mutable, so the property returns a copy. It remains a field of the dataclass.
setattr(  # noqa: B010 (a field has a type of its own)
    PoseHypothesis,
    "X_PO",
    property(
        lambda told: RigidTransform(vars(told)["X_PO"]),
        lambda told, X_PO: vars(told).update(X_PO=X_PO),
        doc="The object's pose in the palm frame; a new copy.",
    ),
)


def whole_sigmas(covariance: FloatArray) -> tuple[float, float]:
    """Standard deviations of a rotation and a translation over all directions together, rad and m."""
    variance = np.diag(covariance)
    return math.sqrt(float(variance[:3].sum())), math.sqrt(float(variance[3:].sum()))
