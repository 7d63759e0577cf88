"""Joins modes with hardly any barrier between them: a valley with a bumpy floor has many minima.

Two equal Gaussians have one peak when their means are within two standard deviations of each other; at four and a half,
the density between them is e^-2 of that at either. The barrier is evaluated on the posterior itself rather than from
samples, which are few in some modes and vary with the seed. Minima are joined in order of rising saddles, if the saddle
is little higher than the lowest minimum on either side; the lowest one then stands for all that are joined [CGOS13].
Modes that are connected through a third one are thus joined however many minima the search has found between them.

A straight path between minima of a bent valley is too high. Its poses are moved down across the path, each in the plane
that the path crosses there, as in the string method [ERV02]; freely, they would slide to either side of a ridge.

From a pose that takes one contact for false to one that takes another leads a plateau on which both are false. It is no
higher than a second false contact is improbable, however far apart the poses are: such poses are one mode only if the
saddle is lower.

Source: [CGOS13] F. Chazal et al., Persistence-based clustering in Riemannian manifolds, J. ACM 60, 2013. [ERV02] W. E,
W. Ren, E. Vanden-Eijnden, String method for the study of rare events, Phys. Rev. B 66, 2002.
"""

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.objectives.objective import SmoothObjective
from tactopose_drake.core.poses import compose
from tactopose_drake.core.posterior.joining_kernels import (
    Lengths,
    Slopes,
    join_over_saddles,
    lay_between,
    lay_paths,
    relax_paths,
)
from tactopose_drake.core.posterior.posterior_params import DEFAULT_PARAMS, MomentParams
from tactopose_drake.core.validation import FloatArray

# Fractions of the path between two minima at which the cost is evaluated. Every second pose of a path is relaxed, and
# the others then lie between these, so that no path leads over a ridge between two poses.
_SHARES, _HALF = np.arange(0.0, 13.0) / 12.0, np.array([0.0, 0.5, 1.0])
# With more pairs than this, those that are likely to settle the others are evaluated first.
_FEW_PAIRS = 10
# How many paths from each minimum between modes are evaluated, the shortest ones.
_NEAREST = 5


class Landscape(NamedTuple):
    """What decides which minima are one mode.

    Attributes:
        objective: the negative log posterior.
        lengths: units and limits of the steps that relax paths.
        false_ones: tells which contacts and pads poses (B, 3, 4) take for false, shape (B, k); None if there is none.
    """

    objective: SmoothObjective
    lengths: Lengths
    false_ones: Callable[[FloatArray], NDArray[np.bool_]] | None = None


class Families(NamedTuple):
    """A partition of g modes into families, each of which is one mode.

    Attributes:
        X_PO: the modes' minima, shape (g, 3, 4).
        family: index of the first mode in the family of each, shape (g,).
        symmetry_poses: the object's finite symmetry group as poses X_OO', the identity first, shape (s, 3, 4).
        arm: lever arm that compares rotations with translations between images, m.
    """

    X_PO: FloatArray
    family: NDArray[np.intp]
    symmetry_poses: FloatArray
    arm: float


def find_families(
    X_PO: FloatArray,
    cost: FloatArray,
    landscape: Landscape,
    symmetry_poses: FloatArray,
    size: float,
    between: FloatArray | None = None,
    params: MomentParams = DEFAULT_PARAMS.moments,
) -> Families:
    """Finds which minima are one mode, directly or through other minima between them.

    Args:
        X_PO: minima, the most important first, shape (g, 3, 4). All pairs of the first `params.most_joined` are
            evaluated; of each further one, and of the minima between, the pairs with its nearest neighbours.
        cost: the negative log posterior of these, shape (g,).
        landscape: the posterior.
        symmetry_poses: the object's finite symmetry group as poses X_OO', the identity first, shape (s, 3, 4).
        size: the object's size, m.
        between: further minima through which modes may be connected, shape (n, 3, 4), or None.
        params: which minima are one mode.
    """
    found = Families(X_PO, np.arange(len(X_PO)), symmetry_poses, 0.5 * size)
    most, asked, low = min(len(X_PO), params.most_joined), X_PO, cost
    if between is not None and len(between):
        asked, low = np.concatenate([X_PO, between]), np.concatenate([cost, landscape.objective.cost(between)])
    if len(asked) < 2:
        return found
    ways, pairs = _Ways(asked, found, landscape, params.steps_across), _pairs(most)
    if len(asked) > most:
        pairs = np.concatenate([pairs, _near_pairs(asked, most, found)])
    chosen = np.ones(len(pairs), dtype=np.bool_)
    if len(pairs) > _FEW_PAIRS:
        # First a minimum spanning tree: once two minima are joined, another path between them changes nothing.
        pairs, halfway = _passable(pairs, low, params.ridge, ways)
        _, chosen = _join(pairs, halfway, np.inf, low)
    ends, raised = low[pairs].max(axis=1), np.zeros(len(pairs))
    if landscape.false_ones is not None:
        false_ones = landscape.false_ones(asked)
        raised[(false_ones[pairs[:, 0]] != false_ones[pairs[:, 1]]).any(axis=1)] = params.ridge - params.plateau
    saddle, unknown = np.full(len(pairs), np.inf), np.ones(len(pairs), dtype=np.bool_)
    family = np.arange(len(asked))
    while chosen.any():
        index, straight = chosen.nonzero()[0], ways.lay(pairs[chosen], _SHARES)
        saddle[index] = np.maximum(ways.highest(straight[:, 1:-1]), ends[index]) + raised[index]
        unsure = _are_apart(pairs[index], _join(pairs, saddle, params.ridge, low, surely=True)[0])
        if unsure.any():
            high = index[unsure]
            bent = np.maximum(ways.lowest_pass(straight[unsure, ::2]), ends[high]) + raised[high]
            saddle[high] = np.minimum(saddle[high], bent)
        unknown[index] = False
        family = _join(pairs, saddle, params.ridge, low)[0]
        chosen = unknown & _are_apart(pairs, family)
    return found._replace(family=family[: len(X_PO)])


