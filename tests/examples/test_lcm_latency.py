import os

import pytest

from tactopose_drake.systems.signals import Signal
from tests import held_cube
from tests.examples.scripts import load_script

pytest.importorskip("lcm")


def test_all_that_is_sent_is_accounted_for_and_a_new_sender_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    lcm_latency = load_script("lcm_latency")
    felt = {"joint_positions": Signal.constant(held_cube.Q), "prior": Signal.constant(held_cube.prior())}
    felt |= {f"wrench_{finger}": Signal.constant(F_S) for finger, F_S in held_cube.WRENCHES.items()}
    monkeypatch.setattr(lcm_latency, "rehearse", lambda scenario, model: felt)
    url = f"udpm://239.255.76.67:{20000 + os.getpid() % 20000}?ttl=0"
    report = lcm_latency.measure(4.0, 100.0, url, {"sender": 1.0})
    assert report.sent > 50
    # The operating system may drop datagrams of a process that does not get to run; what never came is said.
    assert report.received + report.lost == report.sent
    assert len(report.latency) == report.received - report.passed_over
    assert {"no senses for", "began anew"} <= set(report.said)
