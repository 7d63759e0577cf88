"""The modes of the pose as the filter carries them from frame to frame, with what it remembers of each."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from tactopose_drake.core.poses import increments_between
from tactopose_drake.core.tracking.tracker_params import MixtureParams
from tactopose_drake.core.validation import FloatArray


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
        frames: how many have updated it since it was found, shape (n,).
        nis_excess: of the latest frames, by which the normalised innovations squared exceed what is expected, and the
            variance of that, shape (n, 2).
        drift: sum of the latest corrections, shape (n, 6).
        drift_covariance: that it is expected to have, shape (n, 6, 6).
    """

    X_PO: FloatArray
    covariance: FloatArray
    cross_covariance: FloatArray
    roughness: FloatArray
    log_weight: FloatArray
    frames: FloatArray
    nis_excess: FloatArray
    drift: FloatArray
    drift_covariance: FloatArray

    def __len__(self) -> int:
        return len(self.X_PO)

    @classmethod
    def make(
        cls,
        X_PO: FloatArray,
        covariance: FloatArray,
        cross_covariance: FloatArray,
        roughness: FloatArray,
        log_weight: FloatArray,
    ) -> TrackedModes:
        """Modes of which no innovation is known yet."""
        n = len(X_PO)
        return cls(
            X_PO,
            covariance,
            cross_covariance,
            roughness,
            log_weight,
            np.zeros(n),
            np.zeros((n, 2)),
            np.zeros((n, 6)),
            np.zeros((n, 6, 6)),
        )

    @classmethod
    def independent(cls, X_PO: FloatArray, covariance: FloatArray, sources: int) -> TrackedModes:
        """Modes of equal weight that know nothing of the biases of so many sources, nor of the surface there."""
        n, even = len(X_PO), np.zeros(len(X_PO))
        return cls.make(X_PO, covariance, np.zeros((n, 6, 6 * sources)), np.zeros((n, sources, 2)), even)

    @classmethod
    def empty(cls, sources: int = 0) -> TrackedModes:
        """No mode at all."""
        return cls.independent(np.zeros((0, 3, 4)), np.zeros((0, 6, 6)), sources)

    def chosen(self, index: Any) -> TrackedModes:
        """Some of the modes, in the order of the index."""
        return TrackedModes(*(getattr(self, field.name)[index] for field in dataclasses.fields(self)))

    def joined(self, others: TrackedModes) -> TrackedModes:
        """These modes and then others, over the same sources."""
        pairs = ((getattr(self, field.name), getattr(others, field.name)) for field in dataclasses.fields(self))
        return TrackedModes(*(np.concatenate(pair) for pair in pairs))

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

    def after(self, before: TrackedModes) -> TrackedModes:
        """The modes as corrections of others, mode by mode, of whose innovations they keep the record."""
        return dataclasses.replace(
            self,
            frames=before.frames,
            nis_excess=before.nis_excess,
            drift=before.drift + increments_between(before.X_PO, self.X_PO),
            drift_covariance=before.drift_covariance,
        )

    def widened(self, covariance: FloatArray) -> TrackedModes:
        """The modes, in every direction at least as wide as other covariances of their increments, (n, 6, 6)."""
        root = np.linalg.cholesky(self.covariance)
        unit = np.linalg.inv(root)
        values, vectors = np.linalg.eigh(unit @ covariance @ np.swapaxes(unit, 1, 2))
        axes = root @ vectors
        more = (axes * np.maximum(values - 1.0, 0.0)[:, None]) @ np.swapaxes(axes, 1, 2)
        return dataclasses.replace(self, covariance=self.covariance + more)

    def pruned(self, params: MixtureParams) -> TrackedModes:
        """The modes of most weight, which then sum to one, without those that hardly count."""
        order = np.argsort(-self.log_weight, kind="stable")[: params.max_modes]
        order = order[self.log_weight[order] >= self.log_weight[order[:1]] + np.log(params.least_share)]
        modes = self.chosen(order)
        total = np.logaddexp.reduce(modes.log_weight) if len(modes) else 0.0
        return dataclasses.replace(modes, log_weight=modes.log_weight - total)
