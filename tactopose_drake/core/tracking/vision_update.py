"""Poses from vision: which are new, and the measurement update of the mixture by one that may be an outlier.

Poses come late, repeated, frozen, or more frequent than their errors change.
"""

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.poses import increments_between, retract
from tactopose_drake.core.tracking.frame import ContactReading, PoseMeasurement
from tactopose_drake.core.tracking.motion_prediction import MotionHistory
from tactopose_drake.core.tracking.pose_belief import VisionRecord
from tactopose_drake.core.tracking.tracked_modes import TrackedModes
from tactopose_drake.core.tracking.tracker_params import VisionParams
from tactopose_drake.core.validation import FloatArray


def read_vision(
    record: VisionRecord,
    measurement: PoseMeasurement | None,
    history: MotionHistory,
    time: float,
    params: VisionParams,
) -> tuple[PoseMeasurement | None, VisionRecord]:
    """What vision says that is new, as of now, and the record of it.

    Args:
        record: of what it said before.
        measurement: the latest pose from vision.
        history: how the object moved lately, up to now.
        time: now, s.
        params: how long vision counts.
    """
    if measurement is None:
        return None, record
    age = time - measurement.time
    if age > params.max_age:
        return None, dataclasses.replace(record, remark=f"vision is of {age:.1f} s ago")
    if age < 0.0:
        return None, dataclasses.replace(record, remark="vision is of the future")
    if measurement.time in record.times:
        return None, record
    times = (*record.times[-params.remembered :], measurement.time)
    if record.X_PO is not None and np.array_equal(record.X_PO, measurement.X_PO):
        return None, dataclasses.replace(record, times=times, remark="vision is frozen")
    now = history.predict(measurement)
    record = dataclasses.replace(record, times=times, X_PO=measurement.X_PO, remark="")
    if now is None:
        return None, record
    if len(times) > 1:
        # The errors of pictures that follow each other are much the same.
        correlation_time = params.correlation_time
        since = max(min(abs(measurement.time - earlier) for earlier in times[:-1]), 1e-3 * correlation_time)
        now = dataclasses.replace(now, covariance=now.covariance * max(1.0, correlation_time / since))
    return now, record


def update_with_vision(
    modes: TrackedModes,
    reading: ContactReading,
    measurement: PoseMeasurement,
    record: VisionRecord,
    params: VisionParams,
) -> tuple[TrackedModes, VisionRecord, bool]:
    """The modes with what vision says now, the record of it, and whether the best mode takes it for an outlier.

    Where there is no mode, and no contact that could say more, vision makes one.
    """
    if len(modes):
        log_outlier = math.log(params.outlier_probability / (8.0 * math.pi**2 * params.outlier_volume))
        modes, is_inlier = update_with_pose(modes, measurement, log_outlier)
        if not is_inlier[0]:
            return modes, dataclasses.replace(record, remark="vision is not believed"), True
    elif reading.has_contact:
        return modes, record, False
    else:
        modes = TrackedModes.independent(measurement.X_PO[None], measurement.covariance[None], len(reading.sources))
    return modes, dataclasses.replace(record, accepted_time=measurement.time), False


def update_with_pose(
    modes: TrackedModes, measurement: PoseMeasurement, log_outlier: float
) -> tuple[TrackedModes, NDArray[np.bool_]]:
    """The modes after a measurement of the pose, a Kalman update of each for which it is no outlier.

    Args:
        modes: before.
        measurement: as of the modes' time.
        log_outlier: the logarithm of the density of outliers, where that of others is normal, 1/(rad^3 m^3). The gate
            of a mode is where both are equal.

    Returns:
        The modes, and within the gates of which the measurement is, shape (n,).
    """
    innovation = increments_between(modes.X_PO, measurement.X_PO)
    expected = modes.covariance + measurement.covariance
    gain = np.swapaxes(np.linalg.solve(expected, modes.covariance), 1, 2)
    nis = np.einsum("ni,ni->n", innovation, np.linalg.solve(expected, innovation[..., None])[..., 0])
    log_density: FloatArray = -0.5 * (nis + np.linalg.slogdet(expected)[1]) - 3.0 * np.log(2.0 * np.pi)
    is_inlier = log_density > log_outlier
    gain *= is_inlier[:, None, None]
    covariance = modes.covariance - gain @ modes.covariance
    after = dataclasses.replace(
        modes,
        X_PO=retract(modes.X_PO, np.einsum("nij,nj->ni", gain, innovation)),
        covariance=0.5 * (covariance + np.swapaxes(covariance, 1, 2)),
        cross_covariance=modes.cross_covariance - gain @ modes.cross_covariance,
        log_prior=modes.log_prior + np.maximum(log_density, log_outlier),
    )
    return after, is_inlier
