"""The errors of contacts: the part that is new at each time, and the part that lasts.

The lasting part comes from the hand's calibration and from the model's surface, as the parameters say; from errors that
a hand declares; and from what the one-shot estimate finds: noise that is larger than told, and false contacts. These
are taken for properties of the fingers: each source's contacts are doubted accordingly in later frames.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping

import numpy as np

from tactopose_drake.core.evidence.contact_reading import ContactReading, ErrorParts, ErrorScales
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.tracking.frame import Frame
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams
from tactopose_drake.core.validation import FloatArray

# Doubt up to this factor is ignored.
_NOTICED_DOUBT = 1.1
LEAST_INLIER = 0.001
"""The least inlier probability that a contact counts with, however false it seems."""


@dataclasses.dataclass(frozen=True)
class BiasModel:
    """Standard deviations of constant errors: of each coordinate of a position, m, and about each axis, rad.

    Attributes:
        calibration: of the hand; included in the standard deviations of the contacts.
        surface: of the model's surface relative to the object's, where it is touched; not included in them.
    """

    calibration: tuple[float, float]
    surface: tuple[float, float]

    @classmethod
    def from_params(cls, params: PoseTrackerParams) -> BiasModel:
        """The model that the parameters describe."""
        return _bias_model(
            params.calibration_position,
            params.calibration_normal_deg,
            params.surface_position,
            params.surface_normal_deg,
        )

    @functools.cached_property
    def variances(self) -> FloatArray:
        """Variances of the bias of a position, m^2, and of a normal, rad^2, shape (2,)."""
        return np.square(self.calibration) + np.square(self.surface)

    @functools.cached_property
    def of_calibration(self) -> FloatArray:
        """The part of `variances` due to the hand's calibration, shape (2,)."""
        return np.square(self.calibration)

    def with_roughness(self, roughness: FloatArray) -> FloatArray:
        """Variances of the biases of s sources, shape (n, 6 s), on surfaces of roughness (n, s, 2)."""
        return np.repeat(self.variances + roughness, 3, axis=2).reshape(len(roughness), -1)


@functools.lru_cache
def _bias_model(position: float, normal_deg: float, surface_position: float, surface_normal_deg: float) -> BiasModel:
    return BiasModel((position, math.radians(normal_deg)), (surface_position, math.radians(surface_normal_deg)))


def declared_excess(contacts: Contacts, params: PoseTrackerParams) -> FloatArray:
    """Lasting variances of points, m^2, and of normals, rad^2, beyond the calibration's, shape (k, 2).

    A hand that declares its errors gives contacts with covariances. The part of these that is not sensor noise, new at
    each time, belongs to the hand, and lasts.
    """
    if contacts.covariance is None:
        return np.zeros((len(contacts), 2))
    frame = np.square([params.frame_position, math.radians(params.frame_normal_deg)])
    lasting = BiasModel.from_params(params).of_calibration
    return np.asarray(np.maximum(contacts.variances - frame - lasting, 0.0))


def calibration_excess(contacts: Contacts, params: PoseTrackerParams, calibration: FloatArray) -> FloatArray:
    """Variances of points, m^2, and of normals, rad^2, by which the calibration exceeds what is told, shape (k, 2).

    Args:
        contacts: with the told variances.
        params: with the told calibration.
        calibration: factors of its variances, shape (2,).
    """
    of_hand = _of_hand(contacts.variances, declared_excess(contacts, params), params)
    return np.asarray((calibration - 1.0) * of_hand)


def _of_hand(told: FloatArray, declared: FloatArray, params: PoseTrackerParams) -> FloatArray:
    """The part of the told variances (k, 2) due to the calibration and declared errors, at most all of them."""
    return np.minimum(BiasModel.from_params(params).of_calibration + declared, told)


def averaged_variances(contacts: Contacts, params: PoseTrackerParams, frames: int) -> FloatArray:
    """Variances (k, 2) of the mean of the contacts over several frames, in which only the new errors average out."""
    bias = BiasModel.from_params(params)
    return _averaged(contacts.variances, declared_excess(contacts, params), bias, frames)


def _averaged(told: FloatArray, declared: FloatArray, bias: BiasModel, frames: int) -> FloatArray:
    lasting = np.minimum(bias.variances + declared, told)
    return np.asarray(lasting + (told - lasting) / frames)


