"""How the arm meets a rod that is handed over, and how it takes it to the hole."""

import dataclasses
import functools

import numpy as np
import pytest
import trimesh
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant

import tactopose_drake as tp
from tactopose_drake.core.grasping.held_axis import HeldAxis
from tactopose_drake.core.poses import make_poses
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture
from tactopose_drake.core.posterior.moved_origin import mixture_of_origin
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.estimation.pose_hypothesis import PoseHypothesis
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import Hand, add_hand
from tactopose_drake.resources import model_path
from tactopose_drake.station.arms.arm import Arm, add_arm, load_arm_config, make_arm_plant, mount_hand
from tactopose_drake.station.arms.arm_station import ArmSetup
from tactopose_drake.station.arms.carried_hand import CarriedHand
from tactopose_drake.station.arms.place_planning import PlaceParams, PlacePlanner
from tactopose_drake.station.arms.table_leans import lean_ways

Q = np.array(ArmSetup().q_start)
X_FBASE = ArmSetup().X_FBase.GetDeterministicValue()
GRIP = HeldAxis(np.array([0.0, -0.05, 0.11]), np.array([-1.0, 0.0, 0.0]), 0.0875)


def make_planner(model: tp.ObjectModel, params: PlaceParams | None = None) -> PlacePlanner:
    arm_plant, arm = make_arm_plant(load_arm_config("seven_axis"), RigidTransform())
    hand = CarriedHand(arm_plant, arm, load_hand_config("shadow_like"), X_FBASE, Q)
    return PlacePlanner(hand, model, GRIP, PlaceParams() if params is None else params)


@pytest.fixture(scope="module")
def planner() -> PlacePlanner:
    return make_planner(pencil())


def moved(held: HeldAxis, X: RigidTransform) -> HeldAxis:
    return dataclasses.replace(held, p_PQ=X.multiply(held.p_PQ), direction=X.rotation().multiply(held.direction))


@functools.cache
def arm_with_hand() -> tuple[MultibodyPlant, Arm, Hand]:
    plant = MultibodyPlant(time_step=0.0)
    arm = add_arm(plant, load_arm_config("seven_axis"), RigidTransform())
    hand = add_hand(plant, load_hand_config("shadow_like"))
    mount_hand(plant, arm, hand, X_FBASE)
    plant.Finalize()
    return plant, arm, hand


def palm_in_world(q: np.ndarray, q_hand: np.ndarray) -> RigidTransform:
    """By a plant of its own."""
    plant, arm, hand = arm_with_hand()
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
    along = dataclasses.replace(GRIP, p_PQ=GRIP.point(0.02))
    assert planner.misplacement(along) == pytest.approx(0.0, abs=1e-12)
    aside = dataclasses.replace(GRIP, p_PQ=GRIP.p_PQ + np.array([0.0, 0.003, 0.004]))
    assert planner.misplacement(aside) == pytest.approx(0.005)
    turned = dataclasses.replace(moved(GRIP, RigidTransform(RollPitchYaw(0.0, 0.0, 0.1), [0, 0, 0])), p_PQ=GRIP.p_PQ)
    assert planner.misplacement(turned) == pytest.approx(GRIP.end * np.sin(0.1), rel=1e-6)


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


def test_an_arm_that_is_over_the_hole_already_rests_before_it_descends(planner: PlacePlanner) -> None:
    q_hand = np.zeros(planner.num_hand_positions)
    first = planner.plan(Q, q_hand, GRIP)
    assert first is not None
    there = first[1].value(0.0)[:, 0]
    again = planner.plan(there, q_hand, GRIP)
    assert again is not None
    np.testing.assert_allclose(again[0].value(again[0].end_time())[:, 0], there, atol=1e-5)
    assert 0.0 < again[0].end_time() < 0.1
    met = planner.meet(Q, q_hand, GRIP)
    assert met is not None
    np.testing.assert_allclose(met.value(met.end_time())[:, 0], Q, atol=1e-5)


def test_a_hand_beside_a_narrow_box_may_descend_until_the_grip_is_at_the_hole() -> None:
    """The fingers of this open hand are beside the rod by more than half of the box."""
    narrow = make_planner(pencil(), PlaceParams(box_width=0.01))
    q_hand = np.zeros(narrow.num_hand_positions)
    plan = narrow.plan(Q, q_hand, GRIP)
    assert plan is not None
    p_WQ = palm_in_world(plan[1].value(plan[1].end_time())[:, 0], q_hand).multiply(GRIP.p_PQ)
    assert p_WQ[2] - PlaceParams().p_WHole[2] == pytest.approx(PlaceParams().hand_clearance, abs=0.002)


