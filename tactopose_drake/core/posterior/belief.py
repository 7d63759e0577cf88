"""The mass and the spread of each mode, by importance sampling of the exact posterior.

Laplace's approximation takes each mode for a Gaussian by its curvature. Real modes have kinks where a contact passes an
edge, and bend where a direction is hardly determined: a Gaussian that fits at the middle leaves the valley. Therefore
each mode is covered by tiles, densities like Laplace's that lie along its floor; samples of their mixture are weighted
by the exact posterior over the mixture [OZ00]; and a mode's mass, its pose and the spread about it are its samples'.
The pose is their mean: no other is off by less on average, and a skew mode's minimum lies at one of its ends. But the
mean of a bent mode lies beside it, so the pose goes toward the mean only as far as it explains the touch.

Sources: [OZ00] A. Owen and Y. Zhou, Safe and effective importance sampling, J. Am. Stat. Assoc. 95, 2000 (deterministic
mixture weights); [JS61] W. James and C. Stein, Estimation with quadratic loss, 4th Berkeley Symp. Math. Stat. Prob.,
1961.
"""

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.kernels.matrix_kernels import inverses
from tactopose_drake.core.posterior import belief_kernels
from tactopose_drake.core.posterior.hypotheses import Modes
from tactopose_drake.core.posterior.pose_mixture import PoseMixture, across_turns, draw, in_chart
from tactopose_drake.core.posterior.posterior import Posterior
from tactopose_drake.core.validation import FloatArray

# Modes that hold less than this share of the mass by Laplace's approximation are taken at its word.
_WORTH_SAMPLING = 1e-4
# Modes that hold less than this share of the best one's are not weighed again either.
_WORTH_A_LOOK = 1e-7
# Tiles are laid out over Laplace's Gaussian, so much wider: a valley may have long ends, and bumps along its floor.
_WIDER = 2.0
# Tiles reach over so much of that way.
_TILE = 1.5
# A step toward the valley's floor is no longer than this share of the object's size.
_LONGEST_STEP = 0.1
# The Laplace covariance counts as so many samples: the fewest that determine a covariance of six dimensions.
_PSEUDO_SAMPLES = 7.0
# The squared length of a mean of chance, in its standard deviations, is below this in 95 % (chi-square, 6 dimensions).
_CHANCE = 12.6
# A pose that costs so much more than its mode's minimum explains the touch as well; tried are these shares of the way.
_AS_GOOD = 0.3
_WAY = np.array([1.0, 0.75, 0.5, 0.25, 0.0])
# Logarithm of the volume of the turns about one continuous axis, or about the three of a ball.
_LOG_TURNS = {0: 0.0, 1: np.log(2.0 * np.pi), 3: np.log(8.0 * np.pi**2)}


class Moments(NamedTuple):
    """Of weighted samples, for each of g groups.

    Attributes:
        worth: how many equally weighted ones they are worth, shape (g,).
        first: mean of the increments from the group's pose, shape (g, 6).
        second: mean product of those increments, shape (g, 6, 6).
    """

    worth: FloatArray
    first: FloatArray
    second: FloatArray


def weigh_moments(X_group: FloatArray, X_PO: FloatArray, weights: FloatArray) -> Moments:
    """The moments of samples X_PO (B, 3, 4) by their weights (B, g) about the groups' poses (g, 3, 4)."""
    moments = Moments(np.empty(len(X_group)), np.zeros((len(X_group), 6)), np.zeros((len(X_group), 6, 6)))
    belief_kernels.add_moments(X_group, X_PO, weights, *moments)
    return moments


