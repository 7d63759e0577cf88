import os

import pytest

from tests.examples.scripts import load_script

pytest.importorskip("lcm")


def test_all_that_is_sent_is_received_and_a_new_sender_is_said() -> None:
    lcm_latency = load_script("lcm_latency")
    url = f"udpm://239.255.76.67:{20000 + os.getpid() % 20000}?ttl=0"
    report = lcm_latency.measure(4.0, 100.0, url, {"sender": 1.0})
    assert report.sent > 50
    assert report.received == report.sent
    assert report.lost == 0
    assert len(report.latency) == report.received - report.passed_over
    assert {"no senses for", "began anew"} <= set(report.said)
