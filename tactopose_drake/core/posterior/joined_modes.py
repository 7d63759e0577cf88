"""Joins modes with hardly any barrier between them: a valley with a bumpy floor has many minima.

Two equal Gaussians have one peak when their means are within two standard deviations of each other; at four and a half,
the density between them is e^-2 of that at either. The barrier is evaluated on the posterior itself rather than from
samples, which are few in some modes and vary with the seed. Minima are joined in order of rising saddles, if the saddle
is little higher than the lowest minimum on either side; the lowest one then stands for all that are joined [CGOS13].
Modes that are connected through a third one are thus joined however many minima the search has found between them.

Source: [CGOS13] F. Chazal et al., Persistence-based clustering in Riemannian manifolds, J. ACM 60, 2013.
"""

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.objectives.objective import Objective
from tactopose_drake.core.poses import compose
from tactopose_drake.core.posterior.joining_kernels import Joined, join, join_over_saddles, lay_paths
from tactopose_drake.core.posterior.mode_moments import Moments
from tactopose_drake.core.posterior.posterior_params import DEFAULT_PARAMS, MomentParams
from tactopose_drake.core.validation import FloatArray

# Fractions of the path between two minima at which the cost is evaluated.
_SHARES, _HALF = np.arange(1.0, 6.0) / 6.0, np.array([3.0 / 6.0])
# With more pairs than this, those that are likely to settle the others are evaluated first.
_FEW_PAIRS = 10
# How many paths from each minimum between modes are evaluated, the shortest ones.
_NEAREST = 5


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

    def chosen(self, index: NDArray[np.intp]) -> "Families":
        """The partition of a subset of the modes."""
        return self._replace(X_PO=self.X_PO[index], family=self.family[index])

    def join(
        self, cost: FloatArray, mass: FloatArray, moments: Moments
    ) -> tuple[FloatArray, Moments, NDArray[np.intp]]:
        """Merges the masses and moments of each family into its mode of lowest cost.

        Args:
            cost: of the minima, shape (g,).
            mass: of the modes, shape (g,).
            moments: of increments from the minima.

        Returns:
            The masses, 0 for modes that were merged into another; the moments; and the index of each one's new mode.
        """
        mass, joint = mass.copy(), Moments(*(moment.copy() for moment in moments))
        order, owner = cost.argsort(kind="stable"), np.empty(len(mass), dtype=np.intp)
        join(self.X_PO, order, self.symmetry_poses, self.family, self.arm, Joined(mass, *joint), owner)
        return mass, joint, owner


def find_families(
    X_PO: FloatArray,
    objective: Objective,
    to_the_floor: Callable[[FloatArray], FloatArray],
    symmetry_poses: FloatArray,
    size: float,
    between: FloatArray | None = None,
    params: MomentParams = DEFAULT_PARAMS.moments,
) -> Families:
    """Finds which minima are one mode, directly or through other minima between them.

    Args:
        X_PO: minima, the most important first, shape (g, 3, 4). All pairs of the first `params.most_joined` are
            evaluated; of each further one, and of the minima between, the pairs with its nearest neighbours.
        objective: the negative log posterior.
        to_the_floor: moves poses (B, 3, 4) on a valley's side to its floor.
        symmetry_poses: the object's finite symmetry group as poses X_OO', the identity first, shape (s, 3, 4).
        size: the object's size, m.
        between: further minima through which modes may be connected, shape (n, 3, 4), or None.
        params: which minima are one mode.
    """
    found = Families(X_PO, np.arange(len(X_PO)), symmetry_poses, 0.5 * size)
    most = min(len(X_PO), params.most_joined)
    asked = X_PO if between is None else np.concatenate([X_PO, between])
    if len(asked) < 2:
        return found
    low, lay = objective.cost(asked), functools.partial(_lay, asked, found)
    pairs = _pairs(most)
    if len(asked) > most:
        pairs = np.concatenate([pairs, _near_pairs(asked, most, found)])
    chosen = np.ones(len(pairs), dtype=np.bool_)
    if len(pairs) > _FEW_PAIRS:
        # First a minimum spanning tree: once two minima are joined, another path between them changes nothing.
        pairs, halfway = _passable(pairs, low, params.ridge, lay, objective, to_the_floor)
        _, chosen = _join(pairs, halfway, np.inf, low)
    saddle, unknown = np.full(len(pairs), np.inf), np.ones(len(pairs), dtype=np.bool_)
    family = np.arange(len(asked))
    while chosen.any():
        saddle[chosen], unknown[chosen] = _saddles(pairs[chosen], low, lay, objective, to_the_floor), False
        family = _join(pairs, saddle, params.ridge, low)[0]
        chosen = unknown & (family[pairs[:, 0]] != family[pairs[:, 1]])
    return found._replace(family=family[: len(X_PO)])


