import re

import pytest

from tests.examples.scripts import load_script


def test_a_hand_feels_on_until_it_knows(capsys: pytest.CaptureFixture[str]) -> None:
    load_script("feel_on.py")
    printed = capsys.readouterr().out
    end = re.search(r"(\d+) touches, (\d+)% of the belief about one pose, ([\d.]+) mm from the truth", printed)
    assert end is not None
    assert int(end[2]) >= 95
    assert float(end[3]) < 10.0
    assert len(re.findall(r"s: \w+ moves, for [\d.]+ of [\d.]+ nats", printed)) >= int(end[1])
