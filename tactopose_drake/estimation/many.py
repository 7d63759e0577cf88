"""`estimate_poses`: estimates for many touches in one call, on all cores."""

import contextlib
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from numbers import Integral
from typing import Any

import numpy as np

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.kernel_library import make_kernels_ready
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import instance_of, shown, whole_number
from tactopose_drake.errors import InvalidInputError, TactoposeError
from tactopose_drake.estimation.estimate import check_question, estimate_pose
from tactopose_drake.estimation.executor_errors import as_done, handing_over
from tactopose_drake.estimation.pickling import Sealed
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.estimation.results import PoseEstimate

# Touches of one object in a worker's task: few for a thread, many for another process, which gets a copy of the model
# with each task.
_TO_A_THREAD, _TO_A_PROCESS = 8, 250
# Names of types in messages.
_CALLED: dict[type, str] = {GaussianPrior: "PosePrior", Integral: "integer"}


def estimate_poses(
    models: ObjectModel | Sequence[ObjectModel],
    contacts: Sequence[Contacts],
    *,
    priors: PosePrior | Sequence[PosePrior | None] | None = None,
    seed: int | Sequence[int] = 0,
    executor: Executor | None = None,
    on_progress: Callable[[int, int], None] | None = None,
    **options: Any,
) -> list[PoseEstimate]:
    """Estimates the poses of many touches, several at a time, with results identical to `estimate_pose` for each.

    Args:
        models: the object of all touches, or one for each touch.
        contacts: contacts of each touch; may be `Contacts.empty()` if patches are felt.
        priors: the prior of all touches, or one for each touch.
        seed: seed of the search's random numbers, for all touches or one for each.
        executor: runs the work in processes or on a cluster. Models are copied to them, so this is worthwhile if each
            object has hundreds of touches. None: one thread per core; they run in parallel except for the Python code,
            two fifths of an estimate, which holds the interpreter lock.
        on_progress: called with the number of touches that are done and their total.
        options: all other options of `estimate_pose`, the same for all touches.

    Raises:
        InvalidInputError: if models, priors or seeds differ in number from the touches or have a wrong type; if `prior`
            is among the options; if the executor is shut down, or loses its workers, before all work is done.
        TactoposeError: what `estimate_pose` raises for one of the touches, with a note that says which one. Errors of
            arguments are raised before any work; other errors cancel work that has not started.
    """
    if isinstance(contacts, Contacts):
        raise InvalidInputError("contacts must be a sequence of Contacts, one for each touch, not a single one.")
    instance_of("contacts", contacts, Iterable)
    if isinstance(contacts, str | bytes | Mapping | Set) or getattr(contacts, "ndim", 1) != 1:
        raise InvalidInputError(f"contacts must be a sequence of Contacts, not {shown(contacts)}.")
    if "prior" in options:
        raise InvalidInputError(
            "prior must be given as `priors=`, one PosePrior or one for each touch, not as `prior=`."
        )
    if executor is not None:
        instance_of("executor", executor, Executor)
    if on_progress is not None:
        instance_of("on_progress", on_progress, Callable)  # type: ignore[arg-type]
    contacts = list(contacts)
    of = _each("models", models, ObjectModel, len(contacts))
    before = [None] * len(contacts) if priors is None else _each("priors", priors, GaussianPrior, len(contacts))
    seeds = _each("seed", seed, Integral, len(contacts))
    for i in range(len(contacts)):
        instance_of(f"contacts[{i}]", contacts[i], Contacts)
        instance_of(f"models[{i}]", of[i], ObjectModel)
        if before[i] is not None and not isinstance(before[i], GaussianPrior):
            instance_of(f"priors[{i}]", before[i], PosePrior)
        seeds[i] = whole_number(f"seed[{i}]", seeds[i], least=0)
        with _naming_touch(i):
            check_question(of[i], contacts[i], prior=before[i], seed=seeds[i], **options)
    make_kernels_ready()  # numba may compile a kernel more than once if threads first call it at the same time.
    estimates: dict[int, PoseEstimate] = {}
    with contextlib.ExitStack() as stack:
        pool = stack.enter_context(ThreadPoolExecutor(os.cpu_count())) if executor is None else executor
        size = _TO_A_THREAD if isinstance(pool, ThreadPoolExecutor) else _TO_A_PROCESS
        futures: dict[Future[list[PoseEstimate]], list[int]] = {}
        for model, part in _parts(of, size):
            touches = [(i, contacts[i], {"prior": before[i], "seed": seeds[i]}) for i in part]
            with handing_over():
                future = pool.submit(_estimate_some, model, Sealed(touches), Sealed(options))
            futures[future] = part
        done = 0
        try:
            for future, found in as_done(futures):
                estimates.update(zip(futures[future], found, strict=True))
                done += len(futures[future])
                if on_progress is not None:
                    on_progress(done, len(contacts))
        finally:
            for future in futures:
                future.cancel()
    return [estimates[i] for i in range(len(contacts))]


def _each(name: str, value: Any, kind: type, count: int) -> list[Any]:
    """One value for each touch, repeating a single one."""
    if isinstance(value, kind):
        return [value] * count
    if isinstance(value, np.ndarray) and value.ndim:
        value = list(value)
    if not isinstance(value, Sequence) or len(value) != count:
        is_list = isinstance(value, Sequence) and not isinstance(value, str)
        given = f"{len(value)} of them" if is_list else shown(value)
        allowed = _CALLED.get(kind, kind.__name__)
        raise InvalidInputError(f"{name} must be one {allowed}, or one for each of {count} touches, not {given}.")
    return list(value)


def _parts(models: Sequence[ObjectModel], most: int) -> Iterator[tuple[Sealed[ObjectModel], list[int]]]:
    """Splits the touches' indices by object into tasks of at most `most`, and small enough to occupy all cores."""
    groups: dict[int, list[int]] = {}
    for i, model in enumerate(models):
        groups.setdefault(id(model), []).append(i)
    for group in groups.values():
        sealed, size = Sealed(models[group[0]]), min(most, -(-len(group) // (os.cpu_count() or 1)))
        for begin in range(0, len(group), size):
            yield sealed, group[begin : begin + size]


def _estimate_some(
    model: Sealed[ObjectModel],
    touches: Sealed[list[tuple[int, Contacts, dict[str, Any]]]],
    options: Sealed[dict[str, Any]],
) -> list[PoseEstimate]:
    """Estimates some touches of one object; may run in another process."""
    estimates = []
    for i, contacts, own in touches.value:
        with _naming_touch(i):
            estimates.append(estimate_pose(model.value, contacts, **own, **options.value))
    return estimates


@contextlib.contextmanager
def _naming_touch(i: int) -> Iterator[None]:
    """Adds a note to an error that says which touch caused it."""
    try:
        yield
    except TactoposeError as error:
        error.add_note(f"The error is of contacts[{i}].")
        raise
