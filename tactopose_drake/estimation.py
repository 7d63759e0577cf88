"""The one call: from contacts to ranked hypotheses of the object's pose."""

import dataclasses
import time
from collections.abc import Callable
from typing import Literal

import numpy as np
from pydrake.math import RigidTransform
from scipy.special import chdtri

from tactopose_drake.core.contacts import Contacts
from tactopose_drake.core.free_spin import turn_toward
from tactopose_drake.core.hypotheses import Modes, find_modes
from tactopose_drake.core.objectives.base import LeastSquaresObjective, SumObjective
from tactopose_drake.core.objectives.pose_prior import PriorObjective
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.objects import ObjectModel
from tactopose_drake.core.prior import PosePrior
from tactopose_drake.core.searches.base import PoseSpace, PriorSpace, Search
from tactopose_drake.core.searches.gradient_descent import GradientDescent
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.searches.pair_search import PairSearch
from tactopose_drake.core.searches.touch_space import TouchSpace
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.errors import InvalidInputError, TooFewContactsError, UnknownNameError
from tactopose_drake.programs.pose_program import PoseProgram

Status = Literal["ok", "ambiguous", "no_solution"]

# A touch is explained when noise alone would leave residuals this large more often than once in a million.
_IMPLAUSIBLE = 1e-6
# The share of the mass that the best hypothesis must carry to be called the answer.
_MOST_OF_THE_MASS = 0.5

# Without a prior, fewer contacts leave whole families of poses, whichever mode carries most of the mass.
_FEWEST_FOR_A_POSE = 3

METHODS: dict[str, Callable[[ObjectModel, Contacts], Search]] = {
    "pair_search": lambda model, contacts: PairSearch(model=model, contacts=contacts),
    "levenberg_marquardt": lambda model, contacts: LevenbergMarquardt(),
    "gradient_descent": lambda model, contacts: GradientDescent(length=model.size / 2),
    "mathematical_program": lambda model, contacts: PoseProgram(length=model.size / 2),
}
GLOBAL_METHODS = frozenset({"pair_search"})
"""The methods that need no prior."""


@dataclasses.dataclass(frozen=True, eq=False)
class PoseHypothesis:
    """One pose that explains the touch.

    Attributes:
        X_PO: the object's pose in the palm frame.
        cost: negative log likelihood up to a constant: half the sum of squared whitened residuals.
        probability: posterior weight among the hypotheses.
        covariance: (6, 6) of the increment (w, v): R_PO = R_hat exp(w), p_PO = p_hat + v; rad, m (v in P).
        free_directions: increments that the touch does not determine, orthonormal rows (f, 6); f = 0 where the pose is
            determined. Along them the pose is the prior's, or arbitrary.
    """

    X_PO: RigidTransform
    cost: float
    probability: float
    covariance: FloatArray
    free_directions: FloatArray


@dataclasses.dataclass(frozen=True, eq=False)
class PoseEstimate:
    """The hypotheses that one touch leaves.

    Attributes:
        hypotheses: by falling probability; never empty.
        status: "ok"; "ambiguous" when the best hypothesis carries less than half of the mass, or when fewer than three
            contacts stand against no prior; "no_solution" when even the best one does not explain the touch within its
            noise.
        duration: s.
    """

    hypotheses: tuple[PoseHypothesis, ...]
    status: Status
    duration: float

    @property
    def best(self) -> PoseHypothesis:
        """The most probable hypothesis."""
        return self.hypotheses[0]


def estimate_pose(
    model: ObjectModel,
    contacts: Contacts,
    *,
    prior: PosePrior | None = None,
    method: str = "pair_search",
    seed: int = 0,
    max_hypotheses: int = 64,
) -> PoseEstimate:
    """Finds the poses of an object that explain a touch.

    Args:
        model: the object.
        contacts: the touch, in the palm frame; at least one contact.
        prior: what is known without it; None where the object may be anywhere that the contacts touch it.
        method: the search. Those of `GLOBAL_METHODS` need no prior; the others start from it.
        seed: of the search's random numbers.
        max_hypotheses: how many hypotheses are kept at the most.

    Raises:
        TooFewContactsError: no contact.
        UnknownNameError: a method that does not exist.
        InvalidInputError: no prior for a method that starts from one, or `max_hypotheses` below 1.
    """
    started = time.perf_counter()
    if method not in METHODS:
        raise UnknownNameError("method", method, METHODS)
    if len(contacts) < 1:
        raise TooFewContactsError("contacts: there are 0; the estimate needs at least 1.")
    if max_hypotheses < 1:
        raise InvalidInputError(f"max_hypotheses: is {max_hypotheses}; allowed are numbers >= 1.")
    if prior is None and method not in GLOBAL_METHODS:
        raise InvalidInputError(
            f"prior: is None; the method {method!r} starts from one. Without: {', '.join(sorted(GLOBAL_METHODS))}."
        )

    touch = SurfaceContact(model.grid, contacts)
    objective: LeastSquaresObjective
    space: PoseSpace
    if prior is None:
        objective, space = touch, TouchSpace(model, contacts)
    else:
        objective, space = SumObjective([touch, PriorObjective(prior)]), PriorSpace(prior)
    found = METHODS[method](model, contacts).minimize(objective, space, np.random.default_rng(seed))
    if prior is None:
        turned = turn_toward(found.X_PO, found.X_PO[0], model.symmetries)
        found = found._replace(X_PO=turned, cost=objective.cost(turned)).ranked()
    touched = touch.normal_equations(found.X_PO)
    modes = find_modes(found, touched.hessian, space.information, model.symmetry_poses, model.size, max_hypotheses)
    status = _status(modes, touch, contacts, prior)
    return PoseEstimate(_hypotheses(modes), status, time.perf_counter() - started)


def _hypotheses(modes: Modes) -> tuple[PoseHypothesis, ...]:
    return tuple(
        PoseHypothesis(RigidTransform(X_PO), float(cost), float(probability), covariance, free)
        for X_PO, cost, probability, covariance, free in zip(
            modes.X_PO, modes.cost, modes.probability, modes.covariance, modes.free_directions, strict=True
        )
    )


def _status(modes: Modes, touch: SurfaceContact, contacts: Contacts, prior: PosePrior | None) -> Status:
    degrees_of_freedom = len(contacts) * (1 if contacts.n_PC is None else 3)
    if 2.0 * float(touch.cost(modes.X_PO[:1])[0]) > chdtri(degrees_of_freedom, _IMPLAUSIBLE):
        return "no_solution"
    if prior is None and len(contacts) < _FEWEST_FOR_A_POSE:
        return "ambiguous"
    return "ok" if modes.probability[0] >= _MOST_OF_THE_MASS else "ambiguous"
