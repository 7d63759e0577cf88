"""What the benchmarks share: the scripts of examples/, and the clock."""

import importlib
import statistics
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import ModuleType
from typing import TypeVar

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"

Trial = TypeVar("Trial")


def load(name: str) -> ModuleType:
    """A script's module, of examples/ or examples/thesis/, by its name."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(EXAMPLES))
        patch.syspath_prepend(str(EXAMPLES / "thesis"))
        return importlib.import_module(name)


def median_seconds(solve: Callable[[Trial], object], trials: Sequence[Trial]) -> float:
    """Of CPU time, after a first call that compiles."""
    durations = []
    for trial in (trials[0], *trials):
        started = time.process_time()
        solve(trial)
        durations.append(time.process_time() - started)
    return statistics.median(durations[1:])
