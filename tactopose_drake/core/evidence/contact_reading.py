"""The contacts of one time as a filter reads them: by which source each is, and how large their errors seem by then."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.validation import FloatArray


class SeemingErrors(NamedTuple):
    """By how much variances of what lasts of contacts' errors seem larger than told.

    Attributes:
        doubt: factors by source, of what the one-shot estimate doubts; 1 of those that are not there.
        calibration: factors of those of the hand's calibration, of points and of normals, shape (2,).
        estimates: of how many estimates the latter are the mean.
    """

    doubt: Mapping[str, float] = {}
    calibration: FloatArray = np.ones(2)
    estimates: int = 0

    def doubts_of(self, sources: Sequence[str]) -> FloatArray:
        """The factors of some sources, shape (k,)."""
        return np.array([self.doubt.get(name, 1.0) for name in sources])


class ErrorParts(NamedTuple):
    """Variances of the errors of k contacts, of points, m^2, and of normals, rad^2, each of shape (k, 2).

    Attributes:
        told: of the whole errors.
        declared: of what lasts beside the calibration's, as the hand says.
        new: of what is new at each time.
        excess: of what lasts beside the calibration's, as they seem.
    """

    told: FloatArray
    declared: FloatArray
    new: FloatArray
    excess: FloatArray


class ContactReading(NamedTuple):
    """The contacts of a frame by all sources that are known.

    Attributes:
        contacts: all points that are touched.
        source: the source of each, shape (k,).
        sources: names of all sources.
        is_new: whether this reading is not the last one again.
        errors: how large those of the contacts seem by what was felt so far.
        evidence: that of the frame; see `as_doubted`.
        parts: of the contacts' errors.
    """

    contacts: Contacts
    source: NDArray[np.intp]
    sources: tuple[str, ...]
    is_new: bool
    errors: SeemingErrors
    evidence: Evidence
    parts: ErrorParts

    @property
    def has_contact(self) -> bool:
        return len(self.contacts) > 0

    @property
    def names(self) -> tuple[str, ...]:
        """The name of each contact's source."""
        return tuple(self.sources[i] for i in self.source)

    @property
    def doubt(self) -> FloatArray:
        """By how much the variance of what lasts of each contact's error seems larger than told, shape (k,)."""
        return self.errors.doubts_of(self.names)


def told_variances(contacts: Contacts) -> FloatArray:
    """Of k contacts' points, m^2, and of their normals, rad^2, as they are told, shape (k, 2)."""
    sigmas = np.empty((len(contacts), 2))
    sigmas[:, 0], sigmas[:, 1] = contacts.sigma_position, contacts.sigma_normal
    return sigmas * sigmas
