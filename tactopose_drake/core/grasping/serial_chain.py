"""Forward kinematics of one finger for whole batches of joint positions."""

from dataclasses import dataclass

import numpy as np

from tactopose_drake.core import poses
from tactopose_drake.core.validation import FloatArray


@dataclass(frozen=True, eq=False)
class SerialChain:
    """Revolute joints in a row from the palm P to a sensor frame S; some may follow others.

    The chain's own positions q, shape (m,), are those of its actuated joints; all k joints turn by `coupling @ q`.

    Attributes:
        X_parent: pose of each joint's frame in the body before it (in P for the first), shape (k, 3, 4).
        axis: unit axis of each joint in its frame, shape (k, 3).
        X_child: pose of the body behind each joint in the frame that the joint turns, shape (k, 3, 4).
        coupling: shape (k, m).
        X_last_sensor: pose of S in the last body, shape (3, 4).
        lower: least actuated positions, shape (m,), rad.
        upper: largest actuated positions, shape (m,), rad.
        bodies: names of the k bodies behind the joints.
    """

    X_parent: FloatArray
    axis: FloatArray
    X_child: FloatArray
    coupling: FloatArray
    X_last_sensor: FloatArray
    lower: FloatArray
    upper: FloatArray
    bodies: tuple[str, ...]

    def body_poses(self, q: FloatArray) -> FloatArray:
        """X_PB of the body behind each joint, shape (B, k, 3, 4), for positions q (B, m), rad."""
        return self._sweep(q)[0]

    def sensor_poses(self, q: FloatArray) -> FloatArray:
        """X_PS, shape (B, 3, 4), for positions q (B, m), rad."""
        return poses.compose(self._sweep(q)[0][:, -1], self.X_last_sensor)

    def point_jacobians(self, q: FloatArray, p_SQ: FloatArray) -> tuple[FloatArray, FloatArray]:
        """A point fixed in S, in P, and how it moves with the joints.

        Args:
            q: positions, shape (B, m), rad.
            p_SQ: the point, shape (3,), m.

        Returns:
            p_PQ, shape (B, 3), m, and J with v_PQ = J dq/dt, shape (B, 3, m), m/rad.
        """
        X_PB, axis_P, p_PJ = self._sweep(q)
        X_PS = poses.compose(X_PB[:, -1], self.X_last_sensor)
        p_PQ = X_PS[:, :, :3] @ p_SQ + X_PS[:, :, 3]
        per_joint = np.cross(axis_P, p_PQ[:, None] - p_PJ)  # (B, k, 3)
        return p_PQ, np.einsum("bki,km->bim", per_joint, self.coupling)

    def _sweep(self, q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Poses of the bodies (B, k, 3, 4), axes (B, k, 3) and origins (B, k, 3) of the joints, all in P."""
        angles = q @ self.coupling.T
        X_PB, axis_P, p_PJ = [], [], []
        X = np.broadcast_to(np.eye(3, 4), (len(q), 3, 4))
        for i, axis in enumerate(self.axis):
            X = poses.compose(X, self.X_parent[i])
            axis_P.append(X[:, :, :3] @ axis)
            p_PJ.append(X[:, :, 3])
            turn = poses.make_poses(poses.exp_so3(angles[:, i, None] * axis), np.zeros((len(q), 3)))
            X = poses.compose(poses.compose(X, turn), self.X_child[i])
            X_PB.append(X)
        return np.stack(X_PB, axis=1), np.stack(axis_P, axis=1), np.stack(p_PJ, axis=1)
