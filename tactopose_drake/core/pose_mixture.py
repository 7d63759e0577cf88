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
from tactopose_drake.core.matrix_kernels import _cholesky, _invert, _solve_transposed
from tactopose_drake.core.validation import FloatArray

_FREEDOM = 6
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
        total = int(self.count.sum())
        normal = generator.standard_normal((total, 6))
        normal /= np.sqrt(generator.chisquare(_FREEDOM, size=(total, 1)) / _FREEDOM)
        _oppose(self.count, normal)
        return draw(self.X_PO, self.group, self.center, self.information, self.count, normal)

    def densities(self, X_PO: FloatArray) -> FloatArray:
        """Densities (B, g) of poses (B, 3, 4), each group's share; they add up to the mixture's.

        They are by the volume of poses: of rotations, as small turns measure it, and translations, rad^3 m^3.
        """
        n = 6 - self.turns.shape[2]
        information, log_determinant = across_turns(self.information, self.turns)
        power = 0.5 * (_FREEDOM + n)
        constant = math.lgamma(power) - math.lgamma(0.5 * _FREEDOM) - 0.5 * n * math.log(math.pi * _FREEDOM)
        scale = self.count * (np.exp(constant + 0.5 * log_determinant) / self.count.sum())
        density, reach = np.zeros((len(X_PO), len(self.X_PO))), np.zeros(len(self.X_PO))
        _find_reach(self.group, self.center, self.information, reach)
        first = np.searchsorted(self.group, np.arange(len(self.X_PO) + 1))
        _add_densities(self.X_PO, first, self.center, information, reach, scale, _FREEDOM + n, X_PO, density)
        return density


def draw(
    X_group: FloatArray,
    group: NDArray[np.intp],
    center: FloatArray,
    information: FloatArray,
    count: NDArray[np.intp],
    normal: FloatArray,
) -> FloatArray:
    """Poses (B, 3, 4), so many (J,) of each component, from white increments (B, 6); see `PoseMixture`."""
    X_PO = np.empty((len(normal), 3, 4))
    _draw(X_group, group, center, information, count, normal, X_PO)
    return X_PO


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
    """Leaves one turn out after the other."""
    L, image = np.empty((6, 6)), np.empty(6)
    for j in range(across.shape[0]):
        A = across[j]
        logarithm[j] = _cholesky(A, L)
        for c in range(turns.shape[2]):
            along = 0.0
            for i in range(6):
                image[i] = 0.0
                for k in range(6):
                    image[i] += A[i, k] * turns[j, k, c]
                along += image[i] * turns[j, i, c]
            logarithm[j] -= np.log(along)
            for i in range(6):
                for k in range(6):
                    A[i, k] -= image[i] * image[k] / along


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
def _oppose(count, normal):  # type: ignore[no-untyped-def]
    """Makes every second row of each component's the opposite of the row before."""
    first = 0
    for j in range(count.shape[0]):
        for b in range(first + 1, first + count[j], 2):
            for i in range(6):
                normal[b, i] = -normal[b - 1, i]
        first += count[j]


@njit(cache=True)
def _draw(X_group, group, center, information, count, normal, X):  # type: ignore[no-untyped-def]
    u, L = np.empty(6), np.empty((6, 6))
    b = 0
    for j in range(count.shape[0]):
        _cholesky(information[j], L)
        for _ in range(count[j]):
            _solve_transposed(L, normal[b], u)
            for i in range(6):
                u[i] += center[j, i]
            kernels._retract(X_group[group[j]], u, X[b])
            b += 1


@njit(cache=True)
def _find_reach(group, center, information, reach):  # type: ignore[no-untyped-def]
    """The squared distance in translation, m^2, within which a pose may belong to each group, into reach (g,)."""
    L, covariance = np.empty((6, 6)), np.empty((6, 6))
    for j in range(group.shape[0]):
        _cholesky(information[j], L)
        _invert(L, covariance)
        spread, square = 0.0, 0.0
        for i in range(3, 6):
            spread += covariance[i, i]
            square += center[j, i] ** 2
        reach[group[j]] = max(reach[group[j]], (np.sqrt(square) + np.sqrt(_FAR * spread)) ** 2)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz", "arcp"})
def _add_densities(X_group, first, center, information, reach, scale, power, X, density):  # type: ignore[no-untyped-def]
    """Adds (1 + d^T H d / f)^(-power / 2) of each component, d from its center, times its scale."""
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
                    total += scale[j] * np.sqrt(_FREEDOM / (_FREEDOM + square)) ** power
            if total > 0.0:
                # From the volume of increments to that of poses: the determinant of the right Jacobian.
                angle2 = u[0] ** 2 + u[1] ** 2 + u[2] ** 2
                volume = 1.0 - angle2 / 12.0 if angle2 < 1e-4 else 2.0 * (1.0 - np.cos(np.sqrt(angle2))) / angle2
                density[b, g] += total / volume