def surest_position(params: PoseTrackerParams) -> float:
    """The least standard deviation, m, that a point can have: a mean over frames with the best possible calibration."""
    best = 0.5 ** (0.5 * params.calibration_scale.halvings) * params.calibration_position
    return math.hypot(best, params.surface_position, params.frame_position / math.sqrt(params.window.max_frames))


def split_errors(
    contacts: Contacts, doubt: FloatArray, calibration: FloatArray, params: PoseTrackerParams
) -> ErrorParts:
    """Splits the contacts' errors into the part that is new at each time and the part that lasts.

    Args:
        contacts: with the told variances.
        doubt: factors by which the variance of each contact's lasting error seems larger than told, shape (k,).
        calibration: the same for the calibration's variances, shape (2,).
        params: what is assumed.
    """
    told, declared, bias = contacts.variances, declared_excess(contacts, params), BiasModel.from_params(params)
    of_hand = _of_hand(told, declared, params)
    new = np.maximum(told - of_hand, params.contact_update.least_noise_share**2 * told)
    mean = _averaged(told, declared, bias, params.window.max_frames)
    return ErrorParts(told, declared, new, declared + (doubt - 1.0)[:, None] * mean + (calibration - 1.0) * of_hand)


def read_contacts(
    frame: Frame, sources: tuple[str, ...], before: Contacts, errors: ErrorScales, params: PoseTrackerParams
) -> ContactReading:
    """The frame's contacts, indexed by the known sources and the new ones.

    Args:
        frame: all that is sensed.
        sources: names of those known so far.
        before: the contacts of the last frame.
        errors: their estimated size so far.
        params: what is assumed about them.
    """
    contacts = frame.evidence.touch
    sources += tuple(name for name in frame.names if name not in sources)
    source = np.array([sources.index(name) for name in frame.names], dtype=np.intp)
    is_new = len(contacts) > 0 and not _is_repeated(contacts, before)
    parts = split_errors(contacts, errors.doubts_of(frame.names), errors.calibration, params)
    return ContactReading(contacts, source, sources, is_new, errors, frame.evidence, parts)


def _is_repeated(contacts: Contacts, before: Contacts) -> bool:
    """Whether the contacts have the points and normals of the last frame's, to the last bit."""
    if not np.array_equal(contacts.p_PC, before.p_PC):
        return False
    if contacts.n_PC is None or before.n_PC is None:
        return contacts.n_PC is before.n_PC
    return np.array_equal(contacts.n_PC, before.n_PC)


def with_errors(reading: ContactReading, errors: ErrorScales, params: PoseTrackerParams) -> ContactReading:
    """The reading with another estimate of its errors; see `split_errors`."""
    after = reading._replace(errors=errors)
    return after._replace(parts=split_errors(after.contacts, after.doubt, errors.calibration, params))


def as_doubted(reading: ContactReading) -> ContactReading:
    """The reading with the estimated errors as the standard deviations of its evidence's contacts."""
    evidence, count = reading.evidence, len(reading.evidence.contacts)
    if not count or max(reading.doubt.max(), reading.errors.calibration.max()) < _NOTICED_DOUBT:
        return reading
    variances = reading.parts.told + reading.parts.excess - reading.parts.declared
    contacts = evidence.contacts.with_variances(variances[:count])
    return reading._replace(evidence=evidence.with_parts(contacts, evidence.prior))


def follow_doubt(
    doubt: Mapping[str, float],
    inlier_probability: FloatArray,
    noise_scale: float,
    sources: tuple[str, ...],
    share: float,
) -> dict[str, float]:
    """Updates the factors by which each source's lasting variances seem larger than told, after a further search.

    Args:
        doubt: the factors before.
        inlier_probability: of the contacts, by the posterior, shape (k,).
        noise_scale: factor by which the contacts' standard deviations seem larger than told.
        sources: of these contacts, in their order.
        share: weight of this posterior in the running geometric mean.
    """
    after = dict(doubt)
    for name, inlier in zip(sources, inlier_probability, strict=True):
        now = noise_scale**2 / max(float(inlier), LEAST_INLIER)
        after[name] = math.exp((1.0 - share) * math.log(doubt.get(name, 1.0)) + share * math.log(max(now, 1.0)))
    return after