@pytest.mark.parametrize(
    "q",
    [
        [1.49, 0.94, -1.08, 1.59, -0.39, 1.13, 1.44],  # the wrist turned over
        [-1.15, 1.24, 1.07, 1.45, 0.38, 1.08, -1.41],
        [-1.23, 1.25, 1.22, 1.53, 0.25, 0.98, -1.6],
        [1.59, 1.21, -1.18, 1.63, -0.23, 1.07, 2.06],
    ],
)
def test_a_rod_that_leant_on_the_table_gets_to_the_hole(planner: PlacePlanner, q: list[float]) -> None:
    """From over the table, as the arm is after a touch; on its way the rod keeps off the table, and off the box."""
    q_hand, params = np.zeros(planner.num_hand_positions), PlaceParams()
    plan = planner.plan(np.array(q), q_hand, GRIP)
    assert plan is not None
    move, insert, _ = plan
    np.testing.assert_allclose(move.value(0.0)[:, 0], q, atol=1e-9)
    np.testing.assert_allclose(move.value(move.end_time()), insert.value(0.0), atol=1e-9)
    for time in np.linspace(0.0, move.end_time(), 25):
        end = palm_in_world(move.value(time)[:, 0], q_hand).multiply(GRIP.point(GRIP.end))
        over_box = np.abs(end - params.p_WHole)[:2].max() < 0.5 * params.box_width
        assert end[2] > (params.p_WHole[2] if over_box else 0.0) + 0.5 * params.hand_clearance


def test_the_arms_wrist_stays_off_the_table_with_any_lean() -> None:
    config = load_arm_config("seven_axis")
    arm_plant, arm = make_arm_plant(config, RigidTransform())
    hand = CarriedHand(arm_plant, arm, load_hand_config("shadow_like"), X_FBASE, Q)
    placed = hand.place(np.zeros(hand.num_hand_positions))
    p_PWrist = placed.X_FP.inverse().multiply(np.array(config.p_FWrist))
    for lean in lean_ways(GRIP, placed, 0.008, np.radians(60.0)):
        end = GRIP.point(lean.least_end)  # on the table
        assert (p_PWrist - end) @ lean.n_P > config.wrist_radius + 0.0079


def test_the_wrist_of_an_arm_is_a_ball() -> None:
    config = load_arm_config("seven_axis")
    for spoilt, word in (({"wrist_radius": -0.1}, "wrist_radius"), ({"p_FWrist": [0.0, 0.0]}, "p_FWrist")):
        with pytest.raises(InvalidInputError, match=rf"ArmConfig\.{word}"):
            dataclasses.replace(config, **spoilt).validate()


def test_a_table_that_gives_way_is_lower_where_it_is_touched() -> None:
    soft = make_planner(pencil(), PlaceParams(table_give=0.0004))
    np.testing.assert_allclose(soft.p_WTouch, np.array(PlaceParams().p_WTable) - [0.0, 0.0, 0.0004], atol=1e-12)


def test_what_has_no_axis_is_no_rod() -> None:
    box = tp.ObjectModel.from_mesh(model_path("objects", "bust.obj"))
    with pytest.raises(InvalidInputError, match="axis of symmetry"):
        make_planner(box)


def test_the_rod_leans_on_the_table_and_the_hand_stays_off_it(planner: PlacePlanner) -> None:
    """Before the first touch its end may be anywhere, then the table is to tell which end it is."""
    model, q_hand = pencil(), np.zeros(planner.num_hand_positions)
    seen = []
    for sigma_end in (0.05, 0.001):
        held = dataclasses.replace(GRIP, sigma=0.001, sigma_end=sigma_end)
        touched = planner.touch_table(Q, q_hand, held, either_end_up(model, sigma_end))
        assert touched is not None
        move, lower, above = touched
        np.testing.assert_allclose(move.value(0.0)[:, 0], Q, atol=1e-9)
        np.testing.assert_allclose(move.value(move.end_time()), lower.value(0.0), atol=1e-9)
        first, last = (palm_in_world(lower.value(time)[:, 0], q_hand) for time in (0.0, lower.end_time()))
        # Straight down, with one lean; it may turn about the way down.
        np.testing.assert_allclose(first.rotation().matrix()[2], last.rotation().matrix()[2], atol=2e-3)
        np.testing.assert_allclose(first.multiply(held.p_PQ)[:2], last.multiply(held.p_PQ)[:2], atol=1e-3)
        # Not in a hurry: the slower the arm, the nearer the rod is to where it first touches.
        speed = (first.translation()[2] - last.translation()[2]) / lower.end_time()
        assert 0.0 < speed < PlaceParams().touch_speed
        farthest = min(held.end + 3.0 * sigma_end, 0.175)
        assert first.multiply(held.point(farthest))[2] > PlaceParams().table_clearance
        assert palm_in_world(above, q_hand).translation()[2] > first.translation()[2] + 0.1
        seen.append(np.degrees(np.arccos(-first.rotation().multiply(held.direction)[2])))
    assert seen[1] > 30.0


