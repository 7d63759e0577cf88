import re

import numpy as np
import pytest

from tactopose_drake.hand import load_hand_config
from tests.examples.scripts import load_script, share_script

study = load_script("calibration_study")


def test_a_hand_is_drawn_calibrated_and_tried(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--grasps", "6", "--trials", "1", "--others", "bust"]
    monkeypatch.setattr("sys.argv", ["calibration_study.py", *options])
    study.main()
    printed = " ".join(capsys.readouterr().out.split())
    assert "1 hands, 6 grasps of spray_bottle each" in printed
    medians = re.search(r"median ([0-9.]+) mm known, ([0-9.]+) mm calibrated, ([0-9.]+) mm as it is", printed)
    assert medians is not None
    known, calibrated, as_it_is = map(float, medians.groups())
    assert known < as_it_is
    assert calibrated < 50.0
    inside = re.search(r"([0-9.]+)% of 83 errors in their own 95 % intervals", printed)
    assert inside is not None
    assert float(inside[1]) > 60.0


def test_the_simulated_hand_has_the_errors_that_are_to_be_found() -> None:
    hand = study.DrawnHand("shadow_like", np.random.default_rng(3), True)
    simulated = share_script("simulated_grasps").as_simulated(hand.errors, hand.truth)
    simulated.validate(load_hand_config("shadow_like"))
    named = dict(zip(hand.errors.names, hand.truth, strict=True))
    for joint, offset in simulated.joint_offsets_deg.items():
        assert offset == pytest.approx(np.degrees(named[f"{joint} offset"]))
    for finger, errors in simulated.fingers.items():
        assert errors.radius == named[f"{finger} radius"]
        assert errors.sensor_force == [named[f"{finger} force bias {axis}"] for axis in "xyz"]
        assert errors.sensor_moment == [named[f"{finger} moment bias {axis}"] for axis in "xyz"]
        assert errors.mounting == [named[f"{finger} mounting translation {axis}"] for axis in "xyz"]
        # What the simulator cannot have is not there.
        assert [named[f"{finger} mounting rotation {axis}"] for axis in "xyz"] == [0.0, 0.0, 0.0]
