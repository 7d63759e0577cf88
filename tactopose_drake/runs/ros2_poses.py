"""Conversion of poses and covariances to and from messages of ROS 2."""

import numpy as np
from pydrake.math import RigidTransform

from tactopose_drake.core.validation import FloatArray


def ros_pose(X: RigidTransform) -> dict[str, dict[str, float]]:
    """A geometry_msgs/Pose."""
    w, *xyz = X.rotation().ToQuaternion().wxyz().tolist()
    return {"position": ros_xyz(X.translation()), "orientation": {**dict(zip("xyz", xyz, strict=True)), "w": w}}


def ros_xyz(vector: FloatArray) -> dict[str, float]:
    """A geometry_msgs/Point or Vector3."""
    return dict(zip("xyz", vector.tolist(), strict=True))


def ros_covariance(covariance: FloatArray, R_PO: FloatArray) -> FloatArray:
    """Covariance of position and rotation about P's axes, shape (36,), from that of (w, v) with w about O's axes."""
    turn = _turn(R_PO)
    return (turn @ covariance @ turn.T).reshape(-1)


def increment_covariance(of_ros: FloatArray, R_PO: FloatArray) -> FloatArray:
    """Covariance of (w, v), with w about O's axes, shape (6, 6), from that of position and rotation about P's axes."""
    turn = _turn(R_PO)
    covariance: FloatArray = turn.T @ np.reshape(of_ros, (6, 6)) @ turn
    return covariance


def _turn(R_PO: FloatArray) -> FloatArray:
    """The matrix from (w, v), with w about O's axes, to position and rotation about P's axes."""
    turn = np.zeros((6, 6))
    turn[:3, 3:], turn[3:, :3] = np.eye(3), R_PO
    return turn
