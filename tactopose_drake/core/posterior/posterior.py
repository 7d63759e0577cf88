"""The posterior of an object's pose, and the length scales on which it changes."""

import dataclasses
import functools
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.objectives.objective import SmoothObjective
from tactopose_drake.core.posterior.modes import increments_of_one_metre
from tactopose_drake.core.posterior.posterior_params import DEFAULT_PARAMS, PosteriorParams
from tactopose_drake.core.posterior.single_contact import SingleContact
from tactopose_drake.core.searches.pose_problem import PoseProblem
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray

# The standard deviation of a normal, rad, from which on it says next to nothing.
_NO_NORMAL = 1.0


@dataclasses.dataclass(frozen=True, eq=False)
class Posterior:
    """The posterior that is sampled, and how it is sampled.

    Attributes:
        likelihood: the smooth objective of all evidence except the prior.
        objective: the smooth objective of all evidence.
        exact_cost: the negative log posterior of poses (B, 3, 4), up to a constant.
        alternatives: maps poses (B, 3, 4) and the cost's Hessians (B, 6, 6) there to the Hessians that remain if one
            contact is false, shape (B, m, 6, 6); None without contacts.
        turn_axes: axes of the rotations that change nothing, unit rows (c, 3), in O.
        turn_moments: the displacement of O's origin per radian about each, rows (c, 3), m, in O.
        prior_information: information on increments without the touch, shape (6, 6).
        symmetry_poses: the object's finite symmetry group as poses X_OO', the identity first, shape (s, 3, 4).
        size: the object's size, m.
        sigma: the smallest standard deviation of the positions of contacts and pads, m.
        params: how it is sampled.
        contacts: number of contacts, which limits that of the samples.
        false_ones: tells which contacts and pads poses (B, 3, 4) take for false, shape (B, k); None if there is none.
        single_contact: the contact or pad from which poses can be drawn; None if there is more of either.
        excludes_out_of_touch: whether poses that take all contacts and pads for false belong to no mode. They may be
            anywhere if no prior tells the position, and cost little more than the best if there are few contacts.
    """

    likelihood: SmoothObjective
    objective: SmoothObjective
    exact_cost: Callable[[FloatArray], FloatArray]
    alternatives: Callable[[FloatArray, FloatArray], FloatArray] | None
    turn_axes: FloatArray
    turn_moments: FloatArray
    prior_information: FloatArray
    symmetry_poses: FloatArray
    size: float
    sigma: float
    params: PosteriorParams = DEFAULT_PARAMS
    contacts: int = 0
    false_ones: Callable[[FloatArray], NDArray[np.bool_]] | None = None
    single_contact: SingleContact | None = None
    excludes_out_of_touch: bool = False

    @property
    def most_samples(self) -> int:
        """The number of samples after which there is no further round."""
        params = self.params.sampling
        return min(params.most_samples, params.most_densities // max(self.contacts, 1))

    def turn_directions(self, X_PO: FloatArray) -> FloatArray:
        """The increments of turns about the axes at poses (B, 3, 4), shape (B, 6, c)."""
        directions = np.empty((len(X_PO), 6, len(self.turn_axes)))
        if len(self.turn_axes):
            directions[:, :3] = self.turn_axes.T
            directions[:, 3:] = X_PO[:, :, :3] @ self.turn_moments.T
        return directions

    @property
    def turn_variance(self) -> float:
        """The variance reported for a rotation that changes nothing, rad^2."""
        return 1.0 / float(self.prior_information[0, 0])

    @functools.cached_property
    def gauge(self) -> FloatArray:
        """Information (6, 6) that fixes the turns; it changes no density over the other directions."""
        gauge = np.zeros((6, 6))
        if len(self.turn_axes):
            gauge[:3, :3] = self.turn_axes.T @ self.turn_axes / self.params.sampling.held_turn**2
        return gauge

    @functools.cached_property
    def held(self) -> FloatArray:
        """Information (6, 6) added to every tile: it limits the tile's width, and fixes the turns."""
        widest = 1.0 / (self.params.sampling.tile_reach * self.straight) ** 2
        return np.diag(widest / self.units**2) + self.gauge

    @functools.cached_property
    def units(self) -> FloatArray:
        """Increments (6,) that move a point at half the object's size by one metre."""
        return increments_of_one_metre(self.size)

    @functools.cached_property
    def straight(self) -> float:
        """Displacement, m, up to which the arc of a rotation is as good as straight."""
        return math.sqrt(2.0 * self.params.sampling.sagitta * self.sigma * self.size / 2.0)


def make_posterior(
    model: ObjectModel,
    evidence: Evidence,
    problem: PoseProblem,
    params: PosteriorParams = DEFAULT_PARAMS,
    images: FloatArray | None = None,
) -> Posterior:
    """The posterior of a search's problem, with the contacts' exact likelihood in place of the smooth one.

    Patches have no likelihood other than the one on the signed distance, which counts as exact. Of the object's finite
    symmetries those count whose images (s, 3, 4) the touch cannot tell apart; all, if they are not given.
    """
    mixture, objective = problem.mixture, problem.doubted(problem.objective)
    # Only a prior distinguishes rotations about a continuous axis.
    turns = model.continuous_symmetries if evidence.prior is None else ()
    return Posterior(
        likelihood=problem.doubted(problem.likelihood),
        objective=objective,
        exact_cost=objective.exact_cost,
        alternatives=None if mixture is None else mixture.alternatives,
        turn_axes=np.array([symmetry.axis for symmetry in turns]).reshape(-1, 3),
        turn_moments=np.array([symmetry.moment for symmetry in turns]).reshape(-1, 3),
        prior_information=problem.space.information,
        symmetry_poses=model.symmetry_poses if images is None else images,
        size=model.size,
        sigma=float(np.min(evidence.touch.sigma_position)),
        params=params,
        contacts=len(evidence.contacts),
        false_ones=problem.false_ones,
        single_contact=_single_contact(model, evidence),
        excludes_out_of_touch=not evidence.tells_position and len(evidence.touch) < params.modes.fewest_contacts,
    )


def _single_contact(model: ObjectModel, evidence: Evidence) -> SingleContact | None:
    """The only contact or pad, if it has a normal."""
    touch = evidence.touch
    if len(touch) != 1 or touch.n_PC is None or float(np.max(touch.sigma_normal)) >= _NO_NORMAL:
        return None
    return SingleContact(model, touch, evidence.prior)
