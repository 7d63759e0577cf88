"""Modes between which the density hardly falls are one: a valley with bumps along its floor has many minima.

Two equal Gaussians make one peak when their means are within two standard deviations of each other, and at four and a
half the density between them is e^-2 of that at either. Whether that is so is asked of the posterior itself, and not of
samples: those are few in some modes, and others with another seed. Minima are joined by rising saddles, as long as the
saddle is a low one above the lowest minimum of either side, which then is all its minima's [CGOS13]: a mode that is
joined by way of a third one is so however many the search has found between them.

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

# Shares of the way between two minima at which the density is asked for.
_SHARES, _HALF = np.arange(1.0, 6.0) / 6.0, np.array([3.0 / 6.0])
# So many pairs are asked for at once; of more, first those that are likely to settle the others.
_FEW_PAIRS = 10
# Of the ways from a minimum between modes so many are asked for, the shortest ones.
_NEAREST = 5


class Families(NamedTuple):
    """Which of g modes are one.

    Attributes:
        X_PO: their minima, shape (g, 3, 4).
        family: the first mode of each one's family, maybe itself, shape (g,).
        symmetry_poses: the object's finite symmetry group as poses X_OO', the identity first, shape (s, 3, 4).
        arm: the way of a turn by a radian, by which images are compared, m.
    """

    X_PO: FloatArray
    family: NDArray[np.intp]
    symmetry_poses: FloatArray
    arm: float

    def chosen(self, index: NDArray[np.intp]) -> "Families":
        """Of some of the modes."""
        return self._replace(X_PO=self.X_PO[index], family=self.family[index])

    def join(
        self, cost: FloatArray, mass: FloatArray, moments: Moments
    ) -> tuple[FloatArray, Moments, NDArray[np.intp]]:
        """The masses and moments of modes of which those of a family are one: that of the lowest cost.

        Args:
            cost: of the minima, shape (g,).
            mass: of the modes, shape (g,).
            moments: of increments from the minima.

        Returns:
            Masses, none for a mode that another one has taken in; the moments; and which mode each one is part of.
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
    """Finds which minima are one mode, directly or by way of others between them.

    Args:
        X_PO: minima, the most important first, shape (g, 3, 4). Up to `params.most_joined`, all pairs of them are
            evaluated; of each further one and the minima between, the pairs with its nearest neighbours.
        objective: the negative log posterior.
        to_the_floor: moves poses (B, 3, 4) beside a valley down to its floor.
        symmetry_poses: the object's finite symmetry group as poses X_OO', the identity first, shape (s, 3, 4).
        size: the object's, m.
        between: more minima, by way of which those may be one, shape (n, 3, 4); None: no others.
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
        # Ways that join all as low as can be come first: between two that are one by then, another way changes nothing.
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
    """The families (g,) of minima of these costs (g,) by the saddles (n,) of pairs (n, 2); which pairs joined any."""
    family, joined = np.arange(len(low)), np.zeros(len(pairs), dtype=np.bool_)
    join_over_saddles(pairs, saddle, saddle.argsort(kind="stable"), ridge, low.copy(), family, joined)
    return family, joined


@functools.cache
def _pairs(count: int) -> NDArray[np.intp]:
    """All pairs of so many, shape (n, 2)."""
    return np.stack(np.tril_indices(count, -1), axis=1)


def _near_pairs(X_PO: FloatArray, first: int, images: Families) -> NDArray[np.intp]:
    """Pairs (n, 2) of each of the poses (g, 3, 4) from that one on with the few nearest of all, up to a symmetry."""
    count, turned = min(_NEAREST + 1, len(X_PO)), images.arm / np.sqrt(2.0)
    # A turn moves the columns of a rotation matrix by its angle times the root of two.
    places = compose(X_PO, images.symmetry_poses[:, None]) * np.array([turned, turned, turned, 1.0])
    places = places.reshape(len(images.symmetry_poses), -1, 12)
    square, asked = np.square(places).sum(axis=2), places[0, first:]
    way = (square[:, :, None] + square[0, first:] - 2.0 * places @ asked.T).min(axis=0).T
    near = way.argpartition(count - 1, axis=1)[:, :count]
    pairs = np.stack([np.arange(first, len(X_PO)).repeat(count), near.ravel()], axis=1)
    pairs.sort(axis=1)
    return np.unique(pairs[pairs[:, 0] < pairs[:, 1]], axis=0)[:, ::-1]


def _lay(X_PO: FloatArray, images: Families, pairs: NDArray[np.intp], shares: FloatArray) -> FloatArray:
    """Poses (n, t, 3, 4) at shares (t,) of the ways between pairs (n, 2) of minima (g, 3, 4)."""
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
    """Of pairs (n, 2) those that half the way between them does not tell apart, and the costs halfway."""
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
    """The highest cost on the ways between pairs (n, 2) of minima of these costs (g,), shape (n,).

    A way that rises is straight no longer, where its points find lower ones on the valley's floor.
    """
    ends, ways = low[pairs].max(axis=1), lay(pairs, _SHARES)
    costs = objective.cost(ways.reshape(-1, 3, 4)).reshape(-1, len(_SHARES))
    rising = costs.max(axis=1) > ends
    bent = objective.cost(to_the_floor(ways[rising].reshape(-1, 3, 4))).reshape(-1, len(_SHARES))
    costs[rising] = np.minimum(costs[rising], bent)
    saddles: FloatArray = np.maximum(costs.max(axis=1), ends)
    return saddles
