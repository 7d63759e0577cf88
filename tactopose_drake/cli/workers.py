"""Processes that work for a command."""

import contextlib
import multiprocessing.context
import signal
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor


class _QuietProcess(multiprocessing.context.SpawnProcess):
    """A process that an interrupt from the keyboard passes by: whoever has started it ends it."""

    def start(self) -> None:
        if not hasattr(signal, "pthread_sigmask"):  # Windows
            super().start()
            return
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            super().start()  # It inherits what is blocked.
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


class _QuietContext(multiprocessing.context.SpawnContext):
    Process = _QuietProcess


@contextlib.contextmanager
def processes(jobs: int) -> Iterator[Executor]:
    """So many processes, which start when work comes in; what is not done yet is dropped when the user interrupts."""
    executor = ProcessPoolExecutor(jobs, mp_context=_QuietContext())
    try:
        yield executor
    finally:
        executor.shutdown(cancel_futures=True)
