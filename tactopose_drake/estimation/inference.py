"""From evidence to an estimate: a search finds modes, sampling weighs them, and contacts are checked against them."""

import dataclasses
import functools
import math
import threading
import time
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform

from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.identification.model_evidence import log_evidence
from tactopose_drake.core.objectives.contact_mixture import Judgement
from tactopose_drake.core.plain_values import seal
from tactopose_drake.core.posterior.alike_modes import indistinct_images, join_alike
from tactopose_drake.core.posterior.importance_sampling import weigh_modes
from tactopose_drake.core.posterior.modes import Modes, find_modes
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

# Poses are clipped to this multiple of the space's reach, beyond which the object is out of touch.
_REACHES = 2.0
# Doubt of single contacts widens covariances. Without such doubt a covariance is only as good as its samples; with as
# few as suffice for probabilities, the standard deviation in some direction is two thirds of the true one.
_MORE_SAMPLES = dataclasses.replace(
    DEFAULT_PARAMS, sampling=dataclasses.replace(DEFAULT_PARAMS.sampling, effective_samples=300.0)
)
# A fixed seed, so that the modes' weights depend on the touch alone and not on the search's seed.
_SAMPLES_SEED = 0


class _Generators(threading.local):
    """The generators of each thread, seeded anew for each estimate: to make new ones takes several times as long."""

    def __init__(self) -> None:
        self.of_search, self.of_samples = np.random.default_rng(0), np.random.default_rng(0)


_GENERATORS = _Generators()


class _Answer(NamedTuple):
    """The modes that a search has led to, weighed if there was time.

    Attributes:
        modes: of the pose, n of them.
        judgement: of each contact under each mode; None without contacts.
        explains: which modes explain the touch, shape (n,).
    """

    modes: Modes
    judgement: Judgement | None
    explains: NDArray[np.bool_]

    @property
    def rank(self) -> tuple[bool, bool, float]:
        """The lower, the better: modes that explain the touch, then modes that there was time to weigh, then costs."""
        return not self.explains.any(), math.isinf(self.modes.standard_error), float(self.modes.cost.min())


def weigh_poses(
    model: ObjectModel, evidence: Evidence, method: str, seed: int, max_hypotheses: int, time_limit: float
) -> PoseEstimate:
    """Does the work of `estimate_pose` for checked arguments; `time_limit` in s, infinite for none.

    Raises:
        InvalidInputError: for balance of an object whose mass is unknown or whose symmetries move its centre of mass.
    """
    deadline, evidence = _Deadline(time_limit), evidence.rounded()
    params = _MORE_SAMPLES if _is_hardly_doubted(evidence) else DEFAULT_PARAMS
    most_modes = max(max_hypotheses, params.modes.most_modes)
    problem = make_problem(model, evidence)
    search = METHODS[method](model, evidence)
    generator = _seeded(_GENERATORS.of_search, seed)
    images = indistinct_images(model, float(np.min(evidence.touch.sigma_position)))

    def answer(search: Search) -> _Answer:
        found = _search(problem, search, generator, deadline)
        modes = _modes_of(model, evidence, problem, found, images, most_modes)
        if not deadline():
            posterior = make_posterior(model, evidence, problem, params, images)
            modes = weigh_modes(modes, posterior, _seeded(_GENERATORS.of_samples, _SAMPLES_SEED))
        if model.near_symmetries or len(images) < len(model.symmetry_poses):
            modes = join_alike(modes, model, params.modes)
        return _Answer(modes, *_judge(model, evidence, problem, modes, params))

    best = answer(search)
    wider_search = None if evidence.prior is None or best.explains.any() else search.widened()
    if wider_search is not None and not deadline():
        # The pose may be in a narrow valley that no start of the search has led to.
        best = min(best, answer(wider_search), key=lambda each: each.rank)
    modes, judged, explains = best
    hypotheses = _hypotheses(modes, _inlier_probability(problem, evidence, modes, judged), explains)
    undetermined = _is_undetermined(model, evidence, params.modes.fewest_contacts, hypotheses[0])
    estimate = PoseEstimate(
        hypotheses,
        status_of(hypotheses, undetermined),
        deadline.elapsed(),
        not deadline.passed,
        log_evidence(model, evidence, modes.log_mass, len(images)),
        1.0 if judged is None else _noise_scale(problem, modes, judged),
        modes.standard_error,
        undetermined,
    )
    return estimate.first(max_hypotheses)


