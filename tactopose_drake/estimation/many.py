"""Many touches in one call, on all cores."""

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
from tactopose_drake.estimation.executors import as_done, handing_over
from tactopose_drake.estimation.pickling import Sealed
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.estimation.results import PoseEstimate

# So many touches of one object go to a worker at a time: to a thread few, to another process, which needs a copy of the
# model each time, many.
_TO_A_THREAD, _TO_A_PROCESS = 8, 250
# What users call a type.
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
    """Estimates the poses of many touches, several at a time, to the same bits as `estimate_pose` one by one.

    Args:
        models: the object of all touches, or of each.
        contacts: of each touch; they may be `Contacts.empty()` where patches are felt.
        priors: of all touches, or of each.
        seed: likewise, of the search's random numbers.
        executor: where the work is done: processes, or a cluster's, which are handed the models and so pay where each
            object has hundreds of touches. Threads without, one a core: of an estimate two fifths are Python's, which
            one thread at a time has.
        on_progress: is told how many touches of how many are done.
        options: all others of `estimate_pose`, the same for all touches.

    Raises:
        InvalidInputError: models, priors or seeds of another number than the touches, or of another type; `prior`
            among the options; an executor that is shut down, or loses its workers, before all is done.
        TactoposeError: what `estimate_pose` raises of one of the touches, with a note of which one: of its arguments
            before any work, else when it comes to it; work that is not begun yet is dropped.
    """
    if isinstance(contacts, Contacts):
        raise InvalidInputError("contacts: are of one touch; allowed is a sequence of Contacts, one for each touch.")
    instance_of("contacts", contacts, Iterable)
    if isinstance(contacts, str | bytes | Mapping | Set) or getattr(contacts, "ndim", 1) != 1:
        raise InvalidInputError(f"contacts: is {shown(contacts)}; allowed is a sequence of Contacts.")
    if "prior" in options:
        raise InvalidInputError("prior: of many touches it is `priors=`, one PosePrior or one for each touch.")
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
        with _told_of(i):
            check_question(of[i], contacts[i], prior=before[i], seed=seeds[i], **options)
    make_kernels_ready()  # Threads that meet a type for the first time at once may each get their own from numba.
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
    """One for each touch, of those that were given or of the one."""
    if isinstance(value, kind):
        return [value] * count
    if isinstance(value, np.ndarray) and value.ndim:
        value = list(value)
    if not isinstance(value, Sequence) or len(value) != count:
        is_list = isinstance(value, Sequence) and not isinstance(value, str)
        given = f"are {len(value)}" if is_list else f"is {shown(value)}"
        allowed = _CALLED.get(kind, kind.__name__)
        raise InvalidInputError(f"{name}: {given}; allowed are one {allowed}, or one for each touch, {count}.")
    return list(value)


def _parts(models: Sequence[ObjectModel], most: int) -> Iterator[tuple[Sealed[ObjectModel], list[int]]]:
    """The touches by number, so many of one object at a time, or fewer so that all cores have work."""
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
    """The estimates of some touches of one object; maybe in another process."""
    estimates = []
    for i, contacts, own in touches.value:
        with _told_of(i):
            estimates.append(estimate_pose(model.value, contacts, **own, **options.value))
    return estimates


@contextlib.contextmanager
def _told_of(i: int) -> Iterator[None]:
    """Notes at an error of which touch it is."""
    try:
        yield
    except TactoposeError as error:
        error.add_note(f"This is of contacts[{i}].")
        raise
