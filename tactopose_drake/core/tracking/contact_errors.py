"""What contacts are off by: what is new at each time, and what lasts.

What lasts is of the hand's calibration and of the model's surface, as the parameters say; of what a hand declares of
its errors; and what the one-shot estimate finds of noise that is larger than told, and of contacts that are false.
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.tracking.frame import ContactReading
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams
from tactopose_drake.core.validation import FloatArray

# So little doubt changes nothing.
_NOTICED_DOUBT = 1.1


class BiasModel(NamedTuple):
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
        return cls(
            (params.calibration_position, math.radians(params.calibration_normal_deg)),
            (params.surface_position, math.radians(params.surface_normal_deg)),
        )

    @property
    def variances(self) -> FloatArray:
        """Of a bias of the position, m^2, and of the normal, rad^2, shape (2,)."""
        return np.square(self.calibration) + np.square(self.surface)

    def with_roughness(self, roughness: FloatArray) -> FloatArray:
        """Variances of the biases of s sources, shape (n, 6 s), on surfaces of a roughness (n, s, 2)."""
        variances = np.repeat(self.variances, 3) + np.repeat(roughness, 3, axis=2)
        return variances.reshape(len(roughness), -1)


def declared_excess(contacts: Contacts, params: PoseTrackerParams) -> FloatArray:
    """Variances of points, m^2, and of normals, rad^2, that last, beside the calibration's, shape (k, 2).

    A hand that declares its errors gives contacts covariances. Of these all that the sensors' noise does not make new
    at each time is of the hand, and lasts.
    """
    if contacts.covariance is None:
        return np.zeros((len(contacts), 2))
    told = np.stack([contacts.sigma_position, contacts.sigma_normal], axis=1) ** 2
    frame = np.square([params.frame_position, math.radians(params.frame_normal_deg)])
    lasting = np.square(BiasModel.from_params(params).calibration)
    return np.asarray(np.maximum(told - frame - lasting, 0.0))


def calibration_excess(contacts: Contacts, params: PoseTrackerParams, calibration: FloatArray) -> FloatArray:
    """Variances of points, m^2, and of normals, rad^2, of a calibration beyond what is told of it, shape (k, 2).

    Args:
        contacts: what is told.
        params: likewise.
        calibration: factors of the variances, shape (2,).
    """
    told = np.square(BiasModel.from_params(params).calibration) + declared_excess(contacts, params)
    return np.asarray((calibration - 1.0) * told)


def averaged_variances(contacts: Contacts, params: PoseTrackerParams, frames: int) -> FloatArray:
    """Variances (k, 2) of the mean of so many frames' contacts, in which only what is new at each time averages out."""
    told = np.stack([contacts.sigma_position, contacts.sigma_normal], axis=1) ** 2
    bias = BiasModel.from_params(params)
    lasting = np.minimum(bias.variances + declared_excess(contacts, params), told)
    return np.asarray(lasting + (told - lasting) / frames)


def lasting_excess(reading: ContactReading, params: PoseTrackerParams) -> FloatArray:
    """What lasts beside the calibration, with what is doubted of contacts, shape (k, 2)."""
    return declared_excess(reading.contacts, params) + _seeming_excess(reading.contacts, reading, params)


def as_doubted(reading: ContactReading, params: PoseTrackerParams) -> ContactReading:
    """The reading whose evidence has contacts as unsure as they seem."""
    evidence, count = reading.evidence, len(reading.evidence.contacts)
    if not count or max(reading.doubt.max(), reading.calibration.max()) < _NOTICED_DOUBT:
        return reading
    contacts = evidence.contacts
    more = _seeming_excess(contacts, reading, params)
    contacts = dataclasses.replace(
        contacts,
        covariance=None,
        sigma_position=np.sqrt(contacts.sigma_position**2 + more[:, 0]),
        sigma_normal=np.sqrt(contacts.sigma_normal**2 + more[:, 1]),
    )
    return reading._replace(evidence=dataclasses.replace(evidence, contacts=contacts))


def _seeming_excess(contacts: Contacts, reading: ContactReading, params: PoseTrackerParams) -> FloatArray:
    """By how much the variances of what lasts of contacts, the reading's first ones, seem larger than told, (k, 2)."""
    mean = averaged_variances(contacts, params, params.window.max_frames)
    of_calibration = calibration_excess(contacts, params, reading.calibration)
    return np.asarray((reading.doubt[: len(contacts)] - 1.0)[:, None] * mean + of_calibration)
