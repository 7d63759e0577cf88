"""Poses from vision: which are new, and the measurement update of the mixture by one that may be an outlier.

Poses may come late, repeatedly, frozen, or faster than their errors change.
"""

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.evidence.contact_reading import ContactReading
from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.kernels.matrix_kernels import inverses
from tactopose_drake.core.motion.rigid_motion import MotionHistory
from tactopose_drake.core.plain_values import copied
from tactopose_drake.core.poses import increments_between, increments_of_images, retract
from tactopose_drake.core.shape.free_spin import nearest_images
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.times import has_exceeded
from tactopose_drake.core.tracking.contact_update import limit_gain
from tactopose_drake.core.tracking.frame import Frame, PoseMeasurement
from tactopose_drake.core.tracking.pose_belief import PoseBelief, VisionRecord
from tactopose_drake.core.tracking.tracked_modes import TrackedModes
from tactopose_drake.core.tracking.tracker_params import VisionParams
from tactopose_drake.core.validation import FloatArray

_NOT_BELIEVED = "vision is not believed"
# The least share of an independent measurement that a pose counts as: with none, its noise would be infinite.
_LEAST_SHARE = 1e-3


class Sighting(NamedTuple):
    """A pose from vision, with its effective share of an independent measurement.

    The errors of successive pictures are correlated: within the correlation time, each counts as a share of one
    measurement.
    """

    pose: PoseMeasurement  # moved to the present
    share: float  # in (0, 1]: the power of its likelihood


def read_vision(
    record: VisionRecord,
    measurement: PoseMeasurement | None,
    history: MotionHistory,
    time: float,
    params: VisionParams,
) -> tuple[Sighting | None, VisionRecord]:
    """The new pose from vision, moved to the present, if there is one, and the updated record.

    Args:
        record: of the poses before.
        measurement: the latest pose from vision.
        history: the object's latest motions, up to the present.
        time: now, s.
        params: how long vision counts.
    """
    if measurement is None:
        # That the last picture was not believed is said while a picture counts; the other remarks are obsolete.
        is_recent = record.last is not None and not has_exceeded(time, record.last.time, params.max_age)
        kept = record.remark == "" or (record.remark == _NOT_BELIEVED and is_recent)
        return None, record if kept else dataclasses.replace(record, remark="")
    if has_exceeded(time, measurement.time, params.max_age):
        return None, dataclasses.replace(record, remark=f"vision is of {time - measurement.time:.1f} s ago")
    if has_exceeded(measurement.time, time, 0.0):
        return None, dataclasses.replace(record, remark="vision is of the future")
    if measurement.time in record.times:
        return None, record
    times = (*record.times[-params.remembered :], measurement.time)
    if record.last is not None and not measurement.is_news_after(record.last):
        return None, dataclasses.replace(record, times=times, remark="vision is frozen")
    now = history.predict(min(measurement.time, time), measurement.X_PO, measurement.covariance)
    record = dataclasses.replace(record, times=times, last=measurement, remark="")
    if now is None:
        return None, record
    since = min((abs(measurement.time - earlier) for earlier in times[:-1]), default=params.correlation_time)
    predicted = measurement.moved_to(time, *now)
    return Sighting(predicted, min(1.0, max(since / params.correlation_time, _LEAST_SHARE))), record


