"""The one call: from contacts to ranked hypotheses of the object's pose."""

import math
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform
from scipy.special import chdtri

from tactopose_drake.core.belief import BeliefSampling
from tactopose_drake.core.contacts import Contacts
from tactopose_drake.core.evidence import Evidence
from tactopose_drake.core.force_balance import ForceBalance
from tactopose_drake.core.free_spin import turn_toward
from tactopose_drake.core.hand_clearance import HandClearance
from tactopose_drake.core.hand_spheres import HandSpheres
from tactopose_drake.core.hypotheses import Modes, find_modes
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.objectives.surface_density import SurfaceDensity
from tactopose_drake.core.objects import ObjectModel
from tactopose_drake.core.pose_problem import make_problem
from tactopose_drake.core.posterior import make_posterior
from tactopose_drake.core.prior import PosePrior
from tactopose_drake.core.searches.base import Search
from tactopose_drake.core.searches.gradient_descent import GradientDescent
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.searches.monte_carlo import MonteCarlo
from tactopose_drake.core.searches.pair_search import PairSearch
from tactopose_drake.core.searches.scaling_series import ScalingSeries
from tactopose_drake.core.searches.simulated_annealing import SimulatedAnnealing
from tactopose_drake.core.validation import positive_number
from tactopose_drake.errors import InvalidInputError, TooFewContactsError, UnknownNameError
from tactopose_drake.estimates import PoseEstimate, PoseHypothesis, status_of
from tactopose_drake.programs.direct import Direct
from tactopose_drake.programs.pose_program import PoseProgram

# A touch is explained when noise alone would leave residuals this large more often than once in a million.
_IMPLAUSIBLE = 1e-6
# Without a prior, fewer contacts leave whole families of poses, whichever mode carries most of the mass.
_FEWEST_FOR_A_POSE = 3

METHODS: dict[str, Callable[[ObjectModel, Evidence], Search]] = {
    "pair_search": lambda model, evidence: PairSearch(model=model, contacts=evidence.contacts),
    "levenberg_marquardt": lambda model, evidence: LevenbergMarquardt(),
    "gradient_descent": lambda model, evidence: GradientDescent(length=model.size / 2),
    "mathematical_program": lambda model, evidence: PoseProgram(length=model.size / 2),
    "monte_carlo": lambda model, evidence: _monte_carlo(model, evidence),
    "direct": lambda model, evidence: Direct(),
    "simulated_annealing": lambda model, evidence: SimulatedAnnealing(),
    "scaling_series": lambda model, evidence: ScalingSeries(),
}
GLOBAL_METHODS = frozenset({"pair_search", "monte_carlo", "direct", "simulated_annealing", "scaling_series"})
"""The methods that need no prior."""


def estimate_pose(
    model: ObjectModel,
    contacts: Contacts,
    *,
    prior: PosePrior | None = None,
    hand: HandSpheres | None = None,
    untouched: HandSpheres | None = None,
    balance: ForceBalance | None = None,
    friction: float | None = None,
    method: str = "pair_search",
    seed: int = 0,
    max_hypotheses: int = 64,
    time_limit: float | None = None,
) -> PoseEstimate:
    """Finds the poses of an object that explain a touch.

    Args:
        model: the object.
        contacts: the touch, in the palm frame; at least one contact.
        prior: what is known without it; None where the object may be anywhere that the contacts touch it.
        hand: the hand's volume, where the object is not.
        untouched: parts of the hand that feel no contact: the object is not in them, nor presses into them.
        balance: that the object is at rest under the contacts' forces and gravity alone.
        friction: coefficient of friction; each force lies in its cone about the object's normal.
        method: the search. Those of `GLOBAL_METHODS` need no prior; the others start from it.
        seed: of the search's random numbers.
        max_hypotheses: how many hypotheses are kept at the most.
        time_limit: after so long, s, the search ends with the best that it has; None for as long as it takes. It is
            asked between rounds, and at least one is made.

    Raises:
        TooFewContactsError: no contact.
        UnknownNameError: a method that does not exist.
        InvalidInputError: no prior for a method that starts from one, a friction below 0, `max_hypotheses` below 1, or
            a time limit that is not above 0; balance or friction without forces, or balance of an object whose mass is
            not known or whose centre of mass is moved by its symmetries.
    """
    deadline = _Deadline(math.inf if time_limit is None else positive_number("time_limit", time_limit))
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

    evidence = Evidence(contacts, prior, hand, untouched, balance, friction)
    problem = make_problem(model, evidence)
    search = METHODS[method](model, evidence)
    generator = np.random.default_rng(seed)
    found = search.minimize(problem.objective, problem.space, generator, deadline)
    if prior is None:
        turned = turn_toward(found.X_PO, found.X_PO[0], model.symmetries)
        found = found._replace(X_PO=turned, cost=problem.objective.cost(turned)).ranked()
    modes = find_modes(
        found,
        problem.determining.normal_equations(found.X_PO).hessian,
        problem.space.information,
        model.symmetry_poses,
        model.size,
        max_hypotheses,
    )
    if _explain_touch(model, modes, problem.touch, contacts).any() and not deadline():
        modes = BeliefSampling().weigh(modes, make_posterior(model, contacts, problem, prior is not None), generator)
    explained = _explain_touch(model, modes, problem.touch, contacts)
    hypotheses = _hypotheses(modes, explained)
    undetermined = prior is None and len(contacts) < _FEWEST_FOR_A_POSE
    return PoseEstimate(hypotheses, status_of(hypotheses, undetermined), deadline.elapsed(), not deadline.passed)


class _Deadline:
    """The stop signal of a time limit, s from now; it remembers whether it said stop."""

    def __init__(self, limit: float) -> None:
        self._started, self._limit = time.perf_counter(), limit
        self.passed = False

    def __call__(self) -> bool:
        self.passed = self.elapsed() >= self._limit
        return self.passed

    def elapsed(self) -> float:
        """Since it was made, s."""
        return time.perf_counter() - self._started


def _monte_carlo(model: ObjectModel, evidence: Evidence) -> MonteCarlo:
    """Its scale is what noise alone makes the true pose cost, on average: half of what the contacts measure."""
    return MonteCarlo(
        scale=0.5 * _degrees_of_freedom(evidence.contacts),
        is_possible=None if evidence.hand is None else HandClearance(model.samples.points, evidence.hand),
    )


def _degrees_of_freedom(contacts: Contacts) -> int:
    return len(contacts) * (1 if contacts.n_PC is None else 3)


def _explain_touch(model: ObjectModel, modes: Modes, touch: SurfaceContact, contacts: Contacts) -> NDArray[np.bool_]:
    """Which of the modes leave residuals that may be noise."""
    limit = 0.5 * float(chdtri(_degrees_of_freedom(contacts), _IMPLAUSIBLE))
    explained: NDArray[np.bool_] = touch.cost(modes.X_PO) <= limit
    if not explained.all():
        # At edges and thin walls the smooth residuals are larger than noise.
        explained[~explained] = SurfaceDensity(model, contacts).cost(modes.X_PO[~explained]) <= limit
    return explained


def _hypotheses(modes: Modes, explained: NDArray[np.bool_]) -> tuple[PoseHypothesis, ...]:
    return tuple(
        PoseHypothesis(RigidTransform(X_PO), float(cost), float(probability), covariance, free, bool(explains))
        for X_PO, cost, probability, covariance, free, explains in zip(
            modes.X_PO,
            modes.cost,
            modes.probability,
            modes.covariance,
            modes.free_directions,
            explained,
            strict=True,
        )
    )
