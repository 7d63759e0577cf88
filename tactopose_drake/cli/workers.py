"""Worker processes of a command."""

import contextlib
import multiprocessing.context
import signal
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor


class _QuietProcess(multiprocessing.context.SpawnProcess):
    """A process that ignores keyboard interrupts; its parent ends it."""

    def start(self) -> None:
        if not hasattr(signal, "pthread_sigmask"):  # Windows
            super().start()
            return
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            super().start()  # It inherits the blocked signals.
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


class _QuietContext(multiprocessing.context.SpawnContext):
    Process = _QuietProcess


@contextlib.contextmanager
def processes(jobs: int) -> Iterator[Executor]:
    """An executor of `jobs` processes, which start on demand; pending work is cancelled at the end."""
    executor = ProcessPoolExecutor(jobs, mp_context=_QuietContext())
    try:
        yield executor
    finally:
        executor.shutdown(cancel_futures=True)
