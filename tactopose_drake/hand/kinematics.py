"""The kinematics of a hand by a plant that holds it alone."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, JacobianWrtVariable

from tactopose_drake.core.validation import FARTHEST, FloatArray
from tactopose_drake.hand.geometry import BodySpheres
from tactopose_drake.hand.joint_paths import JointPaths


class HandKinematics:
    """Where the parts of a hand are, and how they move, at the joint positions that it was last moved to.

    It is scratch, with a plant's context of its own: a system keeps one in a cache entry, and what copies the system's
    context copies that.
    """

    def __init__(self, plant: MultibodyPlant, frame: Frame) -> None:
        """Keeps a reference to the plant; begins at its default positions.

        Args:
            plant: finalized plant of the hand alone; not the simulator's.
            frame: that everything is expressed in, mostly the palm's P.
        """
        self._plant, self._frame, self._context = plant, frame, plant.CreateDefaultContext()
        self._paths = JointPaths(plant, frame)
        self._known = np.ones(plant.num_bodies(), dtype=np.bool_)
        self._farthest = _farthest(plant)

    def __deepcopy__(self, memo: Any) -> HandKinematics:
        copied = copy.copy(self)
        copied._context = self._context.Clone()
        return copied

    def move(self, q: FloatArray) -> None:
        """Sets the positions, shape (nq,), rad; NaN where one is not known, nor is one that slides out of reach."""
        told = np.isfinite(q) & (np.abs(q) <= self._farthest)
        self._known = self._paths.known(np.where(told, q, np.nan))
        self._plant.SetPositions(self._context, np.where(told, q, 0.0))

    def is_known(self, bodies: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Whether all joints between the frame and the bodies of these indices (k,) are known, shape (k,)."""
        return self._known[bodies]

    def poses(self, frames: Mapping[str, Frame]) -> dict[str, RigidTransform]:
        """The poses of those frames, by name, whose joints are known."""
        return {
            name: self._plant.CalcRelativeTransform(self._context, self._frame, frame)
            for name, frame in frames.items()
            if self._known[int(frame.body().index())]
        }

    def positions(self, spheres: BodySpheres) -> FloatArray:
        """Centres of the spheres that fill the hand, shape (h, 3), m, whether known or not."""
        X_FW = self._frame.CalcPoseInWorld(self._context).inverse()
        X_WB = self._plant.get_body_poses_output_port().Eval(self._context)
        p_FH: FloatArray = X_FW.multiply(spheres.positions(X_WB).T).T
        return p_FH

    def jacobian(self, frame: Frame, p_FC: FloatArray) -> FloatArray:
        """How the joints' velocities move a part and its point at p_FC, shape (3,), m, in that frame.

        Returns:
            Shape (6, nv): of the angular velocity, then of the point's, in the kinematics' own frame.
        """
        J: FloatArray = self._plant.CalcJacobianSpatialVelocity(
            self._context, JacobianWrtVariable.kV, frame, p_FC, self._frame, self._frame
        )
        return J

    def velocity(self, frame: Frame, v: FloatArray) -> FloatArray:
        """Spatial velocity [w, v] of a part at the origin of the kinematics' own frame, shape (6,), rad/s and m/s.

        Args:
            frame: on the part.
            v: of the joints, shape (nv,), rad/s.
        """
        p_FP = self._plant.CalcPointsPositions(self._context, self._frame, np.zeros(3), frame)[:, 0]
        J = self._plant.CalcJacobianSpatialVelocity(
            self._context, JacobianWrtVariable.kV, frame, p_FP, self._frame, self._frame
        )
        velocity: FloatArray = J @ v
        return velocity


def _farthest(plant: MultibodyPlant) -> FloatArray:
    """Up to where each position may be, shape (nq,): a joint that slides takes no finger to where no contact can be."""
    farthest = np.full(plant.num_positions(), np.inf)
    for index in plant.GetJointIndices():
        joint = plant.get_joint(index)
        if joint.type_name() == "prismatic":
            farthest[joint.position_start()] = 0.5 * FARTHEST
    return farthest