def see(
    model: ObjectModel, belief: PoseBelief, frame: Frame, reading: ContactReading, params: VisionParams
) -> tuple[PoseBelief, bool]:
    """Updates the belief with vision and a prior; also tells whether the best mode takes vision for an outlier.

    Args:
        model: the object.
        belief: the predicted belief.
        frame: all that is sensed now.
        reading: its contacts.
        params: what is assumed about vision.
    """
    never_felt = belief.touch_time == -np.inf
    prior = frame.evidence.prior if never_felt and frame.evidence.prior != belief.vision.spent else None
    sighting, record = read_vision(belief.vision, frame.vision, belief.history, frame.time, params)
    is_outlier = False
    if sighting is not None and len(belief.modes):
        belief, is_outlier = _update_modes(model, belief, sighting, params)
    # Only vision tells where an object is that nothing feels. If it contradicts the earlier poses for so long, the
    # object has been moved, or the first pose was the outlier.
    latest = max(record.accepted_time, belief.touch_time)
    is_anew = is_outlier and not reading.has_contact and has_exceeded(frame.time, latest, params.max_age)
    if is_outlier and not is_anew:
        sighting, record = None, dataclasses.replace(record, remark=_NOT_BELIEVED)
    standing = None if is_anew else belief.standing
    standing, record = _update_standing(model, standing, record, sighting, prior, frame.time, params)
    modes = belief.modes
    if (never_felt or is_anew) and standing is not None and not reading.has_contact:
        modes = TrackedModes.independent(standing.X_PO[None], standing.covariance[None], len(reading.sources))
        if prior is not None and not _is_news(prior, record):
            record = dataclasses.replace(record, accepted_time=frame.time)
        if record.remark == _NOT_BELIEVED and standing is not belief.standing:
            record = dataclasses.replace(record, remark="")  # The pose that vision contradicted is replaced.
    return copied(belief, modes=modes, standing=standing, vision=record), is_outlier and not is_anew


def _update_modes(
    model: ObjectModel, belief: PoseBelief, sighting: Sighting, params: VisionParams
) -> tuple[PoseBelief, bool]:
    """Updates the modes with vision; also tells whether it is an outlier to the mode that was best before."""
    log_outlier = math.log(params.outlier_probability / (8.0 * math.pi**2 * params.outlier_volume))
    modes, is_inlier = update_with_pose(model, belief.modes, sighting, log_outlier)
    order = np.argsort(-modes.log_weight, kind="stable")
    slip_test = belief.slip_test if order[0] == 0 else belief.slip_test.restarted()
    return copied(belief, modes=modes.chosen(order), slip_test=slip_test), not is_inlier[0]


def _update_standing(
    model: ObjectModel,
    standing: PoseMeasurement | None,
    record: VisionRecord,
    sighting: Sighting | None,
    prior: GaussianPrior | None,
    time: float,
    params: VisionParams,
) -> tuple[PoseMeasurement | None, VisionRecord]:
    """The fused pose, and the record, with a new pose from vision, or else with a new prior.

    Args:
        model: the object.
        standing: the fused pose so far; None to begin anew.
        record: of the poses up to now.
        sighting: a new pose that is believed.
        prior: applies only until the object is felt.
        time: now, s.
        params: what is assumed about vision.
    """
    is_news = prior is not None and _is_news(prior, record)
    if sighting is not None:
        # A prior is a guess of the same kind, which the first picture replaces.
        standing = sighting.pose if len(record.times) == 1 else fuse(model, standing, sighting, params)
        told = prior if is_news else record.prior
        return standing, dataclasses.replace(record, accepted_time=sighting.pose.time, prior=told)
    if prior is None or not is_news:
        return standing, record
    guess = PoseMeasurement.from_prior(prior, time)
    if standing is None:
        return guess, dataclasses.replace(record, prior=prior)
    # Vision that is not believed may be an outlier, but not if nothing else has been seen for so long.
    if record.remark == _NOT_BELIEVED and not has_exceeded(time, record.accepted_time, params.max_age):
        return standing, record
    return guess, dataclasses.replace(record, prior=prior)


def _is_news(prior: GaussianPrior, record: VisionRecord) -> bool:
    """Whether a prior says more than the last one that was used."""
    if record.prior is None:
        return True
    guess, last = (PoseMeasurement.from_prior(each, 0.0) for each in (prior, record.prior))
    return guess.is_news_after(last)


