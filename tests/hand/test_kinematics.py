import copy

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.multibody.plant import MultibodyPlant

from tactopose_drake.hand.geometry import BodySpheres
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import Hand, make_hand_plant
from tactopose_drake.hand.kinematics import HandKinematics

CONFIG = load_hand_config("shadow_like")


@pytest.fixture(scope="module")
def parts() -> tuple[MultibodyPlant, Hand]:
    return make_hand_plant(CONFIG)


def test_poses_are_those_of_the_plant(parts: tuple[MultibodyPlant, Hand]) -> None:
    plant, hand = parts
    kinematics, context = HandKinematics(plant, hand.palm_frame), plant.CreateDefaultContext()
    for q in 0.4 * np.random.default_rng(0).random((2, plant.num_positions())):
        kinematics.move(q)
        plant.SetPositions(context, q)
        poses = kinematics.poses(hand.sensor_frames)
        assert set(poses) == set(hand.sensor_frames)
        for finger, frame in hand.sensor_frames.items():
            X_PS = plant.CalcRelativeTransform(context, hand.palm_frame, frame)
            np.testing.assert_array_equal(poses[finger].GetAsMatrix34(), X_PS.GetAsMatrix34())


def test_a_joint_that_is_not_known_hides_what_it_moves_alone(parts: tuple[MultibodyPlant, Hand]) -> None:
    plant, hand = parts
    kinematics, q = HandKinematics(plant, hand.palm_frame), np.full(plant.num_positions(), 0.1)
    moved = hand.fingers[1]
    q[plant.GetJointByName(hand.config.finger(moved).joints[-1]).position_start()] = np.nan
    kinematics.move(q)
    assert set(kinematics.poses(hand.sensor_frames)) == set(hand.sensor_frames) - {moved}
    bodies = {finger: int(frame.body().index()) for finger, frame in hand.sensor_frames.items()}
    known = kinematics.is_known(np.array(list(bodies.values())))
    assert [finger for finger, is_known in zip(bodies, known, strict=True) if not is_known] == [moved]
    assert np.all(np.isfinite(kinematics.positions(BodySpheres.of_hand(CONFIG))))


def test_spheres_go_where_their_links_go(parts: tuple[MultibodyPlant, Hand]) -> None:
    plant, hand = parts
    kinematics, spheres = HandKinematics(plant, hand.palm_frame), BodySpheres.of_hand(CONFIG)
    kinematics.move(np.full(plant.num_positions(), 0.3))
    frames = {str(index): plant.get_body(index).body_frame() for index in plant.GetBodyIndices(hand.model_instance)}
    X_PB = {int(frames[name].body().index()): X for name, X in kinematics.poses(frames).items()}
    expected = [X_PB[body] @ p_BH for body, p_BH in zip(spheres.body, spheres.p_BH, strict=True)]
    np.testing.assert_allclose(kinematics.positions(spheres), expected, atol=1e-12)


@pytest.mark.parametrize("again", [copy.deepcopy, lambda value: AbstractValue.Make(value).Clone().get_value()])
def test_a_copy_moves_by_itself(parts: tuple[MultibodyPlant, Hand], again) -> None:  # type: ignore[no-untyped-def]
    plant, hand = parts
    kinematics = HandKinematics(plant, hand.palm_frame)
    kinematics.move(np.full(plant.num_positions(), 0.1))
    before = kinematics.poses(hand.sensor_frames)
    copied = again(kinematics)
    copied.move(np.full(plant.num_positions(), 0.5))
    for finger, X_PS in kinematics.poses(hand.sensor_frames).items():
        assert X_PS.IsExactlyEqualTo(before[finger])
        assert not copied.poses(hand.sensor_frames)[finger].IsNearlyEqualTo(X_PS, 1e-3)


@pytest.mark.parametrize("reading", [30.0, -30.0, np.inf])
def test_a_reading_far_beyond_its_joints_limits_is_not_known_and_named(
    parts: tuple[MultibodyPlant, Hand], reading: float
) -> None:
    plant, hand = parts
    kinematics, q = HandKinematics(plant, hand.palm_frame), np.full(plant.num_positions(), 0.1)
    moved = hand.fingers[1]
    joint = plant.GetJointByName(hand.config.finger(moved).joints[-1])
    q[joint.position_start()] = joint.position_upper_limits()[0] + 0.4
    kinematics.move_to_readings(q)
    assert kinematics.knows_all
    q[joint.position_start()] = reading
    kinematics.move_to_readings(q)
    assert not kinematics.knows_all
    assert set(kinematics.poses(hand.sensor_frames)) == set(hand.sensor_frames) - {moved}
    fault = kinematics.fault(hand.sensor_frames[moved])
    assert fault.startswith(f"joint {joint.name()} reads {reading:g} rad, not from ")
    kinematics.move(q)  # What is no reading may be anywhere, but not at infinity.
    assert kinematics.knows_all == np.isfinite(reading)
    q[joint.position_start()] = np.nan
    kinematics.move_to_readings(q)
    assert kinematics.fault(hand.sensor_frames[moved]) == "a joint position is not known"
