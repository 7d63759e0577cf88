"""The compiled inner loops of forward kinematics, over joint positions, joints and spheres."""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import kernel
from tactopose_drake.core.kernel_types import Floats1, Floats2, Floats3, Floats4, Longs1, OutFloats3, OutFloats4
from tactopose_drake.core.kernels.pose_kernels import compose_one, retract_one
from tactopose_drake.core.kernels.sorting_kernels import copy_matrix


class Joints(NamedTuple):
    """The constants of k joints in a row; all arrays are read-only.

    Attributes:
        X_parent: pose of each joint's frame in the body before it, shape (k, 3, 4), m.
        axis: unit axis of each in its frame, shape (k, 3).
        X_child: pose of the body behind each in the frame that it moves, shape (k, 3, 4), m.
        slides: 1 for a prismatic joint, 0 for a revolute one, shape (k,).
    """

    X_parent: Floats3
    axis: Floats2
    X_child: Floats3
    slides: Floats1


@kernel
def sweep(joints: Joints, positions: Floats2, X_PB: OutFloats4, axis_P: OutFloats3, p_PJ: OutFloats3) -> None:
    """Fills, for positions (B, k), the bodies' poses (B, k, 3, 4), and the joints' axes and origins (B, k, 3), in P."""
    joint, moved, increment = np.empty((3, 4)), np.empty((3, 4)), np.empty(6)
    for b in range(positions.shape[0]):
        for i in range(positions.shape[1]):
            if i == 0:
                copy_matrix(joints.X_parent[0], joint)
            else:
                compose_one(X_PB[b, i - 1], joints.X_parent[i], joint)
            turn = positions[b, i] * (1.0 - joints.slides[i])
            slide = positions[b, i] * joints.slides[i]
            for a in range(3):
                x, y, z = joints.axis[i, 0], joints.axis[i, 1], joints.axis[i, 2]
                axis_P[b, i, a] = joint[a, 0] * x + joint[a, 1] * y + joint[a, 2] * z
                p_PJ[b, i, a] = joint[a, 3]
                increment[a] = turn * joints.axis[i, a]
                increment[3 + a] = slide * axis_P[b, i, a]
            retract_one(joint, increment, moved)
            compose_one(moved, joints.X_child[i], X_PB[b, i])


@kernel
def place_points(X_PB: Floats4, body: Longs1, p_BH: Floats2, p_PH: OutFloats3) -> None:
    """Transforms points (s, 3), each fixed on one of k bodies at poses (B, k, 3, 4), to P, shape (B, s, 3)."""
    for b in range(X_PB.shape[0]):
        for s in range(len(body)):
            X, x, y, z = X_PB[b, body[s]], p_BH[s, 0], p_BH[s, 1], p_BH[s, 2]
            for a in range(3):
                p_PH[b, s, a] = X[a, 0] * x + X[a, 1] * y + X[a, 2] * z + X[a, 3]
