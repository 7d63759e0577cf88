"""The filter's state: modes of the pose with their correlations, carried from frame to frame."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np

from tactopose_drake.core.motion.rigid_motion import Motion, carry, three_each
from tactopose_drake.core.plain_values import copied
from tactopose_drake.core.poses import RANDOM_ROTATION_VARIANCE, increments_between
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.shape.free_spin import nearest_images
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.tracker_params import MixtureParams, PoseTrackerParams
from tactopose_drake.core.validation import FloatArray

REFINEMENT = LevenbergMarquardt(max_iterations=20, tolerance=1e-2)
"""Refines poses of modes, new ones and those weighed by earlier touches."""
# Stands for unbounded information, 1/rad^2 and 1/m^2.
_NO_BOUND = 1e16


@dataclasses.dataclass(frozen=True, eq=False)
class TrackedModes:
    """Modes, each a joint Gaussian of the increments (w, v) from its pose and of the contacts' biases.

    A belief publishes them as a `GaussianMixture`. Weights are kept as logarithms, because the likelihoods of modes may
    differ by more than the range of a double.

    Attributes:
        X_PO: the modes' poses, shape (n, 3, 4).
        covariance: of the increments from them, shape (n, 6, 6), rad and m.
        cross_covariance: of the increments with the biases of s sources of contacts, shape (n, 6, 6 s).
        roughness: variances that the surface where each source touches adds to the biases, of positions, m^2, and of
            normals, rad^2, shape (n, s, 2).
        log_weight: logarithms of the modes' weights, shape (n,).
        most_information: of the increments, from the last search and the window: no update by contacts makes a mode
            surer; practically unbounded for modes that no search has found, shape (n, 6, 6).
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
        """Modes of equal weight, uncorrelated with the biases of this number of sources, and without roughness."""
        n, unbounded = len(X_PO), np.tile(_NO_BOUND * np.eye(6), (len(X_PO), 1, 1))
        cross_covariance, roughness = np.zeros((n, 6, 6 * sources)), np.zeros((n, sources, 2))
        return cls(X_PO, covariance, cross_covariance, roughness, np.zeros(n), unbounded)

    @classmethod
    def empty(cls, sources: int = 0) -> TrackedModes:
        """No modes."""
        return cls.independent(np.zeros((0, 3, 4)), np.zeros((0, 6, 6)), sources)

    def chosen(self, index: Any) -> TrackedModes:
        """A subset of the modes, in the order of the index."""
        return TrackedModes(*(array[index] for array in self._arrays))

    def joined(self, others: TrackedModes) -> TrackedModes:
        """These modes followed by others, over the same sources."""
        return TrackedModes(*(np.concatenate(pair) for pair in zip(self._arrays, others._arrays, strict=True)))

    def with_sources(self, count: int) -> TrackedModes:
        """The modes over at least `count` sources, uncorrelated with new ones."""
        missing = 6 * count - self.cross_covariance.shape[2]
        if missing <= 0:
            return self
        return dataclasses.replace(
            self,
            cross_covariance=np.pad(self.cross_covariance, ((0, 0), (0, 0), (0, missing))),
            roughness=np.pad(self.roughness, ((0, 0), (0, missing // 6), (0, 0))),
        )

    def with_roughness(self, roughness: FloatArray, variances: FloatArray) -> TrackedModes:
        """The modes after the biases turn out larger or smaller than assumed all along.

        The dependence of the increments on the biases, the gain C B^-1 with their cross-covariance C, is kept; the part
        of the covariance that comes from the biases is scaled to their new variances B.

        Args:
            roughness: what the surface adds to these variances from now on, shape (n, s, 2).
            variances: of the bias of a position, m^2, and of a normal, rad^2, shape (2,).
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
        """The modes with other covariances of their increments, shape (n, 6, 6).

        Where these are narrower, the part of the increments that is correlated with the biases shrinks likewise; where
        they are wider, the added part is uncorrelated.
        """
        root, unit, values, vectors = self._compared(covariance)
        shrink = (root @ vectors * np.sqrt(np.clip(values, 0.0, 1.0))[:, None]) @ np.swapaxes(vectors, 1, 2) @ unit
        return dataclasses.replace(self, covariance=covariance, cross_covariance=shrink @ self.cross_covariance)

    def at_least(self, covariance: FloatArray) -> TrackedModes:
        """The modes, widened so that no direction is better known than by these covariances, shape (n, 6, 6)."""
        root, _, values, vectors = self._compared(covariance)
        wider = root @ vectors * np.sqrt(np.maximum(values, 1.0))[:, None]
        return dataclasses.replace(self, covariance=wider @ np.swapaxes(wider, 1, 2))

    def _compared(self, covariance: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Compares covariances (n, 6, 6) with the modes' own, in coordinates in which these are identities.

        Returns:
            The maps from these coordinates and to them, shape (n, 6, 6), and the eigenvalues, shape (n, 6), and
            eigenvectors, shape (n, 6, 6), of the covariances in them.
        """
        root = np.asarray(np.linalg.cholesky(self.covariance))
        unit = np.asarray(np.linalg.inv(root))
        values, vectors = np.linalg.eigh(unit @ covariance @ np.swapaxes(unit, 1, 2))
        return root, unit, values, vectors

    def pruned(self, params: MixtureParams) -> TrackedModes:
        """The modes of most weight, without negligible ones, normalised so that weights sum to one."""
        if len(self) == 1:
            return copied(self, log_weight=np.zeros(1))
        order = (-self.log_weight).argsort(kind="stable")[: params.max_modes]
        order = order[self.log_weight[order] >= self.log_weight[order[:1]] + math.log(params.least_share)]
        modes = self.chosen(order)
        total = np.logaddexp.reduce(modes.log_weight) if len(modes) else 0.0
        return copied(modes, log_weight=modes.log_weight - total)


def predict_modes(modes: TrackedModes, motion: Motion, max_sigma_translation: float) -> TrackedModes:
    """Moves the modes with the object; limits covariances that express no knowledge any more.

    Args:
        modes: before the motion.
        motion: of the object.
        max_sigma_translation: upper bound on the standard deviation of a translation, m.
    """
    X_PO, covariance, cross = carry(modes.X_PO, modes.covariance, modes.cross_covariance, motion)
    limits = three_each(RANDOM_ROTATION_VARIANCE, max_sigma_translation**2)
    is_beyond = np.diagonal(covariance, axis1=1, axis2=2) > limits
    for b in np.flatnonzero(is_beyond.any(axis=1)):
        shrink = _shrink(covariance[b], limits)
        covariance[b], cross[b] = shrink @ covariance[b] @ shrink.T, shrink @ cross[b]
    most = motion.increment_map @ modes.most_information @ motion.increment_map.T  # The map is orthogonal.
    return copied(modes, X_PO=X_PO, covariance=covariance, cross_covariance=cross, most_information=most)


def has_moved(model: ObjectModel, params: PoseTrackerParams, X_before: FloatArray, X_now: FloatArray) -> bool:
    """Whether the best mode, shape (1, 3, 4), is another than before, up to a symmetry."""
    if np.array_equal(X_before, X_now):
        return False
    X_near = nearest_images(X_now, X_before[0], model.symmetry_turns, model.symmetries)
    u = increments_between(X_before, X_near)[0]
    moved = np.linalg.norm(u[3:]) + params.lever_arm * model.size * np.linalg.norm(u[:3])
    return bool(moved > params.settled_distance)


def _shrink(covariance: FloatArray, limits: FloatArray) -> FloatArray:
    """A map (6, 6) of increments after which no direction of rotation or of translation exceeds its variance limit."""
    shrink = np.eye(6)
    for part in (slice(0, 3), slice(3, 6)):
        values, vectors = np.linalg.eigh(covariance[part, part])
        scale = np.sqrt(np.minimum(1.0, limits[part] / np.maximum(values, 1e-300)))
        shrink[part, part] = vectors @ np.diag(scale) @ vectors.T
    return shrink
