"""The contacts of one time as a filter reads them: with their sources, and the current estimate of their errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.validation import FloatArray


class ErrorScales(NamedTuple):
    """Estimated scales of the contacts' lasting errors: factors of their variances over what is told.

    Attributes:
        doubt: factors by source, from the one-shot estimate; 1 for sources that are absent.
        calibration: factors for the hand's calibration, of points and of normals, shape (2,).
        estimates: number of estimates that the latter are the mean of.
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
        declared: of the lasting part besides the calibration's, as the hand declares it.
        new: of the part that is new at each time.
        excess: of the lasting part besides the told calibration's, as estimated.
    """

    told: FloatArray
    declared: FloatArray
    new: FloatArray
    excess: FloatArray


class ContactReading(NamedTuple):
    """The contacts of a frame, indexed by all known sources.

    Attributes:
        contacts: all points that are touched.
        source: index of the source of each, shape (k,).
        sources: names of all sources.
        is_new: whether this reading differs from the last one.
        errors: their estimated size so far.
        evidence: that of the frame; see `as_doubted`.
        parts: the parts of the contacts' errors.
    """

    contacts: Contacts
    source: NDArray[np.intp]
    sources: tuple[str, ...]
    is_new: bool
    errors: ErrorScales
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
        """Factors by which the variances of each contact's lasting error seem larger than told, shape (k,)."""
        return self.errors.doubts_of(self.names)
