"""A short run of the kinds of hostile frames, faults of buses, and outputs; and that these see what they are to see."""

from pathlib import Path

import numpy as np
import pytest

from tactopose_drake.drivers.simulation import faults
from tests.fuzz import buses, outputs
from tests.fuzz.runner import Kind, make_call, run_here


@pytest.mark.parametrize(
    ("kind", "calls", "least"), [(buses.can_frames, 1, 1), (buses.bus_faults, 12, 12), (outputs.outputs, 200, 40)]
)
def test_nothing_is_found(kind: Kind, calls: int, least: int) -> None:
    summary = run_here({kind.__name__: kind}, range(calls))
    assert not summary.findings, "\n".join(f"{found.command}\n{found.detail}" for found in summary.findings)
    assert summary.counts[kind.__name__]["answered"] >= least


def test_a_wrong_number_is_a_finding(monkeypatch: pytest.MonkeyPatch) -> None:
    def lie(_: object, replies: list[faults.Reply]) -> list[faults.Reply]:
        for reply in replies:
            reply.frame.data = bytes(reply.frame.data[:-1]) + bytes([reply.frame.data[-1] ^ 0x40])
        return replies

    monkeypatch.setattr(faults, "duplicates", lie)
    results = {make_call("bus_faults", buses.bus_faults, seed).result for seed in range(20)}
    assert "finding" in results


def test_an_input_that_changes_is_a_finding(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outputs, "check_outputs", lambda given, inputs: None)
    results = {make_call("outputs", outputs.outputs, seed).result for seed in range(100)}
    assert "finding" in results


def test_what_is_left_beside_is_a_finding(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outputs, "check_outputs", lambda given, inputs: Path("stray").write_text("stray"))
    outcome = make_call("outputs", outputs.outputs, 0)
    assert "the check has changed something" in outcome.detail


def test_calls_are_the_same_each_time() -> None:
    first, again = (outputs._path(np.random.default_rng(3), Path("/top")) for _ in range(2))
    assert first == again
