"""Runs the experiments of section 4.3.1: four methods on the same trials of each cell, a number of fingers and a noise.

Two are `tp.estimate_pose` as it is called by default: from the contacts alone, and with the hand's volume. Two are the
thesis' search: of our likelihood (`method="monte_carlo"`), and of the thesis' own cost (`published_search.py`).

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016, section 4.3.1.
"""

import contextlib
import dataclasses
import itertools
import math
import signal
import time
from collections.abc import Iterator, Mapping, Sequence
from types import FrameType
from typing import NamedTuple

import numpy as np
from grasp_library import Array, SimulatedGrasp
from grasp_trials import Errors, Noise, Trial, make_trial, pose_errors
from published_search import search_as_published
from rich.console import Console
from rich.progress import Progress

import tactopose_drake as tp

# The thesis names the second and the third; its axis ticks are not in its text, so the steps are ours.
LEVELS = tuple(Noise(1e-3 * mm, math.radians(deg)) for mm, deg in ((0.45, 2.5), (0.9, 5), (1.8, 10), (2.7, 15)))
FINGER_COUNTS = (3, 4, 5)

OURS, WITH_HAND = "pair_search", "with hand"
SAME_COST, PUBLISHED = "monte_carlo", "as published"
OUR_METHODS, THESIS_METHODS = (OURS, WITH_HAND), (SAME_COST, PUBLISHED)
METHODS = (*OUR_METHODS, *THESIS_METHODS)


class Cell(NamedTuple):
    """The conditions of a group of trials."""

    fingers: int
    noise: Noise


CELLS = tuple(itertools.starmap(Cell, itertools.product(FINGER_COUNTS, LEVELS)))
MAIN_CELL = Cell(5, LEVELS[1])  # where the thesis gives numbers


@dataclasses.dataclass(frozen=True, kw_only=True)
class Experiment:
    """One of the two experiments, and what the thesis says of it.

    Attributes:
        name: of the files.
        title: of the table.
        object: the object that is held.
        guess: whether there is a displaced pose to correct.
        mean_translation, mean_rotation: the thesis' mean errors in the main cell, m and rad.
        seconds: the thesis' mean time there.
        success: the thesis' least share of successes by at least `success_fingers` fingers in noise up to the main
            cell's.
        success_fingers: see there.
        trials: how many the thesis made, over all of its cells.
    """

    name: str
    title: str
    object: str
    guess: bool
    mean_translation: float
    mean_rotation: float
    seconds: float
    success: float
    success_fingers: int
    trials: int


# [B16] section 4.3.1.1: "over 80% of the time as long as the sensor noise is below 1.8 mm and 10 deg and four fingers".
CORRECTION = Experiment(
    name="correction",
    title="Pose correction of the bust, 33.2 mm and 16° off (figures 4.8 to 4.10)",
    object="bust",
    guess=True,
    mean_translation=0.00405,
    mean_rotation=math.radians(5.0),
    seconds=0.64,
    success=0.80,
    success_fingers=4,
    trials=2978,
)
# [B16] section 4.3.1.2: "over 75% when using at least four fingers and a sensor noise below 0.9 mm and 5 deg".
GLOBAL = Experiment(
    name="global",
    title="Global pose estimation of the wine glass (figures 4.12 and 4.13)",
    object="wine_glass",
    guess=False,
    mean_translation=0.0071,
    mean_rotation=math.radians(3.72),
    seconds=63.0,
    success=0.75,
    success_fingers=4,
    trials=1329,
)


@dataclasses.dataclass(frozen=True, eq=False)
class Runs:
    """How one method did on the first n trials of a cell.

    Attributes:
        errors: of the most probable poses, shape (n,) each.
        found: whether a pose within the limits was among the hypotheses, shape (n,).
        mass: the hypotheses' probability of such a pose, shape (n,); NaN where they have none.
        seconds: CPU time, shape (n,).
    """

    errors: Errors
    found: Array
    mass: Array
    seconds: Array

    def first(self, count: int) -> "Runs":
        """Those of the first `count` trials."""
        errors = Errors(self.errors.translation[:count], self.errors.rotation[:count])
        return Runs(errors, self.found[:count], self.mass[:count], self.seconds[:count])

    def __len__(self) -> int:
        return len(self.seconds)


