"""From evidence to an estimate: a search finds modes of the posterior, samples weigh them, and contacts judge them."""

import math
import time

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform

from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.identification.model_evidence import log_evidence
from tactopose_drake.core.objectives.contact_mixture import Judgement
from tactopose_drake.core.posterior.alike_modes import indistinct_images, join_alike
from tactopose_drake.core.posterior.hypotheses import Modes, find_modes
from tactopose_drake.core.posterior.importance_sampling import weigh_modes
from tactopose_drake.core.posterior.plausibility import explain_with_doubt, is_at_rest, lies_on_planes
from tactopose_drake.core.posterior.posterior import make_posterior
from tactopose_drake.core.posterior.posterior_params import DEFAULT_PARAMS, PosteriorParams
from tactopose_drake.core.searches.doubt import search_with_doubt
from tactopose_drake.core.searches.pose_problem import PoseProblem, make_problem
from tactopose_drake.core.searches.search import PoseSpace, Search, SearchResult, StopSignal
from tactopose_drake.core.shape.free_spin import turn_alike
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.estimation.pose_hypothesis import PoseHypothesis
from tactopose_drake.estimation.results import PoseEstimate, status_of
from tactopose_drake.estimation.search_methods import METHODS

# Beyond so many times the reach of touch and surface no pose is of interest; within it none is changed.
_REACHES = 2.0
# The same samples weigh the modes whatever the search's seed is: what is believed of them hangs on the touch alone.
_SAMPLES_SEED = 0


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
        log_evidence(model, evidence, modes.log_mass, len(images)),
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
