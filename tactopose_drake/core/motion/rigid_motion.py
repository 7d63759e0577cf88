"""A small rigid motion of the object in the hand, and its effect on poses and their covariances.

A pose from vision arrives late, as an out-of-sequence measurement. The belief of its time is gone, but the fingertips
tell how the object has moved since, the same for every mode: the pose is predicted to the present by that motion, whose
error is added to its covariance. What the touch has told about the motion meanwhile is not used; it is small beside the
error of vision. This costs one step, whereas replaying all touch since then would cost as many updates as vision is
late.
"""

from __future__ import annotations

import dataclasses
import functools

import numpy as np

from tactopose_drake.core.kernels.pose_kernels import retract
from tactopose_drake.core.motion import prediction_kernels
from tactopose_drake.core.poses import skew
from tactopose_drake.core.validation import FloatArray

_ORIGIN = np.eye(3, 4)[None]


@dataclasses.dataclass(frozen=True, eq=False)
class Motion:
    """A small rigid motion of the object in P: a rotation about the origin of P followed by a translation.

    Attributes:
        twist: [rotation vector, translation], shape (6,), rad and m.
        covariance: of the twist, shape (6, 6).
    """

    twist: FloatArray
    covariance: FloatArray

    @functools.cached_property
    def pose(self) -> FloatArray:
        """The motion as a pose to multiply from the left, X_PO_after = pose X_PO_before, shape (3, 4)."""
        pose = np.empty((3, 4))
        retract(_ORIGIN, self.twist[None], pose[None])
        return pose

    @functools.cached_property
    def adjoint(self) -> FloatArray:
        """Maps a small twist before the motion to the equivalent one after it, shape (6, 6)."""
        pose = self.pose
        adjoint = np.zeros((6, 6))
        adjoint[:3, :3] = adjoint[3:, 3:] = pose[:, :3]
        adjoint[3:, :3] = skew(pose[:, 3]) @ pose[:, :3]
        return adjoint

    @functools.cached_property
    def increment_map(self) -> FloatArray:
        """Maps increments (w, v) from a pose before the motion to those after it, shape (6, 6): w stays, v rotates."""
        turn = np.eye(6)
        turn[3:, 3:] = self.pose[:, :3]
        return turn

    def of_poses(self, X_PO: FloatArray) -> FloatArray:
        """Applies the motion to poses (..., 3, 4)."""
        moved: FloatArray = self.pose[:, :3] @ X_PO
        moved[..., 3] += self.pose[:, 3]
        return moved


@dataclasses.dataclass(frozen=True, eq=False)
class MotionHistory:
    """The latest motions, oldest first; motion i went from times[i] to times[i + 1]."""

    times: tuple[float, ...]
    motions: tuple[Motion, ...] = ()

    def followed_by(self, motion: Motion, time: float, length: float) -> MotionHistory:
        """Appends the motion up to a time, s, and drops those that ended more than `length`, s, before it."""
        first = next((i for i, end in enumerate(self.times[1:]) if end >= time - length), len(self.motions))
        return MotionHistory((*self.times[first:], time), (*self.motions[first:], motion))

    def predict(self, time: float, X_PO: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """Predicts a pose (3, 4) at a time, s, and its covariance (6, 6) to the history's end.

        Of the motion during which the pose was measured, the later part counts. Returns None if the history does not
        reach back so far.
        """
        if not self.times[0] <= time <= self.times[-1]:
            return None
        for start, end, motion in zip(self.times, self.times[1:], self.motions, strict=False):
            if end > time:
                share = (end - max(start, time)) / (end - start)
                part = Motion(share * motion.twist, share * motion.covariance)
                X_PO, covariance = predict_poses(X_PO[None], covariance[None], part)
                X_PO, covariance = X_PO[0], covariance[0]
        return X_PO, covariance


def predict_poses(X_PO: FloatArray, covariance: FloatArray, motion: Motion) -> tuple[FloatArray, FloatArray]:
    """Moves poses (n, 3, 4) and the covariances (n, 6, 6) of their increments.

    If the motion (E, t) acts on a pose (R, p) from the left, its increment (w, v) becomes (w, E v); a small twist
    (r, s) after it is the increment (R^T r, s + r x p).
    """
    return carry(X_PO, covariance, np.empty((len(X_PO), 6, 0)), motion)[:2]


def error_of_motion(X_PO: FloatArray, motion: Motion) -> FloatArray:
    """Covariance (n, 6, 6) of the increments at poses (n, 3, 4) due to the error of the motion that led there."""
    return predict_poses(X_PO, np.zeros((len(X_PO), 6, 6)), Motion(np.zeros(6), motion.covariance))[1]


def carry(
    X_PO: FloatArray, covariance: FloatArray, cross: FloatArray, motion: Motion
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The same as `predict_poses`, with cross-covariances (n, 6, m) of the increments and other variables."""
    X_after, before = motion.of_poses(X_PO), (np.ascontiguousarray(covariance), np.ascontiguousarray(cross))
    after = np.empty_like(before[0]), np.empty_like(before[1])
    prediction_kernels.carry(motion.increment_map, motion.covariance, X_after, *before, *after)
    return X_after, *after


def three_each(rotation: float, translation: float) -> FloatArray:
    """Variances (6,) of an increment with these variances of each rotation and each translation."""
    return np.array([rotation, rotation, rotation, translation, translation, translation])