def _join(
    pairs: NDArray[np.intp], saddle: FloatArray, ridge: float, low: FloatArray
) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Families (g,) of minima with costs (g,), joined over the saddles (n,) of pairs (n, 2); and which pairs joined."""
    family, joined = np.arange(len(low)), np.zeros(len(pairs), dtype=np.bool_)
    join_over_saddles(pairs, saddle, saddle.argsort(kind="stable"), ridge, low.copy(), family, joined)
    return family, joined


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
    way = (square[:, :, None] + square[0, first:] - 2.0 * places @ asked.T).min(axis=0).T
    near = way.argpartition(count - 1, axis=1)[:, :count]
    pairs = np.stack([np.arange(first, len(X_PO)).repeat(count), near.ravel()], axis=1)
    pairs.sort(axis=1)
    return np.unique(pairs[pairs[:, 0] < pairs[:, 1]], axis=0)[:, ::-1]


def _lay(X_PO: FloatArray, images: Families, pairs: NDArray[np.intp], shares: FloatArray) -> FloatArray:
    """Poses (n, t, 3, 4) at fractions (t,) of the paths between pairs (n, 2) of minima (g, 3, 4)."""
    ways = np.empty((len(pairs), len(shares), 3, 4))
    lay_paths(X_PO, pairs, images.symmetry_poses, images.arm, shares, ways)
    return ways


def _passable(
    pairs: NDArray[np.intp],
    low: FloatArray,
    ridge: float,
    lay: Callable[[NDArray[np.intp], FloatArray], FloatArray],
    objective: Objective,
    to_the_floor: Callable[[FloatArray], FloatArray],
) -> tuple[NDArray[np.intp], FloatArray]:
    """The pairs among (n, 2) without a high barrier halfway between them, and the costs halfway."""
    most, halfway = low[pairs].max(axis=1) + ridge, lay(pairs, _HALF)[:, 0]
    cost = objective.cost(halfway)
    high = np.flatnonzero(cost > most)
    cost[high] = np.minimum(cost[high], objective.cost(to_the_floor(halfway[high])))
    passable = np.flatnonzero(cost <= most)
    return pairs[passable], cost[passable]


def _saddles(
    pairs: NDArray[np.intp],
    low: FloatArray,
    lay: Callable[[NDArray[np.intp], FloatArray], FloatArray],
    objective: Objective,
    to_the_floor: Callable[[FloatArray], FloatArray],
) -> FloatArray:
    """The highest cost on the path between each pair (n, 2) of minima with costs (g,), shape (n,).

    Where a straight path rises, its points are first moved to the valley's floor, if the cost is lower there.
    """
    ends, ways = low[pairs].max(axis=1), lay(pairs, _SHARES)
    costs = objective.cost(ways.reshape(-1, 3, 4)).reshape(-1, len(_SHARES))
    rising = costs.max(axis=1) > ends
    bent = objective.cost(to_the_floor(ways[rising].reshape(-1, 3, 4))).reshape(-1, len(_SHARES))
    costs[rising] = np.minimum(costs[rising], bent)
    saddles: FloatArray = np.maximum(costs.max(axis=1), ends)
    return saddles
