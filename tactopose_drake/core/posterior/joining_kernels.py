"""Paths between modes, and which of them are joined over the saddles of these, compiled."""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import kernel, part
from tactopose_drake.core.kernel_types import (
    Floats1,
    Floats2,
    Floats3,
    Floats4,
    Longs2,
    OutFlags1,
    OutFloats1,
    OutFloats2,
    OutFloats3,
    OutFloats4,
    OutLongs1,
)
from tactopose_drake.core.kernels.least_squares_kernels import damped_step
from tactopose_drake.core.kernels.pose_kernels import compose_one, increment_between, retract_one
from tactopose_drake.core.kernels.sorting_kernels import copy_matrix, copy_vector, sort_stably


class Image(NamedTuple):
    """A mode's symmetric image: the increment (6,) to it from another mode, and the Jacobian (6, 6) of increments."""

    u: OutFloats1
    turn: OutFloats2


class Slopes(NamedTuple):
    """Cost (B,), gradient (B, 6) and Hessian (B, 6, 6) at poses."""

    cost: OutFloats1
    gradient: OutFloats2
    hessian: OutFloats3


class Lengths(NamedTuple):
    """Increments (6,) that move the surface by one metre, the longest step, m, and the least information, 1/m^2."""

    units: Floats1
    longest: float
    soft: float


@kernel
def lay_paths(X: Floats3, pairs: Longs2, symmetries: Floats3, arm: float, shares: Floats1, path: OutFloats4) -> None:
    """Fills poses (n, t, 3, 4) at fractions (t,) of the paths between pairs (n, 2) of modes X (g, 3, 4).

    Each path leads from the second mode to the nearest image of the first under the symmetries (s, 3, 4), where
    rotations are weighted by the lever arm.
    """
    Y, image, u = np.empty((3, 4)), Image(np.empty(6), np.empty((6, 6))), np.empty(6)
    for n in range(pairs.shape[0]):
        i = pairs[n, 1]
        find_nearest_image(X[i], X[pairs[n, 0]], symmetries, arm, image, Y)
        for t in range(shares.shape[0]):
            for a in range(6):
                u[a] = shares[t] * image.u[a]
            retract_one(X[i], u, path[n, t])


@kernel
def lay_between(path: Floats4, middle: OutFloats4) -> None:
    """Fills poses (n, t - 1, 3, 4) halfway between consecutive poses of paths (n, t, 3, 4)."""
    u = np.empty(6)
    for n in range(middle.shape[0]):
        for i in range(middle.shape[1]):
            increment_between(path[n, i], path[n, i + 1], u)
            for a in range(6):
                u[a] *= 0.5
            retract_one(path[n, i], u, middle[n, i])


@kernel
def relax_paths(
    path: OutFloats4, tried: OutFloats4, here: Slopes, there: Slopes, damping: OutFloats1, lengths: Lengths
) -> None:
    """Accepts or rejects a step of each inner pose of paths (n, t, 3, 4), and proposes the next one, across the path.

    Args:
        path: the paths so far, whose ends stay.
        tried: the poses (n, t - 2, 3, 4) that the last step led to; afterwards, those that the next one leads to.
        here: costs and derivatives at the inner poses, of all paths one after the other; the costs infinite at first.
        there: the same at the poses tried.
        damping: of each inner pose.
        lengths: units and limits of steps.
    """
    along, step, H = np.empty(6), np.empty(6), np.empty((6, 6))
    g, L, forward = np.empty(6), np.empty((6, 6)), np.empty(6)
    inner = tried.shape[1]
    for n in range(path.shape[0]):
        for i in range(inner):
            b = n * inner + i
            if there.cost[b] < here.cost[b]:
                damping[b], here.cost[b] = 0.0, there.cost[b]
                copy_vector(there.gradient[b], here.gradient[b])
                copy_matrix(there.hessian[b], here.hessian[b])
                copy_matrix(tried[n, i], path[n, i + 1])
            else:
                damping[b] = max(10.0 * damping[b], 10.0)
        for i in range(inner):
            b = n * inner + i
            _find_direction(path[n, i], path[n, i + 2], lengths.units, along)
            _find_slope_across(here.gradient[b], here.hessian[b], along, lengths, g, H)
            damped_step(6, H, g, damping[b], L, forward, step)
            ahead = 0.0
            for a in range(6):
                ahead += along[a] * step[a]
            square = 0.0
            for a in range(6):
                step[a] -= ahead * along[a]
                square += step[a] ** 2
            share = lengths.longest / max(np.sqrt(square), lengths.longest)
            for a in range(6):
                step[a] *= share * lengths.units[a]
            retract_one(path[n, i + 1], step, tried[n, i])


