import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.exploration.guarded_moves import GuardedMoves
from tactopose_drake.core.grasping.finger_reach import ReachParams
from tactopose_drake.core.poses import exp_so3, make_poses
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.errors import InvalidInputError, UnknownNameError
from tactopose_drake.estimation.pose_hypothesis import PoseHypothesis
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.hand.hand_reach import make_hand_reach, rest_posture
from tactopose_drake.resources import model_path
from tactopose_drake.systems.next_touch_chooser import GuardedMove, NextTouchChooser, NextTouchParams

# A bust upright before the fingers, and the same the other way round.
MIDDLE = np.array([-0.03, -0.07, 0.07])


@pytest.fixture(scope="module")
def bust() -> ObjectModel:
    return ObjectModel.from_mesh(model_path("objects", "bust.obj"))


def poses() -> np.ndarray:
    upright = exp_so3(np.array([0.0, 0.5 * np.pi, 0.0]))
    turns = np.array([upright, upright @ exp_so3(np.array([0.0, 0.0, np.pi]))])
    return make_poses(turns, np.tile(MIDDLE, (2, 1)))


def estimate(*probabilities: float, sigma: float = 0.001, status: str = "ambiguous") -> PoseEstimate:
    covariance = np.diag([0.02**2] * 3 + [sigma**2] * 3)
    return PoseEstimate(
        tuple(
            PoseHypothesis(RigidTransform(X), 0.0, p, covariance, np.zeros((0, 6)))
            for X, p in zip(poses(), probabilities, strict=False)
        ),
        status,
        0.01,
    )


def choose(
    model: ObjectModel, hypotheses: PoseEstimate | None, params: NextTouchParams | None = None, **inputs: object
) -> tuple[GuardedMove | None, float, str]:
    plant, hand = make_hand_plant(load_hand_config("shadow_like"))
    system = NextTouchChooser(hand.config, model, params or NextTouchParams(moves=60))
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    values: dict[str, object] = {
        "hypotheses": hypotheses,
        "contacts": Contacts(np.tile(MIDDLE, (2, 1))),
        "fingers_in_contact": ("thumb", "first"),
        "joint_positions": rest_posture(plant, hand),
    }
    for name, value in (values | inputs).items():
        is_vector = isinstance(value, np.ndarray)
        system.GetInputPort(name).FixValue(context, value if is_vector else AbstractValue.Make(value))
    simulator.AdvanceTo(0.001)
    found, resolved, status = (
        system.GetOutputPort(name).Eval(context) for name in ("next_touch", "resolved", "status")
    )
    return found, float(resolved[0]), status


def test_it_chooses_a_free_finger_from_where_it_is(bust: ObjectModel) -> None:
    found, resolved, status = choose(bust, estimate(0.6, 0.4))
    assert status == "chosen"
    assert resolved == pytest.approx(0.6, abs=0.06)
    assert found is not None
    assert found.finger in ("middle", "ring", "little")
    assert 0.1 < found.information < found.entropy
    config = load_hand_config("shadow_like")
    assert found.joints == tuple(config.finger(found.finger).joints)
    plant, hand = make_hand_plant(config)
    geometry = make_hand_reach(config, ReachParams()).fingers[found.finger].geometry
    chain = geometry.chain
    assert np.all((found.q_goal >= chain.lower) & (found.q_goal <= chain.upper))
    # The two poses foresee another touch.
    move = GuardedMoves.of_finger(geometry, found.q_start, found.q_goal[None])
    felt = move.feel(bust, poses())
    assert felt.is_hit.any()
    assert felt.is_hit[0, 0] != felt.is_hit[1, 0] or abs(felt.way[0, 0] - felt.way[1, 0]) > 0.001
    assert len(rest_posture(plant, hand)) == plant.num_positions()


