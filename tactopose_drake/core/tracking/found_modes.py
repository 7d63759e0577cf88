"""The modes that a search has found, by the one-shot posterior, and their correction for penetration of the hand."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple, Self

import numpy as np
import scipy.special
from numpy.typing import NDArray

from tactopose_drake.core.evidence.hand_geometry import HandGeometry
from tactopose_drake.core.objectives.penetration import overlap_slope
from tactopose_drake.core.poses import compose
from tactopose_drake.core.posterior.modes import Modes
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.tracker_params import RelocalisationParams
from tactopose_drake.core.validation import FloatArray


class FoundModes(NamedTuple):
    """The modes of the one-shot posterior that a search has found, and what they imply about the contacts.

    Attributes:
        modes: of the pose.
        inlier_probability: of each contact, shape (k,): the geometric mean over the modes, so that if two modes make
            different contacts outliers, both are doubted, and neither biases a mode.
        sources: of these contacts; others may touch by the time that the search ends.
        noise_scale: factor by which the noise seems larger than told.
    """

    modes: Modes
    inlier_probability: FloatArray
    sources: tuple[str, ...]
    noise_scale: float

    def moved(self, X_PP: FloatArray) -> FoundModes:
        """The result after a motion (3, 4) of the object from the left, which also rotates translations."""
        turn, mixture = np.eye(6), self.modes.mixture
        turn[3:, 3:] = X_PP[:, :3]
        mixture = dataclasses.replace(
            mixture, X_PO=compose(X_PP, mixture.X_PO), covariance=turn @ mixture.covariance @ turn.T
        )
        free = tuple(directions @ turn.T for directions in self.modes.free_directions)
        return self._replace(modes=dataclasses.replace(self.modes, mixture=mixture, free_directions=free))

    def likely(self, params: RelocalisationParams) -> NDArray[np.intp]:
        """Indices of the likely modes, if there are at least two; otherwise empty."""
        weights = self.modes.mixture.weights
        found = np.flatnonzero(weights > params.least_checked_share * weights.max())
        return found if len(found) > 1 else found[:0]

    def clear(
        self,
        model: ObjectModel,
        hand: HandGeometry | None,
        params: RelocalisationParams,
        likely: NDArray[np.intp],
        depth: FloatArray,
    ) -> Self:
        """The result with each mode weighted by the probability that the object does not penetrate the hand there.

        The variance of the penetration comes from the mode's pose, to first order, and from the hand's surface.

        Args:
            model: the object.
            hand: its volume with the standard deviation of its surface; None if unknown.
            params: the allowed penetration, and the assumed standard deviation of the surface.
            likely: indices of the likely modes, shape (n,); only these are weighted.
            depth: penetration at these, shape (n,), m.
        """
        mixture, variance = self.modes.mixture, np.full(len(likely), params.depth_sigma**2)
        if hand is not None:
            slope, covariance = overlap_slope(model.grid, hand, mixture.X_PO[likely]), mixture.covariance[likely]
            variance = hand.sigma**2 + np.einsum("ni,nij,nj->n", slope, covariance, slope)
        log_clear = scipy.special.log_ndtr((params.allowed_depth - depth) / np.sqrt(variance))
        weights = mixture.weights.copy()
        weights[likely] *= np.exp(log_clear - log_clear.max())
        mixture = dataclasses.replace(mixture, weights=weights / weights.sum())
        return self._replace(modes=dataclasses.replace(self.modes, mixture=mixture))
