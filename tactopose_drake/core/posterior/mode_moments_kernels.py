"""Compiled loops from weighted samples to the pose and covariance of each mode; see `mode_moments.py`.

For increments u from the pose of a mode, with weights w, the moments are sum w u / sum w and sum w u u^T / sum w; the
effective sample size is (sum w)^2 / sum w^2. A mean m of increments with covariance S and effective sample size n is
shrunk by the factor max(0, 1 - noise_limit / (n m^T S^-1 m)) [JS61].
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
from tactopose_drake.core.kernels.pose_kernels import increment_between, retract_one
from tactopose_drake.core.posterior.joining_kernels import Image, find_nearest_image


class Joined(NamedTuple):
    """The masses of g modes and the moments of their samples, merged in place.

    Attributes:
        mass: shape (g,).
        effective_samples: effective sample sizes, shape (g,).
        first: means of the increments from the modes, shape (g, 6).
        second: mean products of these increments, shape (g, 6, 6).
    """

    mass: OutFloats1
    effective_samples: OutFloats1
    first: OutFloats2
    second: OutFloats3


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


class WeightedSamples(NamedTuple):
    """Samples of g modes: the modes' poses, shape (g, 3, 4), and the samples' poses (B, 3, 4) and weights (B, g)."""

    X_mode: Floats3
    X: Floats3
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


class Work(NamedTuple):
    """Scratch arrays of shapes (6,), (6,), (6, 6) and (6, 6)."""

    mean: OutFloats1
    d: OutFloats1
    half: OutFloats2
    products: OutFloats2


@kernel
def try_means(
    minima: Minima, samples: WeightedSamples, shares: Floats1, noise_limit: float, joined: Joined, tried: Tried
) -> int:
    """Joins the modes with moments by family, and tries the given shares (s,) of their shrunken means.

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
        certain = max(0.0, 1.0 - noise_limit / max(effective_samples[j] * square, noise_limit))
        tried.mode[count] = j
        for t in range(shares.shape[0]):
            share = certain * shares[t]
            for i in range(6):
                u[i] = share * mean[i]
                for k in range(6):
                    tried.second[count, t, i, k] = second[j, i, k] - share * (2.0 - share) * mean[i] * mean[k]
            retract_one(minima.X[j], u, tried.X[count, t])
        count += 1
    return count


@part
def add_moments(samples: WeightedSamples, effective_samples: OutFloats1, first: OutFloats2, second: OutFloats3) -> None:
    """Fills the effective sample sizes (g,), means (g, 6) and second moments (g, 6, 6); these are zero on entry."""
    X_mode, X, weights = samples
    u = np.empty(6)
    for g in range(weights.shape[1]):
        mass, squares = 0.0, 0.0
        for b in range(weights.shape[0]):
            mass += weights[b, g]
            squares += weights[b, g] ** 2
        effective_samples[g] = mass * mass / squares if squares > 0.0 else 0.0
        for b in range(weights.shape[0]):
            if weights[b, g] > 1e-12 * mass:
                share = weights[b, g] / mass
                increment_between(X_mode[g], X[b], u)
                for i in range(6):
                    part = share * u[i]
                    first[g, i] += part
                    for j in range(i + 1):
                        second[g, i, j] += part * u[j]
        for i in range(6):
            for j in range(i):
                second[g, j, i] = second[g, i, j]


@part
def join(
    X: Floats3, order: Longs1, symmetries: Floats3, family: Longs1, arm: float, joined: Joined, owner: OutLongs1
) -> None:
    """Merges each mode into the first of its family in `order`, its owner, and sets its own mass to 0."""
    image, Y = Image(np.empty(6), np.empty((6, 6))), np.empty((3, 4))
    work = Work(np.empty(6), np.empty(6), np.empty((6, 6)), np.empty((6, 6)))
    for place in range(order.shape[0]):
        j = order[place]
        owner[j] = j
        for i in order[:place]:
            if family[i] == family[j] and owner[i] == i:
                s = find_nearest_image(X[i], X[j], symmetries, arm, image, Y)
                _derivative(X[j], symmetries[s], image.turn)
                _add(joined, i, j, image, work)
                owner[j] = i
                break


@part
def _add(joined: Joined, i: int, j: int, image: Image, work: Work) -> None:
    """Merges the image of mode j into mode i.

    With p the share of j's mass and d the offset of its mean, the mean becomes m + p d, and the second moment
    (1 - p) P + p (J P' J^T + J m' u^T + u (J m')^T + u u^T).
    """
    mass, effective_samples, first, second = joined
    p = mass[j] / (mass[i] + mass[j])
    u, mean, d, products = image.u, work.mean, work.d, work.products
    _transport(image.turn, first[j], second[j], mean, work.half, products)
    for a in range(6):
        d[a] = u[a] + mean[a] - first[i, a]
    for a in range(6):
        first[i, a] += p * d[a]
        for c in range(6):
            product = products[a, c] + mean[a] * u[c] + u[a] * mean[c] + u[a] * u[c]
            second[i, a, c] = (1.0 - p) * second[i, a, c] + p * product
    effective_samples[i] = 1.0 / ((1.0 - p) ** 2 / effective_samples[i] + p**2 / effective_samples[j])
    mass[i] += mass[j]
    mass[j] = 0.0


@part
def _transport(J: Floats2, m: Floats1, C: Floats2, mean: OutFloats1, half: OutFloats2, out: OutFloats2) -> None:
    """J m and J C J^T for a mean m (6,) and a matrix C (6, 6); half (6, 6) is scratch."""
    for a in range(6):
        mean[a] = 0.0
        for c in range(6):
            mean[a] += J[a, c] * m[c]
            half[a, c] = 0.0
            for k in range(6):
                half[a, c] += J[a, k] * C[k, c]
    for a in range(6):
        for c in range(6):
            out[a, c] = 0.0
            for k in range(6):
                out[a, c] += half[a, k] * J[c, k]


@part
def _derivative(X: Floats2, S: Floats2, J: OutFloats2) -> None:
    """Jacobian of increments at X S with respect to those (w, v) at X = (R, p): (R_S^T w, v + R (w x p_S))."""
    for i in range(6):
        for k in range(6):
            J[i, k] = 0.0
    for i in range(3):
        x, y, z = X[i, 0], X[i, 1], X[i, 2]
        J[3 + i, 0] = z * S[1, 3] - y * S[2, 3]
        J[3 + i, 1] = x * S[2, 3] - z * S[0, 3]
        J[3 + i, 2] = y * S[0, 3] - x * S[1, 3]
        J[3 + i, 3 + i] = 1.0
        for k in range(3):
            J[i, k] = S[k, i]
