"""Poses and covariances as messages of ROS 2 have them."""

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
    """Of the position and a rotation about P's axes, shape (36,), from that of (w, v) with w about O's axes."""
    turn = _turn(R_PO)
    return (turn @ covariance @ turn.T).reshape(-1)


def increment_covariance(of_ros: FloatArray, R_PO: FloatArray) -> FloatArray:
    """The other way: of (w, v), shape (6, 6)."""
    turn = _turn(R_PO)
    covariance: FloatArray = turn.T @ np.reshape(of_ros, (6, 6)) @ turn
    return covariance


def _turn(R_PO: FloatArray) -> FloatArray:
    """From (w, v), with w about O's axes, to the position and a rotation about P's."""
    turn = np.zeros((6, 6))
    turn[:3, 3:], turn[3:, :3] = np.eye(3), R_PO
    return turn
