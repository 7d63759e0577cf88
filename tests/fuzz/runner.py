"""Makes the fuzzer's calls, in this process or in several with a watchdog, and sums up what they found.

A kind is a function of one random generator that makes one call of the package. It returns when the call was answered
as it should be. A `TactoposeError` that leaves it counts as a refusal, which is an answer too. Any other exception is a
finding, and so are a warning, a call that takes more than `CPU_LIMIT` seconds of processor time and one that does not
come back. Call number `seed` of a kind is always the same call, whatever ran before it and wherever it runs.
"""

import collections
import dataclasses
import multiprocessing
import multiprocessing.connection
import time
import traceback
import warnings
import zlib
from collections.abc import Callable, Mapping

import numpy as np

from tactopose_drake.errors import TactoposeError

Kind = Callable[[np.random.Generator], None]

CPU_LIMIT = 5.0
"""Seconds of processor time that a call may take, once its kernels are compiled."""
CPU_LIMITS = {"bits": 15 * CPU_LIMIT}
"""Of kinds that make so many calls of the package in one."""
WALL_LIMIT = 900.0
"""Seconds after which a call that has not come back is taken for hung; long, for it may compile on a loaded machine."""

_spawned = multiprocessing.get_context("spawn")


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What became of one call: "answered", "refused", or "finding" with what was found."""

    kind: str
    seed: int
    result: str
    detail: str = ""

    @property
    def command(self) -> str:
        """How to make this call again."""
        return f"python -m tests.fuzz --kind {self.kind} --seed {self.seed} --calls 1"


def make_call(name: str, kind: Kind, seed: int, cpu_limit: float | None = None) -> Outcome:
    """Makes one call in this process. A slow one is made again, for the first may have compiled kernels."""
    limit = CPU_LIMITS.get(name, CPU_LIMIT) if cpu_limit is None else cpu_limit
    for last in (False, True):
        generator = np.random.default_rng([zlib.crc32(name.encode()), seed])
        started = time.process_time()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                kind(generator)
            result = "answered"
        except TactoposeError:
            result = "refused"
        except Exception:
            return Outcome(name, seed, "finding", traceback.format_exc())
        taken = time.process_time() - started
        if taken <= limit:
            return Outcome(name, seed, result)
        if last:
            return Outcome(name, seed, "finding", f"took {taken:.1f} s of processor time; allowed are {limit:g} s")
    raise AssertionError


@dataclasses.dataclass
class Summary:
    """The outcomes of many calls: how many of each result a kind had, and the findings."""

    counts: dict[str, collections.Counter[str]] = dataclasses.field(default_factory=dict)
    findings: list[Outcome] = dataclasses.field(default_factory=list)

    def add(self, outcome: Outcome) -> None:
        self.counts.setdefault(outcome.kind, collections.Counter())[outcome.result] += 1
        if outcome.result == "finding":
            self.findings.append(outcome)

    def __str__(self) -> str:
        return "\n".join(
            f"{kind}: {counts.total()} calls, {counts['answered']} answered, {counts['refused']} refused, "
            f"{counts['finding']} findings"
            for kind, counts in self.counts.items()
        )


def run_here(kinds: Mapping[str, Kind], seeds: range, cpu_limit: float = 60.0) -> Summary:
    """Makes one call of each kind for each seed, in this process, which may be on a slow machine."""
    summary = Summary()
    for seed in seeds:
        for name, kind in kinds.items():
            summary.add(make_call(name, kind, seed, cpu_limit))
    return summary


def run(
    kinds: Mapping[str, Kind],
    *,
    seed: int,
    calls: int | None,
    minutes: float | None,
    jobs: int,
    report: Callable[[Outcome], None],
    wall_limit: float = WALL_LIMIT,
) -> Summary:
    """Makes calls of each kind from `seed` on in worker processes, until there are so many or the time is over.

    An interrupt ends it with what was found until then.

    Args:
        kinds: by name; importable functions.
        seed: of the first call of each kind.
        calls: of each kind; None for as many as the time allows.
        minutes: after so many no further call is begun; None for as long as it takes.
        jobs: how many processes.
        report: told of each finding as it is made.
        wall_limit: s, after which a call that has not come back is a finding, and its process is replaced.
    """
    summary = Summary()
    deadline = None if minutes is None else time.time() + 60.0 * minutes
    end = None if calls is None else seed + calls
    workers = [_Worker(kinds, seed + job, jobs, end, deadline) for job in range(jobs)]
    try:
        while workers:
            ready = multiprocessing.connection.wait([worker.connection for worker in workers], timeout=1.0)
            for worker in list(workers):
                outcomes = worker.receive() if worker.connection in ready else worker.check(wall_limit)
                for outcome in outcomes:
                    summary.add(outcome)
                    if outcome.result == "finding":
                        report(outcome)
                if worker.finished:
                    workers.remove(worker)
    except KeyboardInterrupt:  # What was found until then counts.
        for worker in workers:
            worker.end()
    return summary


class _Worker:
    """A process that makes every `stride`-th call; it is started anew behind a call that hangs or kills it."""

    def __init__(
        self, kinds: Mapping[str, Kind], seed: int, stride: int, end: int | None, deadline: float | None
    ) -> None:
        self._kinds, self._stride, self._end, self._deadline = dict(kinds), stride, end, deadline
        self.finished = False
        self._start([(name, seed) for name in kinds])

    def _start(self, first: list[tuple[str, int]]) -> None:
        """Starts a process that makes the calls `first`, then those of the following seeds."""
        self.connection, theirs = _spawned.Pipe(duplex=False)
        arguments = (theirs, self._kinds, first, self._stride, self._end, self._deadline)
        self._process = _spawned.Process(target=_work, args=arguments, daemon=True)
        self._process.start()
        theirs.close()
        self._current: tuple[str, int] | None = None
        self._since = time.monotonic()

    def receive(self) -> list[Outcome]:
        """The outcome that has arrived, if one has."""
        try:
            message = self.connection.recv()
        except EOFError:
            self._process.join()
            if self._current is None:
                self.finished = True
                return []
            return self._abandon(f"the process ended with exit code {self._process.exitcode}")
        self._since = time.monotonic()
        if isinstance(message, Outcome):
            self._current = None
            return [message]
        self._current = message
        return []

    def check(self, wall_limit: float) -> list[Outcome]:
        """A finding, if the current call has not come back for so long."""
        if self._current is None or time.monotonic() - self._since < wall_limit:
            return []
        self.end()
        return self._abandon(f"has not come back after {wall_limit:g} s")

    def end(self) -> None:
        """Ends the process, wherever it is."""
        self._process.kill()
        self._process.join()

    def _abandon(self, detail: str) -> list[Outcome]:
        """Goes on behind the current call in a new process."""
        assert self._current is not None
        name, seed = self._current
        self.connection.close()
        names = list(self._kinds)
        self._start([(later, seed) for later in names[names.index(name) + 1 :]] or [("", seed)])
        return [Outcome(name, seed, "finding", detail)]


def _work(
    connection: multiprocessing.connection.Connection,
    kinds: dict[str, Kind],
    first: list[tuple[str, int]],
    stride: int,
    end: int | None,
    deadline: float | None,
) -> None:
    """Makes calls and sends, for each, its name and seed before it and its outcome after it."""
    seed, calls = first[0][1], [(name, number) for name, number in first if name]
    while end is None or seed < end:
        for name, number in calls:
            if deadline is not None and time.time() >= deadline:
                return
            connection.send((name, number))
            connection.send(make_call(name, kinds[name], number))
        seed += stride
        calls = [(name, seed) for name in kinds]