def fuse(
    model: ObjectModel, standing: PoseMeasurement | None, sighting: Sighting, params: VisionParams
) -> PoseMeasurement:
    """Fuses a further pose from vision with the earlier ones; of two that contradict each other the later one is kept.

    Among the measured pose's symmetric images, the one nearest to the earlier poses counts.
    """
    measurement, share = sighting
    if standing is None:
        return measurement
    X_seen, covariance_seen = _nearest_images(model, measurement, standing.X_PO[None])
    u, told = increments_between(standing.X_PO[None], X_seen)[0], covariance_seen[0]
    expected = standing.covariance + told
    if u @ np.linalg.solve(expected, u) > params.gate:
        return measurement
    noise = told / share
    gain = np.linalg.solve(standing.covariance + noise, standing.covariance).T
    left = np.eye(6) - gain
    # Joseph's form stays positive definite however different the two covariances are.
    covariance = left @ standing.covariance @ left.T + gain @ noise @ gain.T
    # The common part of the errors does not average out, however many poses there are.
    most = inverses(params.lasting_share * told[None])[0]
    covariance = limit_gain(standing.covariance[None], most, covariance[None])[0]
    X_PO = retract(standing.X_PO[None], (gain @ u)[None])[0]
    return measurement.moved_to(measurement.time, X_PO, 0.5 * (covariance + covariance.T))


def update_with_pose(
    model: ObjectModel, modes: TrackedModes, sighting: Sighting, log_outlier: float
) -> tuple[TrackedModes, NDArray[np.bool_]]:
    """Kalman update of those modes for which a measurement of the pose is no outlier.

    Each mode is updated with the symmetric image of the measured pose that is nearest to it.

    Args:
        model: the object.
        modes: before the update.
        sighting: at the modes' time. The outlier test uses the whole measurement, whatever its share.
        log_outlier: log density of outliers, 1/(rad^3 m^3); inliers are normally distributed. A mode's gate is where
            both densities are equal.

    Returns:
        The modes, and whether the measurement is within the gate of each, shape (n,).
    """
    measurement, share = sighting
    X_seen, told = _nearest_images(model, measurement, modes.X_PO)
    innovation = increments_between(modes.X_PO, X_seen)
    expected = modes.covariance + told
    nis = np.einsum("ni,ni->n", innovation, np.linalg.solve(expected, innovation[..., None])[..., 0])
    log_density: FloatArray = -0.5 * (nis + np.linalg.slogdet(expected)[1]) - 3.0 * np.log(2.0 * np.pi)
    is_inlier = log_density > log_outlier
    tempered = modes.covariance + told / share
    gain = np.swapaxes(np.linalg.solve(tempered, modes.covariance), 1, 2) * is_inlier[:, None, None]
    covariance = modes.covariance - gain @ modes.covariance
    after = dataclasses.replace(
        modes,
        X_PO=retract(modes.X_PO, np.einsum("nij,nj->ni", gain, innovation)),
        covariance=0.5 * (covariance + np.swapaxes(covariance, 1, 2)),
        cross_covariance=modes.cross_covariance - gain @ modes.cross_covariance,
        log_weight=modes.log_weight + share * np.maximum(log_density, log_outlier),
    )
    return after, is_inlier


def _nearest_images(model: ObjectModel, seen: PoseMeasurement, X_PO: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The symmetric image of the measured pose that is nearest to each of the poses (n, 3, 4), and its covariance.

    Returns:
        The images, shape (n, 3, 4), and the covariances of the increments from them, shape (n, 6, 6), which differ, as
        rotations are about the object's own axes.
    """
    turns, symmetries = model.symmetry_turns, model.symmetries
    images = np.array([nearest_images(seen.X_PO[None], X, turns, symmetries)[0] for X in X_PO])
    if len(turns) == 1:
        return images, np.repeat(seen.covariance[None], len(X_PO), axis=0)
    J = increments_of_images(seen.X_PO, images)
    return images, J @ seen.covariance @ np.swapaxes(J, 1, 2)