def _seeded(generator: np.random.Generator, seed: int) -> np.random.Generator:
    """The generator in the state of a new one with this seed."""
    generator.bit_generator.state = _state(seed)
    return generator


@functools.lru_cache
def _state(seed: int) -> Any:
    return np.random.default_rng(seed).bit_generator.state


def _search(
    problem: PoseProblem, search: Search, generator: np.random.Generator, should_stop: StopSignal
) -> SearchResult:
    """Runs a search, with doubt in the contacts where they may be false."""
    if problem.but_for_one is None:
        return search.minimize(problem.objective, problem.space, generator, should_stop)
    return search_with_doubt(problem, search, generator, should_stop)


def _is_hardly_doubted(evidence: Evidence) -> bool:
    """Whether doubt of contacts widens no covariance: the prior is more precise, or only one or two pads are felt."""
    if not len(evidence.contacts) and len(evidence.touch) < DEFAULT_PARAMS.modes.fewest_contacts:
        return True
    prior = evidence.prior
    return prior is not None and prior.sigma_translation < float(np.min(evidence.touch.sigma_position))


def _is_undetermined(model: ObjectModel, evidence: Evidence, fewest: int, best: PoseHypothesis) -> bool:
    """Whether the touch leaves whole families of poses.

    It does if there are fewer contacts than `fewest`, fewer than six distances without normals, only free directions,
    or only contacts that are more probably false than not.
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
    """The judgement of each contact under each mode, and which modes explain the touch."""
    X_PO = modes.mixture.X_PO
    judged = None if problem.mixture is None else problem.mixture.judge(X_PO)
    explained = explain_with_doubt(model, evidence, judged, X_PO, params.plausibility)
    explained &= lies_on_planes(model, evidence, X_PO, params.plausibility)
    return judged, explained & is_at_rest(model, evidence, X_PO, params.plausibility)


def _noise_scale(problem: PoseProblem, modes: Modes, judged: Judgement) -> float:
    """The noise of the contacts' points over the told one, under the best mode."""
    assert problem.mixture is not None
    best = judged._replace(inlier_probability=judged.inlier_probability[:1], factors=judged.factors[:1])
    return float(problem.mixture.noise_scale(modes.mixture.X_PO[:1], best, problem.space.information)[0])


class _Deadline:
    """The stop signal of a time limit, s from now; `passed` tells whether it has signalled."""

    def __init__(self, limit: float) -> None:
        self._started, self._limit = time.perf_counter(), limit
        self.passed = False

    def __call__(self) -> bool:
        self.passed = self.elapsed() >= self._limit
        return self.passed

    def elapsed(self) -> float:
        """Time since it was created, s."""
        return time.perf_counter() - self._started


def _modes_of(
    model: ObjectModel, evidence: Evidence, problem: PoseProblem, found: SearchResult, images: FloatArray, limit: int
) -> Modes:
    """The modes of a search's poses under contacts that may be false, without symmetric images, at most `limit`.

    `images` are the symmetry poses whose results count as the same, shape (s, 3, 4).
    """
    X_PO = found.X_PO
    if not evidence.tells_position:
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
    """Poses (n, 3, 4), clipped to twice the reach: those that no contact holds may have drifted anywhere."""
    center, reach = space.center[:, 3], _REACHES * space.reach[1]
    return np.concatenate(
        [X_PO[:, :, :3], X_PO[:, :, 3:].clip((center - reach)[:, None], (center + reach)[:, None])], 2
    )


def _inlier_probability(problem: PoseProblem, evidence: Evidence, modes: Modes, judged: Judgement | None) -> FloatArray:
    """Inlier probability of each contact, then of each patch, shape (n, k); 1 for pads that feel nothing."""
    by_contacts = np.empty((len(modes.cost), 0)) if judged is None else judged.inlier_probability
    by_patches = np.ones((len(modes.cost), len(evidence.patches)))
    if problem.pad_mixture is not None:
        felt = [patch.is_felt for patch in evidence.patches]
        by_patches[:, felt] = problem.pad_mixture.inlier_probability(modes.mixture.X_PO)
    return np.concatenate([by_contacts, by_patches], axis=1)


def _hypotheses(modes: Modes, inlier: FloatArray, explained: NDArray[np.bool_]) -> tuple[PoseHypothesis, ...]:
    weights = np.minimum(modes.mixture.weights, 1.0)  # Rounding may exceed 1.
    seal((modes.mixture, modes.free_directions, inlier))  # Rows of read-only arrays are read-only.
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
