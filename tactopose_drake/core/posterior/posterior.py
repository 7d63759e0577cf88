"""The posterior of an object's pose, and the scales on which it changes."""

import dataclasses
import functools
import math
from collections.abc import Callable

import numpy as np

from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.objectives.objective import SmoothObjective
from tactopose_drake.core.posterior.hypotheses import increments_of_one_metre
from tactopose_drake.core.posterior.posterior_params import DEFAULT_PARAMS, PosteriorParams
from tactopose_drake.core.searches.pose_problem import PoseProblem
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray


@dataclasses.dataclass(frozen=True, eq=False)
class Posterior:
    """What is sampled, and how.

    Attributes:
        likelihood: the smooth objective of all evidence but the prior.
        objective: that of all evidence.
        exact_cost: the negative log posterior of poses (B, 3, 4), up to a constant.
        alternatives: of poses (B, 3, 4) and the cost's Hessians (B, 6, 6) there, what is left of these with one or
            another contact false, shape (B, m, 6, 6); None where there is no contact.
        turns: axes, unit rows (c, 3), about which turns change nothing, and by which these move O's origin, rows
            (c, 3), m, in O.
        prior_information: what is known without the touch, of increments, shape (6, 6).
        symmetry_poses: the object's finite symmetry group as poses X_OO', the identity first, shape (s, 3, 4).
        size: the object's, m.
        sigma: of the positions of contacts and pads, m.
        params: how it is sampled.
    """

    likelihood: SmoothObjective
    objective: SmoothObjective
    exact_cost: Callable[[FloatArray], FloatArray]
    alternatives: Callable[[FloatArray, FloatArray], FloatArray] | None
    turns: tuple[FloatArray, FloatArray]
    prior_information: FloatArray
    symmetry_poses: FloatArray
    size: float
    sigma: float
    params: PosteriorParams = DEFAULT_PARAMS

    def turn_directions(self, X_PO: FloatArray) -> FloatArray:
        """The increments of turns about the axes at poses (B, 3, 4), shape (B, 6, c)."""
        axes = self.turns[0]
        directions = np.empty((len(X_PO), 6, len(axes)))
        if len(axes):
            directions[:, :3] = axes.T
            directions[:, 3:] = X_PO[:, :, :3] @ self.turns[1].T
        return directions

    @property
    def turn_variance(self) -> float:
        """What is reported as the variance of a turn that changes nothing, rad^2."""
        return 1.0 / float(self.prior_information[0, 0])

    @functools.cached_property
    def gauge(self) -> FloatArray:
        """Information (6, 6) that holds the turns in place; it changes no density over the other directions."""
        gauge = np.zeros((6, 6))
        if len(self.turns[0]):
            gauge[:3, :3] = self.turns[0].T @ self.turns[0] / self.params.sampling.held_turn**2
        return gauge

    @functools.cached_property
    def held(self) -> FloatArray:
        """Information (6, 6) that every tile has: it is no wider than its reach allows, and the turns are in place."""
        widest = 1.0 / (self.params.sampling.tile_reach * self.straight) ** 2
        return np.diag(widest / self.units**2) + self.gauge

    @functools.cached_property
    def units(self) -> FloatArray:
        """Increments (6,) that move a point at half the object's size by one metre."""
        return increments_of_one_metre(self.size)

    @functools.cached_property
    def straight(self) -> float:
        """Within this way, m, a turn's arc is as good as straight."""
        return math.sqrt(2.0 * self.params.sampling.sagitta * self.sigma * self.size / 2.0)


def make_posterior(
    model: ObjectModel,
    evidence: Evidence,
    problem: PoseProblem,
    params: PosteriorParams = DEFAULT_PARAMS,
    images: FloatArray | None = None,
) -> Posterior:
    """The posterior of a search's problem, with the contacts' exact likelihood in place of the smooth one.

    Patches have no other likelihood than theirs on the signed distance: it counts as exact. Of the object's finite
    symmetries those count whose images (s, 3, 4) the touch does not tell apart; all, if they are not given.
    """
    mixture, objective = problem.mixture, problem.doubted(problem.objective)
    # A prior tells the turns about a continuous axis apart; no other evidence does.
    turns = model.continuous_symmetries if evidence.prior is None else ()
    return Posterior(
        likelihood=problem.doubted(problem.likelihood),
        objective=objective,
        exact_cost=objective.exact_cost,
        alternatives=None if mixture is None else mixture.alternatives,
        turns=(
            np.array([symmetry.axis for symmetry in turns]).reshape(-1, 3),
            np.array([symmetry.moment for symmetry in turns]).reshape(-1, 3),
        ),
        prior_information=problem.space.information,
        symmetry_poses=model.symmetry_poses if images is None else images,
        size=model.size,
        sigma=float(np.min(evidence.touch.sigma_position)),
        params=_for_contacts(params, len(evidence.contacts)),
    )


@functools.lru_cache
def _for_contacts(params: PosteriorParams, count: int) -> PosteriorParams:
    """What is assumed, with no more samples than so many contacts allow."""
    sampling = params.sampling
    most = min(sampling.most_samples, sampling.most_densities // max(count, 1))
    return dataclasses.replace(params, sampling=dataclasses.replace(sampling, most_samples=most))
