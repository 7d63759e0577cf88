"""Compiled loops of the posterior: importance weights, resampling, and steps to a valley's floor.

See `importance_sampling.py` and `mode_cover.py`.

With the exact posterior exp(-c) and the groups' densities q_g, which add up to the mixture q = sum_g q_g, a sample x
out of N has the weight w = exp(-c(x)) / (N q(x)), of which w q_g(x) / q(x) belongs to group g [OZ00]. Weights are
truncated at their mean times a power of N, which keeps estimates consistent [I08].
"""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import kernel, part
from tactopose_drake.core.kernel_types import (
    Floats1,
    Floats2,
    Floats3,
    Longs1,
    OutFloats1,
    OutFloats2,
    OutFloats3,
    OutLongs1,
)
from tactopose_drake.core.kernels import least_squares_kernels, pose_kernels
from tactopose_drake.core.kernels.sorting_kernels import copy_matrix


class Draws(NamedTuple):
    """Samples, sorted by component.

    Attributes:
        cost: negative log posterior densities, up to a constant, shape (B,).
        density: of each group's proposals at the samples, times the number of all samples, shape (B, g).
        each: number of samples of each component, shape (J,).
        group: the group of each component, shape (J,).
    """

    cost: Floats1
    density: Floats2
    each: Longs1
    group: Longs1


class WeightSummary(NamedTuple):
    """Summary of the importance weights.

    Attributes:
        lowest: the lowest cost; weights are relative to exp(lowest).
        standard_error: the largest one of the families' probabilities.
        effective_samples: the effective sample size before truncation.
        mass: the sum of the weights, including those of samples that belong to no group.
    """

    lowest: float
    standard_error: float
    effective_samples: float
    mass: float


@kernel
def weigh(
    draws: Draws,
    family: Longs1,
    lowest: float,
    most_excess_cost: float,
    power: float,
    weights: OutFloats2,
    variance: OutFloats1,
) -> WeightSummary:
    """Fills the weights (B, g), and each group's contribution (g,) to the variance of the noisiest probability.

    Variances are those of families, each named by one of its groups (g,), as probability that moves between groups of
    the same family does not matter. A sample whose cost exceeds the lowest known one by more than `most_excess_cost`
    belongs to no group; no weight exceeds the mean of all times their number to the given power [I08].
    """
    cost, density = draws.cost, draws.density
    for b in range(cost.shape[0]):
        lowest = min(lowest, cost[b])
    each, every, total, mass = np.zeros(cost.shape[0]), np.empty(cost.shape[0]), 0.0, 0.0
    for b in range(cost.shape[0]):
        whole = 1e-300
        for g in range(family.shape[0]):
            whole += density[b, g]
        weight = np.exp(lowest - cost[b]) / whole
        every[b] = weight
        mass += weight
        for g in range(family.shape[0]):
            weights[b, g] = weight * (density[b, g] / whole) if cost[b] < lowest + most_excess_cost else 0.0
            each[b] += weights[b, g]
        total += each[b]
    for g in range(family.shape[0]):
        variance[g] = 0.0
    if not total > 0.0:
        return WeightSummary(lowest, 0.5, 0.0, mass)
    most, squares = total * cost.shape[0] ** (power - 1.0), 0.0
    for b in range(cost.shape[0]):
        squares += (each[b] / total) ** 2  # Normalised first, as the weights may be near underflow.
    total, mass = 0.0, 0.0
    for b in range(cost.shape[0]):
        mass += min(every[b], most)
        if each[b] > most:
            for g in range(family.shape[0]):
                weights[b, g] *= most / each[b]
            each[b] = most
        total += each[b]
    together = np.zeros((family.shape[0], cost.shape[0]))
    for b in range(cost.shape[0]):
        each[b] /= total
        for g in range(family.shape[0]):
            together[family[g], b] += weights[b, g] / total
    largest, own = 0.0, np.empty(family.shape[0])
    for g in range(family.shape[0]):
        whole = _variance(together[g], each, draws, own) if family[g] == g else 0.0
        if whole > largest:
            largest = whole
            for k in range(family.shape[0]):
                variance[k] = own[k]
    return WeightSummary(lowest, np.sqrt(largest), 1.0 / squares, mass)


