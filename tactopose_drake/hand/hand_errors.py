"""The errors of a hand as one vector, with their standard deviations and names, and as a calibration."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.multibody.plant import MultibodyPlant

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.hand.calibration_file import (
    FingerCalibration,
    HandCalibration,
    MeasuredNumber,
    MeasuredVector,
    rounded,
)
from tactopose_drake.hand.encoder_offsets import SLIDE
from tactopose_drake.hand.hand_config import HandUncertainty
from tactopose_drake.hand.hand_in_plant import Hand, measured_joints, sliding_joints
from tactopose_drake.hand.joint_matrices import joint_matrix
from tactopose_drake.hand.kinematics import JointPaths

_AXES = ("x", "y", "z")
_DIGITS = 4  # decimal digits of a correlation


class FingertipErrors(NamedTuple):
    """The errors of one finger's fingertip and sensor.

    Attributes:
        bias: the sensor's reading without a touch, [m, f], shape (6,), N m and N.
        drift: rate of change of the bias, shape (6,), N m/s and N/s.
        radius: excess of the fingertip's radius over the hand's file, m.
        mounting: error of the pose of S with the fingertip: rotation vector and translation in the nominal S, shape
            (6,), rad and m.
    """

    bias: FloatArray
    drift: FloatArray
    radius: float
    mounting: FloatArray


_SIZES = {"bias": 6, "drift": 6, "radius": 1, "mounting": 6}


@dataclasses.dataclass(frozen=True, eq=False)
class HandErrors:
    """The layout of the error vector: first the joints' offsets, then the errors of each finger.

    Attributes:
        joints: names of the measured joints that move a fingertip in the palm.
        fingers: names of the fingers with a force-torque sensor.
        sigma: prior standard deviations, shape (d,), SI units; zero for errors that do not exist.
        names: names of the errors.
        slides: whether each joint is prismatic.
        joints_of: names of the joints that move a finger's fingertip in the palm, by finger.
    """

    joints: tuple[str, ...]
    fingers: tuple[str, ...]
    sigma: FloatArray
    names: tuple[str, ...]
    slides: tuple[bool, ...]
    joints_of: Mapping[str, tuple[str, ...]]

    @classmethod
    def of(cls, plant: MultibodyPlant, hand: Hand, uncertainty: HandUncertainty, span: float = 0.0) -> HandErrors:
        """The error vector's layout for a hand.

        Args:
            plant: finalized plant of the hand alone.
            hand: the hand in it.
            uncertainty: standard deviations of its errors.
            span: time over which biases drift by one standard deviation of the bias, s; 0: they do not drift.
        """
        uncertainty.validate()
        moved_by = {name: _moved_sensors(plant, hand, name) for name in measured_joints(plant, hand)}
        joints = tuple(name for name, fingers in moved_by.items() if fingers)
        joints_of = {f: tuple(name for name in joints if f in moved_by[name]) for f in hand.sensor_frames}
        sliding = sliding_joints(plant, hand)
        slides = tuple(name in sliding for name in joints)
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
        """Indices of the errors with a standard deviation above 0, shape (f,)."""
        return np.flatnonzero(self.sigma)

    def gains(self, plant: MultibodyPlant, hand: Hand) -> FloatArray:
        """The matrix from positions of `joints` to those of the plant, shape (nq, number of joints)."""
        measured = measured_joints(plant, hand)
        return joint_matrix(plant, hand, measured)[:, [measured.index(joint) for joint in self.joints]]

    def offsets(self, vector: FloatArray) -> FloatArray:
        """The joints' offsets (readings minus positions), shape (number of joints,), rad or m."""
        return vector[: len(self.joints)]

    def place(self, finger: str, kind: str) -> slice:
        """The slice of a finger's errors of a kind: "bias", "drift", "radius" or "mounting"."""
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
        """The vector of the given errors, with zeros for all others."""
        vector = np.zeros(len(self.sigma))
        for k, joint in enumerate(self.joints):
            vector[k] = offsets.get(joint, 0.0)
        for finger, errors in fingers.items():
            for kind in _SIZES:
                vector[self.place(finger, kind)] = getattr(errors, kind)
        return vector


def _moved_sensors(plant: MultibodyPlant, hand: Hand, joint: str) -> tuple[str, ...]:
    """The fingers whose sensor's pose in the palm depends on a measured joint, or on joints coupled to it."""
    measured = measured_joints(plant, hand)
    by_joint = joint_matrix(plant, hand, measured)[:, measured.index(joint)]
    known = JointPaths(plant, hand.palm_frame).known(np.where(by_joint != 0.0, np.nan, 0.0))
    return tuple(finger for finger, frame in hand.sensor_frames.items() if not known[int(frame.body().index())])


def calibration_of(errors: HandErrors, vector: FloatArray, covariance: FloatArray, time: float) -> HandCalibration:
    """Converts estimated errors to a calibration, with the biases at a given time.

    Args:
        errors: the layout of the error vector.
        vector: the estimated errors, shape (d,), SI units.
        covariance: their covariance, shape (d, d); zero for errors that were not estimated.
        time: the time, relative to that of `bias` without drift, s.
    """
    sigma = np.sqrt(np.diag(covariance))
    units = [1.0 if slides else 180.0 / np.pi for slides in errors.slides]
    offsets = {
        joint: MeasuredNumber(value=rounded(units[k] * vector[k]), sigma=rounded(units[k] * sigma[k]))
        for k, joint in enumerate(errors.joints)
    }
    fingers = {finger: _of_finger(errors, finger, vector, covariance, time) for finger in errors.fingers}
    return HandCalibration(joint_offsets=offsets, fingers=fingers)


def _of_finger(
    errors: HandErrors, finger: str, vector: FloatArray, covariance: FloatArray, time: float
) -> FingerCalibration:
    joints = errors.joints_of[finger]
    of_joints = np.array([errors.joints.index(joint) for joint in joints], dtype=np.intp)
    chosen = np.r_[(of_joints, *(errors.place(finger, kind) for kind in ("bias", "radius", "mounting")))]
    gather = np.zeros((len(chosen), len(vector)))
    gather[np.arange(len(chosen)), chosen] = 1.0
    biases = slice(len(joints), len(joints) + 6)
    gather[biases, errors.place(finger, "drift")] += time * np.eye(6)
    values, own = gather @ vector, gather @ covariance @ gather.T
    sigma = np.sqrt(np.diag(own))
    safe = np.where(sigma > 0.0, sigma, 1.0)
    correlation = own / np.outer(safe, safe)
    np.fill_diagonal(correlation, 1.0)
    n = len(joints)

    def three(start: int, unit: float = 1.0) -> MeasuredVector:
        rows = slice(n + start, n + start + 3)
        return MeasuredVector(value=rounded(unit * values[rows]), sigma=rounded(unit * sigma[rows]))

    return FingerCalibration(
        moment_bias=three(0),
        force_bias=three(3),
        radius=MeasuredNumber(value=rounded(values[n + 6]), sigma=rounded(sigma[n + 6])),
        rotation_deg=three(7, 180.0 / np.pi),
        translation=three(10),
        joints=list(joints),
        correlation=np.round(correlation, _DIGITS).tolist(),
    )
