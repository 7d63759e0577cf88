"""Compiled loops from weighted samples to the pose and covariance of each mode; see `mode_moments.py`.

For increments u from the pose of a mode, with weights w, the moments are sum w u / sum w and sum w u u^T / sum w; the
effective sample size is (sum w)^2 / sum w^2. A mean m of increments with covariance S and effective sample size n is
shrunk by the factor max(0, 1 - chance / (n m^T S^-1 m)) [JS61].
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
    OutFloats4,
    OutLongs1,
)
from tactopose_drake.core.kernels.matrix_kernels import cholesky, invert
from tactopose_drake.core.kernels.pose_kernels import retract_one
from tactopose_drake.core.posterior.joining_kernels import Joined, join


class Minima(NamedTuple):
    """The sampled modes by Laplace's approximation, g of them.

    Attributes:
        X: their poses, shape (g, 3, 4).
        family: index of the first mode in the family of each, shape (g,).
        symmetries: the object's finite symmetry group, shape (s, 3, 4).
        arm: lever arm that compares rotations with translations between symmetric images, m.
        order: their indices by rising cost, shape (g,).
        laplace: their covariances, shape (g, 6, 6).
    """

    X: Floats3
    family: Longs1
    symmetries: Floats3
    arm: float
    order: Longs1
    laplace: Floats3


class Weighted(NamedTuple):
    """Samples: their increments from the modes, shape (B, g, 6), and their weights, shape (B, g)."""

    increments: Floats3
    weights: Floats2


class Tried(NamedTuple):
    """Poses toward the means of n modes.

    Attributes:
        mode: index of each mode, shape (n,).
        X: the poses, shape (n, s, 3, 4).
        second: mean products of the increments from these poses, shape (n, s, 6, 6).
    """

    mode: OutLongs1
    X: OutFloats4
    second: OutFloats4


@kernel
def try_means(minima: Minima, samples: Weighted, way: Floats1, chance: float, joined: Joined, tried: Tried) -> int:
    """Joins the modes with moments by family, and tries the fractions `way` (s,) of their shrunken means.

    On entry `joined` holds the modes' masses, and its moments are zero. Modes of an effective sample size of at most 1
    have no moments: these join no other, and are not tried. Returns how many are tried.
    """
    mass, effective_samples, first, second = joined
    add_moments(samples, effective_samples, first, second)
    work = np.empty((2, mass.shape[0]), dtype=np.int64)
    order, owner, known = work[0], work[1], 0
    for j in minima.order:
        owner[j] = -1
        if effective_samples[j] > 1.0:
            order[known] = j
            known += 1
    join(minima.X, order[:known], minima.symmetries, minima.family, minima.arm, joined, owner)
    count, L, information, u = 0, np.empty((6, 6)), np.empty((6, 6)), np.empty(6)
    for j in range(mass.shape[0]):
        if owner[j] < 0 or not mass[j] > 0.0:
            continue
        cholesky(6, minima.laplace[j], L)
        invert(6, L, information)
        square, mean = 0.0, first[j]
        for i in range(6):
            for k in range(6):
                square += mean[i] * information[i, k] * mean[k]
        certain = max(0.0, 1.0 - chance / max(effective_samples[j] * square, chance))
        tried.mode[count] = j
        for t in range(way.shape[0]):
            share = certain * way[t]
            for i in range(6):
                u[i] = share * mean[i]
                for k in range(6):
                    tried.second[count, t, i, k] = second[j, i, k] - share * (2.0 - share) * mean[i] * mean[k]
            retract_one(minima.X[j], u, tried.X[count, t])
        count += 1
    return count


@part
def add_moments(samples: Weighted, effective_samples: OutFloats1, first: OutFloats2, second: OutFloats3) -> None:
    """Fills the effective sample sizes (g,), means (g, 6) and second moments (g, 6, 6); these are zero on entry."""
    increment, weights = samples
    for g in range(weights.shape[1]):
        mass, squares = 0.0, 0.0
        for b in range(weights.shape[0]):
            mass += weights[b, g]
            squares += weights[b, g] ** 2
        effective_samples[g] = mass * mass / squares if squares > 0.0 else 0.0
        for b in range(weights.shape[0]):
            if weights[b, g] > 1e-12 * mass:
                share, u = weights[b, g] / mass, increment[b, g]
                for i in range(6):
                    part = share * u[i]
                    first[g, i] += part
                    for j in range(i + 1):
                        second[g, i, j] += part * u[j]
        for i in range(6):
            for j in range(i):
                second[g, j, i] = second[g, i, j]
