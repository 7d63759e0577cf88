"""What the object was moved by lately, to bring what was seen then to where it is now.

A pose of vision comes late. Its time's belief is gone, but how the object moved since then is known from the
fingertips, alike for every mode: by that motion the pose is brought here, and what is unknown of the motion is added to
its covariance. What the touch has told of the motion meanwhile is not counted; it is little beside the error of vision.
This costs one step, where a replay of all touch since then would cost as many updates as vision is late.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from tactopose_drake.core.poses import compose, skew
from tactopose_drake.core.tracking.object_motion import Motion
from tactopose_drake.core.tracking.pose_measurement import PoseMeasurement
from tactopose_drake.core.validation import FloatArray


@dataclasses.dataclass(frozen=True, eq=False)
class MotionHistory:
    """The latest motions, oldest first; motion i went from times[i] to times[i + 1]."""

    times: tuple[float, ...]
    motions: tuple[Motion, ...] = ()

    def followed_by(self, motion: Motion, time: float, length: float) -> MotionHistory:
        """The history with the motion up to a time, s, without what ended more than a length, s, before that."""
        first = next((i for i, end in enumerate(self.times[1:]) if end >= time - length), len(self.motions))
        return MotionHistory((*self.times[first:], time), (*self.motions[first:], motion))

    def bring_here(self, seen: PoseMeasurement) -> PoseMeasurement | None:
        """The measurement as of the history's end; None where the history does not reach back to its time.

        Of the motion during which it was taken the later part counts.
        """
        if not self.times[0] <= seen.time <= self.times[-1]:
            return None
        X_PO, covariance = seen.X_PO, seen.covariance
        for start, end, motion in zip(self.times, self.times[1:], self.motions, strict=False):
            if end > seen.time:
                share = (end - max(start, seen.time)) / (end - start)
                part = Motion(share * motion.twist, share * motion.covariance)
                X_PO, covariance = move(X_PO[None], covariance[None], part)
                X_PO, covariance = X_PO[0], covariance[0]
        return PoseMeasurement(self.times[-1], X_PO, covariance)


def move(X_PO: FloatArray, covariance: FloatArray, motion: Motion) -> tuple[FloatArray, FloatArray]:
    """Poses (n, 3, 4) and covariances (n, 6, 6) of their increments, after a motion.

    With X exp'd by the increment (w, v) and the motion (E, t) acting from the left, w stays and v becomes E v; a small
    twist (r, s) after it is the increment (R^T r, s + r x p).
    """
    moved = compose(motion.pose, X_PO)
    turn = turn_of_increments(motion)
    M = np.zeros((len(moved), 6, 6))
    M[:, :3, :3], M[:, 3:, :3], M[:, 3:, 3:] = np.swapaxes(moved[:, :, :3], 1, 2), -skew(moved[:, :, 3]), np.eye(3)
    return moved, turn @ covariance @ turn.T + M @ motion.covariance @ np.swapaxes(M, 1, 2)


def turn_of_increments(motion: Motion) -> FloatArray:
    """What a motion makes of increments, shape (6, 6)."""
    turn = np.eye(6)
    turn[3:, 3:] = motion.pose[:, :3]
    return turn
