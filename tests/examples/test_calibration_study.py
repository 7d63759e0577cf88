import dataclasses
import itertools
import re

import numpy as np
import pytest

from tactopose_drake.hand import FeltGrasps, load_hand_config, make_hand_plant
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
        turned = [named[f"{finger} mounting rotation {axis}"] for axis in "xyz"]
        np.testing.assert_allclose(np.radians(errors.mounting_deg), turned)


def test_what_the_simulated_hand_reads_fits_the_object_when_its_errors_are_taken_off(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    wrong = dataclasses.replace(study.DECLARED, mounting=0.0015, mounting_deg=4.0)
    monkeypatch.setattr(study, "DECLARED", wrong)
    hand = study.DrawnHand("shadow_like", np.random.default_rng(1), True)
    bottle = study.tp.ObjectModel.from_mesh(study.model_path("objects", "spray_bottle.obj"))
    grasps = hand.grasps({"spray_bottle": bottle}, 2)
    plant, parts = make_hand_plant(hand.config)
    felt = FeltGrasps(plant, parts, hand.errors, [grasp.recorded for grasp in grasps])
    off = {}
    for name, vector in (("known", hand.truth), ("as it is", np.zeros(len(hand.truth)))):
        touches = felt.touches(vector[hand.errors.free] / hand.errors.sigma[hand.errors.free])
        X_PO = np.array([grasp.X_PO for grasp in grasps])[touches.grasp]
        p_O = np.einsum("nji,nj->ni", X_PO[:, :, :3], touches.p_PC - X_PO[:, :, 3])
        distance, normal_O = bottle.grid.distance_and_normal(p_O)
        normal_P = np.einsum("nij,nj->ni", X_PO[:, :, :3], normal_O)
        angle = np.arccos(np.clip(np.sum(normal_P * touches.n_PC, axis=1), -1.0, 1.0))
        off[name] = np.median(np.abs(distance)), np.degrees(np.median(angle))
    assert len(felt.grasp) >= 6
    # Fingertips sink in by tenths of a millimetre, and what touches is no point.
    assert off["known"][0] < 0.0005
    assert off["known"][1] < 3.0
    assert off["as it is"][0] > 3.0 * off["known"][0]
    assert off["as it is"][1] > 2.0 * off["known"][1]


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
