"""What the grasp planner takes from a hand's model: of fingers that slide, of thick ones, and of sensors anywhere."""

import dataclasses
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tactopose_drake.core.grasping.finger_reach import FingerReach, ReachParams
from tactopose_drake.core.grasping.finger_sides import are_apart, half_width, sides
from tactopose_drake.core.grasping.grasp_plan import Refusals
from tactopose_drake.core.grasping.grasp_planner import HandReach, PlannerParams, plan_grasps
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.finger_chain import finger_chain
from tactopose_drake.hand.hand_check import check_hand
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.hand.hand_reach import make_hand_reach, rest_posture
from tactopose_drake.hand.joint_matrices import joint_matrix, joint_offsets
from tests.hand.grippers import YAML, write_gripper

WEIGHT = np.array([0.0, -1.0, 0.0])


@pytest.fixture(scope="module")
def cube() -> ObjectModel:
    return ObjectModel.from_mesh(trimesh.creation.box((0.05, 0.05, 0.05)), cache=False)


def test_a_sliding_finger_reaches_where_the_plant_says(tmp_path: Path) -> None:
    plant, hand = make_hand_plant(load_hand_config(write_gripper(tmp_path)))
    chain = finger_chain(plant, hand, "right")
    X_PS = chain.sensor_poses(np.array([[0.0], [0.02]]))
    np.testing.assert_allclose(X_PS[:, :, 3], [[0.06, 0.0, 0.1], [0.04, 0.0, 0.1]], atol=1e-12)
    _, J = chain.point_jacobians(np.array([[0.01]]), np.array([0.0, 0.01, 0.0]))
    np.testing.assert_allclose(J[0, :, 0], [-1.0, 0.0, 0.0], atol=1e-12)


def test_two_sliding_fingers_with_sensors_at_their_middles_hold_a_cube(tmp_path: Path, cube: ObjectModel) -> None:
    reach = make_hand_reach(load_hand_config(write_gripper(tmp_path)), ReachParams())
    assert not reach.fingers["left"].geometry.has_axis
    plans = plan_grasps(cube, reach, WEIGHT, PlannerParams(), np.random.default_rng(0))
    assert plans
    for plan in plans:
        (p_a, n_a), (p_b, n_b) = ((finger.p_PC, finger.n_PC) for finger in plan.fingers.values())
        assert n_a @ n_b < -0.9
        for p in (p_a, p_b):  # on a face of the cube
            assert np.abs((p - plan.X_PO[:, 3]) @ plan.X_PO[:, :3]).max() == pytest.approx(0.025, abs=1e-3)


def test_a_sensor_elsewhere_on_the_fingertip_changes_nothing_but_its_own_frame(tmp_path: Path) -> None:
    middle = make_hand_reach(load_hand_config(write_gripper(tmp_path)), ReachParams()).fingers["left"]
    beside = YAML.replace("sensor_frame: left_tip", "sensor_frame: left_finger").replace(
        "surface: !SphereSurface {radius: 0.012}",
        "surface: !SphereSurface {radius: 0.012, X_SF: {translation: [-0.06, 0, 0.1]}}",
        1,
    )
    there = make_hand_reach(load_hand_config(write_gripper(tmp_path, yaml=beside)), ReachParams()).fingers["left"]
    np.testing.assert_allclose(there.reached, middle.reached, atol=1e-12)
    assert there.geometry.has_axis  # from the sensor's frame


def test_why_nothing_was_found_is_counted(tmp_path: Path) -> None:
    reach = make_hand_reach(load_hand_config(write_gripper(tmp_path)), ReachParams())
    wide = ObjectModel.from_mesh(trimesh.creation.box((0.11, 0.11, 0.05)), cache=False)
    refusals = Refusals()
    assert not plan_grasps(wide, reach, WEIGHT, PlannerParams(most_poses=20), np.random.default_rng(0), refusals)
    assert refusals.poses.total() == 20
    assert "of 20 poses: " in refusals.explanation()
    assert refusals.touches["left"].total() > 0
    assert "touches of 'left': " in refusals.explanation()
    assert "because the finger" in refusals.explanation()


def test_without_a_direction_down_or_a_possible_force_there_is_no_plan(tmp_path: Path) -> None:
    reach = make_hand_reach(load_hand_config(write_gripper(tmp_path)), ReachParams())
    cube = ObjectModel.from_mesh(trimesh.creation.box((0.05, 0.05, 0.05)), cache=False)
    for load, message in ((np.zeros(3), "must not be zero"), (np.full(3, np.nan), "must be a finite number")):
        with pytest.raises(InvalidInputError, match=rf"load_P.* {message}"):
            plan_grasps(cube, reach, load, PlannerParams(), np.random.default_rng(0))
    with pytest.raises(InvalidInputError, match=r"least_force must be at most `most_force`, 7 N, not 8 N"):
        PlannerParams(least_force=8.0).validate()


