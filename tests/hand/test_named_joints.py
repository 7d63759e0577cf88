from pathlib import Path

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant

from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.hand.joint_matrices import joint_matrix
from tactopose_drake.hand.named_joints import NamedJoints, check_near_limits
from tests.hand.grippers import YAML, write_gripper

HANDS = ["shadow_like", "barrett_like"]


@pytest.mark.parametrize("name", HANDS)
def test_joints_come_into_the_plants_order_and_others_follow(name: str) -> None:
    plant, hand = make_hand_plant(load_hand_config(name))
    named = NamedJoints(plant, hand)
    followers = {coupling.joint for finger in hand.config.fingers for coupling in finger.couplings}
    measured = [joint for joint in named.names if joint not in followers]
    values = np.random.default_rng(0).normal(size=len(measured))
    by_name = dict(zip(measured, values.tolist(), strict=True))
    expected = joint_matrix(plant, hand, measured) @ values
    assert followers
    np.testing.assert_allclose(named.positions("joints", by_name), expected, atol=1e-15)
    np.testing.assert_allclose(named.velocities("joints", by_name), expected, atol=1e-15)
    for joint, place in zip(named.names, range(plant.num_positions()), strict=True):
        assert plant.GetJointByName(joint).position_start() == place


@pytest.mark.parametrize("name", HANDS)
def test_what_is_not_known_is_nan_with_what_follows_it(name: str) -> None:
    plant, hand = make_hand_plant(load_hand_config(name))
    named = NamedJoints(plant, hand)
    assert np.all(np.isnan(named.positions("joints", {})))
    coupling = next(coupling for finger in hand.config.fingers for coupling in finger.couplings)
    q = dict(zip(named.names, named.positions("joints", {coupling.follows: 0.5}), strict=True))
    assert {joint for joint, value in q.items() if np.isfinite(value)} >= {coupling.follows, coupling.joint}
    told = {coupling.follows: 0.5, coupling.joint: 0.123}
    q = dict(zip(named.names, named.positions("joints", told), strict=True))
    assert q[coupling.joint] == 0.123  # A joint that is measured does not follow.


def test_a_coupling_with_an_offset_shifts_positions_and_not_velocities() -> None:
    plant, hand = make_hand_plant(load_hand_config("shadow_like"))
    coupling = next(coupling for finger in hand.config.fingers for coupling in finger.couplings)
    plain = NamedJoints(plant, hand)
    coupling.offset = 0.2
    shifted = NamedJoints(plant, hand)
    leader = {coupling.follows: 0.5}
    place = plain.names.index(coupling.joint)
    expected = 0.5 * coupling.ratio
    assert plain.velocities("joints", leader)[place] == pytest.approx(expected)
    assert shifted.velocities("joints", leader)[place] == pytest.approx(expected)
    assert shifted.positions("joints", leader)[place] == pytest.approx(expected + 0.2)
    assert shifted.positions("joints", leader | {coupling.joint: 0.1})[place] == 0.1


def test_the_offset_of_a_coupling_that_fingers_share_counts_once(tmp_path: Path) -> None:
    coupled = "joints: [left_slide]\n  couplings: [{joint: right_slide, follows: left_slide, ratio: 0.5, offset: 0.01}]"
    yaml = YAML.replace("joints: [left_slide]", coupled).replace("joints: [right_slide]", coupled)
    plant, hand = make_hand_plant(load_hand_config(write_gripper(tmp_path, yaml=yaml)))
    np.testing.assert_allclose(NamedJoints(plant, hand).positions("joints", {"left_slide": 0.02}), [0.02, 0.02])


def test_mistakes_are_named() -> None:
    named = NamedJoints(*make_hand_plant(load_hand_config("shadow_like")))
    for values, message in (
        ({"elbow": 0.0}, "joints must be one of .*, not 'elbow'"),
        ({"FFJ3": "bent"}, r"joints\[FFJ3\] must be a number, not"),
        (np.zeros(3), r"joints must have the shape \(24,\), not \(3,\)"),
    ):
        with pytest.raises(InvalidInputError, match=message):
            named.positions("joints", values)


def test_positions_of_a_file_are_near_the_limits_of_their_joints(tmp_path: Path) -> None:
    plant, hand = make_hand_plant(load_hand_config("shadow_like"))
    low, high = (float(np.asarray(limits)[0]) for limits in _limits(plant, "FFJ2"))
    for near in (low - 0.4, high + 0.4, np.nan):
        check_near_limits("joints", {"FFJ2": near}, plant, hand)
    for far in (low - 0.6, high + 0.6, 60.5):
        with pytest.raises(
            InvalidInputError, match=r"joints\[FFJ2\] must be from .* rad, near the joint's limits, .*, not"
        ):
            check_near_limits("joints", {"FFJ2": far}, plant, hand)
        # What a running hand measures is taken as it is.
        assert far in NamedJoints(plant, hand).positions("joints", {"FFJ2": far})
    gripper, parts = make_hand_plant(load_hand_config(write_gripper(tmp_path)))
    with pytest.raises(InvalidInputError, match=r"joints\[left_slide\] must be from .* m, .* 0 and 0.045, not 20\."):
        check_near_limits("joints", {"left_slide": 20.0}, gripper, parts)


def test_coupled_joints_give_way_a_little_and_no_more(tmp_path: Path) -> None:
    named = NamedJoints(*make_hand_plant(load_hand_config("shadow_like")))
    for near in ({"FFJ2": 1.44}, {"FFJ2": 1.44, "FFJ1": 1.41}, {"FFJ1": 0.1}, {"FFJ2": np.nan, "FFJ1": 0.1}):
        named.check_couplings("joints", near)
    with pytest.raises(
        InvalidInputError, match=r"joints\[FFJ1\] must be .* 1.44 rad, by the coupling with FFJ2, not 0.1 rad"
    ):
        named.check_couplings("joints", {"FFJ2": 1.44, "FFJ1": 0.1})
    coupled = "joints: [left_slide]\n  couplings: [{joint: right_slide, follows: left_slide, ratio: 0.5}]"
    yaml = YAML.replace("joints: [left_slide]", coupled).replace("joints: [right_slide]", coupled)
    slides = NamedJoints(*make_hand_plant(load_hand_config(write_gripper(tmp_path, yaml=yaml))))
    slides.check_couplings("joints", {"left_slide": 0.02, "right_slide": 0.012})
    with pytest.raises(
        InvalidInputError, match=r"right_slide\] must be .* within 0.003 m of 0.01 m, by .* left_slide, not 0.02 m"
    ):
        slides.check_couplings("joints", {"left_slide": 0.02, "right_slide": 0.02})


def _limits(plant: MultibodyPlant, joint: str) -> tuple[np.ndarray, np.ndarray]:
    found = plant.GetJointByName(joint)
    return found.position_lower_limits(), found.position_upper_limits()
