"""What contacts are off by: what is new at each time, and what lasts.

What lasts is of the hand's calibration and of the model's surface, as the parameters say; of what a hand declares of
its errors; and what the one-shot estimate finds of noise that is larger than told, and of contacts that are false. That
is of the fingers: each source's contacts are doubted by it at the frames to come.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping

import numpy as np

from tactopose_drake.core.evidence.contact_reading import ContactReading, ErrorParts, SeemingErrors, told_variances
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.tracking.frame import Frame
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams
from tactopose_drake.core.validation import FloatArray

# So little doubt changes nothing.
_NOTICED_DOUBT = 1.1
LEAST_INLIER = 0.001
"""However false a contact seems, it counts by this share."""


@dataclasses.dataclass(frozen=True)
class BiasModel:
    """Standard deviations of what never changes: of each coordinate of a position, m, and about each axis, rad.

    Attributes:
        calibration: of the hand, which is a part of what the contacts say of their errors.
        surface: how far the model's surface is from the object's where it is touched; contacts do not know of it.
    """

    calibration: tuple[float, float]
    surface: tuple[float, float]

    @classmethod
    def from_params(cls, params: PoseTrackerParams) -> BiasModel:
        """What the parameters say."""
        return _bias_model(
            params.calibration_position,
            params.calibration_normal_deg,
            params.surface_position,
            params.surface_normal_deg,
        )

    @functools.cached_property
    def variances(self) -> FloatArray:
        """Of a bias of the position, m^2, and of the normal, rad^2, shape (2,)."""
        return np.square(self.calibration) + np.square(self.surface)

    @functools.cached_property
    def of_calibration(self) -> FloatArray:
        """What of that is of the hand's calibration, shape (2,)."""
        return np.square(self.calibration)

    def with_roughness(self, roughness: FloatArray) -> FloatArray:
        """Variances of the biases of s sources, shape (n, 6 s), on surfaces of a roughness (n, s, 2)."""
        return np.repeat(self.variances + roughness, 3, axis=2).reshape(len(roughness), -1)


@functools.lru_cache
def _bias_model(position: float, normal_deg: float, surface_position: float, surface_normal_deg: float) -> BiasModel:
    return BiasModel((position, math.radians(normal_deg)), (surface_position, math.radians(surface_normal_deg)))


def declared_excess(contacts: Contacts, params: PoseTrackerParams) -> FloatArray:
    """Variances of points, m^2, and of normals, rad^2, that last, beside the calibration's, shape (k, 2).

    A hand that declares its errors gives contacts covariances. Of these all that the sensors' noise does not make new
    at each time is of the hand, and lasts.
    """
    if contacts.covariance is None:
        return np.zeros((len(contacts), 2))
    told = told_variances(contacts)
    frame = np.square([params.frame_position, math.radians(params.frame_normal_deg)])
    lasting = BiasModel.from_params(params).of_calibration
    return np.asarray(np.maximum(told - frame - lasting, 0.0))


def calibration_excess(contacts: Contacts, params: PoseTrackerParams, calibration: FloatArray) -> FloatArray:
    """Variances of points, m^2, and of normals, rad^2, of a calibration beyond what is told of it, shape (k, 2).

    Args:
        contacts: what is told.
        params: likewise.
        calibration: factors of the variances, shape (2,).
    """
    of_hand = _of_hand(told_variances(contacts), declared_excess(contacts, params), params)
    return np.asarray((calibration - 1.0) * of_hand)


def _of_hand(told: FloatArray, declared: FloatArray, params: PoseTrackerParams) -> FloatArray:
    """What of variances (k, 2) is of the calibration, and declared beside it: no more than all that is told."""
    return np.minimum(BiasModel.from_params(params).of_calibration + declared, told)


def averaged_variances(contacts: Contacts, params: PoseTrackerParams, frames: int) -> FloatArray:
    """Variances (k, 2) of the mean of so many frames' contacts, in which only what is new at each time averages out."""
    bias = BiasModel.from_params(params)
    return _averaged(told_variances(contacts), declared_excess(contacts, params), bias, frames)


def _averaged(told: FloatArray, declared: FloatArray, bias: BiasModel, frames: int) -> FloatArray:
    lasting = np.minimum(bias.variances + declared, told)
    return np.asarray(lasting + (told - lasting) / frames)


