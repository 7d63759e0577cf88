import numpy as np
import pytest

from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.hand.joint_matrices import joint_matrix
from tactopose_drake.hand.named_joints import NamedJoints

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


def test_mistakes_are_named() -> None:
    named = NamedJoints(*make_hand_plant(load_hand_config("shadow_like")))
    for values, message in (
        ({"elbow": 0.0}, "joints: 'elbow' is unknown; valid names: "),
        ({"FFJ3": "bent"}, r"joints\[FFJ3\]: not an array of numbers"),
        (np.zeros(3), r"joints: has shape \(3,\); allowed is \(24,\)"),
    ):
        with pytest.raises(InvalidInputError, match=message):
            named.positions("joints", values)
