"""The one call: from touch to ranked hypotheses of the object's pose."""

import inspect
import math
import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform

from tactopose_drake.core.evidence.contact_doubt import SCEPTICAL, USUAL
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.evidence.force_balance import ForceBalance
from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.evidence.hand_geometry import HandGeometry
from tactopose_drake.core.evidence.plane_contact import PlaneContact
from tactopose_drake.core.identification.model_evidence import log_evidence
from tactopose_drake.core.objectives.contact_mixture import Judgement
from tactopose_drake.core.plain_values import copied
from tactopose_drake.core.posterior.alike_modes import indistinct_images, join_alike
from tactopose_drake.core.posterior.hypotheses import Modes, find_modes
from tactopose_drake.core.posterior.importance_sampling import weigh_modes
from tactopose_drake.core.posterior.moved_origin import has_far_origin, prior_of_middle
from tactopose_drake.core.posterior.plausibility import explain_with_doubt, is_at_rest, lies_on_planes
from tactopose_drake.core.posterior.posterior import make_posterior
from tactopose_drake.core.posterior.posterior_params import DEFAULT_PARAMS, PosteriorParams
from tactopose_drake.core.searches.doubt import search_with_doubt
from tactopose_drake.core.searches.pose_problem import PoseProblem, check_mass, make_problem
from tactopose_drake.core.searches.search import PoseSpace, Search, SearchResult, StopSignal
from tactopose_drake.core.sensing.patches import Patch
from tactopose_drake.core.shape.free_spin import turn_alike
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray, instance_of, known_name, positive_number, whole_number
from tactopose_drake.errors import InvalidInputError, TooFewContactsError
from tactopose_drake.estimation.contact_checks import check_contacts
from tactopose_drake.estimation.far_origins import with_near_origin
from tactopose_drake.estimation.pose_hypothesis import PoseHypothesis
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.estimation.question import Question
from tactopose_drake.estimation.results import PoseEstimate, status_of
from tactopose_drake.estimation.search_methods import GLOBAL_METHODS, METHODS
from tactopose_drake.estimation.shape_errors import log_dilution, with_shape_errors

# Beyond so many times the reach of touch and surface no pose is of interest; within it none is changed.
_REACHES = 2.0
# The same samples weigh the modes whatever the search's seed is: what is believed of them hangs on the touch alone.
_SAMPLES_SEED = 0


def estimate_pose(
    model: ObjectModel,
    contacts: Contacts,
    patches: Sequence[Patch] = (),
    prior: PosePrior | None = None,
    hand: HandGeometry | None = None,
    method: str = "pair_search",
    seed: int = 0,
    max_hypotheses: int = 64,
    *,
    untouched: HandGeometry | None = None,
    balance: ForceBalance | None = None,
    friction: float | None = None,
    time_limit: float | None = None,
    outlier_probability: float = 0.02,
    planes: Sequence[PlaneContact] = (),
) -> PoseEstimate:
    """Finds the poses of an object that explain a touch.

    Args:
        model: the object.
        contacts: the touch at single points, in the palm frame; may be `Contacts.empty()` where a patch is felt.
        patches: what tactile arrays feel, in the palm frame; those that feel nothing count too. Where they and contacts
            feel the same place twice, the estimate takes that for two touches.
        prior: what is known without touch; None where the object may be anywhere.
        hand: the hand's volume, where the object is not.
        method: the search. Those of `GLOBAL_METHODS` need no prior; the others start from it. Probabilities are among
            what it finds: "monte_carlo", "direct" and "simulated_annealing" miss the pose in a fifth to a half of
            touches without a prior, and may then be "ok" all the same.
        seed: of the search's random numbers.
        max_hypotheses: how many hypotheses are kept at the most. What the others carry counts for the status, and is
            left out of the probabilities; `kept_share` says how much is left.
        untouched: parts of the hand that feel no contact: the object is not in them, nor presses into them.
        balance: that the object is at rest under the contacts' forces and gravity alone. A pose at which it is not, by
            far more than these forces err, explains no touch.
        friction: coefficient of friction; each force lies in its cone about the object's normal.
        time_limit: after so long, s, the search ends with the best that it has; None for as long as it takes. It is
            asked between rounds, and at least one is made. Where `finished` says that it has cut the search short, "ok"
            is of what was found by then, and may be wrong.
        outlier_probability: that a contact is not of this object at all, before the touch, from 0 to 0.99. With it go
            contacts of the object that are displaced, flipped, have any normal, or tell nothing: see `SCEPTICAL`. 0
            takes every contact as told; all their noise may be larger than told then too, as rarely as a good hand's.
        planes: known planes of the world, in the palm frame, that the held object touches with its lowest point over
            each; a table that it was set upon says how far it has slid in the hand. A pose that
            is not at them explains no touch.

    Raises:
        TooFewContactsError: no contact, and no patch that is felt.
        UnknownNameError: a method that does not exist.
        InvalidInputError: no prior for a method that starts from one, a friction or a seed below 0, `max_hypotheses`
            below 1, a time limit that is not above 0, or a value of another type; a touch that is evidently not in
            metres, or whose forces are of the wrong sign (see `check_contacts`); balance or friction without forces, or
            balance of an object whose mass is not known or whose centre of mass is moved by its symmetries.
    """
    asked = _asked(
        model,
        contacts,
        patches,
        prior,
        hand,
        method,
        seed,
        max_hypotheses,
        untouched,
        balance,
        friction,
        time_limit,
        outlier_probability,
        planes,
    )
    near = prior_of_middle(prior, model.middle) if prior is not None and has_far_origin(model) else prior
    felt = with_shape_errors(model, contacts)
    evidence = asked.evidence.with_parts(felt, near)
    found = with_near_origin(
        model, lambda each: weigh_poses(each, evidence, method, asked.seed, asked.max_hypotheses, asked.time_limit)
    )
    return copied(
        found,
        log_evidence=found.log_evidence - log_dilution(contacts, felt),
        question=Question(model, evidence if near is prior else copied(evidence, prior=prior)),
    )


