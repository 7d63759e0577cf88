"""Where the time of an estimate from five contacts goes, near a prior and without one: by stage and by kernel.

A kernel's time is split by least squares into a part per call and a part per evaluation of a pose. The latter, times
the counted evaluations, is what remains if nothing is lost between the kernels and their batches are large: a bound for
this search and these samples on one core.
"""

import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import pytest
from numba.core.registry import CPUDispatcher
from numpy.typing import NDArray
from scipy.optimize import nnls

import tactopose_drake as tp
from tactopose_drake.core.compilation import Kernel, _OfTuples
from tactopose_drake.core.posterior import importance_sampling
from tactopose_drake.estimation import inference
from tactopose_drake.resources import model_path
from tests.benchmarks.test_estimation import OBJECTS, make_trials

TRIALS, REPEATS = 20, 5
STAGES = {
    "state the problem": [(inference, "make_problem")],
    "search for minima": [(inference, "_search")],
    "tell modes apart": [(inference, "_modes_of")],
    "cover modes": [(importance_sampling, "begin_sampling")],
    "join modes": [(importance_sampling, "join_modes")],
    "sample": [(importance_sampling, name) for name in ("_first_round", "minima_between", "_next_round")],
    "take moments": [(importance_sampling, name) for name in ("_as_sampled", "widen_by_doubt")],
    "judge contacts": [(inference, "_judge")],
}
EVALUATIONS: dict[str, Callable[..., int]] = {
    "descend": lambda *given: int(np.sum(given[8].iterations + 1)),
    "densities": lambda discs, measured, X, density: len(X),
    "judge": lambda *given: len(given[5]),
    "contact_costs": lambda grid, touch, prior, X, cost: len(X),
    "keep_best": lambda samples, matched, *_: int(np.diff(matched.begins) @ matched.spins),
    "add_densities": lambda components, freedom, power, u, volume, density: u.shape[0] * u.shape[1],
}
"""How many poses, or for `add_densities` increments, a kernel evaluates for these arguments."""


class Call(NamedTuple):
    """One call of a kernel: in which stage, how many poses were evaluated, and how long it took, s."""

    stage: str
    kernel: str
    evaluations: int
    seconds: float


class Clock:
    """Times the stages and all kernels of one pass over the trials."""

    def __init__(self) -> None:
        self.calls: list[Call] = []
        self.stages: list[tuple[str, float]] = []
        self._stage = "between"

    def stage(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """The function, timed as a stage."""

        def timed(*args: Any) -> Any:
            outer, self._stage = self._stage, name
            started = time.process_time()
            result = function(*args)
            self.stages.append((name, time.process_time() - started))
            self._stage = outer
            return result

        return timed

    def kernel(self, call: Callable[..., Any]) -> Callable[..., Any]:
        """A kernel's call, timed."""

        def timed(kernel: Kernel, *args: Any) -> Any:
            started = time.process_time()
            result = call(kernel, *args)
            seconds, name = time.process_time() - started, kernel.py_func.__name__
            count = EVALUATIONS[name](*args) if name in EVALUATIONS else 0
            self.calls.append(Call(self._stage, name, count, seconds))
            return result

        return timed


def watch(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    """Times the stages and kernels from now on. Kernels must be ready: at its first call one calls itself again."""
    for name, functions in STAGES.items():
        for module, function in functions:
            monkeypatch.setattr(module, function, clock.stage(name, getattr(module, function)))
    monkeypatch.setattr(_OfTuples, "__call__", clock.kernel(_OfTuples.__call__))
    monkeypatch.setattr(Kernel, "__call__", clock.kernel(CPUDispatcher.__call__))


@pytest.mark.parametrize("is_near", [True, False], ids=["with a prior", "without"])
def test_stages(monkeypatch: pytest.MonkeyPatch, is_near: bool) -> None:
    """Each pass makes the same calls: the fastest of all passes counts, of each call, stage and estimate."""
    trials = []
    for name in OBJECTS:
        model = tp.ObjectModel.from_mesh(model_path("objects", f"{name}.obj"))
        trials += [(model, contacts, prior if is_near else None) for contacts, prior, _ in make_trials(model)[:TRIALS]]

    def estimate_all() -> list[float]:
        seconds = []
        for model, contacts, prior in trials:
            started = time.process_time()
            tp.estimate_pose(model, contacts, prior=prior)
            seconds.append(time.process_time() - started)
        return seconds

    whole = np.min([estimate_all() for _ in range(1 + REPEATS)], axis=0).sum()
    clock, passes = Clock(), []
    watch(clock, monkeypatch)
    for _ in range(REPEATS):
        clock.calls, clock.stages = [], []
        estimate_all()
        passes.append(([seconds for _, seconds in clock.stages], [call.seconds for call in clock.calls]))
    in_stages, in_calls = (np.min(times, axis=0) for times in zip(*passes, strict=True))
    calls = [call._replace(seconds=s) for call, s in zip(clock.calls, in_calls, strict=True)]
    show_stages(dict(by_name([name for name, _ in clock.stages], in_stages)), calls, len(trials), float(whole))
    show_kernels(calls, len(trials))


def by_name(names: list[str], seconds: NDArray[np.float64]) -> Iterator[tuple[str, float]]:
    """The sums of equally named times, the largest first."""
    sums = {name: float(sum(s for other, s in zip(names, seconds, strict=True) if other == name)) for name in names}
    yield from sorted(sums.items(), key=lambda item: -item[1])


def show_stages(stages: dict[str, float], calls: list[Call], count: int, whole: float) -> None:
    print(f"\n\n{'stage':24}{'ms':>8}{'compiled':>10}{'calls':>8}{'evaluations':>13}")  # noqa: T201
    for name, seconds in {**stages, "between": whole - sum(stages.values())}.items():
        own = [call for call in calls if call.stage == name]
        compiled, evaluations = sum(call.seconds for call in own), sum(call.evaluations for call in own)
        numbers = 1e3 * seconds / count, compiled / seconds, len(own) / count, evaluations / count
        print(f"{name:24}{numbers[0]:8.2f}{numbers[1]:10.0%}{numbers[2]:8.1f}{numbers[3]:13.0f}")  # noqa: T201


def show_kernels(calls: list[Call], count: int) -> None:
    print(f"\n{'kernel':24}{'ms':>8}{'us a call':>10}{'calls':>8}{'evaluations':>13}{'ns each':>9}")  # noqa: T201
    bound = 0.0
    for name, seconds in by_name([call.kernel for call in calls], np.array([call.seconds for call in calls])):
        own = [call for call in calls if call.kernel == name]
        columns = np.array([[1.0, call.evaluations] for call in own])
        per_call, per_evaluation = nnls(columns, np.array([call.seconds for call in own]))[0]
        evaluations = columns[:, 1].sum()
        bound += per_evaluation * evaluations / count
        numbers = 1e3 * seconds / count, 1e6 * per_call, len(own) / count, evaluations / count, 1e9 * per_evaluation
        print("{:24}{:8.2f}{:10.1f}{:8.1f}{:13.0f}{:9.0f}".format(name, *numbers))  # noqa: T201
    print(f"\nevaluations alone, in large batches: {1e3 * bound:.2f} ms an estimate")  # noqa: T201
