import re

import pytest

from tests.examples.scripts import load_script


def test_a_belief_follows_a_grasp_from_its_first_contact(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--objects", "bust", "--placements", "1", "--first-seed", "500"]
    monkeypatch.setattr("sys.argv", ["belief_study.py", *arguments])
    study = load_script("belief_study.py")
    monkeypatch.setattr(study, "DURATION", 1.2)  # s; the last finger touches after 0.25 s
    study.main()
    printed = " ".join(capsys.readouterr().out.split())
    cases = {}
    for case in ("all, with a prior", "all, without"):
        found = re.search(
            rf"{case}: the belief is right at ([0-9.]+)% of (\d+) instants .*? they give ([0-9.]+)% and ([0-9.]+)% to "
            r"poses that are; .*? wrong at ([0-9.]+)%",
            printed,
        )
        assert found is not None
        right, counted, by_belief, by_estimate, wrong = map(float, found.groups())
        assert counted > 10
        assert wrong < 2.0
        cases[case] = right, by_belief, by_estimate
    assert cases["all, with a prior"][0] > 95.0
    # Without it two poses are nearly as probable: one touch is never sure, and all of them together know no less.
    right, by_belief, by_estimate = cases["all, without"]
    assert right > 85.0
    assert by_belief > by_estimate
