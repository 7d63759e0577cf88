"""The errors of a hand as one vector: which they are, how large they may be, and what they are called."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import PrismaticJoint

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.hand.encoder_offsets import SLIDE
from tactopose_drake.hand.hand_config import HandUncertainty
from tactopose_drake.hand.hand_in_plant import Hand, measured_joints
from tactopose_drake.hand.joint_matrices import joint_matrix
from tactopose_drake.hand.joint_paths import JointPaths

_AXES = ("x", "y", "z")


class FingertipErrors(NamedTuple):
    """What one finger's fingertip and sensor are off by.

    Attributes:
        bias: what the sensor reads without a touch, [m, f], shape (6,), N m and N.
        drift: by which that grows, shape (6,), N m/s and N/s.
        radius: by how much the fingertip is thicker than told, m.
        mounting: of S with the fingertip on the finger: rotation vector and translation in S as told, shape (6,), rad
            and m.
    """

    bias: FloatArray
    drift: FloatArray
    radius: float
    mounting: FloatArray


_SIZES = {"bias": 6, "drift": 6, "radius": 1, "mounting": 6}


@dataclasses.dataclass(frozen=True, eq=False)
class HandErrors:
    """Where each error is in the vector, which has those of the joints first and then each finger's.

    Attributes:
        joints: that are measured and move a fingertip in the palm.
        fingers: with a force-torque sensor.
        sigma: standard deviations before anything is measured, shape (d,), SI units; zero where there is no error.
        names: of the errors.
        slides: whether each joint does.
        joints_of: by finger, those that move its fingertip in the palm.
    """

    joints: tuple[str, ...]
    fingers: tuple[str, ...]
    sigma: FloatArray
    names: tuple[str, ...]
    slides: tuple[bool, ...]
    joints_of: Mapping[str, tuple[str, ...]]

    @classmethod
    def of(cls, plant: MultibodyPlant, hand: Hand, uncertainty: HandUncertainty, span: float = 0.0) -> HandErrors:
        """The errors of a hand.

        Args:
            plant: finalized plant of the hand alone.
            hand: the hand in it.
            uncertainty: how large its errors may be.
            span: time over which biases may drift by as much as they may be, s; 0 where they do not.
        """
        uncertainty.validate()
        moved_by = {name: _moved_sensors(plant, hand, name) for name in measured_joints(plant, hand)}
        joints = tuple(name for name, fingers in moved_by.items() if fingers)
        joints_of = {f: tuple(name for name in joints if f in moved_by[name]) for f in hand.sensor_frames}
        slides = tuple(isinstance(plant.GetJointByName(name, hand.model_instance), PrismaticJoint) for name in joints)
        offset = math.radians(uncertainty.encoder_offset_deg)
        sigma = [np.where(slides, SLIDE * offset, offset)]
        names = [f"{joint} offset" for joint in joints]
        bias = np.repeat([uncertainty.sensor_moment, uncertainty.sensor_force], 3)
        turned, moved = math.radians(uncertainty.mounting_deg), uncertainty.mounting
        for finger in hand.sensor_frames:
            sigma += [bias, bias / span if span > 0.0 else np.zeros(6)]
            sigma += [np.array([uncertainty.fingertip_radius]), np.repeat([turned, moved], 3)]
            for kind in ("bias", "drift"):
                names += [f"{finger} {part} {kind} {axis}" for part in ("moment", "force") for axis in _AXES]
            names += [f"{finger} radius"]
            names += [f"{finger} mounting {part} {axis}" for part in ("rotation", "translation") for axis in _AXES]
        return cls(joints, tuple(hand.sensor_frames), np.concatenate(sigma), tuple(names), slides, joints_of)

    @functools.cached_property
    def free(self) -> NDArray[np.intp]:
        """Places of the errors that there may be, shape (f,)."""
        return np.flatnonzero(self.sigma)

    def gains(self, plant: MultibodyPlant, hand: Hand) -> FloatArray:
        """What turns positions of the joints into those of the plant, shape (nq, joints)."""
        measured = measured_joints(plant, hand)
        return joint_matrix(plant, hand, measured)[:, [measured.index(joint) for joint in self.joints]]

    def offsets(self, vector: FloatArray) -> FloatArray:
        """By which the joints' readings exceed their positions, shape (joints,), rad or m."""
        return vector[: len(self.joints)]

    def place(self, finger: str, kind: str) -> slice:
        """Where a finger's errors of a kind are: bias, drift, radius or mounting."""
        start = len(self.joints) + sum(_SIZES.values()) * self.fingers.index(finger)
        for name, size in _SIZES.items():
            if name == kind:
                return slice(start, start + size)
            start += size
        raise KeyError(kind)

    def of_finger(self, vector: FloatArray, finger: str) -> FingertipErrors:
        """One finger's part of a vector."""
        bias, drift, radius, mounting = (vector[self.place(finger, kind)] for kind in _SIZES)
        return FingertipErrors(bias, drift, float(radius[0]), mounting)

    def vector(self, offsets: Mapping[str, float], fingers: Mapping[str, FingertipErrors]) -> FloatArray:
        """The vector of given errors; zero for those that are not given."""
        vector = np.zeros(len(self.sigma))
        for k, joint in enumerate(self.joints):
            vector[k] = offsets.get(joint, 0.0)
        for finger, errors in fingers.items():
            for kind in _SIZES:
                vector[self.place(finger, kind)] = getattr(errors, kind)
        return vector


def _moved_sensors(plant: MultibodyPlant, hand: Hand, joint: str) -> tuple[str, ...]:
    """The fingers whose sensor's place in the palm depends on a measured joint, or on those that follow it."""
    measured = measured_joints(plant, hand)
    by_joint = joint_matrix(plant, hand, measured)[:, measured.index(joint)]
    known = JointPaths(plant, hand.palm_frame).known(np.where(by_joint != 0.0, np.nan, 0.0))
    return tuple(finger for finger, frame in hand.sensor_frames.items() if not known[int(frame.body().index())])
