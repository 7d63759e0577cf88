"""Identification of the object in the hand among many known ones ([B16] section 6.2.1).

A pose is estimated for every candidate. An object's evidence is the marginal likelihood of the touch, integrated over
all poses of the object, whether or not the touch determines the pose. The thesis compares the inverses of the lowest
costs instead (`likelihood="inverse_cost"`). The probability that it is none of the known objects is computed from their
evidence (see `core.identification.unknown_object`), whichever measure ranks them.

Only a few objects of a library are estimated, so that ten times as many take little longer. The objects whose pairs of
surface points agree best with the contacts' (see `core.identification.library_index`) have their poses searched. The
ones with the largest approximate evidence, which ignores edges and the curvature of modes, are then estimated.

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from typing import Any

import numpy as np

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.identification.model_evidence import log_evidence
from tactopose_drake.core.identification.unknown_object import unknown_probability
from tactopose_drake.core.kernel_library import make_kernels_ready
from tactopose_drake.core.posterior.modes import find_modes
from tactopose_drake.core.posterior.moved_origin import has_far_origin
from tactopose_drake.core.searches.pose_problem import make_problem
from tactopose_drake.core.sensing.patches import Patch
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import instance_of, positive_number, shown, whole_number
from tactopose_drake.errors import InvalidInputError, TooFewContactsError
from tactopose_drake.estimation.contact_checks import check_contacts
from tactopose_drake.estimation.executor_errors import handing_over, taking_back
from tactopose_drake.estimation.far_origins import with_near_origin
from tactopose_drake.estimation.identities import Identification, Identity
from tactopose_drake.estimation.inference import weigh_poses
from tactopose_drake.estimation.object_library import LibraryObject, ObjectLibrary
from tactopose_drake.estimation.pickling import Sealed
from tactopose_drake.estimation.ranking import (
    Likelihood,
    check_likelihood,
    evidence_of_shapes,
    group_equal_shapes,
    likelihood_weights,
    rank_objects,
    status_of_ranking,
)
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.estimation.search_methods import METHODS
from tactopose_drake.estimation.shape_errors import log_dilution, with_shape_errors

_METHOD = "pair_search"
# The number of a library's objects whose poses are searched, for each one that is estimated.
_SEARCHED = 4


def identify(
    models: Sequence[ObjectModel] | ObjectLibrary,
    contacts: Contacts,
    patches: Sequence[Patch] = (),
    executor: Executor | None = None,
    *,
    likelihood: Likelihood = "evidence",
    candidates: int = 16,
    max_hypotheses: int = 16,
    seed: int = 0,
    unknown_prior: float = 1.0 / 3.0,
) -> Identification:
    """Ranks objects by how well they explain a touch, and computes the probability that it is none of them.

    Args:
        models: the objects; of an `ObjectLibrary` only the most promising candidates are estimated.
        contacts: the touch at single points, in the palm frame; may be `Contacts.empty()` if a patch is felt.
        patches: what tactile arrays feel, as for `estimate_pose`.
        executor: an executor of threads, processes or a cluster that estimates several objects at a time; the result
            is the same. Processes are worthwhile if loading the models takes some seconds.
        likelihood: "evidence", or "inverse_cost", the thesis' measure.
        candidates: number of a library's objects whose poses are estimated.
        max_hypotheses: the largest number of poses to keep for each object.
        seed: seed of the searches' random numbers.
        unknown_prior: prior probability that the object is none of these, >= 0 and < 1; 0 if it is certainly one of
            them.

    Raises:
        TooFewContactsError: if there is no contact and no felt patch.
        UnknownNameError: if the likelihood does not exist.
        InvalidInputError: if there is no object, or one is not an `ObjectModel`; if `candidates` or `max_hypotheses` is
            below 1, the seed below 0, or the prior out of range; if patches have a wrong type, or the touch is not in
            metres; if the executor is shut down, or loses its workers.
    """
    started = time.perf_counter()
    likelihood = check_likelihood("likelihood", likelihood)
    candidates = whole_number("candidates", candidates, least=1)
    max_hypotheses = whole_number("max_hypotheses", max_hypotheses, least=1)
    seed = whole_number("seed", seed, least=0)
    unknown_prior = check_prior("unknown_prior", unknown_prior)
    run = _runner(executor)
    objects = check_objects(models)
    evidence = _check_touch(contacts, patches)
    names = [(known.name, _content(known)) for known in objects]
    order = sorted(range(len(objects)), key=names.__getitem__)  # Nothing depends on the order in which they came.
    chosen, rest = order, []
    if isinstance(models, ObjectLibrary) and len(objects) > candidates:
        order = _by_likelihood(models, order, evidence, candidates, seed, run)
        chosen, rest = order[:candidates], order[candidates:]
    explain = functools.partial(_explain, evidence=Sealed(evidence), max_hypotheses=max_hypotheses, seed=seed)
    several = [objects[i] for i in chosen]
    check_contacts(evidence, max(_model(known).size for known in several))
    estimates = list(run(explain, [Sealed(known) for known in several]))
    groups = group_equal_shapes([_model(known) for known in several])
    shapes = len(set(groups)) + len(rest)
    unknown = unknown_probability(evidence_of_shapes(estimates, groups), shapes, evidence.touch, unknown_prior)
    several_names, weights = [known.name for known in several], likelihood_weights(estimates, likelihood)
    identities = rank_objects(chosen, several_names, estimates, groups, weights, 1.0 - unknown)
    ranks = enumerate(rest, start=len(chosen) + 1)
    ruled_out = [Identity(objects[i].name, i, rank, 0.0, 0.0, -math.inf, None) for rank, i in ranks]
    status = status_of_ranking(identities, len(evidence.touch), unknown)
    return Identification((*identities, *ruled_out), status, time.perf_counter() - started, unknown)


def _by_likelihood(
    library: ObjectLibrary, order: list[int], evidence: Evidence, candidates: int, seed: int, run: Callable[..., Any]
) -> list[int]:
    """Orders a library's objects by its index, and the first of them again by their approximate evidence."""
    order = _by_falling(order, library.index.scores(evidence.touch)[order])
    searched, rest = order[: _SEARCHED * candidates], order[_SEARCHED * candidates :]
    approximate = functools.partial(_approximate_evidence, evidence=Sealed(evidence), seed=seed)
    objects = library.objects
    return _by_falling(searched, run(approximate, [Sealed(objects[i]) for i in searched])) + rest


