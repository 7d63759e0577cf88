"""The modes of the pose as the filter carries them from frame to frame, with what it remembers of each."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np

from tactopose_drake.core.motion.rigid_motion import Motion, carry, three_each
from tactopose_drake.core.plain_values import copied
from tactopose_drake.core.poses import RANDOM_ROTATION_VARIANCE
from tactopose_drake.core.tracking.tracker_params import MixtureParams
from tactopose_drake.core.validation import FloatArray

# Information that nothing has, 1/rad^2 and 1/m^2.
_NO_BOUND = 1e16


@dataclasses.dataclass(frozen=True, eq=False)
class TrackedModes:
    """Modes, each a joint Gaussian of the increments (w, v) from its pose and of the contacts' biases.

    What they say of the pose at one time a belief holds as a `GaussianMixture`. Here weights are logarithms, because
    likelihoods of single modes differ by more than a number holds.

    Attributes:
        X_PO: the modes' poses, shape (n, 3, 4).
        covariance: of the increments from them, shape (n, 6, 6), rad and m.
        cross_covariance: of the increments with the biases of s sources of contacts, shape (n, 6, 6 s).
        roughness: of the surface where each source touches: by how much it adds to the biases' variances, of positions,
            m^2, and of normals, rad^2, shape (n, s, 2).
        log_weight: logarithms of the modes' weights, shape (n,).
        most_information: of the increments, what the last search and the window tell of them: no update by contacts
            makes a mode surer; without a bound where no search has found it, shape (n, 6, 6).
    """

    X_PO: FloatArray
    covariance: FloatArray
    cross_covariance: FloatArray
    roughness: FloatArray
    log_weight: FloatArray
    most_information: FloatArray

    def __len__(self) -> int:
        return len(self.X_PO)

    @property
    def _arrays(self) -> tuple[FloatArray, ...]:
        filtered = self.X_PO, self.covariance, self.cross_covariance, self.roughness
        return *filtered, self.log_weight, self.most_information

    @classmethod
    def independent(cls, X_PO: FloatArray, covariance: FloatArray, sources: int) -> TrackedModes:
        """Modes of equal weight that know nothing of the biases of so many sources, nor of the surface there."""
        n, unbounded = len(X_PO), np.tile(_NO_BOUND * np.eye(6), (len(X_PO), 1, 1))
        cross_covariance, roughness = np.zeros((n, 6, 6 * sources)), np.zeros((n, sources, 2))
        return cls(X_PO, covariance, cross_covariance, roughness, np.zeros(n), unbounded)

    @classmethod
    def empty(cls, sources: int = 0) -> TrackedModes:
        """No mode at all."""
        return cls.independent(np.zeros((0, 3, 4)), np.zeros((0, 6, 6)), sources)

    def chosen(self, index: Any) -> TrackedModes:
        """Some of the modes, in the order of the index."""
        return TrackedModes(*(array[index] for array in self._arrays))

    def joined(self, others: TrackedModes) -> TrackedModes:
        """These modes and then others, over the same sources."""
        return TrackedModes(*(np.concatenate(pair) for pair in zip(self._arrays, others._arrays, strict=True)))

    def with_sources(self, count: int) -> TrackedModes:
        """The modes over at least so many sources; of new ones they know nothing."""
        missing = 6 * count - self.cross_covariance.shape[2]
        if missing <= 0:
            return self
        return dataclasses.replace(
            self,
            cross_covariance=np.pad(self.cross_covariance, ((0, 0), (0, 0), (0, missing))),
            roughness=np.pad(self.roughness, ((0, 0), (0, missing // 6), (0, 0))),
        )

    def with_roughness(self, roughness: FloatArray, variances: FloatArray) -> TrackedModes:
        """The modes where the biases are found to be larger or smaller than was assumed all along.

        How the increments depend on the biases stays, which is the gain C B^-1 of their covariance C; what is of the
        biases in their covariance is as the biases' variances B now are.

        Args:
            roughness: what there is beside these variances from now on, shape (n, s, 2).
            variances: of a bias of the position, m^2, and of the normal, rad^2, shape (2,).
        """
        shape = (len(self), 1, self.cross_covariance.shape[2])
        before, after = (
            np.repeat(variances + of_surface, 3, axis=2).reshape(shape) for of_surface in (self.roughness, roughness)
        )
        gain = self.cross_covariance / before
        more = (gain * (after - before)) @ np.swapaxes(gain, 1, 2)
        return dataclasses.replace(
            self, covariance=self.covariance + more, cross_covariance=gain * after, roughness=roughness
        )

    def fitted(self, covariance: FloatArray) -> TrackedModes:
        """The modes with other covariances of their increments, (n, 6, 6).

        Where these are narrower, the part of the increments that is shared with the biases shrinks alike; where they
        are wider, what is added is the pose's own.
        """
        root = np.linalg.cholesky(self.covariance)
        unit = np.linalg.inv(root)
        values, vectors = np.linalg.eigh(unit @ covariance @ np.swapaxes(unit, 1, 2))
        shrink = (root @ vectors * np.sqrt(np.clip(values, 0.0, 1.0))[:, None]) @ np.swapaxes(vectors, 1, 2) @ unit
        return dataclasses.replace(self, covariance=covariance, cross_covariance=shrink @ self.cross_covariance)

    def at_least(self, covariance: FloatArray) -> TrackedModes:
        """The modes whose increments are nowhere better known than by other covariances, (n, 6, 6)."""
        root = np.linalg.cholesky(self.covariance)
        unit = np.linalg.inv(root)
        values, vectors = np.linalg.eigh(unit @ covariance @ np.swapaxes(unit, 1, 2))
        wider = root @ vectors * np.sqrt(np.maximum(values, 1.0))[:, None]
        return dataclasses.replace(self, covariance=wider @ np.swapaxes(wider, 1, 2))

    def pruned(self, params: MixtureParams) -> TrackedModes:
        """The modes of most weight, which then sum to one, without those that hardly count."""
        if len(self) == 1:
            return copied(self, log_weight=np.zeros(1))
        order = (-self.log_weight).argsort(kind="stable")[: params.max_modes]
        order = order[self.log_weight[order] >= self.log_weight[order[:1]] + math.log(params.least_share)]
        modes = self.chosen(order)
        total = np.logaddexp.reduce(modes.log_weight) if len(modes) else 0.0
        return copied(modes, log_weight=modes.log_weight - total)


def predict_modes(modes: TrackedModes, motion: Motion, max_sigma_translation: float) -> TrackedModes:
    """The modes after a motion of the object; what is no knowledge any more does not grow further.

    Args:
        modes: before.
        motion: of the object.
        max_sigma_translation: of a translation with this standard deviation nothing is known, m.
    """
    X_PO, covariance, cross = carry(modes.X_PO, modes.covariance, modes.cross_covariance, motion)
    limits = three_each(RANDOM_ROTATION_VARIANCE, max_sigma_translation**2)
    is_beyond = np.diagonal(covariance, axis1=1, axis2=2) > limits
    for b in np.flatnonzero(is_beyond.any(axis=1)) if is_beyond.any() else ():
        shrink = _shrink(covariance[b], limits)
        covariance[b], cross[b] = shrink @ covariance[b] @ shrink.T, shrink @ cross[b]
    most = motion.increment_map @ modes.most_information @ motion.increment_map.T  # The map is orthogonal.
    return copied(modes, X_PO=X_PO, covariance=covariance, cross_covariance=cross, most_information=most)


def _shrink(covariance: FloatArray, limits: FloatArray) -> FloatArray:
    """The map (6, 6) of increments after which no direction of rotation or of translation is above its limit."""
    shrink = np.eye(6)
    for part in (slice(0, 3), slice(3, 6)):
        values, vectors = np.linalg.eigh(covariance[part, part])
        scale = np.sqrt(np.minimum(1.0, limits[part] / np.maximum(values, 1e-300)))
        shrink[part, part] = vectors @ np.diag(scale) @ vectors.T
    return shrink
