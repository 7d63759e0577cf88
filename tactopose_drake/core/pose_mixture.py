"""A mixture of Student-t densities over poses: what a belief is sampled from.

Their tails are heavier than a Gaussian's, so that no sample that a Gaussian would hardly propose counts for all others.
The components come in groups; all of a group are over the increments (w, v) from one pose, so that a sample is compared
with all of them by one logarithm.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tactopose_drake.core import kernels
from tactopose_drake.core.poses import right_jacobian
from tactopose_drake.core.validation import FloatArray

_FREEDOM = 6.0
# A component counts up to this squared Mahalanobis distance; one sample in half a million lies further out.
_FAR = 1500.0


@dataclass(frozen=True, eq=False)
class PoseMixture:
    """Student-t densities with `_FREEDOM` degrees of freedom.

    Attributes:
        X_PO: the groups' poses, shape (g, 3, 4).
        group: which group each component belongs to, rising, shape (J,).
        center: the components' middles, increments from their groups' poses, shape (J, 6).
        information: the inverses of their scale matrices, over the same increments, shape (J, 6, 6).
        turns: the increments that change nothing, shape (J, 6, c). The densities are then over the other 6 - c
            dimensions.
        count: how many samples are drawn of each, shape (J,), at least one: its share of the density is theirs.
    """

    X_PO: FloatArray
    group: NDArray[np.intp]
    center: FloatArray
    information: FloatArray
    turns: FloatArray
    count: NDArray[np.intp]

    def sample(self, generator: np.random.Generator) -> FloatArray:
        """Poses, shape (count.sum(), 3, 4)."""
        index = np.repeat(np.arange(len(self.count)), self.count)
        normal = generator.normal(size=(len(index), 6))
        normal /= np.sqrt(generator.chisquare(_FREEDOM, size=(len(index), 1)) / _FREEDOM)
        # H = L L^T, so that L^-T z has the covariance H^-1.
        root = np.linalg.inv(np.linalg.cholesky(self.information))[index]
        X_PO = np.empty((len(index), 3, 4))
        increments = self.center[index] + np.einsum("bji,bj->bi", root, normal)
        kernels.retract(self.X_PO[self.group[index]], increments, X_PO)
        return X_PO

    def densities(self, X_PO: FloatArray) -> FloatArray:
        """Densities (B, g) of poses (B, 3, 4), each group's share; they add up to the mixture's.

        They are by the volume of poses: of rotations, as small turns measure it, and translations, rad^3 m^3.
        """
        information = self.information
        n = 6 - self.turns.shape[2]
        _, log_determinant = np.linalg.slogdet(information)
        if n < 6:
            across = information @ self.turns
            inner = np.swapaxes(self.turns, 1, 2) @ across
            information = information - across @ np.linalg.solve(inner, np.swapaxes(across, 1, 2))
            log_determinant = log_determinant - np.linalg.slogdet(inner)[1]
        power = 0.5 * (_FREEDOM + n)
        constant = math.lgamma(power) - math.lgamma(0.5 * _FREEDOM) - 0.5 * n * math.log(math.pi * _FREEDOM)
        scale = self.count / self.count.sum() * np.exp(constant + 0.5 * log_determinant)
        density = np.zeros((len(X_PO), len(self.X_PO)))
        first = np.searchsorted(self.group, np.arange(len(self.X_PO) + 1))
        _add_densities(
            self.X_PO,
            first,
            self.center,
            np.ascontiguousarray(information),
            self._reach(first),
            scale,
            power,
            X_PO,
            density,
        )
        return density

    def _reach(self, first: NDArray[np.intp]) -> FloatArray:
        """The squared distance in translation, m^2, within which a pose may belong to each group, shape (g,)."""
        spread = np.einsum("jaa->j", np.linalg.inv(self.information)[:, 3:, 3:])
        way = np.linalg.norm(self.center[:, 3:], axis=1) + np.sqrt(_FAR * spread)
        reach: FloatArray = np.maximum.reduceat(way, first[:-1]) ** 2
        return reach


def in_chart(center: FloatArray, information: FloatArray, turns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Information (J, 6, 6) and directions (J, 6, c), by the increments at poses, as changes of the increment there.

    Args:
        center: the poses, as increments (J, 6) from another pose.
        information: by the increments at them.
        turns: directions at them.
    """
    J = np.tile(np.eye(6), (len(center), 1, 1))
    J[:, :3, :3] = right_jacobian(center[:, :3])
    moved = np.asarray(np.linalg.solve(J, turns), dtype=np.float64)
    return np.swapaxes(J, 1, 2) @ information @ J, moved


@njit(cache=True, nogil=True)
def _add_densities(X_group, first, center, information, reach, scale, power, X, density):  # type: ignore[no-untyped-def]
    u, d, identity = np.empty(6), np.empty(6), np.eye(3, 4)
    for b in range(X.shape[0]):
        for g in range(X_group.shape[0]):
            square = 0.0
            for a in range(3):
                square += (X[b, a, 3] - X_group[g, a, 3]) ** 2
            if square > reach[g]:
                continue
            kernels._increment(X_group[g], X[b], identity, u)
            total = 0.0
            for j in range(first[g], first[g + 1]):
                for a in range(6):
                    d[a] = u[a] - center[j, a]
                square = 0.0
                for a in range(6):
                    half = 0.5 * information[j, a, a] * d[a]
                    for c in range(a):
                        half += information[j, a, c] * d[c]
                    square += 2.0 * half * d[a]
                if square < _FAR:
                    total += scale[j] * (1.0 + square / _FREEDOM) ** (-power)
            if total > 0.0:
                # From the volume of increments to that of poses: the determinant of the right Jacobian.
                angle2 = u[0] ** 2 + u[1] ** 2 + u[2] ** 2
                volume = 1.0 - angle2 / 12.0 if angle2 < 1e-4 else 2.0 * (1.0 - np.cos(np.sqrt(angle2))) / angle2
                density[b, g] += total / volume