def check_prior(name: str, value: float) -> float:
    """Checks the prior probability of an unknown object.

    Args:
        name: name of the value in messages.
        value: the probability, >= 0 and < 1.

    Raises:
        InvalidInputError: if it is out of this range.
    """
    prior = positive_number(name, value, allow_zero=True)
    if prior >= 1.0:
        raise InvalidInputError(f"{name} must be a number >= 0 and < 1, not {prior:g}.")
    return prior


def _runner(executor: Executor | None) -> Callable[..., Any]:
    if executor is None:
        return map
    instance_of("executor", executor, Executor)
    make_kernels_ready()  # As in `estimate_poses`: the executor's workers may be threads.

    def run(work: Callable[[Any], Any], items: Iterable[Any]) -> Iterator[Any]:
        with handing_over():
            found = executor.map(work, items)
        with taking_back():
            yield from found

    return run


def _check_touch(contacts: Contacts, patches: Sequence[Patch]) -> Evidence:
    evidence = Evidence(contacts, patches=patches)
    if len(evidence.touch) < 1:
        raise TooFewContactsError("contacts must be at least 1 if no patch is felt, not 0.")
    return evidence


def check_objects(models: object) -> Sequence[ObjectModel | LibraryObject]:
    """The candidate objects, from a library or a sequence of one or more.

    Raises:
        InvalidInputError: if `models` is neither.
    """
    if isinstance(models, ObjectLibrary):
        return models.objects
    if not isinstance(models, Sequence) or not models:
        raise InvalidInputError(
            f"models must be an ObjectLibrary, or a sequence of at least one ObjectModel, not {shown(models)}."
        )
    for i, model in enumerate(models):
        instance_of(f"models[{i}]", model, ObjectModel)
    return models


def _by_falling(indices: Sequence[int], values: Iterable[float]) -> list[int]:
    """The indices by falling values; indices of equal values keep their order."""
    return [i for _, i in sorted(zip(values, indices, strict=True), key=lambda pair: -pair[0])]


def _content(known: ObjectModel | LibraryObject) -> str:
    return known.content if isinstance(known, LibraryObject) else known.content_hash


def _model(known: ObjectModel | LibraryObject) -> ObjectModel:
    return known.load() if isinstance(known, LibraryObject) else known


def _approximate_evidence(known: Sealed[ObjectModel | LibraryObject], evidence: Sealed[Evidence], seed: int) -> float:
    """The evidence of one object by Laplace's approximation of the smooth likelihood."""
    model = _model(known.value)
    model = model.about_middle if has_far_origin(model) else model
    touch, dilution = _with_shape_errors(model, evidence.value)
    problem, generator = make_problem(model, touch), np.random.default_rng(seed)
    found = METHODS[_METHOD](model, touch).minimize(problem.objective, problem.space, generator)
    information = problem.determining.normal_equations(found.X_PO).hessian
    symmetry_poses, size, every = model.symmetry_poses, model.size, len(found.cost)
    modes = find_modes(found.X_PO, found.cost, information, problem.space.information, symmetry_poses, size, every)
    return log_evidence(model, touch, modes.log_mass) - dilution


def _explain(
    known: Sealed[ObjectModel | LibraryObject], evidence: Sealed[Evidence], max_hypotheses: int, seed: int
) -> PoseEstimate:
    """Estimates the pose of one object; may run in another process, which loads a library's object itself."""
    model = _model(known.value)
    felt, dilution = _with_shape_errors(model, evidence.value)
    found = with_near_origin(model, lambda near: weigh_poses(near, felt, _METHOD, seed, max_hypotheses, math.inf))
    return dataclasses.replace(found, log_evidence=found.log_evidence - dilution)


def _with_shape_errors(model: ObjectModel, touch: Evidence) -> tuple[Evidence, float]:
    """The touch with the object's shape errors added to its noise, and how much that alone raises the log evidence."""
    contacts = with_shape_errors(model, touch.contacts)
    return dataclasses.replace(touch, contacts=contacts), log_dilution(touch.contacts, contacts)
