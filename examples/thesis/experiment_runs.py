"""Runs the experiments of `pose_experiments.py` on several processes, and continues interrupted runs."""

import contextlib
import dataclasses
import itertools
import multiprocessing
import signal
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from types import FrameType
from typing import NamedTuple

import numpy as np
from grasp_library import SimulatedGrasp
from grasp_trials import Errors, Trial, make_trial, pose_errors
from pose_experiments import (
    CELLS,
    LEVELS,
    MAIN_CELL,
    METHODS,
    OUR_METHODS,
    THESIS_METHODS,
    Cell,
    Experiment,
    Results,
    Runs,
    find_poses,
    run_trial,
)
from rich.console import Console
from rich.progress import Progress
from trial_journal import Key, Numbers, TrialJournal

import tactopose_drake as tp


class Task(NamedTuple):
    """One method applied to the trial of one grasp in one cell."""

    grasp: int
    cell: Cell
    method: str


@dataclasses.dataclass(frozen=True, eq=False)
class Bench:
    """The inputs of an experiment's trials.

    Attributes:
        experiment: the experiment.
        model: the model of its object.
        grasps: the grasps of its object; each gives one trial in each cell.
        seed: seed of the noise, the displacements and the choice of fingers that are left out.
    """

    experiment: Experiment
    model: tp.ObjectModel
    grasps: Sequence[SimulatedGrasp]
    seed: int

    def trial(self, grasp: int, cell: Cell) -> Trial:
        """The trial of a grasp in a cell, the same for all methods."""
        name, guess = self.experiment.object, self.experiment.guess
        return make_trial(name, self.grasps[grasp], cell.fingers, cell.noise, (self.seed, grasp), guess)

    def rehearse(self, methods: Sequence[str]) -> None:
        """Calls each method once before it is timed, because the first call compiles, or loads what is compiled."""
        # The thesis' search is fast only around a prior.
        near = make_trial(self.experiment.object, self.grasps[0], 5, LEVELS[0], (self.seed, 0), True)
        for method in methods:
            for trial in (self.trial(0, cell) for cell in CELLS) if method in OUR_METHODS else (near,):
                find_poses(self.model, trial, method)

    def run(self, task: Task) -> Numbers:
        """The result of a task; see `run_trial`."""
        return tuple(map(float, run_trial(self.model, self.trial(task.grasp, task.cell), task.method)))

    def key(self, task: Task) -> Key:
        """The key of a task in the journal."""
        return {
            "experiment": self.experiment.name,
            "seed": self.seed,
            "grasp": task.grasp,
            "fingers": task.cell.fingers,
            "noise": str(task.cell.noise),
            "method": task.method,
        }


def run_experiment(
    bench: Bench, counts: Mapping[str, int], journal: TrialJournal | None = None, jobs: int = 1
) -> Results:
    """Runs an experiment.

    After an interrupt (Ctrl-C), the thesis' searches, which take hours, stop after the current grasp.

    Args:
        bench: the inputs of its trials.
        counts: number of trials of each cell on which each method runs, unless interrupted.
        journal: has the trials that need not be run again, and receives those that are run.
        jobs: number of processes that run trials in parallel.
    """
    journal = TrialJournal() if journal is None else journal
    with Progress(console=Console(stderr=True), transient=True) as progress, noted_interrupts() as interrupts:
        bar = progress.add_task(bench.experiment.name, total=len(CELLS) * sum(counts.values()))

        def tasks() -> Iterator[Task]:
            for grasp in range(max(counts.values())):
                methods = [m for m, n in counts.items() if grasp < n and not (interrupts and m in THESIS_METHODS)]
                for cell, method in itertools.product(CELLS, methods):
                    if bench.key(task := Task(grasp, cell, method)) in journal:
                        progress.advance(bar)
                    else:
                        yield task

        for task, numbers in _run_all(bench, [m for m, n in counts.items() if n], tasks(), jobs):
            journal.add(bench.key(task), numbers)
            progress.advance(bar)
    priors = [(bench.trial(i, MAIN_CELL).prior, bench.grasps[i].X_PO) for i in range(max(counts.values()))]
    initial = [pose_errors(bench.model, prior.mean[None], X_PO) for prior, X_PO in priors if prior is not None]
    return Results(
        bench.experiment,
        Errors(*(np.array([errors[part] for errors in initial]).ravel() for part in (0, 1))),
        {
            (cell, method): _gather(numbers)
            for cell, method in itertools.product(CELLS, METHODS)
            if (numbers := _first_trials(bench, cell, method, counts.get(method, 0), journal))
        },
    )


@contextlib.contextmanager
def noted_interrupts() -> Iterator[list[int]]:
    """Collects the interrupts since it was entered; a second one ends the program as usual."""
    seen: list[int] = []

    def note(signal_number: int, _: FrameType | None) -> None:
        if seen:
            raise KeyboardInterrupt
        seen.append(signal_number)

    before = signal.signal(signal.SIGINT, note)
    try:
        yield seen
    finally:
        signal.signal(signal.SIGINT, before)


def _run_all(bench: Bench, methods: Sequence[str], tasks: Iterator[Task], jobs: int) -> Iterator[tuple[Task, Numbers]]:
    """The tasks and their results, in order. A task is taken only when a process will soon be free for it."""
    if jobs == 1:
        bench.rehearse(methods)
        for task in tasks:
            yield task, bench.run(task)
        return
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, mp_context=spawn, initializer=_take, initargs=(bench, methods)) as executor:
        waiting: deque[tuple[Task, Future[Numbers]]] = deque()
        for task in tasks:
            waiting.append((task, executor.submit(_run_taken, task)))
            if len(waiting) > 2 * jobs:
                yield waiting[0][0], waiting.popleft()[1].result()
        for task, future in waiting:
            yield task, future.result()


def _take(bench: Bench, methods: Sequence[str]) -> None:
    """Stores the bench in this process."""
    global _taken
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # The main process handles it.
    _taken = bench
    bench.rehearse(methods)


def _run_taken(task: Task) -> Numbers:
    return _taken.run(task)


_taken: Bench


def _first_trials(bench: Bench, cell: Cell, method: str, count: int, journal: TrialJournal) -> list[Numbers]:
    """The trials of the first `count` of a method in a cell, up to the first one that a method or cell has not run."""
    keys = [[bench.key(Task(grasp, each, method)) for each in CELLS] for grasp in range(count)]
    complete = itertools.takewhile(lambda row: all(key in journal for key in row), keys)
    return [journal[row[CELLS.index(cell)]] for row in complete]


def _gather(rows: list[Numbers]) -> Runs:
    translation, rotation, found, mass, seconds = np.array(rows).T
    return Runs(Errors(translation, rotation), found, mass, seconds)
