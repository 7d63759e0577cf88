"""Conversion of a vector of a hand's errors to a calibration file."""

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.hand.calibration_file import (
    FingerCalibration,
    HandCalibration,
    MeasuredNumber,
    MeasuredVector,
    rounded,
)
from tactopose_drake.hand.hand_errors import HandErrors

_DIGITS = 4  # decimal digits of a correlation


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
    places = [np.array([errors.joints.index(joint) for joint in joints], dtype=np.intp)]
    places += [_range(errors.place(finger, kind)) for kind in ("bias", "radius", "mounting")]
    chosen = np.concatenate(places)
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


def _range(place: slice) -> NDArray[np.intp]:
    return np.arange(place.start, place.stop, dtype=np.intp)