def test_a_finger_keeps_off_all_others_and_not_off_itself(bust: ObjectModel) -> None:
    config = load_hand_config("shadow_like")
    plant, hand = make_hand_plant(config)
    system, fingers = NextTouchChooser(config, bust, NextTouchParams()), make_hand_reach(config, ReachParams()).fingers
    q, start = rest_posture(plant, hand), {}
    for name in fingers:
        joints = [plant.GetJointByName(joint, hand.model_instance) for joint in config.finger(name).joints]
        start[name] = q[[joint.position_start() for joint in joints]]
    tips = {name: reach.geometry.tip(start[name][None])[0] for name, reach in fingers.items()}
    for name in fingers:
        rest = system._rest_of_hand(name, start)
        for other, tip in tips.items():
            is_there = np.linalg.norm(rest.p_PH - tip, axis=1).min() < 1e-3
            assert is_there == (other != name)


def test_chance_takes_another_motion_that_tells_less(bust: ObjectModel) -> None:
    best, _, _ = choose(bust, estimate(0.6, 0.4))
    other, _, status = choose(bust, estimate(0.6, 0.4), NextTouchParams(moves=60, rule="chance"))
    assert status == "chosen"
    assert best is not None
    assert other is not None
    assert other.information < best.information


def test_no_touch_is_needed_where_enough_of_the_belief_is_about_one_pose(bust: ObjectModel) -> None:
    found, resolved, status = choose(bust, estimate(0.98, 0.02, status="ok"))
    assert (found, status) == (None, "resolved")
    assert resolved > 0.95
    # One wide hypothesis does not pass for one pose.
    found, resolved, status = choose(bust, estimate(1.0, sigma=0.02, status="ok"))
    assert found is not None
    assert (resolved < 0.3, status) == (True, "chosen")


def test_what_is_wanting_is_said(bust: ObjectModel) -> None:
    assert choose(bust, None) == (None, 0.0, "held: no estimate yet")
    unexplained = estimate(0.6, 0.4, status="no_solution")
    assert choose(bust, unexplained) == (None, 0.0, "held: no pose explains the touch")
    for lost in (np.full(24, np.nan), np.append(np.zeros(23), 30.0)):
        assert choose(bust, estimate(0.6, 0.4), joint_positions=lost)[2] == "held: a joint position is not known"
    five = ("thumb", "first", "middle", "ring", "little")
    all_hold = choose(bust, estimate(0.6, 0.4), contacts=Contacts(np.tile(MIDDLE, (5, 1))), fingers_in_contact=five)
    assert all_hold[2] == "held: no motion is allowed"
    # While none is asked for, there is none.
    assert choose(bust, estimate(0.6, 0.4), deciding=np.zeros(1))[:2] == (None, 0.0)


@pytest.mark.parametrize("later", [None, estimate(0.6, 0.4, status="no_solution")])
def test_what_was_resolved_is_no_longer_without_an_estimate(bust: ObjectModel, later: PoseEstimate | None) -> None:
    config = load_hand_config("shadow_like")
    system = NextTouchChooser(config, bust, NextTouchParams(moves=60))
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    for hypotheses, until, is_resolved in ((estimate(0.98, 0.02, status="ok"), 0.05, True), (later, 0.15, False)):
        system.GetInputPort("hypotheses").FixValue(context, AbstractValue.Make(hypotheses))
        simulator.AdvanceTo(until)
        assert (system.GetOutputPort("resolved").Eval(context)[0] > 0.0) == is_resolved
        assert (system.GetOutputPort("status").Eval(context) == "resolved") == is_resolved


def test_bad_parameters_are_refused() -> None:
    with pytest.raises(UnknownNameError, match="rule"):
        NextTouchParams(rule="luck").validate()
    with pytest.raises(InvalidInputError, match="enough"):
        NextTouchParams(enough=1.2).validate()
    with pytest.raises(InvalidInputError, match="moves"):
        NextTouchParams(moves=0).validate()
    with pytest.raises(InvalidInputError, match=r"friction must be .*, not 1001"):
        NextTouchParams(friction=1001.0).validate()
