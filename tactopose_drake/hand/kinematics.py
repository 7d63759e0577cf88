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

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.hand.geometry import BodySpheres
from tactopose_drake.hand.joint_paths import JointPaths
from tactopose_drake.hand.reading_ranges import ReadingRanges


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
        self._ranges, self._q = ReadingRanges.of(plant), plant.GetPositions(self._context)
        self._told = np.ones(len(self._q), dtype=np.bool_)

    def __deepcopy__(self, memo: Any) -> HandKinematics:
        copied = copy.copy(self)
        copied._context = self._context.Clone()
        return copied

    def move(self, q: FloatArray) -> None:
        """Sets the positions, shape (nq,), rad; NaN where one is not known."""
        self._set(q, np.isfinite(q))

    def move_to_readings(self, q: FloatArray) -> None:
        """As `move`, by what encoders read: what is far beyond a joint's limits is not known."""
        self._set(q, self._ranges.told(q))

    def _set(self, q: FloatArray, told: NDArray[np.bool_]) -> None:
        self._q, self._told = np.array(q), told
        self._known = self._paths.known(np.where(told, q, np.nan))
        self._plant.SetPositions(self._context, np.where(told, q, 0.0))

    def is_known(self, bodies: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Whether all joints between the frame and the bodies of these indices (k,) are known, shape (k,)."""
        return self._known[bodies]

    @property
    def knows_all(self) -> bool:
        """Whether all joints are known."""
        return bool(self._told.all())

    def fault(self, frame: Frame) -> str:
        """Why the pose of a part is not known: the joint whose reading cannot be true, or that there is none."""
        between = self._paths.between(int(frame.body().index()))
        beyond = between[~self._told[between]]
        faults = [self._ranges.fault(int(place), self._q[place]) for place in beyond]
        return next(filter(None, faults), "a joint position is not known")

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
        velocity: FloatArray = self.jacobian(frame, p_FP) @ v
        return velocity
