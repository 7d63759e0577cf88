"""Gaussian modes of the pose, as the filter carries them from frame to frame."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.kernels import prior_kernels
from tactopose_drake.core.poses import compose, increments_between, retract
from tactopose_drake.core.tracking.motion_history import move, turn_of_increments
from tactopose_drake.core.tracking.object_motion import Motion
from tactopose_drake.core.tracking.pose_measurement import PoseMeasurement
from tactopose_drake.core.validation import FloatArray

# Two poses are one mode when they lie within this many standard deviations of each other. What lies farther off may be
# another minimum, on the flank of a mode that is still wide.
_SAME_MODE = 2.0
# The roughness that a contact is taken to feel follows the measured one by this share a frame: noise makes it jump.
_FOLLOW = 0.2
# Nothing is known of a rotation with this variance about each axis, rad^2: the mean square of a random rotation's.
_ANY_ROTATION = (np.pi**2 / 3.0 + 2.0) / 3.0
# Nor of a translation with this one, m^2.
_ANY_TRANSLATION = 0.3**2


@dataclasses.dataclass(frozen=True, eq=False)
class ModeSet:
    """Modes of the pose, each a Gaussian.

    Attributes:
        X_PO: the modes' poses, shape (n, 3, 4).
        covariance: of the increments (w, v) from them, shape (n, 6, 6), rad and m.
        cross: covariance of the increments with the biases of s sources of contacts, shape (n, 6, 6 s).
        roughness: of the surface where each source touches: by how much it adds to the biases' variances, of positions,
            m^2, and of normals, rad^2, shape (n, s, 2).
        log_prior: logarithms of the modes' shares but for the touch's part, shape (n,).
        log_touch: that part, see `touch_memory`, shape (n,).
        frames: how many of them it is the mean of, shape (n,).
        misfit: of the touch lately, see `surprise`, shape (n, 2).
        drift: likewise, shape (n, 6).
        drift_covariance: likewise, shape (n, 6, 6).
    """

    X_PO: FloatArray
    covariance: FloatArray
    cross: FloatArray
    roughness: FloatArray
    log_prior: FloatArray
    log_touch: FloatArray
    frames: FloatArray
    misfit: FloatArray
    drift: FloatArray
    drift_covariance: FloatArray

    def __len__(self) -> int:
        return len(self.X_PO)

    @classmethod
    def make(
        cls,
        X_PO: FloatArray,
        covariance: FloatArray,
        cross: FloatArray,
        roughness: FloatArray,
        log_prior: FloatArray,
        log_touch: FloatArray,
    ) -> ModeSet:
        """Modes that nothing surprised yet."""
        n = len(X_PO)
        return cls(
            X_PO,
            covariance,
            cross,
            roughness,
            log_prior,
            log_touch,
            np.zeros(n),
            np.zeros((n, 2)),
            np.zeros((n, 6)),
            np.zeros((n, 6, 6)),
        )

    @classmethod
    def empty(cls, sources: int = 0) -> ModeSet:
        """No mode at all."""
        poses, covariance, cross = np.zeros((0, 3, 4)), np.zeros((0, 6, 6)), np.zeros((0, 6, 6 * sources))
        return cls.make(poses, covariance, cross, np.zeros((0, sources, 2)), np.zeros(0), np.zeros(0))

    @property
    def log_weight(self) -> FloatArray:
        """Logarithms of the modes' shares, shape (n,)."""
        return self.log_prior + self.log_touch

    def chosen(self, index: Any) -> ModeSet:
        """Some of the modes, in the order of the index."""
        return ModeSet(*(getattr(self, field.name)[index] for field in dataclasses.fields(self)))

    def joined(self, others: ModeSet) -> ModeSet:
        """These modes and then others, over the same sources."""
        pairs = ((getattr(self, field.name), getattr(others, field.name)) for field in dataclasses.fields(self))
        return ModeSet(*(np.concatenate(pair) for pair in pairs))

    def with_sources(self, count: int) -> ModeSet:
        """The modes over at least so many sources; new ones know nothing of the pose."""
        missing = 6 * count - self.cross.shape[2]
        if missing <= 0:
            return self
        return dataclasses.replace(
            self,
            cross=np.pad(self.cross, ((0, 0), (0, 0), (0, missing))),
            roughness=np.pad(self.roughness, ((0, 0), (0, missing // 6), (0, 0))),
        )

    def touched(self, source: NDArray[np.intp], roughness: FloatArray, variances: FloatArray) -> ModeSet:
        """The modes when some sources (k,) touch a surface of this roughness (n, k, 2).

        A bias is the sum of the hand's, of variances (2,) of positions and of normals, and the surface's. Where the
        latter's variance grows, the pose knows nothing of what is added. Where the sum's falls from T to t, of the bias
        a share t / T is expected to be left.
        """
        after = self.roughness.copy()
        after[:, source] += _FOLLOW * (roughness - after[:, source])
        left = np.minimum(1.0, (variances + after) / (variances + self.roughness))
        cross = self.cross * np.repeat(left, 3, axis=2).reshape(len(self), 1, -1)
        return dataclasses.replace(self, cross=cross, roughness=after)

    def moved(self, motion: Motion) -> ModeSet:
        """The modes after a motion of the object; what is no knowledge any more does not grow further."""
        X_PO, covariance = move(self.X_PO, self.covariance, motion)
        cross = turn_of_increments(motion) @ self.cross
        limits = np.repeat([_ANY_ROTATION, _ANY_TRANSLATION], 3)
        for b in np.flatnonzero(np.any(np.diagonal(covariance, axis1=1, axis2=2) > limits, axis=1)):
            shrink = _shrink(covariance[b], limits)
            covariance[b], cross[b] = shrink @ covariance[b] @ shrink.T, shrink @ cross[b]
        return dataclasses.replace(self, X_PO=X_PO, covariance=covariance, cross=cross)

    def seen(self, measurement: PoseMeasurement, log_outlier: float) -> tuple[ModeSet, FloatArray]:
        """The modes after a measurement of the pose, which each of them either believes or takes for an error.

        Args:
            measurement: as of the modes' time.
            log_outlier: the logarithm of the density of a measurement that is an error, where those of others are
                normal, 1/(rad^3 m^3).

        Returns:
            The modes, and which of them believe it, shape (n,).
        """
        innovation = increments_between(self.X_PO, measurement.X_PO)
        expected = self.covariance + measurement.covariance
        gain = np.swapaxes(np.linalg.solve(expected, self.covariance), 1, 2)
        square = np.einsum("ni,ni->n", innovation, np.linalg.solve(expected, innovation[..., None])[..., 0])
        log_density = -0.5 * (square + np.linalg.slogdet(expected)[1]) - 3.0 * np.log(2.0 * np.pi)
        believes = log_density > log_outlier
        gain *= believes[:, None, None]
        covariance = self.covariance - gain @ self.covariance
        after = dataclasses.replace(
            self,
            X_PO=retract(self.X_PO, np.einsum("nij,nj->ni", gain, innovation)),
            covariance=0.5 * (covariance + np.swapaxes(covariance, 1, 2)),
            cross=self.cross - gain @ self.cross,
            log_prior=self.log_prior + np.maximum(log_density, log_outlier),
        )
        return after, believes

    def merged(self, symmetry_poses: FloatArray) -> ModeSet:
        """Distinct modes up to the object's symmetries: of equal ones the first, with the mass of all."""
        owner = _owners(self.X_PO, np.asarray(np.linalg.inv(self.covariance)), symmetry_poses)
        log_weight = np.full(len(self), -np.inf)
        np.logaddexp.at(log_weight, owner, self.log_weight)
        return dataclasses.replace(self, log_prior=log_weight - self.log_touch).chosen(
            np.flatnonzero(owner == np.arange(len(self)))
        )

    def distinct(self, symmetry_poses: FloatArray) -> ModeSet:
        """Distinct modes up to the object's symmetries: of equal ones the first, which was found more than once."""
        owner = _owners(self.X_PO, np.asarray(np.linalg.inv(self.covariance)), symmetry_poses)
        return self.chosen(np.flatnonzero(owner == np.arange(len(self))))

    def best(self, count: int, least: float) -> ModeSet:
        """The modes of most weight, which then sum to one: at most so many, and none below a share of the first's."""
        order = np.argsort(-self.log_weight, kind="stable")[:count]
        order = order[self.log_weight[order] >= self.log_weight[order[:1]] + np.log(least)]
        modes = self.chosen(order)
        total = np.logaddexp.reduce(modes.log_weight) if len(modes) else 0.0
        return dataclasses.replace(modes, log_prior=modes.log_prior - total)


def _owners(X_PO: FloatArray, information: FloatArray, symmetry_poses: FloatArray) -> NDArray[np.intp]:
    """For each of the poses (n, 3, 4) the first that it equals up to a symmetry, maybe itself."""
    n, g = len(X_PO), len(symmetry_poses)
    owner = np.arange(n)
    images = compose(X_PO[:, None], symmetry_poses[None])
    for a in range(n - 1):
        if owner[a] == a:
            later = np.ascontiguousarray(images[a + 1 :].reshape(-1, 3, 4))
            increments, slopes = np.empty((len(later), 6)), np.empty((len(later), 6, 6))
            prior_kernels.prior_residuals(np.ascontiguousarray(X_PO[a]), np.ones(6), later, increments, slopes)
            square = np.einsum("ni,ij,nj->n", increments, information[a], increments).reshape(-1, g).min(axis=1)
            free = owner[a + 1 :] == np.arange(a + 1, n)
            owner[a + 1 :][free & (square < _SAME_MODE**2)] = a
    return owner


def _shrink(covariance: FloatArray, limits: FloatArray) -> FloatArray:
    """The map (6, 6) of increments after which no direction of rotation or of translation is above its limit."""
    shrink = np.eye(6)
    for part in (slice(0, 3), slice(3, 6)):
        values, vectors = np.linalg.eigh(covariance[part, part])
        scale = np.sqrt(np.minimum(1.0, limits[part] / np.maximum(values, 1e-300)))
        shrink[part, part] = vectors @ np.diag(scale) @ vectors.T
    return shrink