@pytest.mark.parametrize("end", [0.03, 0.01])
def test_a_rod_too_short_to_touch_the_table_is_lowered_until_the_hand_is_near_it(
    planner: PlacePlanner, end: float
) -> None:
    """The task then tells that the rod does not reach the table."""
    params, q_hand = PlaceParams(), np.zeros(planner.num_hand_positions)
    held = dataclasses.replace(GRIP, end=end, sigma=0.001, sigma_end=0.001)
    touched = planner.touch_table(Q, q_hand, held, either_end_up(pencil(), 0.001))
    assert touched is not None
    move, lower, _ = touched
    np.testing.assert_allclose(move.value(move.end_time()), lower.value(0.0), atol=1e-9)
    first, last = (palm_in_world(lower.value(time)[:, 0], q_hand) for time in (0.0, lower.end_time()))
    fallen = first.multiply(held.p_PQ)[2] - last.multiply(held.p_PQ)[2]
    assert fallen == pytest.approx(params.table_clearance, abs=5e-4)
    assert last.multiply(held.point(held.end))[2] > 0.0  # The rod's end is still off the table.


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [
        ("speed_share", 5.0, "from 0 to 1"),
        ("touch_speed", 0.0, "> 0"),
        ("most_acceleration", 0.0, "> 0"),
        ("most_lean_deg", 120.0, "from 15 to 90 deg"),
        ("most_lean_deg", 10.0, "from 15 to 90 deg"),  # of less there is no lean to choose
        ("seed", -3, ">= 0"),
    ],
)
def test_how_fast_the_arm_goes_has_limits(name: str, value: float, allowed: str) -> None:
    with pytest.raises(InvalidInputError, match=rf"PlaceParams\.{name} must be an? \w+ {allowed}, not {value:g}"):
        PlaceParams(**{name: value}).validate()


def pencil() -> tp.ObjectModel:
    return tp.ObjectModel.from_mesh(model_path("objects", "pencil.obj"), mass=0.0055)


def either_end_up(model: tp.ObjectModel, sigma: float) -> PoseEstimate:
    """A pencil that is held by its middle where the grip wants it."""
    down = RigidTransform(RollPitchYaw(0.0, -0.5 * np.pi, 0.0), GRIP.point(-0.0875))
    up = RigidTransform(RollPitchYaw(0.0, 0.5 * np.pi, 0.0), GRIP.point(0.0875))
    covariance = np.diag(np.repeat([(10.0 * sigma) ** 2, sigma**2], 3)) * 1e-2
    either = (PoseHypothesis(X_PO, 0.0, 0.5, covariance, np.zeros((0, 6))) for X_PO in (down, up))
    return PoseEstimate(tuple(either), "ambiguous", 0.0)


def test_where_the_rod_s_origin_is_makes_its_axis_no_less_certain() -> None:
    near = pencil()
    shift = np.array([0.5, 0.0, 0.0])
    mesh = trimesh.Trimesh(near.vertices + shift, near.faces, process=False)
    far = tp.ObjectModel.from_mesh(mesh, mass=0.0055, symmetry=[near.symmetries[0].seen_from(-shift)])
    R = RollPitchYaw(0.3, -1.4, 0.5).ToRotationMatrix().matrix()
    # Its spin is known to 5 degrees, and its lean to one, about its middle.
    covariance = np.diag(np.repeat([np.radians(1.0) ** 2, 0.0005**2], 3))
    covariance[2, 2] = np.radians(5.0) ** 2
    of_middle = GaussianMixture(make_poses(R[None], GRIP.p_PQ[None]), np.ones(1), covariance[None])
    contacts, found = tp.Contacts(GRIP.p_PQ + 0.01 * np.eye(3)), []
    for model in (near, far):
        belief = mixture_of_origin(of_middle, model.middle)
        pose = PoseHypothesis(RigidTransform(belief.X_PO[0]), 0.0, 1.0, belief.covariance[0], np.zeros((0, 6)))
        found.append(make_planner(model).held_axis(PoseEstimate((pose,), "ok", 0.0), contacts))
    np.testing.assert_allclose(found[1].point(found[1].end), found[0].point(found[0].end), atol=1e-6)
    assert found[1].sigma == pytest.approx(found[0].sigma, rel=0.02)
    assert found[1].sigma_end == pytest.approx(found[0].sigma_end, rel=0.02)
