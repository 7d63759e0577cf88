"""The kinematics of a hand, computed in a plant of the hand alone."""

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
from tactopose_drake.hand.reading_ranges import ReadingRanges


class HandKinematics:
    """Poses, positions and velocities of a hand's parts at the joint positions of the last `move`.

    It holds a plant context as scratch. A system keeps one in a cache entry, so that it is copied with the system's
    context.
    """

    def __init__(self, plant: MultibodyPlant, frame: Frame) -> None:
        """Keeps a reference to the plant; starts at its default positions.

        Args:
            plant: finalized plant of the hand alone; not the simulator's.
            frame: frame in which everything is expressed, usually the palm's P.
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
        """Sets the positions, shape (nq,), rad; NaN where unknown."""
        self._set(q, np.isfinite(q))

    def move_to_readings(self, q: FloatArray) -> None:
        """Like `move`, for encoder readings: a reading far beyond the joint's limits counts as unknown."""
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
        """Why the pose of a part is unknown: the joint with an impossible reading, or that a position is unknown."""
        between = self._paths.between(int(frame.body().index()))
        beyond = between[~self._told[between]]
        faults = [self._ranges.fault(int(place), self._q[place]) for place in beyond]
        return next(filter(None, faults), "a joint position is not known")

    def poses(self, frames: Mapping[str, Frame]) -> dict[str, RigidTransform]:
        """The poses of the frames that are known, by name."""
        return {
            name: self._plant.CalcRelativeTransform(self._context, self._frame, frame)
            for name, frame in frames.items()
            if self._known[int(frame.body().index())]
        }

    def positions(self, spheres: BodySpheres) -> FloatArray:
        """Centres of the spheres that fill the hand, shape (h, 3), m, including those whose pose is unknown."""
        X_FW = self._frame.CalcPoseInWorld(self._context).inverse()
        X_WB = self._plant.get_body_poses_output_port().Eval(self._context)
        p_FH: FloatArray = X_FW.multiply(spheres.positions(X_WB).T).T
        return p_FH

    def jacobian(self, frame: Frame, p_FC: FloatArray) -> FloatArray:
        """Jacobian of a part's spatial velocity by the joints' velocities, at its point p_FC, shape (3,), m.

        Returns:
            Shape (6, nv): angular velocity, then the point's velocity, in the kinematics' own frame.
        """
        J: FloatArray = self._plant.CalcJacobianSpatialVelocity(
            self._context, JacobianWrtVariable.kV, frame, p_FC, self._frame, self._frame
        )
        return J

    def velocity(self, frame: Frame, v: FloatArray) -> FloatArray:
        """Spatial velocity [w, v] of a part at the origin of the kinematics' own frame, shape (6,), rad/s and m/s.

        Args:
            frame: a frame on the part.
            v: velocities of the joints, shape (nv,), rad/s.
        """
        p_FP = self._plant.CalcPointsPositions(self._context, self._frame, np.zeros(3), frame)[:, 0]
        velocity: FloatArray = self.jacobian(frame, p_FP) @ v
        return velocity


class JointPaths:
    """Tells which bodies' poses are known when some joint positions are not (NaN)."""

    def __init__(self, plant: MultibodyPlant, frame: Frame) -> None:
        """Finds the joints between a frame and every body.

        Args:
            plant: finalized plant of the hand alone.
            frame: the frame in which poses are expressed.
        """
        path: dict[int, set[int]] = {int(plant.world_body().index()): set()}
        joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
        while joints:
            joint = next(joint for joint in joints if int(joint.parent_body().index()) in path)
            joints.remove(joint)
            own = range(joint.position_start(), joint.position_start() + joint.num_positions())
            path[int(joint.child_body().index())] = path[int(joint.parent_body().index())] | set(own)
        to_frame = path[int(frame.body().index())]
        self._needed = np.zeros((plant.num_bodies(), plant.num_positions()), dtype=np.bool_)
        for body, positions in path.items():
            self._needed[body, sorted(positions ^ to_frame)] = True
        self._all = np.ones(plant.num_bodies(), dtype=np.bool_)
        self._all.setflags(write=False)

    def between(self, body: int) -> NDArray[np.intp]:
        """Indices of the positions on which a body's pose in the frame depends, shape (k,)."""
        return np.flatnonzero(self._needed[body])

    def known(self, q: FloatArray) -> NDArray[np.bool_]:
        """Whether each body's pose in the frame is known, shape (number of bodies,).

        Args:
            q: positions, shape (nq,), rad; NaN where unknown.
        """
        unknown = ~np.isfinite(q)
        return np.asarray(~self._needed[:, unknown].any(axis=1)) if unknown.any() else self._all
