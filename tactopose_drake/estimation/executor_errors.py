"""Handling of errors of `concurrent.futures` executors."""

import contextlib
import queue
from collections.abc import Iterable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Future
from typing import Any, TypeVar

from tactopose_drake.errors import InvalidInputError

Result = TypeVar("Result")


@contextlib.contextmanager
def handing_over() -> Iterator[None]:
    """Context in which work is submitted to an executor.

    Raises:
        InvalidInputError: if the executor is shut down, or its workers have died.
    """
    try:
        yield
    except RuntimeError as error:
        raise InvalidInputError(f"executor must be open, but takes no work ({error}).") from None


@contextlib.contextmanager
def taking_back() -> Iterator[None]:
    """Context in which results of an executor are collected; errors of the work itself are raised unchanged.

    Raises:
        InvalidInputError: if the executor was shut down before the work was done, or its workers have died.
    """
    try:
        yield
    except CancelledError:
        raise InvalidInputError("executor must stay open until the work is done, not be shut down before.") from None
    except BrokenExecutor as error:
        raise InvalidInputError(
            f"executor must keep its workers until the work is done, but has lost them ({error})."
        ) from None


def as_done(futures: Iterable[Future[Result]]) -> Iterator[tuple[Future[Result], Result]]:
    """Yields futures with their results, in the order of their completion.

    Unlike `concurrent.futures.as_completed`, it does not wait for ever for futures that were cancelled when the
    executor was shut down.

    Raises:
        InvalidInputError: as in `taking_back`.
    """
    futures = list(futures)
    done: queue.SimpleQueue[Future[Any]] = queue.SimpleQueue()
    for future in futures:
        future.add_done_callback(done.put)
    for _ in futures:
        future = done.get()
        with taking_back():
            result = future.result()
        yield future, result
