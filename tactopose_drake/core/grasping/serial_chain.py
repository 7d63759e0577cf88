"""Forward kinematics of a finger for batches of joint positions."""

import functools
from dataclasses import dataclass

import numpy as np

from tactopose_drake.core import poses
from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.grasping import chain_kernels
from tactopose_drake.core.validation import FloatArray

SLIDING_ARM = 0.05
"""Arm at which a revolute joint moves its load as a prismatic one does, m: about a finger's length."""


@dataclass(frozen=True, eq=False)
class SerialChain:
    """Joints in series from the palm P to a sensor frame S; some may be coupled to others.

    The chain's positions q, shape (m,), are those of its actuated joints; the positions of all k joints are
    `coupling @ q + offset`.

    Attributes:
        X_parent: pose of each joint's frame in the body before it (in P for the first), shape (k, 3, 4).
        axis: unit axis of each joint in its frame, shape (k, 3).
        X_child: pose of the body behind each joint in the frame that the joint moves, shape (k, 3, 4).
        coupling: shape (k, m).
        X_last_sensor: pose of S in the last body, shape (3, 4).
        lower: least actuated positions, shape (m,), rad or m.
        upper: largest actuated positions, shape (m,), rad or m.
        bodies: names of the k bodies behind the joints.
        sliding: indices of the prismatic joints among the k; the others are revolute.
        offset: positions of the joints if all q are zero, shape (k,), rad or m.
    """

    X_parent: FloatArray
    axis: FloatArray
    X_child: FloatArray
    coupling: FloatArray
    X_last_sensor: FloatArray
    lower: FloatArray
    upper: FloatArray
    bodies: tuple[str, ...]
    sliding: frozenset[int] = frozenset()
    offset: FloatArray | float = 0.0

    @property
    def arms(self) -> FloatArray:
        """The motion of each actuated joint that counts as 1 rad, shape (m,): 1, or `SLIDING_ARM` if it slides."""
        slides = [any(self.coupling[i, k] for i in self.sliding) for k in range(self.coupling.shape[1])]
        return np.where(slides, SLIDING_ARM, 1.0)

    def body_poses(self, q: FloatArray) -> FloatArray:
        """X_PB of the body behind each joint, shape (B, k, 3, 4), for positions q (B, m), rad or m."""
        return self._sweep(q)[0]

    def sensor_poses(self, q: FloatArray) -> FloatArray:
        """X_PS, shape (B, 3, 4), for positions q (B, m), rad or m."""
        return self.all_poses(q)[1]

    def all_poses(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """X_PB and X_PS, as of `body_poses` and `sensor_poses`."""
        X_PB = self.body_poses(q)
        return X_PB, poses.compose(X_PB[:, -1], self.X_last_sensor)

    def point_jacobians(self, q: FloatArray, p_SQ: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The position in P of a point fixed in S, and its Jacobian.

        Args:
            q: positions, shape (B, m), rad or m.
            p_SQ: the point, shape (3,), m.

        Returns:
            p_PQ, shape (B, 3), m, and J with v_PQ = J dq/dt, shape (B, 3, m), m/rad or m/m.
        """
        X_PB, axis_P, p_PJ = self._sweep(q)
        X_PS = poses.compose(X_PB[:, -1], self.X_last_sensor)
        p_PQ = X_PS[:, :, :3] @ p_SQ + X_PS[:, :, 3]
        per_joint = np.cross(axis_P, p_PQ[:, None] - p_PJ)  # (B, k, 3)
        for i in self.sliding:
            per_joint[:, i] = axis_P[:, i]
        return p_PQ, np.einsum("bki,km->bim", per_joint, self.coupling)

    def _sweep(self, q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Poses of the bodies (B, k, 3, 4), axes (B, k, 3) and origins (B, k, 3) of the joints, all in P."""
        positions = np.ascontiguousarray(q @ self.coupling.T + self.offset)
        X_PB, axis_P, p_PJ = (np.empty((*positions.shape, *shape)) for shape in ((3, 4), (3,), (3,)))
        chain_kernels.sweep(self._joints, positions, X_PB, axis_P, p_PJ)
        return X_PB, axis_P, p_PJ

    @functools.cached_property
    def _joints(self) -> chain_kernels.Joints:
        """The joints in the form that the kernel reads."""
        slides = np.isin(np.arange(len(self.axis)), list(self.sliding)).astype(np.float64)
        return chain_kernels.Joints(*map(read_only, (self.X_parent, self.axis, self.X_child, slides)))
