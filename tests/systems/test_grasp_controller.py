import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from tactopose_drake.core.grasping.grasp_law import ClosingMotion, GraspLaw
from tactopose_drake.core.grasping.serial_chain import SLIDING_ARM
from tactopose_drake.errors import InvalidInputError, UnknownNameError
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.hand.hand_joints import HandJoints
from tactopose_drake.systems.grasp_controller import GraspController, GraspControllerParams
from tests.hand.grippers import write_gripper

SET_FORCE = 2.0
PARAMS = GraspControllerParams(closing_time=1.0)


@pytest.fixture(scope="module")
def hand_plant():
    return make_hand_plant(load_hand_config("shadow_like"))


def motion(joints: int) -> ClosingMotion:
    return ClosingMotion(np.full(joints, 0.1), np.full(joints, 0.5), np.full(joints, 0.02), SET_FORCE)


class Bench:
    """The controller alone, with a hand that stands still and forces that a test sets."""

    def __init__(self, hand_plant, params: GraspControllerParams = PARAMS) -> None:
        self.plant, self.hand = hand_plant
        motions = {"first": motion(3), "thumb": motion(5)}
        self.controller = GraspController(self.plant, self.hand, motions, np.zeros(24), params)
        self.simulator = Simulator(self.controller)
        self.context = self.simulator.get_mutable_context()
        self.state = np.zeros(48)
        self.set_forces(0.0, 0.0)
        self.set_state(self.state)

    def set_state(self, state: np.ndarray) -> None:
        self.controller.GetInputPort("hand_state").FixValue(self.context, state)

    def set_forces(self, first: float, thumb: float) -> None:
        for finger, force in (("first", first), ("thumb", thumb)):
            wrench = np.array([0.01, 0, 0, 0, 0.6 * force, 0.8 * force])
            self.controller.GetInputPort(f"wrench_{finger}").FixValue(self.context, wrench)

    def run(self, duration: float) -> None:
        self.simulator.AdvanceTo(self.context.get_time() + duration)

    def torque(self, joint: str) -> float:
        torques = self.controller.GetOutputPort("actuation").Eval(self.context)
        return float(torques[HandJoints.of(self.plant, self.hand).actuated.index(joint)])

    def holding(self) -> bool:
        return bool(self.controller.GetOutputPort("holding").Eval(self.context)[0])

    def status(self) -> str:
        return str(self.controller.GetOutputPort("status").Eval(self.context))


def position(plant, joint: str) -> int:
    return plant.GetJointByName(joint).position_start()


def test_starts_open(hand_plant):
    bench = Bench(hand_plant)
    assert bench.torque("FFJ3") == pytest.approx(PARAMS.finger_stiffness * 0.1)
    assert bench.torque("MFJ3") == 0.0
    assert bench.status() == "closing"


def test_closes_while_nothing_is_felt_and_gives_up_in_time(hand_plant):
    bench = Bench(hand_plant)
    bench.run(0.9)
    # Past the posture of touch by now.
    assert bench.torque("FFJ3") > PARAMS.finger_stiffness * 0.5
    assert not bench.holding()
    bench.run(0.2)
    assert bench.holding()
    assert bench.status() == "holding; not carrying: first, thumb"


def test_the_time_to_close_counts_from_when_it_begins(hand_plant):
    bench = Bench(hand_plant)
    bench.context.SetTime(50.0)
    bench.run(0.9)
    assert not bench.holding()
    bench.run(0.2)
    assert bench.holding()


@pytest.mark.parametrize("force", [0.0, SET_FORCE])
def test_a_clock_that_goes_back_begins_the_times_anew(hand_plant, force):
    bench = Bench(hand_plant)
    bench.context.SetTime(50.0)
    bench.set_forces(force, force)
    bench.run(0.5 * PARAMS.settle_time)
    bench.context.SetTime(0.0)
    bench.simulator.Initialize()
    longest = PARAMS.settle_time if force else PARAMS.closing_time
    bench.run(longest - 2 * PARAMS.period)
    assert not bench.holding()
    bench.run(4 * PARAMS.period)
    assert bench.holding()
    bench.context.SetTime(-1.0)
    bench.simulator.Initialize()
    bench.run(PARAMS.period)
    assert bench.holding()


def test_holds_once_all_fingers_carry_their_force(hand_plant):
    bench = Bench(hand_plant)
    bench.set_forces(SET_FORCE, 0.0)
    bench.run(0.2)
    assert not bench.holding()
    bench.set_forces(SET_FORCE, SET_FORCE)
    bench.run(0.5 * PARAMS.settle_time)
    assert not bench.holding()
    bench.run(PARAMS.settle_time)
    assert bench.holding()
    assert bench.status() == "holding"


def test_a_force_that_comes_and_goes_does_not_count(hand_plant):
    bench = Bench(hand_plant)
    for _ in range(6):
        bench.set_forces(SET_FORCE, SET_FORCE)
        bench.run(0.6 * PARAMS.settle_time)
        bench.set_forces(SET_FORCE, 0.0)
        bench.run(0.02)
    assert not bench.holding()