def check_question(model: ObjectModel, contacts: Contacts, **options: Any) -> None:
    """Raises what `estimate_pose` raises of such arguments before it searches.

    Raises:
        TypeError: an option that `estimate_pose` does not have.
    """
    try:
        given = _SIGNATURE.bind(model, contacts, **options)
    except TypeError as error:
        raise TypeError(f"estimate_pose() {error}") from None
    given.apply_defaults()
    _asked(**given.arguments)


_SIGNATURE = inspect.signature(estimate_pose)


class _Asked(NamedTuple):
    """Arguments of `estimate_pose` that were checked, and those of the evidence together."""

    evidence: Evidence
    seed: int
    max_hypotheses: int
    time_limit: float


def _asked(
    model: ObjectModel,
    contacts: Contacts,
    patches: Sequence[Patch],
    prior: PosePrior | None,
    hand: HandGeometry | None,
    method: str,
    seed: int,
    max_hypotheses: int,
    untouched: HandGeometry | None,
    balance: ForceBalance | None,
    friction: float | None,
    time_limit: float | None,
    outlier_probability: float,
    planes: Sequence[PlaneContact],
) -> _Asked:
    limit = math.inf if time_limit is None else positive_number("time_limit", time_limit)
    _check_kinds(model, contacts, method, prior)
    seed, most = whole_number("seed", seed, least=0), whole_number("max_hypotheses", max_hypotheses, least=1)
    evidence = Evidence(
        contacts, prior, hand, untouched, balance, friction, patches, outlier_probability, planes, SCEPTICAL
    )
    if evidence.outlier_probability == 0.0:
        evidence = copied(evidence, doubt=USUAL)
    if len(evidence.touch) < 1:
        raise TooFewContactsError("contacts: there are 0; the estimate needs at least 1, or a patch that is felt.")
    check_contacts(evidence, model.size)
    if balance is not None:
        check_mass(model)
    return _Asked(evidence, seed, most, limit)


def _check_kinds(model: ObjectModel, contacts: Contacts, method: str, prior: PosePrior | None) -> None:
    known_name("method", method, METHODS)
    instance_of("model", model, ObjectModel)
    instance_of("contacts", contacts, Contacts)
    if prior is not None:
        if not isinstance(prior, GaussianPrior):  # That of `core` will do.
            instance_of("prior", prior, PosePrior)
    elif method not in GLOBAL_METHODS:
        raise InvalidInputError(
            f"prior: is None; the method {method!r} starts from one. Without: {', '.join(sorted(GLOBAL_METHODS))}."
        )


def weigh_poses(
    model: ObjectModel, evidence: Evidence, method: str, seed: int, max_hypotheses: int, time_limit: float
) -> PoseEstimate:
    """What `estimate_pose` does once its arguments are checked; `time_limit` in s, infinite for none.

    Raises:
        InvalidInputError: balance of an object whose mass is not known, or whose symmetries move its centre of mass.
    """
    deadline, evidence, params = _Deadline(time_limit), evidence.rounded(), DEFAULT_PARAMS
    most_modes = max(max_hypotheses, params.modes.most_modes)
    problem = make_problem(model, evidence)
    search = METHODS[method](model, evidence)
    generator = np.random.default_rng(seed)
    images = indistinct_images(model, float(np.min(evidence.touch.sigma_position)))

    def answer(search: Search) -> tuple[Modes, Judgement | None, NDArray[np.bool_]]:
        """The modes that a search finds, as far as there is time weighed, what is said of them, and which explain."""
        found = _search(problem, search, generator, deadline)
        modes = _modes_of(model, evidence, problem, found, images, most_modes)
        if not deadline():
            posterior = make_posterior(model, evidence, problem, params, images)
            modes = weigh_modes(modes, posterior, np.random.default_rng(_SAMPLES_SEED))
        if model.near_symmetries or len(images) < len(model.symmetry_poses):
            modes = join_alike(modes, model, params.modes)
        return modes, *_judge(model, evidence, problem, modes, params)

    modes, judged, explains = answer(search)
    wider_search = None if evidence.prior is None or explains.any() else search.widened()
    if wider_search is not None and not deadline():
        # The valley with the pose may be a narrow one that no start has led to.
        modes, judged, explains = min(
            (modes, judged, explains),
            answer(wider_search),
            # What explains, then what is weighed where there was no time for both.
            key=lambda each: (not each[2].any(), math.isinf(each[0].standard_error), float(each[0].cost.min())),
        )
    hypotheses = _hypotheses(modes, _inlier_probability(problem, evidence, modes, judged), explains)
    undetermined = _is_undetermined(model, evidence, params.modes.fewest_contacts, hypotheses[0])
    estimate = PoseEstimate(
        hypotheses,
        status_of(hypotheses, undetermined),
        deadline.elapsed(),
        not deadline.passed,
        log_evidence(model, evidence, modes.log_mass),
        1.0 if judged is None else float(modes.mixture.weights @ judged.noise_scale),
        modes.standard_error,
        undetermined,
    )
    return estimate.first(max_hypotheses)