def test_fingers_as_thick_as_they_are_stay_apart(tmp_path: Path) -> None:
    reach = make_hand_reach(load_hand_config(write_gripper(tmp_path)), ReachParams())
    left, right = (reach.fingers[name].geometry for name in ("left", "right"))
    assert half_width(left) > 0.012  # its box does not stand on the line through its joint
    q = np.array([[0.0], [0.04]])
    gap = 0.12 - 0.024 - 2 * 0.04  # between the fingertips' balls
    assert are_apart(sides(left, q), sides(right, q), gap - 1e-6)[1, 1]
    assert not are_apart(sides(left, q), sides(right, q), gap + 1e-6)[1, 1]


def test_a_coupling_with_an_offset_is_followed(tmp_path: Path) -> None:
    mimic = '<mimic joint="left_slide" multiplier="0.5" offset="0.01"/>'
    coupling = "couplings: [{joint: right_slide, follows: left_slide, ratio: 0.5, offset: 0.01}]"
    yaml = YAML.replace("joints: [right_slide]", f"joints: [left_slide]\n  {coupling}")
    plant, hand = make_hand_plant(load_hand_config(write_gripper(tmp_path, mimic=mimic, yaml=yaml)))
    chain = finger_chain(plant, hand, "right")
    np.testing.assert_allclose(chain.sensor_poses(np.array([[0.02]]))[0, :, 3], [0.04, 0.0, 0.1], atol=1e-12)
    matrix, offsets = (function(plant, hand, ["left_slide"]) for function in (joint_matrix, joint_offsets))
    np.testing.assert_allclose(matrix @ [0.02] + offsets, [0.02, 0.02])
    np.testing.assert_allclose(joint_offsets(plant, hand, ["left_slide", "right_slide"]), 0.0)
    places = [plant.GetJointByName(name).position_start() for name in ("left_slide", "right_slide")]
    np.testing.assert_allclose(rest_posture(plant, hand, {"right": np.array([0.02])})[places], [0.02, 0.02])


def test_a_hand_whose_fingers_feel_no_forces_cannot_be_planned_for() -> None:
    with pytest.raises(
        InvalidInputError, match=r"a force-torque sensor on 2 or more fingers, not on 0.*Scenario\.grip"
    ):
        make_hand_reach(load_hand_config("barrett_like"), ReachParams())


@pytest.mark.parametrize(
    ("limit", "verdict"),
    [("", "note"), ('<limit lower="0.01" upper="0.01" effort="40" velocity="1"/>', "fault")],
    ids=["unlimited", "fixed"],
)
def test_joints_without_limits_are_told_as_the_check_tells_them(tmp_path: Path, limit: str, verdict: str) -> None:
    path = write_gripper(tmp_path)
    model = tmp_path / "two_finger.urdf"
    model.write_text(re.sub("<limit.*?/>", limit, model.read_text(), count=1))
    with pytest.raises(InvalidInputError) as told:
        make_hand_reach(load_hand_config(path), ReachParams())
    check = check_hand(path)
    (finding,) = (finding for finding in check.findings if "planned grasps" in finding.text)
    assert re.fullmatch("joint limits must be finite and differ for planned grasps, not left_slide .*", finding.text)
    assert (finding.part, str(told.value)) == ("finger left", f"finger 'left': {finding.text}.")
    # A hand that is only to be posed needs no limits.
    assert finding.verdict == verdict
    assert check.faults == ((finding,) if verdict == "fault" else ())


def test_a_continuous_joint_is_no_fault(tmp_path: Path) -> None:
    path = write_gripper(tmp_path)
    model = tmp_path / "two_finger.urdf"
    urdf = model.read_text().replace('type="prismatic"', 'type="continuous"', 1)
    model.write_text(re.sub("<limit.*?/>", "", urdf, count=1))
    check = check_hand(path)
    assert not check.faults
    assert any("left_slide -inf to inf rad" in finding.text for finding in check.findings)


def test_fingertips_touch_with_their_straight_parts_where_round_ends_hold_nothing(tmp_path: Path) -> None:
    upright = YAML.replace("!SphereSurface {radius: 0.012}", "!CapsuleSurface {radius: 0.012, length: 0.02}")
    reach = make_hand_reach(load_hand_config(write_gripper(tmp_path, yaml=upright)), ReachParams())
    ball = ObjectModel.from_mesh(trimesh.creation.icosphere(subdivisions=3, radius=0.025), cache=False)
    refusals, params = Refusals(), PlannerParams(grasps=1, most_poses=30)
    (plan,) = plan_grasps(ball, reach, WEIGHT, params, np.random.default_rng(0), refusals)
    # A finger that slides across its own axis meets the ball with its side.
    assert refusals.touches["left"]["the finger would touch with its side or back"] > 0
    n_a, n_b = (finger.n_PC for finger in plan.fingers.values())
    assert n_a @ n_b < -0.9


def spare_finger(reach: HandReach, offset: float) -> FingerReach:
    """A finger like the left one, so far beside it, m."""
    left = reach.fingers["left"].geometry
    beside = left.chain.X_parent.copy()
    beside[0, 1, 3] += offset
    chain = dataclasses.replace(left.chain, X_parent=beside)
    return FingerReach(dataclasses.replace(left, chain=chain), ReachParams(), np.random.default_rng(0), 200)