@dataclasses.dataclass(frozen=True, kw_only=True)
class BeliefSampling:
    """How the posterior is sampled.

    Attributes:
        samples: poses that are drawn.
        tiles: densities that cover the modes, beside one at each.
        steps: Gauss-Newton steps that bring them to the valley's floor.
    """

    samples: int = 128
    tiles: int = 16
    steps: int = 3

    def weigh(self, modes: Modes, posterior: Posterior, generator: np.random.Generator) -> Modes:
        """The modes with the mass and covariance that samples of the exact posterior give them."""
        close = np.flatnonzero(modes.probability > _WORTH_A_LOOK * modes.probability.max())
        X_close = modes.X_PO[close]
        information = inverses(modes.covariance[close])[0] + posterior.gauge
        least = np.minimum(posterior.exact_cost(X_close), modes.cost[close])
        laplace = -least - 0.5 * across_turns(information, posterior.turn_directions(X_close))[1]
        share = np.exp(laplace - laplace.max())
        share /= share.sum()
        worthy = np.flatnonzero(share > _WORTH_SAMPLING)
        sampled = close[worthy]

        mixture = self._cover(modes.X_PO[sampled], share[worthy], information[worthy], posterior, generator)
        X_PO = mixture.sample(generator)
        densities = mixture.densities(X_PO)
        weights = np.empty_like(densities)
        belief_kernels.weigh(posterior.exact_cost(X_PO), least.min(), densities, weights)
        mass = weights.sum(axis=0)
        if not mass.sum() > 0.0:
            return modes
        every = np.exp(laplace + least.min()) * (2.0 * np.pi) ** (3.0 - 0.5 * len(posterior.turns[0]))
        every[worthy] = mass
        masses = modes.probability * (every.sum() / modes.probability[close].sum())
        masses[close] = every
        moments = weigh_moments(modes.X_PO[sampled], X_PO, weights)
        log_mass = float(np.log(masses.sum()) - least.min() + _LOG_TURNS[len(posterior.turns[0])])
        return self._update(modes, sampled, masses / masses.sum(), moments, posterior, log_mass)

    def _cover(
        self,
        X_mode: FloatArray,
        share: FloatArray,
        information: FloatArray,
        posterior: Posterior,
        generator: np.random.Generator,
    ) -> PoseMixture:
        """A mixture that covers the sampled modes: one density for a narrow one, tiles along a wide one."""
        units, widest = posterior.units, 1.0 / (_TILE * posterior.straight) ** 2
        # The root leaves something for modes that Laplace's approximation underrates.
        root_share = np.sqrt(share)
        counts = 1 + np.rint(self.tiles * root_share / root_share.sum()).astype(np.intp)
        each = np.arange(len(X_mode))
        group = np.repeat(each, counts)
        normal = generator.normal(scale=_WIDER, size=(len(group), 6))
        normal[np.cumsum(counts) - counts] = 0.0  # The first at each mode stands in its middle.
        laplace = draw(X_mode, each, np.zeros((len(X_mode), 6)), information, counts, normal)
        X_PO = self._to_the_floor(laplace, posterior)
        equations = posterior.objective.normal_equations(X_PO)
        # As wide as that and the tile's own reach allow.
        local = equations.hessian + np.diag(widest / units**2) + posterior.gauge
        center, local, turns = in_chart(X_mode, group, X_PO, local, posterior.turn_directions(X_PO))
        least = np.minimum(posterior.exact_cost(X_PO), equations.cost)
        weight = np.exp(-0.5 * (least - least.min())) + 1e-3
        count = np.maximum(1, np.rint(self.samples * weight / weight.sum())).astype(np.intp)
        return PoseMixture(X_mode, group, center, local, turns, count)

    def _to_the_floor(self, X_PO: FloatArray, posterior: Posterior) -> FloatArray:
        """Moves poses (B, 3, 4) in the directions that the touch determines well, and little in others."""
        soft = 1.0 / (posterior.units * posterior.straight) ** 2
        for _ in range(self.steps):
            _, gradient, hessian = posterior.likelihood.normal_equations(X_PO)
            belief_kernels.step_down(gradient, hessian, soft, posterior.units, _LONGEST_STEP * posterior.size, X_PO)
        return X_PO

    def _update(
        self,
        modes: Modes,
        sampled: NDArray[np.intp],
        probability: FloatArray,
        moments: Moments,
        posterior: Posterior,
        log_mass: float,
    ) -> Modes:
        X_PO, cost, covariance = modes.X_PO.copy(), modes.cost.copy(), modes.covariance.copy()
        known = moments.worth > 1.0
        index = sampled[known]
        X_PO[index], cost[index], second = _toward_the_mean(
            X_PO[index], cost[index], covariance[index], moments, known, posterior
        )
        directions = posterior.turn_directions(X_PO[index])
        spread = second + posterior.turn_variance * directions @ np.swapaxes(directions, 1, 2)
        # What the next sample of an inverse Wishart distribution is expected to be, with Laplace's covariance as prior.
        covariance[index] = spread + _PSEUDO_SAMPLES / moments.worth[known][:, None, None] * covariance[index]
        order = np.argsort(-probability, kind="stable")
        free = tuple(modes.free_directions[i] for i in order)
        return Modes(X_PO[order], cost[order], probability[order], covariance[order], free, log_mass)


def _toward_the_mean(
    X_PO: FloatArray,
    cost: FloatArray,
    laplace: FloatArray,
    moments: Moments,
    known: NDArray[np.bool_],
    posterior: Posterior,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Moves minima (n, 3, 4) of these costs (n,) toward their modes' means as far as the touch allows.

    What of a mean may be chance does not count (it is shrunk as by [JS61]): a mode that is as Laplace's covariances
    (n, 6, 6) say keeps its minimum.

    Returns:
        The poses, their costs, and the mean products (n, 6, 6) of the increments from them.
    """
    n, mean = len(X_PO), moments.first[known]
    shares, tried = np.empty((n, len(_WAY))), np.empty((n, len(_WAY), 3, 4))
    belief_kernels.try_shares(X_PO, laplace, mean, moments.worth[known], _WAY, _CHANCE, shares, tried)
    costs = posterior.objective.cost(tried.reshape(-1, 3, 4)).reshape(n, -1)
    costs[:, -1] = cost
    chosen = np.arange(n), (costs <= cost[:, None] + _AS_GOOD).argmax(axis=1)
    share = shares[chosen]
    left = (share * (2.0 - share))[:, None, None] * mean[:, :, None] * mean[:, None]
    return tried[chosen], costs[chosen], moments.second[known] - left
