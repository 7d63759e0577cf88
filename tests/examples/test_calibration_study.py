import itertools
import re

import numpy as np
import pytest

from tactopose_drake.hand import load_hand_config, make_hand_plant
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
    medians = re.search(r"median ([0-9.]+) mm known, ([0-9.]+) mm calibrated, ([0-9.]+) mm at the bound", printed)
    assert medians is not None
    known, calibrated, at_bound = map(float, medians.groups())
    as_it_is = re.search(r"bound, ([0-9.]+) mm as it is", printed)
    assert as_it_is is not None
    assert known < float(as_it_is[1])
    assert at_bound < float(as_it_is[1])
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


def test_the_bound_falls_with_grasps_and_with_what_is_known_of_the_poses() -> None:
    hand = study.DrawnHand("shadow_like", np.random.default_rng(5), False)
    bottle = study.tp.ObjectModel.from_mesh(study.model_path("objects", "spray_bottle.obj"))
    grasps = hand.grasps({"spray_bottle": bottle}, 6)
    noise, free = (0.0003, np.radians(1.5)), hand.errors.free
    plant, parts = make_hand_plant(hand.config)

    def least(count: int, poses_known: bool) -> np.ndarray:
        covariance = study.least_covariance(
            plant, parts, hand.errors, hand.truth, grasps[:count], noise, poses_known=poses_known
        )
        return covariance[np.ix_(free, free)] / np.outer(hand.errors.sigma[free], hand.errors.sigma[free])

    bounds = [np.eye(len(free)), least(3, False), least(6, False), least(6, True)]
    for wider, narrower in itertools.pairwise(bounds):
        assert np.linalg.eigvalsh(wider - narrower).min() > -1e-9
    assert np.trace(bounds[-1]) < 0.9 * np.trace(bounds[2]) < 0.9 * np.trace(bounds[0])
