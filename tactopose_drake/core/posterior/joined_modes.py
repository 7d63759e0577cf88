"""Modes between which the density hardly falls are one: a valley with bumps along its floor has many minima.

Two equal Gaussians make one peak when their means are within two standard deviations of each other, and at four and a
half the density between them is e^-2 of that at either. Whether that is so is asked of the posterior itself, on the way
from one minimum to the other, and not of samples: those are few in some modes, and others with another seed.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.objectives.objective import Objective
from tactopose_drake.core.posterior.joining_kernels import Joined, Reach, join, lay_paths
from tactopose_drake.core.posterior.mode_moments import Moments
from tactopose_drake.core.posterior.posterior_params import DEFAULT_PARAMS, MomentParams
from tactopose_drake.core.validation import FloatArray

# Shares of the way between two minima at which the density is asked for: the middle first, where most ways are seen to
# cross a ridge.
_SHARES = np.array([3.0, 1.0, 2.0, 4.0, 5.0]) / 6.0


class Families(NamedTuple):
    """Which of g modes are one.

    Attributes:
        X_PO: their minima, shape (g, 3, 4).
        family: the first mode of each one's family, maybe itself, shape (g,).
        symmetry_poses: the object's finite symmetry group as poses X_OO', the identity first, shape (s, 3, 4).
        reach: how images by a symmetry are compared.
    """

    X_PO: FloatArray
    family: NDArray[np.intp]
    symmetry_poses: FloatArray
    reach: Reach

    def chosen(self, index: NDArray[np.intp]) -> "Families":
        """Of some of the modes."""
        return self._replace(X_PO=self.X_PO[index], family=self.family[index])

    def together(self, weights: FloatArray) -> FloatArray:
        """Weights (B, g) of samples in the modes' shares, in the families' shares."""
        sums = np.zeros((len(self.family), len(self.family)))
        sums[np.arange(len(self.family)), self.family] = 1.0
        return weights @ sums

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
        order, owner = np.argsort(cost, kind="stable"), np.empty(len(mass), dtype=np.intp)
        join(self.X_PO, order, self.symmetry_poses, self.family, self.reach, Joined(mass, *joint), owner)
        return mass, joint, owner


def find_families(
    X_PO: FloatArray,
    objective: Objective,
    symmetry_poses: FloatArray,
    size: float,
    params: MomentParams = DEFAULT_PARAMS.moments,
) -> Families:
    """Finds which minima are one mode, directly or by others between them.

    Args:
        X_PO: minima, the most telling first, shape (g, 3, 4); those behind `params.most_joined` stay alone.
        objective: the negative log posterior.
        symmetry_poses: the object's finite symmetry group as poses X_OO', the identity first, shape (s, 3, 4).
        size: the object's, m.
        params: which minima are one mode.
    """
    family, reach = np.arange(len(X_PO)), Reach(0.5 * size, params.widest_turn)
    found = Families(X_PO, family, symmetry_poses, reach)
    asked = np.ascontiguousarray(X_PO[: params.most_joined])
    if len(asked) < 2:
        return found
    most = len(asked) * (len(asked) - 1) // 2
    pairs, path = np.empty((most, 2), dtype=np.intp), np.empty((most, len(_SHARES), 3, 4))
    count = lay_paths(asked, symmetry_poses, reach, _SHARES, pairs, path)
    pairs, path = pairs[:count], path[:count]
    highest = objective.cost(asked)[pairs].max(axis=1) + params.ridge
    for part in (slice(0, 1), slice(1, None)):
        if len(pairs):
            ways = objective.cost(path[:, part].reshape(-1, 3, 4)).reshape(len(pairs), -1)
            low = (ways <= highest[:, None]).all(axis=1)
            pairs, path, highest = pairs[low], path[low], highest[low]
    for i, j in pairs:
        first, other = sorted((family[i], family[j]))
        family[family == other] = first
    return found
