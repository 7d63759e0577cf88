"""What the one-shot posterior says while a search goes on, and what of it is clear of the hand."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple, Self

import numpy as np
import scipy.special
from numpy.typing import NDArray

from tactopose_drake.core.evidence.hand_geometry import HandGeometry
from tactopose_drake.core.objectives.penetration import overlap_slope
from tactopose_drake.core.poses import compose
from tactopose_drake.core.posterior.hypotheses import Modes
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.tracker_params import RelocalisationParams
from tactopose_drake.core.validation import FloatArray


class WeighedModes(NamedTuple):
    """What the one-shot posterior says.

    Attributes:
        modes: of the pose.
        inlier_probability: of each contact, that it is what it claims to be, shape (k,): the geometric mean over the
            modes, so that of two by which another contact is false each, both are doubted, and none draws a mode away.
        sources: of these contacts; others may touch by the time that the search ends.
        noise_scale: by how much the noise seems larger than told.
    """

    modes: Modes
    inlier_probability: FloatArray
    sources: tuple[str, ...]
    noise_scale: float

    def moved(self, X_PP: FloatArray) -> WeighedModes:
        """The same after a motion (3, 4) of the object, which acts from the left: translations turn with it."""
        turn, mixture = np.eye(6), self.modes.mixture
        turn[3:, 3:] = X_PP[:, :3]
        mixture = dataclasses.replace(
            mixture, X_PO=compose(X_PP, mixture.X_PO), covariance=turn @ mixture.covariance @ turn.T
        )
        free = tuple(directions @ turn.T for directions in self.modes.free_directions)
        return self._replace(modes=dataclasses.replace(self.modes, mixture=mixture, free_directions=free))

    def likely(self, params: RelocalisationParams) -> NDArray[np.intp]:
        """Which of several modes are likely, the numbers of two at least; none where one alone is."""
        weights = self.modes.mixture.weights
        found = np.flatnonzero(weights > params.least_checked_share * weights.max())
        return found if len(found) > 1 else found[:0]

    def clear(
        self, model: ObjectModel, hand: HandGeometry | None, params: RelocalisationParams, depth: FloatArray
    ) -> Self:
        """The same where each mode counts by the probability that the object does not reach into the hand at it.

        How deep it does is as unsure as the mode's pose is, to first order, and as the hand's surface.

        Args:
            model: the object.
            hand: its volume, which says how unsure its surface is; None where that is not known.
            params: what may be, and what is assumed of the surface.
            depth: of the object in the hand at the likely modes, shape (n,), m.
        """
        mixture, likely = self.modes.mixture, self.likely(params)
        variance = np.full(len(likely), params.depth_sigma**2)
        if hand is not None:
            slope, covariance = overlap_slope(model.grid, hand, mixture.X_PO[likely]), mixture.covariance[likely]
            variance = hand.sigma**2 + np.einsum("ni,nij,nj->n", slope, covariance, slope)
        log_clear = scipy.special.log_ndtr((params.allowed_depth - depth) / np.sqrt(variance))
        weights = mixture.weights.copy()
        weights[likely] *= np.exp(log_clear - log_clear.max())
        mixture = dataclasses.replace(mixture, weights=weights / weights.sum())
        return self._replace(modes=dataclasses.replace(self.modes, mixture=mixture))
