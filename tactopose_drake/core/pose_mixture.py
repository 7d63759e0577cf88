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
        """Poses, shape (count.sum(), 3, 4), every second one of a component opposite to the one before it.

        Means over them are less noisy so: what is odd about a component's middle cancels.
        """
        index = np.repeat(np.arange(len(self.count)), self.count)
        normal = generator.normal(size=(len(index), 6))
        normal /= np.sqrt(generator.chisquare(_FREEDOM, size=(len(index), 1)) / _FREEDOM)
        is_second = (np.arange(len(index)) - (np.cumsum(self.count) - self.count)[index]) % 2 == 1
        normal[is_second] = -normal[np.flatnonzero(is_second) - 1]
        X_PO = np.empty((len(index), 3, 4))
        _draw(self.X_PO, self.group, self.center, np.linalg.cholesky(self.information), index, normal, X_PO)
        return X_PO

    def densities(self, X_PO: FloatArray) -> FloatArray:
        """Densities (B, g) of poses (B, 3, 4), each group's share; they add up to the mixture's.

        They are by the volume of poses: of rotations, as small turns measure it, and translations, rad^3 m^3.
        """
        n = 6 - self.turns.shape[2]
        information, log_determinant = across_turns(self.information, self.turns)
        power = 0.5 * (_FREEDOM + n)
        constant = math.lgamma(power) - math.lgamma(0.5 * _FREEDOM) - 0.5 * n * math.log(math.pi * _FREEDOM)
        scale = self.count / self.count.sum() * np.exp(constant + 0.5 * log_determinant)
        density = np.zeros((len(X_PO), len(self.X_PO)))
        first = np.searchsorted(self.group, np.arange(len(self.X_PO) + 1))
        _add_densities(self.X_PO, first, self.center, information, self._reach(first), scale, power, X_PO, density)
        return density

    def _reach(self, first: NDArray[np.intp]) -> FloatArray:
        """The squared distance in translation, m^2, within which a pose may belong to each group, shape (g,)."""
        spread = np.einsum("jaa->j", np.linalg.inv(self.information)[:, 3:, 3:])
        way = np.linalg.norm(self.center[:, 3:], axis=1) + np.sqrt(_FAR * spread)
        reach: FloatArray = np.maximum.reduceat(way, first[:-1]) ** 2
        return reach


