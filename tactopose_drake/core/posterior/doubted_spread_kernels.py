"""How far modes spread where each contact may be false, compiled; see `doubted_spread.py`."""

from typing import NamedTuple, Self

import numpy as np

from tactopose_drake.core.compilation import kernel, part
from tactopose_drake.core.kernel_types import (
    Floats1,
    Floats2,
    Floats3,
    Floats4,
    OutFloats2,
    OutFloats3,
    OutFloats4,
    OutLongs1,
)
from tactopose_drake.core.kernels import pose_kernels
from tactopose_drake.core.kernels.matrix_kernels import cholesky, solve
from tactopose_drake.core.kernels.sorting_kernels import copy_vector

# Abscissae on each side of a line: the first in standard deviations of the mode with all contacts; then a geometric
# sequence, _POINTS in all, up to _LAST standard deviations of the mode with the contact left out.
_NEAR = (0.5, 1.0, 1.5)
_POINTS, _LAST = 12, 4.0
# A line is evaluated only if leaving out the contact widens the mode at least by this factor.
_LEAST_WIDER = 2.0
# Iterations of the power method that finds the direction of most lost information; a distance (rank 1) needs only one.
_STEPS = 6


class Lines(NamedTuple):
    """Lines through modes along which these spread if one contact is false.

    Attributes:
        mode: index of the mode that each line goes through, shape (n,).
        direction: increments of one standard deviation of the mode with all contacts, shape (n, 6).
        place: abscissae of the points on the line, in `direction`s, one side after the other, shape (n, q).
        X: the points, shape (n, q, 3, 4).
    """

    mode: OutLongs1
    direction: OutFloats2
    place: OutFloats2
    X: OutFloats4

    @classmethod
    def empty(cls, count: int) -> Self:
        """Uninitialised arrays for `count` lines."""
        points = 2 * _POINTS
        return cls(
            np.empty(count, dtype=np.int64),
            np.empty((count, 6)),
            np.empty((count, points)),
            np.empty((count, points, 3, 4)),
        )

    def first(self, count: int) -> Self:
        """The first `count` lines."""
        return type(self)(self.mode[:count], self.direction[:count], self.place[:count], self.X[:count])


@kernel
def lay_lines(X: Floats3, information: Floats3, left: Floats4, lines: Lines) -> int:
    """Lays lines through modes (B, 3, 4) along the direction in which each alternative loses most information.

    information (B, 6, 6) counts all contacts; left (B, m, 6, 6) is what remains of it in each alternative. Returns the
    number of lines that are worth evaluating.
    """
    n, L, d, lost, u = 0, np.empty((6, 6)), np.empty(6), np.empty((6, 6)), np.empty(6)
    for b in range(X.shape[0]):
        if not np.isfinite(cholesky(6, information[b], L)):
            continue
        for z in range(left.shape[1]):
            column, most = -1, 0.0
            for i in range(6):
                for j in range(6):
                    lost[i, j] = information[b, i, j] - left[b, z, i, j]
                if lost[i, i] > most * information[b, i, i]:
                    column, most = i, lost[i, i] / information[b, i, i]
            if column < 0:
                continue
            for i in range(6):
                u[i] = lost[i, column]
            kept = 0.0
            for _ in range(_STEPS):
                copy_vector(u, d)
                solve(6, L, d)
                square = 0.0
                for i in range(6):
                    square += u[i] * d[i]
                for i in range(6):
                    d[i] /= np.sqrt(square)  # Normalises d^T H d to 1: before, it is u^T H^-1 u.
                kept = 0.0
                for i in range(6):
                    u[i] = 0.0
                    for j in range(6):
                        u[i] += lost[i, j] * d[j]
                        kept += d[i] * left[b, z, i, j] * d[j]
            if not 0.0 < kept <= 1.0 / _LEAST_WIDER**2:
                continue
            lines.mode[n] = b
            copy_vector(d, lines.direction[n])
            grown = (_LAST / (np.sqrt(kept) * _NEAR[-1])) ** (1.0 / (_POINTS - len(_NEAR)))
            place = _NEAR[-1]
            for q in range(_POINTS):
                place = _NEAR[q] if q < len(_NEAR) else grown * place
                for side in range(2):
                    signed = place if side == 0 else -place
                    for i in range(6):
                        u[i] = signed * d[i]
                    lines.place[n, side * _POINTS + q] = signed
                    pose_kernels.retract_one(X[b], u, lines.X[n, side * _POINTS + q])
            n += 1
    return n


@part
def _mean_square(place: Floats1, low: float, cost: Floats1) -> float:
    """The mean square abscissa under densities exp(low - cost), capped at 1: lower costs belong to another mode."""
    mass, second = 0.0, 0.0
    for side in range(2):
        before, at = 1.0, 0.0
        for q in range(side * _POINTS, (side + 1) * _POINTS):
            density, half_width = np.exp(min(low - cost[q], 0.0)), 0.5 * (abs(place[q]) - at)
            mass += half_width * (density + before)
            second += half_width * (density * place[q] ** 2 + before * at**2)
            before, at = density, abs(place[q])
    return second / mass


@kernel
def widen_modes(lines: Lines, low: Floats1, cost: Floats2, information: Floats3, covariance: OutFloats3) -> None:
    """Raises covariances (B, 6, 6) to the variance that the exact costs (n, q) imply along each line.

    low (B,) are the modes' own costs; information (B, 6, 6) is that of all contacts.
    """
    dual = np.empty(6)
    for line in range(lines.mode.shape[0]):
        b, d = lines.mode[line], lines.direction[line]
        variance = 0.0
        for i in range(6):  # The functional dual^T u is 1 at u = d and 0 on the H-conjugate directions.
            dual[i] = 0.0
            for j in range(6):
                dual[i] += information[b, i, j] * d[j]
        for i in range(6):
            for j in range(6):
                variance += dual[i] * covariance[b, i, j] * dual[j]
        missing = _mean_square(lines.place[line], low[b], cost[line]) - variance
        if missing > 0.0:
            for i in range(6):
                for j in range(6):
                    covariance[b, i, j] += missing * d[i] * d[j]
