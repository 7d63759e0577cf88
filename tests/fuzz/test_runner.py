"""The fuzzer's runner, with calls whose outcome is known."""

import multiprocessing
import os
import time
import warnings

import numpy as np
import pytest

from tactopose_drake.errors import InvalidInputError
from tests.fuzz.runner import Outcome, make_call, run


def answers(rng: np.random.Generator) -> None:
    assert 0.0 <= rng.random() < 1.0


def refuses(rng: np.random.Generator) -> None:
    raise InvalidInputError("not so")


def divides(rng: np.random.Generator) -> None:
    raise ZeroDivisionError


def warns(rng: np.random.Generator) -> None:
    warnings.warn("careful", RuntimeWarning, stacklevel=1)


def works_long(rng: np.random.Generator) -> None:
    started = time.process_time()
    while time.process_time() - started < 0.05:
        pass


def hangs_in_between(rng: np.random.Generator) -> None:
    if rng.random() < 0.5:
        time.sleep(1000.0)


def dies_in_between(rng: np.random.Generator) -> None:
    if rng.random() < 0.5:
        os._exit(3)


@pytest.mark.parametrize(
    ("kind", "result"), [(answers, "answered"), (refuses, "refused"), (divides, "finding"), (warns, "finding")]
)
def test_a_call_is_answered_refused_or_a_finding(kind, result: str) -> None:
    assert make_call(kind.__name__, kind, 0).result == result


def test_a_call_that_takes_long_is_a_finding() -> None:
    assert "0.0" in make_call("works_long", works_long, 0, cpu_limit=0.01).detail
    assert make_call("works_long", works_long, 0).result == "answered"


def test_a_call_is_the_same_whatever_ran_before() -> None:
    drawn = []
    kind = lambda rng: drawn.append(rng.random())  # noqa: E731
    for seed in (3, 4, 3):
        make_call("kind", kind, seed)
    make_call("other", kind, 3)
    assert drawn[0] == drawn[2]
    assert len(set(drawn)) == 3


@pytest.mark.parametrize(("kind", "detail"), [(hangs_in_between, "not come back"), (dies_in_between, "exit code 3")])
def test_the_others_go_on_behind_a_call_that_does_not_come_back(kind, detail: str) -> None:
    found: list[Outcome] = []
    kinds = {"bad": kind, "good": answers}
    summary = run(kinds, seed=0, calls=4, minutes=None, jobs=2, report=found.append, wall_limit=3.0)
    assert summary.counts["good"] == {"answered": 4}
    assert summary.counts["bad"].total() == 4
    assert 0 < len(found) == summary.counts["bad"]["finding"] < 4
    assert all(detail in outcome.detail for outcome in found)


def test_no_call_is_begun_after_the_time() -> None:
    assert run({"good": answers}, seed=0, calls=None, minutes=0.0, jobs=1, report=print).counts == {}


def test_an_interrupt_keeps_what_was_found_until_then() -> None:
    def interrupt(finding: Outcome) -> None:
        raise KeyboardInterrupt

    summary = run({"bad": divides}, seed=0, calls=100_000, minutes=None, jobs=1, report=interrupt)
    assert len(summary.findings) == 1
    assert not multiprocessing.active_children()
