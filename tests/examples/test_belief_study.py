import re

import pytest

from tests.examples.scripts import load_script


def test_a_belief_follows_a_grasp_from_its_first_contact(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--objects", "bust", "--placements", "1", "--first-seed", "500"]
    monkeypatch.setattr("sys.argv", ["belief_study.py", *arguments])
    load_script("belief_study.py").main()
    printed = " ".join(capsys.readouterr().out.split())
    for case in ("all, with a prior", "all, without"):
        found = re.search(
            rf"{case}: the belief is right at ([0-9.]+)% of (\d+) instants .*? wrong at ([0-9.]+)%", printed
        )
        assert found is not None
        right, counted, wrong = map(float, found.groups())
        assert counted > 10
        assert right > 95.0
        assert wrong < 2.0