def surest_position(params: PoseTrackerParams) -> float:
    """To what a point may come to be known, m: a mean of frames, by a calibration as good as it may be found to be."""
    best = 0.5 ** (0.5 * params.calibration_scale.halvings) * params.calibration_position
    return math.hypot(best, params.surface_position, params.frame_position / math.sqrt(params.window.max_frames))


def split_errors(
    contacts: Contacts, doubt: FloatArray, calibration: FloatArray, params: PoseTrackerParams
) -> ErrorParts:
    """What of the contacts' errors is new at each time, and what lasts of them.

    Args:
        contacts: what is told.
        doubt: by how much the variance of what lasts of each one's error seems larger than told, shape (k,).
        calibration: by how much those of the calibration do, shape (2,).
        params: what is assumed.
    """
    told, declared, bias = told_variances(contacts), declared_excess(contacts, params), BiasModel.from_params(params)
    of_hand = _of_hand(told, declared, params)
    new = np.maximum(told - of_hand, params.contact_update.least_noise_share**2 * told)
    mean = _averaged(told, declared, bias, params.window.max_frames)
    return ErrorParts(told, declared, new, declared + (doubt - 1.0)[:, None] * mean + (calibration - 1.0) * of_hand)


def read_contacts(
    frame: Frame, sources: tuple[str, ...], before: Contacts, errors: SeemingErrors, params: PoseTrackerParams
) -> ContactReading:
    """The frame's contacts by the sources known so far and the new ones.

    Args:
        frame: all that is sensed.
        sources: names of those known so far.
        before: the last frame's contacts.
        errors: how large they seem by what was felt so far.
        params: what is assumed of them.
    """
    contacts = frame.evidence.touch
    sources += tuple(name for name in frame.names if name not in sources)
    source = np.array([sources.index(name) for name in frame.names], dtype=np.intp)
    is_new = len(contacts) > 0 and not _is_repeated(contacts, before)
    parts = split_errors(contacts, errors.doubts_of(frame.names), errors.calibration, params)
    return ContactReading(contacts, source, sources, is_new, errors, frame.evidence, parts)


def _is_repeated(contacts: Contacts, before: Contacts) -> bool:
    """Whether contacts are at the points of the last frame's, and have their normals, to the last bit."""
    if not np.array_equal(contacts.p_PC, before.p_PC):
        return False
    if contacts.n_PC is None or before.n_PC is None:
        return contacts.n_PC is before.n_PC
    return np.array_equal(contacts.n_PC, before.n_PC)


def with_errors(reading: ContactReading, errors: SeemingErrors, params: PoseTrackerParams) -> ContactReading:
    """The reading whose errors seem otherwise; see `split_errors`."""
    after = reading._replace(errors=errors)
    return after._replace(parts=split_errors(after.contacts, after.doubt, errors.calibration, params))


def as_doubted(reading: ContactReading) -> ContactReading:
    """The reading whose evidence has contacts as unsure as they seem."""
    evidence, count = reading.evidence, len(reading.evidence.contacts)
    if not count or max(reading.doubt.max(), reading.errors.calibration.max()) < _NOTICED_DOUBT:
        return reading
    variances = reading.parts.told + reading.parts.excess - reading.parts.declared
    position, normal = np.ascontiguousarray(np.sqrt(variances[:count]).T)
    contacts = evidence.contacts.with_arrays(covariance=None, sigma_position=position, sigma_normal=normal)
    return reading._replace(evidence=evidence.with_parts(contacts, evidence.prior))


def follow_doubt(
    doubt: Mapping[str, float],
    inlier_probability: FloatArray,
    noise_scale: float,
    sources: tuple[str, ...],
    share: float,
) -> dict[str, float]:
    """By how much the variances of what lasts of each source's errors seem larger than told, after another search.

    Args:
        doubt: before.
        inlier_probability: of contacts, by the posterior, shape (k,).
        noise_scale: by how much their noise seems larger than told.
        sources: of these contacts, in their order.
        share: of the mean that is by this posterior.
    """
    after = dict(doubt)
    for name, inlier in zip(sources, inlier_probability, strict=True):
        now = noise_scale**2 / max(float(inlier), LEAST_INLIER)
        after[name] = math.exp((1.0 - share) * math.log(doubt.get(name, 1.0)) + share * math.log(max(now, 1.0)))
    return after