def _search(
    problem: PoseProblem, search: Search, generator: np.random.Generator, should_stop: StopSignal
) -> SearchResult:
    """What a search finds, with doubt where contacts may be false."""
    if problem.but_for_one is None:
        return search.minimize(problem.objective, problem.space, generator, should_stop)
    return search_with_doubt(problem, search, generator, should_stop)


def _is_undetermined(model: ObjectModel, evidence: Evidence, fewest: int, best: PoseHypothesis) -> bool:
    """Whether whole families of poses are left.

    By fewer contacts, by distances alone that are too few for six, by contacts that determine nothing, or that are not
    believed themselves.
    """
    if evidence.prior is not None:
        return False
    if len(evidence.touch) < fewest or len(best.free_directions) == 6 or np.all(best.inlier_probability < 0.5):
        return True
    only_distances = evidence.contacts.n_PC is None and not evidence.felt
    told = len(evidence.contacts) + len(evidence.planes) + len(model.continuous_symmetries)
    return only_distances and told < 6


def _judge(
    model: ObjectModel, evidence: Evidence, problem: PoseProblem, modes: Modes, params: PosteriorParams
) -> tuple[Judgement | None, NDArray[np.bool_]]:
    """What the contacts say of the modes, and which of those explain the touch."""
    X_PO = modes.mixture.X_PO
    judged = None if problem.mixture is None else problem.mixture.judge(X_PO)
    explained = explain_with_doubt(model, evidence, judged, X_PO, params.plausibility)
    explained &= lies_on_planes(model, evidence, X_PO, params.plausibility)
    return judged, explained & is_at_rest(model, evidence, X_PO, params.plausibility)


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


def _modes_of(
    model: ObjectModel, evidence: Evidence, problem: PoseProblem, found: SearchResult, images: FloatArray, limit: int
) -> Modes:
    """What a search has found, as modes of contacts that may be false, up to images (s, 3, 4); so many at the most."""
    X_PO = found.X_PO
    if evidence.prior is None:
        X_PO = _brought_back(X_PO, problem.space)
    if evidence.prior is None and model.continuous_symmetries:
        X_PO = turn_alike(X_PO, X_PO[0], model.symmetries, model.symmetry_poses)
    cost, _, hessian = problem.doubted(problem.determining).normal_equations(X_PO)
    for term in problem.bounding:
        cost = cost + term.cost(X_PO)
    return find_modes(
        X_PO,
        cost,
        hessian,
        problem.space.information,
        images,
        model.size,
        limit,
    )


def _brought_back(X_PO: FloatArray, space: PoseSpace) -> FloatArray:
    """Poses (n, 3, 4), those that no contact holds and that have gone anywhere no farther off than twice the reach."""
    center, reach = space.center[:, 3], _REACHES * space.reach[1]
    return np.concatenate(
        [X_PO[:, :, :3], X_PO[:, :, 3:].clip((center - reach)[:, None], (center + reach)[:, None])], 2
    )


def _inlier_probability(problem: PoseProblem, evidence: Evidence, modes: Modes, judged: Judgement | None) -> FloatArray:
    """Of each contact, then of each patch, that it is what it claims to be, shape (n, k); silent pads claim nothing."""
    by_contacts = np.empty((len(modes.cost), 0)) if judged is None else judged.inlier_probability
    by_patches = np.ones((len(modes.cost), len(evidence.patches)))
    if problem.pad_mixture is not None:
        felt = [patch.is_felt for patch in evidence.patches]
        by_patches[:, felt] = problem.pad_mixture.inlier_probability(modes.mixture.X_PO)
    return np.concatenate([by_contacts, by_patches], axis=1)


def _hypotheses(modes: Modes, inlier: FloatArray, explained: NDArray[np.bool_]) -> tuple[PoseHypothesis, ...]:
    weights = np.minimum(modes.mixture.weights, 1.0)  # A sum of one may be more by rounding.
    return tuple(
        PoseHypothesis(RigidTransform(pose=X_PO), float(cost), float(weight), covariance, free, bool(explains), own)
        for X_PO, cost, weight, covariance, free, explains, own in zip(
            modes.mixture.X_PO,
            modes.cost,
            weights,
            modes.mixture.covariance,
            modes.free_directions,
            explained,
            inlier,
            strict=True,
        )
    )