def across_turns(information: FloatArray, turns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Information (J, 6, 6) over the directions across the turns (J, 6, c) alone, and the logarithms (J,) of what is
    left of its determinants.
    """
    across, logarithm = information.copy(), np.empty(len(information))
    _leave_out(np.ascontiguousarray(turns), across, logarithm)
    return across, logarithm


def in_chart(
    X_group: FloatArray, group: NDArray[np.intp], X_PO: FloatArray, information: FloatArray, turns: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Poses, information and directions at them, as increments from their groups' poses and changes of those.

    Args:
        X_group: the groups' poses, shape (g, 3, 4).
        group: which group each pose belongs to, shape (J,).
        X_PO: the poses, shape (J, 3, 4).
        information: by the increments at the poses, shape (J, 6, 6).
        turns: directions at the poses, shape (J, 6, c).

    Returns:
        The increments (J, 6), the information (J, 6, 6) and the directions (J, 6, c).
    """
    center, inside, moved = np.empty((len(X_PO), 6)), np.empty((len(X_PO), 6, 6)), turns.copy()
    _enter_chart(X_group, group, X_PO, information, center, inside, moved)
    return center, inside, moved


@njit(cache=True)
def _leave_out(turns, across, logarithm):  # type: ignore[no-untyped-def]
    """Leaves one turn out after the other, then takes the determinants' logarithms from Cholesky factors."""
    L, image = np.empty((6, 6)), np.empty(6)
    for j in range(across.shape[0]):
        A = across[j]
        total = 0.0
        for i in range(6):
            for k in range(i + 1):
                s = A[i, k]
                for c in range(k):
                    s -= L[i, c] * L[k, c]
                if i == k:
                    total += np.log(s)
                    L[i, i] = np.sqrt(s)
                else:
                    L[i, k] = s / L[k, k]
        for c in range(turns.shape[2]):
            along = 0.0
            for i in range(6):
                image[i] = 0.0
                for k in range(6):
                    image[i] += A[i, k] * turns[j, k, c]
                along += image[i] * turns[j, i, c]
            total -= np.log(along)
            for i in range(6):
                for k in range(6):
                    A[i, k] -= image[i] * image[k] / along
        logarithm[j] = total


@njit(cache=True)
def _enter_chart(X_group, group, X, information, center, inside, turns):  # type: ignore[no-untyped-def]
    """By the right Jacobian of the rotations and its inverse: J. Sola et al., A micro Lie theory for state estimation,
    2018, eqs. 143 and 144.
    """
    J, inverse, W, part = np.empty((3, 3)), np.empty((3, 3)), np.zeros((3, 3)), np.empty((3, 6))
    for j in range(X.shape[0]):
        u = center[j]
        kernels._increment(X_group[group[j]], X[j], u)
        W[0, 1], W[0, 2], W[1, 2] = -u[2], u[1], -u[0]
        W[1, 0], W[2, 0], W[2, 1] = u[2], -u[1], u[0]
        angle2 = u[0] * u[0] + u[1] * u[1] + u[2] * u[2]
        if angle2 < 1e-6:
            first, second, back = 0.5 - angle2 / 24.0, 1.0 / 6.0 - angle2 / 120.0, 1.0 / 12.0 + angle2 / 720.0
        else:
            angle = np.sqrt(angle2)
            first, second = (1.0 - np.cos(angle)) / angle2, (angle - np.sin(angle)) / (angle * angle2)
            back = 1.0 / angle2 - np.cos(0.5 * angle) / (2.0 * angle * np.sin(0.5 * angle))
        for a in range(3):
            for c in range(3):
                square = W[a, 0] * W[0, c] + W[a, 1] * W[1, c] + W[a, 2] * W[2, c]
                J[a, c] = -first * W[a, c] + second * square
                inverse[a, c] = 0.5 * W[a, c] + back * square
            J[a, a] += 1.0
            inverse[a, a] += 1.0
        # Only the rows and columns of the rotation change.
        A, B = information[j], inside[j]
        for a in range(3):
            for c in range(6):
                part[a, c] = J[0, a] * A[0, c] + J[1, a] * A[1, c] + J[2, a] * A[2, c]
        for a in range(6):
            for c in range(6):
                B[a, c] = part[a, c] if a < 3 else A[a, c]
        for a in range(3):
            for c in range(3):
                B[3 + a, c] = B[c, 3 + a]
                B[a, c] = part[a, 0] * J[0, c] + part[a, 1] * J[1, c] + part[a, 2] * J[2, c]
        for c in range(turns.shape[2]):
            x, y, z = turns[j, 0, c], turns[j, 1, c], turns[j, 2, c]
            for a in range(3):
                turns[j, a, c] = inverse[a, 0] * x + inverse[a, 1] * y + inverse[a, 2] * z


@njit(cache=True)
def _draw(X_group, group, center, roots, index, normal, X):  # type: ignore[no-untyped-def]
    """With H = L L^T, L^-T z has the covariance H^-1."""
    u = np.empty(6)
    for b in range(X.shape[0]):
        j = index[b]
        L = roots[j]
        for i in range(5, -1, -1):
            s = normal[b, i]
            for k in range(i + 1, 6):
                s -= L[k, i] * u[k]
            u[i] = s / L[i, i]
        for i in range(6):
            u[i] += center[j, i]
        kernels._retract(X_group[group[j]], u, X[b])


@njit(cache=True, nogil=True)
def _add_densities(X_group, first, center, information, reach, scale, power, X, density):  # type: ignore[no-untyped-def]
    u, d = np.empty(6), np.empty(6)
    for b in range(X.shape[0]):
        for g in range(X_group.shape[0]):
            square = 0.0
            for a in range(3):
                square += (X[b, a, 3] - X_group[g, a, 3]) ** 2
            if square > reach[g]:
                continue
            kernels._increment(X_group[g], X[b], u)
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
