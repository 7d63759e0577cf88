"""Grasps made up by kinematics alone."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand import (
    ClosedGraspParams,
    GraspCloser,
    HandErrors,
    HandUncertainty,
    load_hand_config,
    make_hand_plant,
)
from tests.hand.grippers import write_bending_gripper, write_gripper


def test_a_hand_closes_one_of_whose_joints_cannot_be_at_zero(tmp_path: Path) -> None:
    path = write_bending_gripper(tmp_path, 3)
    model = tmp_path / "bending.urdf"
    model.write_text(model.read_text().replace('lower="-0.6"', 'lower="0.2"', 1))
    grip = {"grip_low": [-0.01, -0.01, 0.08], "grip_high": [0.01, 0.01, 0.1]}
    plant, hand = make_hand_plant(dataclasses.replace(load_hand_config(path), **grip))
    errors = HandErrors.of(plant, hand, HandUncertainty())
    none, params = np.zeros(len(errors.sigma)), ClosedGraspParams(least_fingers=2)
    closer = GraspCloser(plant, hand, errors, none, params)
    cylinder = ObjectModel.from_cylinder(0.02, 0.1)
    for seed in range(4):
        recorded = closer.grasp(cylinder, np.random.default_rng(seed)).recorded
        assert len(recorded.wrenches) >= 2
        still = [finger for finger in ("f0", "f1", "f2") if finger not in recorded.wrenches]
        at = {finger: [recorded.joint_positions[f"{finger}_j{joint}"] for joint in (0, 1)] for finger in hand.fingers}
        assert at["f0"][0] >= 0.2
        for finger in still:
            assert at[finger] == ([0.2, 0.0] if finger == "f0" else [0.0, 0.0])


@pytest.mark.parametrize("slides", [True, False])
def test_readings_scatter_by_degrees_and_of_what_slides_by_as_many_millimetres(slides: bool, tmp_path: Path) -> None:
    path = write_gripper(tmp_path) if slides else write_bending_gripper(tmp_path, 2)
    grip = {"grip_low": [-0.01, -0.01, 0.08], "grip_high": [0.01, 0.01, 0.1]}
    plant, hand = make_hand_plant(dataclasses.replace(load_hand_config(path), **grip))
    errors, ball = HandErrors.of(plant, hand, HandUncertainty()), ObjectModel.from_sphere(0.03)
    readings = []
    for noise in (0.0, 0.2):
        params = ClosedGraspParams(least_fingers=1, noise_joint_deg=noise)
        closer = GraspCloser(plant, hand, errors, np.zeros(len(errors.sigma)), params)
        grasps = [closer.grasp(ball, np.random.default_rng(seed)) for seed in range(30)]
        readings.append([[grasp.recorded.joint_positions[joint] for joint in errors.joints] for grasp in grasps])
    off = np.subtract(*readings[::-1])
    assert np.sqrt(np.mean(off**2)) == pytest.approx(2e-4 if slides else np.radians(0.2), rel=0.35)


def test_impossible_numbers_are_named_before_a_grasp_is_made_of_them(tmp_path: Path) -> None:
    grip = {"grip_low": [-0.01, -0.01, 0.08], "grip_high": [0.01, 0.01, 0.1]}
    plant, hand = make_hand_plant(dataclasses.replace(load_hand_config(write_gripper(tmp_path)), **grip))
    errors = HandErrors.of(plant, hand, HandUncertainty())
    none = np.zeros(len(errors.sigma))
    for told, params in {
        "least_fingers must be an integer >= 1, not 0": ClosedGraspParams(least_fingers=0),
        "least_force must be a number > 0, not -1": ClosedGraspParams(least_force=-1.0),
        "most_force must be at least least_force, 3 N, not 2.5": ClosedGraspParams(least_force=3.0),
        "friction must be a number >= 0, not -0.4": ClosedGraspParams(friction=-0.4),
        "noise_moment must be a finite number, not nan": ClosedGraspParams(noise_moment=np.nan),
    }.items():
        with pytest.raises(InvalidInputError, match=rf"ClosedGraspParams\.{told}"):
            GraspCloser(plant, hand, errors, none, params)
    with pytest.raises(InvalidInputError, match=r"vector must have the shape"):
        GraspCloser(plant, hand, errors, np.zeros(len(errors.sigma) + 1))
    closer = GraspCloser(plant, hand, errors, none, ClosedGraspParams(least_fingers=1))
    with pytest.raises(InvalidInputError, match=r"time must be a finite number, not nan"):
        closer.grasp(ObjectModel.from_sphere(0.03), np.random.default_rng(0), np.nan)