@dataclasses.dataclass(frozen=True, eq=False)
class Results:
    """All runs of an experiment.

    Attributes:
        experiment: which one.
        initial: errors of the displaced poses, shape (n,) each; empty where there are none.
        runs: by cell and method.
    """

    experiment: Experiment
    initial: Errors
    runs: Mapping[tuple[Cell, str], Runs]


def run_experiment(
    experiment: Experiment,
    model: tp.ObjectModel,
    grasps: Sequence[SimulatedGrasp],
    counts: Mapping[str, int],
    seed: int,
) -> Results:
    """Runs an experiment.

    An interrupt (Ctrl-C) lets the thesis' searches, which take hours, end with the grasp that they are at.

    Args:
        experiment: which one.
        model: of its object.
        grasps: of its object; each gives one trial to each cell.
        counts: how many of the trials of each cell each method runs on, unless interrupted.
        seed: of the noise, the displacements and the fingers that are left out.
    """

    def trial(i: int, cell: Cell) -> Trial:
        return make_trial(experiment.object, grasps[i], cell.fingers, cell.noise, (seed, i), experiment.guess)

    # The first calls compile, or load what is compiled. The thesis' search is only fast about a guess.
    rehearsal = make_trial(experiment.object, grasps[0], 5, LEVELS[0], (seed, 0), True)
    for method in (method for method, count in counts.items() if count):
        for tried in (trial(0, cell) for cell in CELLS) if method in OUR_METHODS else (rehearsal,):
            find_poses(model, tried, method)

    rows: dict[tuple[Cell, str], list[tuple[float, ...]]] = {}
    with Progress(console=Console(stderr=True), transient=True) as progress, noted_interrupts() as interrupts:
        task = progress.add_task(experiment.name, total=len(CELLS) * sum(counts.values()))
        for i in range(max(counts.values())):
            methods = [m for m, count in counts.items() if i < count and not (interrupts and m in THESIS_METHODS)]
            for cell, method in itertools.product(CELLS, methods):
                rows.setdefault((cell, method), []).append(run_trial(model, trial(i, cell), method))
                progress.advance(task)
    priors = [(trial(i, MAIN_CELL).prior, grasps[i].X_PO) for i in range(max(counts.values()))]
    initial = [pose_errors(model, prior.X_PO[None], X_PO) for prior, X_PO in priors if prior is not None]
    return Results(
        experiment,
        Errors(*(np.array([errors[part] for errors in initial]).ravel() for part in (0, 1))),
        {key: _gather(values) for key, values in rows.items()},
    )


@contextlib.contextmanager
def noted_interrupts() -> Iterator[list[int]]:
    """The interrupts since it was entered; a second one ends the program as usual."""
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


def find_poses(model: tp.ObjectModel, trial: Trial, method: str) -> tuple[Array, Array]:
    """Poses (B, 3, 4), best first, and their probabilities (B,), NaN where the method gives none."""
    if method == PUBLISHED:
        X_PO = search_as_published(model, trial)
        return X_PO, np.full(len(X_PO), np.nan)
    estimated = tp.estimate_pose(
        model,
        trial.contacts,
        prior=trial.prior,
        hand=trial.hand if method == WITH_HAND else None,
        method="monte_carlo" if method == SAME_COST else "pair_search",
    )
    hypotheses = estimated.hypotheses
    return np.stack([h.X_PO.GetAsMatrix34() for h in hypotheses]), np.array([h.probability for h in hypotheses])


def run_trial(model: tp.ObjectModel, trial: Trial, method: str) -> tuple[float, ...]:
    """Errors of the best pose, m and rad, whether a good one was found, with which probability, and the CPU time, s."""
    started = time.process_time()
    X_PO, probability = find_poses(model, trial, method)
    seconds = time.process_time() - started
    errors = pose_errors(model, X_PO, trial.X_PO)
    good = errors.success
    mass = math.nan if np.isnan(probability).any() else float(probability[good].sum())
    return errors.translation[0], errors.rotation[0], float(good.any()), mass, seconds


def _gather(rows: list[tuple[float, ...]]) -> Runs:
    translation, rotation, found, mass, seconds = np.array(rows).T
    return Runs(Errors(translation, rotation), found, mass, seconds)
