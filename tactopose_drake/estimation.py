"""The one call: from contacts to ranked hypotheses of the object's pose."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np
from pydrake.math import RigidTransform
from scipy.special import chdtri

from tactopose_drake.core.contacts import Contacts
from tactopose_drake.core.evidence import Evidence
from tactopose_drake.core.free_spin import turn_toward
from tactopose_drake.core.hypotheses import Modes, find_modes
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.objects import ObjectModel
from tactopose_drake.core.pose_problem import make_problem
from tactopose_drake.core.prior import PosePrior
from tactopose_drake.core.searches.base import Search
from tactopose_drake.core.searches.gradient_descent import GradientDescent
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.searches.monte_carlo import MonteCarlo
from tactopose_drake.core.searches.pair_search import PairSearch
from tactopose_drake.core.validation import FloatArray, positive_number
from tactopose_drake.errors import InvalidInputError, TooFewContactsError, UnknownNameError
from tactopose_drake.programs.pose_program import PoseProgram

Status = Literal["ok", "ambiguous", "no_solution"]

# A touch is explained when noise alone would leave residuals this large more often than once in a million.
_IMPLAUSIBLE = 1e-6
# The share of the mass that the best hypothesis must carry to be called the answer.
_MOST_OF_THE_MASS = 0.5

# Without a prior, fewer contacts leave whole families of poses, whichever mode carries most of the mass.
_FEWEST_FOR_A_POSE = 3

METHODS: dict[str, Callable[[ObjectModel, Evidence], Search]] = {
    "pair_search": lambda model, evidence: PairSearch(model=model, contacts=evidence.contacts),
    "levenberg_marquardt": lambda model, evidence: LevenbergMarquardt(),
    "gradient_descent": lambda model, evidence: GradientDescent(length=model.size / 2),
    "mathematical_program": lambda model, evidence: PoseProgram(length=model.size / 2),
    "monte_carlo": lambda model, evidence: MonteCarlo(scale=_expected_cost(evidence.contacts)),
}
GLOBAL_METHODS = frozenset({"pair_search", "monte_carlo"})
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
        explains_touch: whether noise alone may leave the contacts' residuals as large as this pose does.
    """

    X_PO: RigidTransform
    cost: float
    probability: float
    covariance: FloatArray
    free_directions: FloatArray
    explains_touch: bool = True


@dataclasses.dataclass(frozen=True, eq=False)
class PoseEstimate:
    """The hypotheses that one touch leaves.

    Attributes:
        hypotheses: by falling probability; never empty.
        status: "ok"; "ambiguous" when the best hypothesis carries less than half of the mass, or when fewer than three
            contacts stand against no prior; "no_solution" when even the best one does not explain the touch within its
            noise.
        duration: s.
        finished: whether the search ended by itself, rather than at the time limit.
    """

    hypotheses: tuple[PoseHypothesis, ...]
    status: Status
    duration: float
    finished: bool = True

    @property
    def best(self) -> PoseHypothesis:
        """The most probable hypothesis."""
        return self.hypotheses[0]

    def keep(self, kept: Sequence[bool]) -> PoseEstimate:
        """The estimate by some of the hypotheses alone, weighed among themselves.

        Args:
            kept: for each hypothesis whether it stays; at least one does.
        """
        chosen = [hypothesis for hypothesis, stays in zip(self.hypotheses, kept, strict=True) if stays]
        if not chosen:
            raise InvalidInputError("kept: keeps no hypothesis; the least is 1.")
        mass = sum(hypothesis.probability for hypothesis in chosen)
        hypotheses = tuple(
            dataclasses.replace(hypothesis, probability=hypothesis.probability / mass if mass else 1.0 / len(chosen))
            for hypothesis in chosen
        )
        undetermined = self.status == "ambiguous" and self.best.probability >= _MOST_OF_THE_MASS
        return dataclasses.replace(self, hypotheses=hypotheses, status=_status(hypotheses, undetermined))


def estimate_pose(
    model: ObjectModel,
    contacts: Contacts,
    *,
    prior: PosePrior | None = None,
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
        method: the search. Those of `GLOBAL_METHODS` need no prior; the others start from it.
        seed: of the search's random numbers.
        max_hypotheses: how many hypotheses are kept at the most.
        time_limit: after so long, s, the search ends with the best that it has; None for as long as it takes. It is
            asked between rounds, and at least one is made.

    Raises:
        TooFewContactsError: no contact.
        UnknownNameError: a method that does not exist.
        InvalidInputError: no prior for a method that starts from one, `max_hypotheses` below 1, or a time limit that is
            not above 0.
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

    evidence = Evidence(contacts, prior)
    problem = make_problem(model, evidence)
    search = METHODS[method](model, evidence)
    found = search.minimize(problem.objective, problem.space, np.random.default_rng(seed), deadline)
    if prior is None:
        turned = turn_toward(found.X_PO, found.X_PO[0], model.symmetries)
        found = found._replace(X_PO=turned, cost=problem.objective.cost(turned)).ranked()
    modes = find_modes(
        found,
        problem.likelihood.normal_equations(found.X_PO).hessian,
        problem.space.information,
        model.symmetry_poses,
        model.size,
        max_hypotheses,
    )
    hypotheses = _hypotheses(modes, problem.touch, contacts)
    undetermined = prior is None and len(contacts) < _FEWEST_FOR_A_POSE
    return PoseEstimate(hypotheses, _status(hypotheses, undetermined), deadline.elapsed(), not deadline.passed)


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


def _expected_cost(contacts: Contacts) -> float:
    """What noise alone makes the true pose cost, on average: half for each distance, and for a normal's two turns."""
    return 0.5 * _degrees_of_freedom(contacts)


def _degrees_of_freedom(contacts: Contacts) -> int:
    return len(contacts) * (1 if contacts.n_PC is None else 3)


def _hypotheses(modes: Modes, touch: SurfaceContact, contacts: Contacts) -> tuple[PoseHypothesis, ...]:
    explained = 2.0 * touch.cost(modes.X_PO) <= chdtri(_degrees_of_freedom(contacts), _IMPLAUSIBLE)
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


def _status(hypotheses: Sequence[PoseHypothesis], undetermined: bool) -> Status:
    """Of hypotheses by falling probability; `undetermined`: however they are weighed."""
    if not hypotheses[0].explains_touch:
        return "no_solution"
    if undetermined or hypotheses[0].probability < _MOST_OF_THE_MASS:
        return "ambiguous"
    return "ok"
