"""Work for a second core: the compiled loops release the interpreter's lock, so a thread may take half of one.

What is done is the same whether there is a second core, or not.
"""

import os
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor

_helpers: list[ThreadPoolExecutor] = []
# A child has none of its parent's threads.
os.register_at_fork(after_in_child=_helpers.clear)


def in_two_parts(work: Callable[[int], None]) -> None:
    """Calls work(0) and work(1), at the same time if there are two cores.

    Each part does its work in one compiled loop that releases the interpreter's lock, and touches nothing of the
    other's. If the helper is busy with somebody else's work, the caller does both.
    """
    other = _submit(work) if (os.cpu_count() or 1) > 1 else None
    work(0)
    if other is None or other.cancel():
        work(1)
    else:
        other.result()


def _submit(work: Callable[[int], None]) -> Future[None] | None:
    if not _helpers:
        _helpers.append(ThreadPoolExecutor(1, thread_name_prefix="second-core"))
    try:
        return _helpers[0].submit(work, 1)
    except RuntimeError:  # The interpreter is about to end.
        return None
