"""Where work is done beside this thread."""

import contextlib
import queue
from collections.abc import Iterable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Future
from typing import Any, TypeVar

from tactopose_drake.errors import InvalidInputError

Result = TypeVar("Result")


@contextlib.contextmanager
def handing_over() -> Iterator[None]:
    """What is handed over to an executor inside of this, it takes.

    Raises:
        InvalidInputError: if it does not: it is shut down, or its workers have died.
    """
    try:
        yield
    except RuntimeError as error:
        raise InvalidInputError(f"executor: takes no work ({error}); allowed is one that is open.") from None


@contextlib.contextmanager
def taking_back() -> Iterator[None]:
    """What an executor was handed over is asked for inside of this, where the work's own errors are raised as they are.

    Raises:
        InvalidInputError: if the executor has not done it: it was shut down before, or its workers have died.
    """
    try:
        yield
    except CancelledError:
        raise InvalidInputError(
            "executor: was shut down before the work was done; allowed is one that stays open for as long."
        ) from None
    except BrokenExecutor as error:
        raise InvalidInputError(
            f"executor: has lost its workers before the work was done ({error}); allowed is one that keeps them."
        ) from None


def as_done(futures: Iterable[Future[Result]]) -> Iterator[tuple[Future[Result], Result]]:
    """Futures of an executor with what came of them, in the order in which they are done.

    `concurrent.futures.as_completed` waits for ever for those that an executor has cancelled as it was shut down.

    Raises:
        InvalidInputError: as of `taking_back`.
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
