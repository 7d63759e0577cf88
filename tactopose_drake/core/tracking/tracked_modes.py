"""The modes of the pose as the filter carries them from frame to frame, with what it remembers of each."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.kernels.mode_kernels import one_of_each, owners
from tactopose_drake.core.tracking.tracker_params import MixtureParams
from tactopose_drake.core.validation import FloatArray


@dataclasses.dataclass(frozen=True, eq=False)
class TrackedModes:
    """Modes, each a joint Gaussian of the increments (w, v) from its pose and of the contacts' biases.

    What they say of the pose at one time a belief holds as a `GaussianMixture`. Here weights are logarithms, because
    likelihoods of single modes differ by more than a number holds, and the touch's part is kept apart: it is forgotten.

    Attributes:
        X_PO: the modes' poses, shape (n, 3, 4).
        covariance: of the increments from them, shape (n, 6, 6), rad and m.
        cross_covariance: of the increments with the biases of s sources of contacts, shape (n, 6, 6 s).
        roughness: of the surface where each source touches: by how much it adds to the biases' variances, of positions,
            m^2, and of normals, rad^2, shape (n, s, 2).
        log_prior: logarithms of the modes' weights but for the contacts' part, shape (n,).
        log_likelihood: that part, the mean of the latest frames' times their effective number, shape (n,).
        frames: how many it is the mean of, shape (n,).
        nis_excess: of the latest frames, by which the normalised innovations squared exceed what is expected, and the
            variance of that, shape (n, 2).
        drift: sum of the latest corrections, shape (n, 6).
        drift_covariance: that it is expected to have, shape (n, 6, 6).
    """

    X_PO: FloatArray
    covariance: FloatArray
    cross_covariance: FloatArray
    roughness: FloatArray
    log_prior: FloatArray
    log_likelihood: FloatArray
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
        log_prior: FloatArray,
        log_likelihood: FloatArray,
    ) -> TrackedModes:
        """Modes of which no innovation is known yet."""
        n = len(X_PO)
        return cls(
            X_PO,
            covariance,
            cross_covariance,
            roughness,
            log_prior,
            log_likelihood,
            np.zeros(n),
            np.zeros((n, 2)),
            np.zeros((n, 6)),
            np.zeros((n, 6, 6)),
        )

    @classmethod
    def independent(cls, X_PO: FloatArray, covariance: FloatArray, sources: int) -> TrackedModes:
        """Modes of equal weight that know nothing of the biases of so many sources, nor of the surface there."""
        n, even = len(X_PO), np.zeros(len(X_PO))
        return cls.make(X_PO, covariance, np.zeros((n, 6, 6 * sources)), np.zeros((n, sources, 2)), even, even)

    @classmethod
    def empty(cls, sources: int = 0) -> TrackedModes:
        """No mode at all."""
        return cls.independent(np.zeros((0, 3, 4)), np.zeros((0, 6, 6)), sources)

    @property
    def log_weight(self) -> FloatArray:
        """Logarithms of the modes' weights, shape (n,)."""
        return self.log_prior + self.log_likelihood

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

    def merged(self, symmetry_poses: FloatArray, same_sigmas: float) -> TrackedModes:
        """Distinct modes up to the object's symmetries: of equal ones the first, with the mass of all."""
        owner = self._owners(symmetry_poses, same_sigmas)
        log_weight = np.full(len(self), -np.inf)
        np.logaddexp.at(log_weight, owner, self.log_weight)
        return dataclasses.replace(self, log_prior=log_weight - self.log_likelihood).chosen(one_of_each(owner))

    def distinct(self, symmetry_poses: FloatArray, same_sigmas: float) -> TrackedModes:
        """Distinct modes up to the object's symmetries: of equal ones the first, which was found more than once."""
        return self.chosen(one_of_each(self._owners(symmetry_poses, same_sigmas)))

    def pruned(self, params: MixtureParams) -> TrackedModes:
        """The modes of most weight, which then sum to one, without those that hardly count."""
        order = np.argsort(-self.log_weight, kind="stable")[: params.max_modes]
        order = order[self.log_weight[order] >= self.log_weight[order[:1]] + np.log(params.least_share)]
        modes = self.chosen(order)
        total = np.logaddexp.reduce(modes.log_weight) if len(modes) else 0.0
        return dataclasses.replace(modes, log_prior=modes.log_prior - total)

    def _owners(self, symmetry_poses: FloatArray, same_sigmas: float) -> NDArray[np.int64]:
        """For each mode the first that it equals up to a symmetry (g, 3, 4), maybe itself."""
        information = np.asarray(np.linalg.inv(self.covariance))
        return owners(np.ascontiguousarray(self.X_PO), information, symmetry_poses, same_sigmas)