@part
def _variance(weights: Floats1, each: Floats1, draws: Draws, variance: OutFloats1) -> float:
    """The variance of a family's probability, from its weights (B,) and the total weights (B,), which sum to 1.

    Fills variance (g,) with the contribution of each group's samples to it.

    The probability is a ratio of sums over the samples; its variance is that of the linearised ratio, the residuals
    w_g - share * w. The samples are stratified by component, with `count` (J,) of each, and drawn in antithetic pairs:
    only the variance between the pairs of a component counts.
    """
    share, whole, first, count = 0.0, 0.0, 0, draws.each
    for b in range(each.shape[0]):
        share += weights[b]
    for k in range(variance.shape[0]):
        variance[k] = 0.0
    for j in range(count.shape[0]):
        units, total, squares = 0, 0.0, 0.0
        for b in range(first, first + count[j], 2):
            unit = 0.0
            for paired in range(b, min(b + 2, first + count[j])):
                unit += weights[paired] - share * each[paired]
            units += 1
            total += unit
            squares += unit * unit
        # The variance of a single unit is unknown; its square is an upper bound. That of equal units rounds to 0.
        own = squares if units < 2 else max(squares - total * total / units, 0.0) * units / (units - 1.0)
        variance[draws.group[j]] += own
        whole += own
        first += count[j]
    return whole


class Drawn(NamedTuple):
    """Resampled samples, sorted by group: their indices, groups and multiplicities, shape (n,)."""

    sample: OutLongs1
    group: OutLongs1
    times: OutLongs1


@kernel
def resample(weights: Floats2, drawn: Drawn) -> int:
    """Systematic resampling by weights (B, g): draws as many as fit, and assigns each to its heaviest group.

    Returns the number of distinct samples drawn; only so many entries are filled.
    """
    sample, group, times = drawn
    most, total, passed, done, count = sample.shape[0], 0.0, 0.0, 0, 0
    work = np.empty((3, most), dtype=np.int64)
    chosen, owner, often = work[0], work[1], work[2]
    for b in range(weights.shape[0]):
        for g in range(weights.shape[1]):
            total += weights[b, g]
    for b in range(weights.shape[0]):
        heaviest = 0
        for g in range(weights.shape[1]):
            passed += weights[b, g]
            if weights[b, g] > weights[b, heaviest]:
                heaviest = g
        before = done
        while done < most and total * (done + 0.5) / most <= passed:
            done += 1
        if done > before:
            chosen[count], owner[count], often[count] = b, heaviest, done - before
            count += 1
    filled = 0
    for g in range(weights.shape[1]):
        for k in range(count):
            if owner[k] == g:
                sample[filled], group[filled], times[filled] = chosen[k], g, often[k]
                filled += 1
    return count


@kernel
def find_nearest_images(X: Floats3, X_mode: Floats3, symmetries: Floats3, arm: float, nearest: OutLongs1) -> None:
    """Finds the symmetry (s, 3, 4) whose image of each pose X (B, 3, 4) is nearest to any of the modes (g, 3, 4).

    Rotations are weighted by a lever arm, m.
    """
    image, turns = np.empty((3, 4)), 0.5 * arm * arm
    for b in range(X.shape[0]):
        least = np.inf
        for s in range(symmetries.shape[0]):
            pose_kernels.compose_one(X[b], symmetries[s], image)
            for g in range(X_mode.shape[0]):
                square = 0.0
                for i in range(3):
                    square += (image[i, 3] - X_mode[g, i, 3]) ** 2
                    for j in range(3):
                        square += turns * (image[i, j] - X_mode[g, i, j]) ** 2
                if square < least:
                    least, nearest[b] = square, s


@kernel
def find_nearest_modes(X: Floats3, X_mode: Floats3, arm: float, nearest: OutLongs1) -> None:
    """Finds the nearest mode (g, 3, 4) to each pose X (B, 3, 4). Rotations are weighted by a lever arm, m."""
    for b in range(X.shape[0]):
        least = np.inf
        for g in range(X_mode.shape[0]):
            square, trace = 0.0, 0.0
            for i in range(3):
                square += (X[b, i, 3] - X_mode[g, i, 3]) ** 2
            if square >= least:
                continue
            for i in range(3):
                for j in range(3):
                    trace += X[b, i, j] * X_mode[g, i, j]
            square += (arm * np.arccos(min(1.0, max(-1.0, 0.5 * (trace - 1.0))))) ** 2
            if square < least:
                least, nearest[b] = square, g


@kernel
def step_down(
    gradient: Floats2, hessian: Floats3, soft: Floats1, units: Floats1, longest: float, X: OutFloats3
) -> None:
    """Moves poses X (B, 3, 4) by -(H + diag soft)^-1 g, at most by the length `longest`, m, in these units (6,)."""
    H, L, forward, step, moved = np.empty((6, 6)), np.empty((6, 6)), np.empty(6), np.empty(6), np.empty((3, 4))
    for b in range(X.shape[0]):
        for i in range(6):
            for j in range(i + 1):
                H[i, j] = hessian[b, i, j]
            H[i, i] += soft[i]
        least_squares_kernels.damped_step(6, H, gradient[b], 0.0, L, forward, step)
        square = 0.0
        for i in range(6):
            square += (step[i] / units[i]) ** 2
        share = min(1.0, longest / np.sqrt(square)) if square > 0.0 else 1.0
        for i in range(6):
            step[i] *= share
        pose_kernels.retract_one(X[b], step, moved)
        copy_matrix(moved, X[b])
