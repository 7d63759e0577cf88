"""How the arm meets a rod that is handed over, and how it takes it to the hole."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant

import tactopose_drake as tp
from tactopose_drake.core.grasping.held_axis import HeldAxis
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import add_hand
from tactopose_drake.resources import model_path
from tactopose_drake.station.arms.arm import add_arm, load_arm_config, make_arm_plant, mount_hand
from tactopose_drake.station.arms.place_planning import PlaceParams, PlacePlanner
from tactopose_drake.station.arms.station import ArmSetup

Q = np.array(ArmSetup().q_start)
X_FBASE = ArmSetup().X_FBase.GetDeterministicValue()
GRIP = HeldAxis(np.array([0.0, -0.05, 0.11]), np.array([-1.0, 0.0, 0.0]), 0.0)


def make_planner(model: tp.ObjectModel) -> PlacePlanner:
    arm_plant, arm = make_arm_plant(load_arm_config("seven_axis"), RigidTransform())
    return PlacePlanner(arm_plant, arm, load_hand_config("shadow_like"), X_FBASE, model, GRIP, PlaceParams())


@pytest.fixture(scope="module")
def planner() -> PlacePlanner:
    return make_planner(tp.ObjectModel.from_mesh(model_path("objects", "pencil.obj"), mass=0.0055))


def moved(held: HeldAxis, X: RigidTransform) -> HeldAxis:
    return HeldAxis(X.multiply(held.p_PQ), X.rotation().multiply(held.direction), held.sigma)


def palm_in_world(q: np.ndarray, q_hand: np.ndarray) -> RigidTransform:
    """By a plant of its own."""
    plant = MultibodyPlant(time_step=0.0)
    arm = add_arm(plant, load_arm_config("seven_axis"), RigidTransform())
    hand = add_hand(plant, load_hand_config("shadow_like"))
    mount_hand(plant, arm, hand, X_FBASE)
    plant.Finalize()
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, arm.model_instance, q)
    plant.SetPositions(context, hand.model_instance, q_hand)
    return hand.palm_frame.CalcPoseInWorld(context)


@pytest.mark.parametrize("seed", range(3))
def test_the_met_rod_lies_in_the_hand_as_the_grip_wants_it(planner: PlacePlanner, seed: int) -> None:
    generator = np.random.default_rng(seed)
    q_hand = generator.uniform(-0.1, 0.1, planner.num_hand_positions)  # the wrist's too
    angles, shift = generator.uniform(-0.17, 0.17, 3), generator.uniform(-0.005, 0.005, 3)
    held = moved(GRIP, RigidTransform(RollPitchYaw(angles), shift))
    motion = planner.meet(Q, q_hand, held)
    assert motion is not None
    np.testing.assert_allclose(motion.value(0.0)[:, 0], Q, atol=1e-9)
    q = motion.value(motion.end_time())[:, 0]
    in_world = moved(held, palm_in_world(Q, q_hand))  # where it stays
    after = moved(in_world, palm_in_world(q, q_hand).inverse())
    assert planner.misplacement(held) > 0.003
    assert planner.misplacement(after) < 0.0005
    assert after.direction @ GRIP.direction > np.cos(2e-3)
    # The hand goes to the rod, not along it: the point that was nearest to the grip's is so afterwards.
    nearest = held.point(float((GRIP.p_PQ - held.p_PQ) @ held.direction))
    X_PafterP = palm_in_world(q, q_hand).inverse() @ palm_in_world(Q, q_hand)
    np.testing.assert_allclose(X_PafterP.multiply(nearest), GRIP.p_PQ, atol=5e-4)


def test_misplacement_is_that_of_the_lower_end_across_the_rod(planner: PlacePlanner) -> None:
    assert planner.misplacement(GRIP) == 0.0
    along = HeldAxis(GRIP.point(0.02), GRIP.direction, 0.0)
    assert planner.misplacement(along) == pytest.approx(0.0, abs=1e-12)
    aside = HeldAxis(GRIP.p_PQ + np.array([0.0, 0.003, 0.004]), GRIP.direction, 0.0)
    assert planner.misplacement(aside) == pytest.approx(0.005)
    turned = moved(HeldAxis(np.zeros(3), GRIP.direction, 0.0), RigidTransform(RollPitchYaw(0.0, 0.0, 0.1), [0, 0, 0]))
    turned = HeldAxis(GRIP.p_PQ, turned.direction, 0.0)
    assert planner.misplacement(turned) == pytest.approx(planner.longest_end * np.sin(0.1), rel=1e-6)


def test_the_rod_ends_upright_in_the_hole(planner: PlacePlanner) -> None:
    q_hand = np.zeros(planner.num_hand_positions)
    held = moved(GRIP, RigidTransform(RollPitchYaw(0.05, -0.08, 0.1), [0.0, 0.003, -0.002]))
    plan = planner.plan(Q, q_hand, held)
    assert plan is not None
    hole = np.array(PlaceParams().p_WHole)
    for motion in plan:
        if motion is plan[0]:
            np.testing.assert_allclose(motion.value(0.0)[:, 0], Q, atol=1e-9)
            continue
        for time in np.linspace(0.0, motion.end_time(), 7):  # straight down, and up again, in the hole's axis
            in_world = moved(held, palm_in_world(motion.value(time)[:, 0], q_hand))
            assert np.linalg.norm((in_world.p_PQ - hole)[:2]) < 0.002
            assert in_world.direction[2] < -np.cos(0.01)


def test_what_has_no_axis_is_no_rod() -> None:
    box = tp.ObjectModel.from_mesh(model_path("objects", "bust.obj"))
    with pytest.raises(InvalidInputError, match="axis of symmetry"):
        make_planner(box)
