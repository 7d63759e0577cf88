"""Which of many known objects is in the hand? ([B16] section 6.2.1)

A pose is estimated for every object that may be it. An object's evidence is the likelihood of the touch summed over all
the poses that it may have: what the touch says of the object, be its pose determined or not. The thesis compares the
inverses of the lowest costs instead: `likelihood="inverse_cost"`. That it may be none of the known objects is weighed
by their evidence (see `core.identification.unknown_object`), whichever measure ranks them.

Of a library's objects few are estimated, so that ten times as many take little longer. Those whose pairs of surface
points agree best with the contacts' (see `core.identification.library_index`) have their poses searched; of these the
ones of most evidence by a quick approximation, which leaves out edges and the bends of modes, are estimated.

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
from tactopose_drake.core.posterior.hypotheses import find_modes
from tactopose_drake.core.posterior.moved_origin import has_far_origin
from tactopose_drake.core.searches.pose_problem import make_problem
from tactopose_drake.core.sensing.patches import Patch
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import instance_of, positive_number, shown, whole_number
from tactopose_drake.errors import InvalidInputError, TooFewContactsError
from tactopose_drake.estimation.contact_checks import check_contacts
from tactopose_drake.estimation.executors import handing_over, taking_back
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
# So many of a library's objects, for each one that is estimated, have their poses searched.
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
    """Ranks objects by how well they explain a touch, and says how probable it is that it is of none of them.

    Args:
        models: the objects; of an `ObjectLibrary` only the candidates are looked at closely.
        contacts: the touch at single points, in the palm frame; may be `Contacts.empty()` where a patch is felt.
        patches: what tactile arrays feel, as for `estimate_pose`.
        executor: estimates several objects at a time: processes, threads, or a cluster's; the result is the same.
            Processes pay where some seconds of models are to be loaded.
        likelihood: "evidence", or "inverse_cost", the thesis' measure.
        candidates: of a library's objects so many have their poses estimated.
        max_hypotheses: how many poses of each are kept, at most.
        seed: of the searches' random numbers.
        unknown_prior: the probability that the object is none of these, before the touch: how often that happens. 0
            where it is one of them for certain; below 1.

    Raises:
        TooFewContactsError: no contact, and no patch that is felt.
        UnknownNameError: a likelihood that does not exist.
        InvalidInputError: no object, or one that is no `ObjectModel`; `candidates` or `max_hypotheses` below 1; a seed
            below 0; a prior that is no probability; patches that are none; a touch not in metres; an executor that is
            shut down, or loses its workers.
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
    ruled_out = [_ruled_out(objects[i].name, i, rank) for rank, i in enumerate(rest, start=len(chosen) + 1)]
    status = status_of_ranking(identities, len(evidence.touch), unknown)
    return Identification((*identities, *ruled_out), status, time.perf_counter() - started, unknown)


def _ruled_out(name: str, index: int, rank: int) -> Identity:
    """An object of a library that was not looked at closely."""
    return Identity(name, index, rank, 0.0, 0.0, -math.inf, None)


def _by_likelihood(
    library: ObjectLibrary, order: list[int], evidence: Evidence, candidates: int, seed: int, run: Callable[..., Any]
) -> list[int]:
    """The library's objects, the most likely first: by its index, and the first of those by approximate evidence."""
    order = _by_falling(order, library.index.scores(evidence.touch)[order])
    searched, rest = order[: _SEARCHED * candidates], order[_SEARCHED * candidates :]
    approximate = functools.partial(_approximate_evidence, evidence=Sealed(evidence), seed=seed)
    objects = library.objects
    return _by_falling(searched, run(approximate, [Sealed(objects[i]) for i in searched])) + rest


def check_prior(name: str, value: float) -> float:
    """The probability of an unknown object before the touch.

    Args:
        name: what the value is of.
        value: at least 0, and below 1.

    Raises:
        InvalidInputError: if it is not.
    """
    prior = positive_number(name, value, allow_zero=True)
    if prior >= 1.0:
        raise InvalidInputError(f"{name}: is {prior:g}; allowed are numbers >= 0 and < 1.")
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
        raise TooFewContactsError("contacts: there are 0; identification needs at least 1, or a patch that is felt.")
    return evidence


def check_objects(models: object) -> Sequence[ObjectModel | LibraryObject]:
    """The objects that a touch may be of, from a library or a sequence of one or more.

    Raises:
        InvalidInputError: if it is neither.
    """
    if isinstance(models, ObjectLibrary):
        return models.objects
    if not isinstance(models, Sequence) or not models:
        raise InvalidInputError(
            f"models: is {shown(models)}; allowed are an ObjectLibrary and a sequence of ObjectModel."
        )
    for i, model in enumerate(models):
        if not isinstance(model, ObjectModel):
            raise InvalidInputError(f"models[{i}]: is a {type(model).__name__}; allowed is an ObjectModel.")
    return models


def _by_falling(indices: Sequence[int], values: Iterable[float]) -> list[int]:
    """The indices by falling values; equal ones stay in their order."""
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
    """The pose of one object; maybe in another process, which loads a library's object by itself."""
    model = _model(known.value)
    felt, dilution = _with_shape_errors(model, evidence.value)
    found = with_near_origin(model, lambda near: weigh_poses(near, felt, _METHOD, seed, max_hypotheses, math.inf))
    return dataclasses.replace(found, log_evidence=found.log_evidence - dilution)


def _with_shape_errors(model: ObjectModel, touch: Evidence) -> tuple[Evidence, float]:
    """The touch as unsure as the object's surface makes it, and by how much that alone raises the log evidence."""
    contacts = with_shape_errors(model, touch.contacts)
    return dataclasses.replace(touch, contacts=contacts), log_dilution(touch.contacts, contacts)
