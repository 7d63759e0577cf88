"""Equal numbers give equal estimates to the last bit, in any layout, thread and process."""

import multiprocessing
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest

from tests.fuzz.bits import LAYOUTS, arguments, bits, digest, laid_out
from tests.fuzz.runner import run_here

_SEEDS = range(20)


def digest_of(seed: int) -> bytes:
    return digest(arguments(np.random.default_rng(seed)))


def test_estimates_do_not_depend_on_the_layout_of_their_numbers() -> None:
    summary = run_here({"bits": bits}, range(12))
    assert not summary.findings, summary.findings
    assert summary.counts["bits"]["answered"] >= 9


@pytest.mark.parametrize("layout", sorted(LAYOUTS))
def test_a_layout_is_of_the_same_numbers(layout: str) -> None:
    given = arguments(np.random.default_rng(1))
    changed = laid_out(layout, given)["contacts"]["p_PC"]
    np.testing.assert_array_equal(np.asarray(changed, dtype=np.float64), given["contacts"]["p_PC"])
    assert changed is not given["contacts"]["p_PC"] or layout == "as it is"


def test_estimates_are_the_same_in_another_process() -> None:
    seeds = [seed for seed in _SEEDS if _is_answered(seed)]
    assert len(seeds) > 10
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as executor:
        assert list(executor.map(digest_of, seeds)) == [digest_of(seed) for seed in seeds]


def _is_answered(seed: int) -> bool:
    """Balance is refused for objects whose symmetries move their centre of mass."""
    return arguments(np.random.default_rng(seed))["balance"] is None