def _join(
    pairs: NDArray[np.intp], saddle: FloatArray, ridge: float, low: FloatArray, *, surely: bool = False
) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Families (g,) of minima with costs (g,), joined over the saddles (n,) of pairs (n, 2); and which pairs joined.

    With `surely`, only those pairs are joined that stay joined if any saddles turn out to be lower, however much.
    """
    family, joined = np.arange(len(low)), np.zeros(len(pairs), dtype=np.bool_)
    join_over_saddles(pairs, saddle, ridge, surely, low.copy(), family, joined)
    return family, joined


def _are_apart(pairs: NDArray[np.intp], family: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Which pairs (n, 2) are of two families, shape (n,)."""
    return np.asarray(family[pairs[:, 0]] != family[pairs[:, 1]])


@functools.cache
def _pairs(count: int) -> NDArray[np.intp]:
    """All pairs of `count` indices, shape (n, 2)."""
    return np.stack(np.tril_indices(count, -1), axis=1)


def _near_pairs(X_PO: FloatArray, first: int, images: Families) -> NDArray[np.intp]:
    """Pairs (n, 2) of each pose (g, 3, 4) from index `first` on with its nearest neighbours, up to a symmetry."""
    count, turned = min(_NEAREST + 1, len(X_PO)), images.arm / np.sqrt(2.0)
    # A rotation by an angle changes the rotation matrix by sqrt(2) times that angle in the Frobenius norm.
    places = compose(X_PO, images.symmetry_poses[:, None]) * np.array([turned, turned, turned, 1.0])
    places = places.reshape(len(images.symmetry_poses), -1, 12)
    square, asked = np.square(places).sum(axis=2), places[0, first:]
    square_distance = (square[:, :, None] + square[0, first:] - 2.0 * places @ asked.T).min(axis=0).T
    near = square_distance.argpartition(count - 1, axis=1)[:, :count]
    pairs = np.stack([np.arange(first, len(X_PO)).repeat(count), near.ravel()], axis=1)
    pairs.sort(axis=1)
    return np.unique(pairs[pairs[:, 0] < pairs[:, 1]], axis=0)[:, ::-1]


class _Ways(NamedTuple):
    """Paths between minima (g, 3, 4), up to a symmetry, and how many steps relax them."""

    X_PO: FloatArray
    images: Families
    landscape: Landscape
    steps: int

    def lay(self, pairs: NDArray[np.intp], shares: FloatArray) -> FloatArray:
        """Poses (n, t, 3, 4) at fractions (t,) of the straight paths between pairs (n, 2) of minima."""
        poses = np.empty((len(pairs), len(shares), 3, 4))
        lay_paths(self.X_PO, pairs, self.images.symmetry_poses, self.images.arm, shares, poses)
        return poses

    def highest(self, poses: FloatArray) -> FloatArray:
        """The highest cost of the poses (n, t, 3, 4) of each of n paths, shape (n,)."""
        costs = self.landscape.objective.cost(poses.reshape(-1, 3, 4))
        return np.asarray(costs.reshape(poses.shape[:2]).max(axis=1))

    def relax(self, paths: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Paths (n, t, 3, 4) after Levenberg-Marquardt steps of their inner poses, each across its path.

        Also returns the highest cost of the inner poses of each, shape (n,).
        """
        path, tried = np.array(paths, order="C"), np.array(paths[:, 1:-1], order="C")
        count, (objective, lengths, _) = tried.shape[0] * tried.shape[1], self.landscape
        here = Slopes(np.full(count, np.inf), np.zeros((count, 6)), np.zeros((count, 6, 6)))
        damping = np.zeros(count)
        for _ in range(1 + self.steps):
            there = Slopes(*objective.normal_equations(tried.reshape(-1, 3, 4)))
            relax_paths(path, tried, here, there, damping, lengths)
        return path, here.cost.reshape(tried.shape[:2]).max(axis=1)

    def lowest_pass(self, paths: FloatArray) -> FloatArray:
        """The highest cost of each of the paths (n, t, 3, 4) once relaxed, also between its poses, shape (n,)."""
        bent, highest = self.relax(paths)
        middle = np.empty((len(bent), bent.shape[1] - 1, 3, 4))
        lay_between(bent, middle)
        return np.maximum(highest, self.highest(middle))


def _passable(
    pairs: NDArray[np.intp], low: FloatArray, ridge: float, ways: _Ways
) -> tuple[NDArray[np.intp], FloatArray]:
    """The pairs among (n, 2) without a high barrier halfway between them, and the costs halfway."""
    most, halfway = low[pairs].max(axis=1) + ridge, ways.lay(pairs, _HALF)
    cost = ways.highest(halfway[:, 1:-1])
    high = np.flatnonzero(cost > most)
    cost[high] = np.minimum(cost[high], ways.relax(halfway[high])[1])
    passable = np.flatnonzero(cost <= most)
    return pairs[passable], cost[passable]