def with_idle_fingers(reach: HandReach, idle: dict[str, FingerReach]) -> HandReach:
    """A hand that has these fingers too, which usually wait in the middle of the grip region."""
    in_the_way = (0.5 * (reach.grip_low + reach.grip_high)[None], np.array([0.01]))
    rest = {**reach.rest_spheres, **dict.fromkeys(idle, in_the_way)}
    return dataclasses.replace(reach, fingers={**reach.fingers, **idle}, rest_spheres=rest)


def test_an_idle_finger_makes_way_where_no_grasp_is_found_otherwise(tmp_path: Path, cube: ObjectModel) -> None:
    reach = make_hand_reach(load_hand_config(write_gripper(tmp_path)), ReachParams())
    spare = spare_finger(reach, 0.15)
    params = PlannerParams(grasps=1, most_poses=40, least_fingers=2, fingers=["left", "right"])
    refusals, hand = Refusals(), with_idle_fingers(reach, {"spare": spare})
    (plan,) = plan_grasps(cube, hand, WEIGHT, params, np.random.default_rng(0), refusals)
    assert refusals.poses["a finger that takes no part is in its way"] > 0
    assert set(plan.fingers) == {"left", "right"}
    q = plan.waiting["spare"]
    assert spare.geometry.chain.lower[0] <= q[0] <= spare.geometry.chain.upper[0]


def test_idle_fingers_that_make_way_stay_apart(tmp_path: Path, cube: ObjectModel) -> None:
    reach = make_hand_reach(load_hand_config(write_gripper(tmp_path)), ReachParams())
    params = PlannerParams(grasps=1, most_poses=40, least_fingers=2, fingers=["left", "right"])
    width = 2.0 * reach.fingers["left"].geometry.tip_radius

    def places(hand: HandReach) -> dict[str, FloatArray]:
        """Of the fingertips that make way, in P."""
        (plan,) = plan_grasps(cube, hand, WEIGHT, params, np.random.default_rng(0))
        return {name: hand.fingers[name].geometry.tip(q[None])[0] for name, q in plan.waiting.items()}

    def pair(distance: float) -> HandReach:
        return with_idle_fingers(
            reach, {"one": spare_finger(reach, 0.15), "other": spare_finger(reach, 0.15 + distance)}
        )

    # Each for itself goes as far as it can, as these two do that have room for that beside each other.
    far = places(pair(2.0 * width))
    np.testing.assert_allclose(far["other"] - far["one"], [0.0, 2.0 * width, 0.0], atol=1e-12)
    near = places(pair(0.5 * width))
    assert np.linalg.norm(near["other"] - near["one"]) > width
    # Nor does one go where another one waits as it always does.
    hand = pair(2.0 * width)
    rest = {**hand.rest_spheres, "other": (far["one"][None], np.array([0.5 * width]))}
    alone = places(dataclasses.replace(hand, rest_spheres=rest))
    assert set(alone) == {"one"}
    assert np.linalg.norm(alone["one"] - far["one"]) > width


def test_fingers_that_wait_elsewhere_have_their_own_posture(tmp_path: Path) -> None:
    plant, hand = make_hand_plant(load_hand_config(write_gripper(tmp_path)))
    places = [plant.GetJointByName(name).position_start() for name in ("left_slide", "right_slide")]
    q = rest_posture(plant, hand, {"right": np.array([0.03])})
    np.testing.assert_allclose(q[places], [0.0, 0.03])


def test_a_superquadric_fingertip_is_sought_with_the_capsule_within_it(tmp_path: Path) -> None:
    boxy = YAML.replace(
        "!SphereSurface {radius: 0.012}",
        "!SuperquadricSurface {semi_axes: [0.012, 0.02, 0.014], exponents: [0.4, 0.4],"
        " X_SF: {translation: [0, 0, 0.005]}}",
    )
    geometry = (
        make_hand_reach(load_hand_config(write_gripper(tmp_path, yaml=boxy)), ReachParams()).fingers["left"].geometry
    )
    assert geometry.tip_radius == pytest.approx(0.012)
    assert geometry.p_SL is not None
    ends = np.array([geometry.p_ST, geometry.p_SL])
    np.testing.assert_allclose(np.abs(ends), [[0.0, 0.008, 0.005]] * 2, atol=1e-12)
    assert ends[0] @ ends[1] < 0.0


def test_a_grasp_in_which_the_hand_would_touch_itself_is_not_taken(tmp_path: Path, cube: ObjectModel) -> None:
    reach = make_hand_reach(load_hand_config(write_gripper(tmp_path)), ReachParams())
    asked: list[set[str]] = []

    def touches_itself(positions: Mapping[str, FloatArray]) -> bool:
        asked.append(set(positions))
        return len(asked) <= 2

    params, refusals = PlannerParams(grasps=1), Refusals()
    (plan,) = plan_grasps(cube, reach, WEIGHT, params, np.random.default_rng(0), refusals, touches_itself)
    assert refusals.poses["the hand would touch itself"] == 2
    assert len(asked) == 4  # with the fingers open, and as they touch
    assert all(names == {"left", "right"} == set(plan.fingers) for names in asked)
