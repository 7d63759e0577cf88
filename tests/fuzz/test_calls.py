"""A short run of the fuzzer: no public call ends in anything but an answer or a TactoposeError."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import tactopose_drake as tp
from tests.fuzz.calls import TARGETS, hostile, plausible
from tests.fuzz.corruption import ARRAYS, SUBTLE, corrupt
from tests.fuzz.runner import make_call, run_here


@pytest.mark.parametrize(("kind", "calls"), [(plausible, 150), (hostile, 600)])
def test_no_call_ends_in_a_raw_error(kind: Callable[[np.random.Generator], None], calls: int) -> None:
    summary = run_here({kind.__name__: kind}, range(calls))
    assert not summary.findings, "\n".join(f"{found.command}\n{found.detail}" for found in summary.findings)
    counts = summary.counts[kind.__name__]
    assert counts["answered"] >= 0.8 * calls if kind is plausible else counts["refused"] >= 0.3 * calls


# The same seeds each time: what a change breaks shows here, what is rare in the long runs of `python -m tests.fuzz`.
@settings(max_examples=60, derandomize=True, database=None, suppress_health_check=[HealthCheck.too_slow])
@given(seed=st.integers(0, 2**63 - 1), kind=st.sampled_from([plausible, hostile]))
def test_nor_does_one_of_any_seed(seed: int, kind: Callable[[np.random.Generator], None]) -> None:
    outcome = make_call(kind.__name__, kind, seed, cpu_limit=60.0)
    assert outcome.result != "finding", f"{outcome.command}\n{outcome.detail}"


@given(seed=st.integers(0, 2**32 - 1), change=st.sampled_from([*ARRAYS, *SUBTLE]))
def test_spoilt_contacts_are_answered_or_refused(seed: int, change: Callable[..., object]) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform(-0.1, 0.1, (int(rng.integers(1, 5)), 3))
    with np.errstate(all="ignore"):
        spoilt = change(rng, points)
    try:
        contacts = tp.Contacts(spoilt)  # type: ignore[arg-type]
    except tp.TactoposeError:
        return
    assert np.isfinite(contacts.p_PC).all()
    assert contacts.p_PC.flags.c_contiguous
    assert contacts.p_PC.dtype == np.float64


def test_corruption_leaves_the_original_as_it_was() -> None:
    for target in TARGETS:
        rng = np.random.default_rng(5)
        given = target.arguments(rng)
        texts = repr(given)
        for _ in range(20):
            corrupt(rng, given)
        assert repr(given) == texts