def test_opens_when_it_is_told_to_and_closes_again(hand_plant):
    bench = Bench(hand_plant)
    bench.set_forces(SET_FORCE, SET_FORCE)
    bench.run(0.2)
    assert bench.holding()
    bench.controller.GetInputPort("open").FixValue(bench.context, [1.0])
    bench.run(1.2)
    assert not bench.holding()
    assert bench.status() == "closing"
    assert bench.torque("FFJ3") == pytest.approx(PARAMS.finger_stiffness * 0.1)
    bench.controller.GetInputPort("open").FixValue(bench.context, [0.0])
    bench.set_forces(0.0, 0.0)
    bench.run(0.9)  # the time to close counts from here
    assert not bench.holding()
    assert bench.torque("FFJ3") > PARAMS.finger_stiffness * 0.5
    bench.run(0.2)
    assert bench.holding()


def test_no_reading_counts_as_no_force(hand_plant):
    bench = Bench(hand_plant)
    bench.set_forces(np.nan, np.nan)
    bench.run(0.3)
    assert np.isfinite(bench.torque("FFJ3"))
    assert not bench.holding()


def test_no_reading_leaves_the_squeeze_as_it_is_while_the_hand_holds(hand_plant):
    bench = Bench(hand_plant)
    bench.set_forces(SET_FORCE, SET_FORCE)
    bench.run(0.2)
    assert bench.holding()
    torque = bench.torque("FFJ3")
    bench.set_forces(np.nan, SET_FORCE)
    bench.run(1.0)
    assert bench.torque("FFJ3") == torque
    assert bench.status() == "holding; not carrying: first"


def test_torques_follow_joint_positions_and_velocities(hand_plant):
    bench = Bench(hand_plant)
    before = bench.torque("THJ4")
    state = np.zeros(48)
    state[position(bench.plant, "THJ4")] = 0.05
    state[24 + position(bench.plant, "THJ4")] = 2.0
    bench.set_state(state)
    change = -PARAMS.finger_stiffness * 0.05 - PARAMS.finger_damping * 2.0
    assert bench.torque("THJ4") - before == pytest.approx(change)


def test_the_wrist_is_held_stiffly(hand_plant):
    bench = Bench(hand_plant)
    state = np.zeros(48)
    state[position(bench.plant, "WRJ1")] = 0.01
    bench.set_state(state)
    assert bench.torque("WRJ1") == pytest.approx(-PARAMS.other_stiffness * 0.01)


def test_the_fingers_open_as_quickly_as_they_close(hand_plant):
    bench = Bench(hand_plant)
    bench.run(0.9)
    before = bench.torque("FFJ3")
    bench.controller.GetInputPort("open").FixValue(bench.context, [1.0])
    bench.run(12 * PARAMS.period)
    change = 12 * PARAMS.period * GraspLaw().push_rate * 0.02  # of the commanded position
    assert before - bench.torque("FFJ3") == pytest.approx(PARAMS.finger_stiffness * change)


def test_a_finger_is_called_slack_below_its_share_of_the_set_force(hand_plant):
    bench = Bench(hand_plant)
    bench.set_forces(SET_FORCE, SET_FORCE)
    bench.run(0.2)
    slack = GraspLaw().slack_share * SET_FORCE
    bench.set_forces(0.99 * slack, 1.01 * slack)
    assert bench.status() == "holding; not carrying: first"


def test_joints_that_slide_have_the_springs_of_ones_that_turn_on_an_arm(tmp_path):
    plant, hand = make_hand_plant(load_hand_config(write_gripper(tmp_path)))
    controller = GraspController(plant, hand, {}, np.array([0.01, 0.02]), PARAMS)
    context = controller.CreateDefaultContext()
    controller.GetInputPort("hand_state").FixValue(context, [0.0, 0.0, 0.3, 0.4])
    torques = controller.GetOutputPort("actuation").Eval(context)
    spring, damper = PARAMS.finger_stiffness / SLIDING_ARM**2, PARAMS.finger_damping / SLIDING_ARM**2
    np.testing.assert_allclose(torques, [spring * 0.01 - damper * 0.3, spring * 0.02 - damper * 0.4])


def test_bad_arguments_are_named(hand_plant):
    plant, hand = hand_plant
    with pytest.raises(UnknownNameError, match=r"must be one of first.*, not 'pinky'"):
        GraspController(plant, hand, {"pinky": motion(3)}, np.zeros(24))
    with pytest.raises(InvalidInputError, match=r"GraspControllerParams\.period must be .*, not 0"):
        GraspController(plant, hand, {}, np.zeros(24), GraspControllerParams(period=0.0))


def test_joints_that_do_not_hold_go_where_they_are_told(hand_plant):
    bench = Bench(hand_plant)
    before = bench.torque("FFJ3")
    q = np.zeros(24)
    q[position(bench.plant, "MFJ3")] = 0.3
    q[position(bench.plant, "FFJ3")] = 0.7
    bench.controller.GetInputPort("rest_positions").FixValue(bench.context, q)
    assert bench.torque("MFJ3") == pytest.approx(PARAMS.finger_stiffness * 0.3)
    assert bench.torque("FFJ3") == pytest.approx(before), "it closes as planned"