@part
def _find_direction(X: Floats2, Y: Floats2, units: Floats1, along: OutFloats1) -> None:
    """The unit vector (6,) from pose X to pose Y, in these units; zero if they are equal."""
    increment_between(X, Y, along)
    square = 0.0
    for a in range(6):
        along[a] /= units[a]
        square += along[a] ** 2
    for a in range(6):
        along[a] /= np.sqrt(max(square, 1e-300))


@part
def _find_slope_across(
    gradient: Floats1, hessian: Floats2, along: Floats1, lengths: Lengths, g: OutFloats1, H: OutFloats2
) -> None:
    """The gradient P g (6,) and Hessian P H P + soft (6, 6) in units; P = 1 - a a^T projects out the direction a."""
    units, Ha, ga, aHa = lengths.units, np.empty(6), 0.0, 0.0
    for i in range(6):
        g[i] = gradient[i] * units[i]
        ga += along[i] * g[i]
        Ha[i] = 0.0
        for k in range(6):
            H[i, k] = hessian[i, k] * units[i] * units[k]
            Ha[i] += H[i, k] * along[k]
        aHa += along[i] * Ha[i]
    for i in range(6):
        g[i] -= ga * along[i]
        for k in range(6):
            H[i, k] += aHa * along[i] * along[k] - along[i] * Ha[k] - Ha[i] * along[k]
        H[i, i] += lengths.soft


@kernel
def join_over_saddles(
    pairs: Longs2,
    saddle: Floats1,
    ridge: float,
    surely: bool,
    low: OutFloats1,
    family: OutLongs1,
    joined: OutFlags1,
) -> None:
    """Joins the families of a pair if its saddle (n,) is at most `ridge` above the lowest minima of both.

    Pairs (n, 2) are visited in order of rising saddles; `joined` (n,) marks those that joined two families. On entry
    `low` holds the modes' costs (g,); afterwards, at each family's first mode, the lowest of the family, and infinity
    at the others.

    With `surely`, the saddle must be at most `ridge` above the second lowest family: of two families at least one is as
    high as that, whichever were joined before. Such a pair would be joined however much lower any of the saddles are.
    """
    order, spare = np.empty(saddle.shape[0], dtype=np.int64), np.empty(saddle.shape[0], dtype=np.int64)
    sort_stably(saddle, order, spare)
    for k in order:
        first, other = family[pairs[k, 0]], family[pairs[k, 1]]
        if first > other:
            first, other = other, first
        if first == other:
            continue
        higher = _second_lowest(low) if surely else max(low[first], low[other])
        if saddle[k] <= higher + ridge:
            joined[k], low[first], low[other] = True, min(low[first], low[other]), np.inf
            for i in range(low.shape[0]):
                if family[i] == other:
                    family[i] = first


@part
def _second_lowest(values: Floats1) -> float:
    """The second lowest of at least two values (n,)."""
    lowest, second = np.inf, np.inf
    for i in range(values.shape[0]):
        if values[i] < lowest:
            lowest, second = values[i], lowest
        else:
            second = min(second, values[i])
    return second


@part
def find_nearest_image(
    X: Floats2, X_other: Floats2, symmetries: Floats3, arm: float, image: Image, Y: OutFloats2
) -> int:
    """Finds the image of X_other nearest to X and fills the increment to it; Y (3, 4) is scratch."""
    nearest, least, u = 0, np.inf, np.empty(6)
    for s in range(symmetries.shape[0]):
        compose_one(X_other, symmetries[s], Y)
        increment_between(X, Y, u)
        square = u[3] ** 2 + u[4] ** 2 + u[5] ** 2 + arm**2 * (u[0] ** 2 + u[1] ** 2 + u[2] ** 2)
        if square < least:
            nearest, least = s, square
            copy_vector(u, image.u)
    return nearest
