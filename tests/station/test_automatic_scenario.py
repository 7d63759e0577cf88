"""Scenarios and simulations for hands that nobody has prepared."""

import re
from pathlib import Path

import numpy as np
import pytest
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant

from tactopose_drake.core.grasping.finger_reach import ReachParams
from tactopose_drake.errors import InvalidFileError, InvalidInputError
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import add_hand
from tactopose_drake.hand.hand_reach import make_hand_reach
from tactopose_drake.resources import fixed_pose
from tactopose_drake.station.automatic_scenario import object_axis, scenario_for
from tactopose_drake.station.grasp_planning import plan_scenario
from tactopose_drake.station.motor_inertia import add_motor_inertia
from tactopose_drake.station.simulated import check_bodies
from tactopose_drake.systems.force_torque_sensor import sufficient_calibration
from tactopose_drake.systems.grasp_controller import GraspControllerParams
from tests.hand.grippers import YAML, write_gripper


def test_objects_stand_across_the_fingers_and_the_palm(tmp_path: Path) -> None:
    path = write_gripper(tmp_path)
    reach = make_hand_reach(load_hand_config(path), ReachParams())
    np.testing.assert_allclose(np.abs(object_axis(reach)), [0.0, 1.0, 0.0], atol=0.1)
    scenario = scenario_for(str(path), "cube", seed=3)
    scenario.validate()
    up_P = fixed_pose("X", scenario.X_WBase).rotation().inverse() @ np.array([0.0, 0.0, 1.0])
    np.testing.assert_allclose(up_P, object_axis(reach), atol=1e-3)
    assert scenario.seed == 3
    # The camera looks at the grip region, over the back of the palm and from above.
    X_WC = fixed_pose("X", scenario.X_WC)
    p_CG = X_WC.inverse() @ (fixed_pose("X", scenario.X_WBase) @ (0.5 * (reach.grip_low + reach.grip_high)))
    np.testing.assert_allclose(p_CG, [0.0, 0.0, 0.4], atol=1e-3)
    p_BaseC = fixed_pose("X", scenario.X_WBase).inverse() @ X_WC.translation()
    assert p_BaseC[2] < reach.grip_low[2] - 0.1, "the palm is at z = 0, and the fingers point along z"
    assert X_WC.translation()[2] > 0.1


def test_where_nothing_is_held_a_place_that_was_found_may_be_wrong(tmp_path: Path) -> None:
    advice = "tactopose check-hand`; grip_low and grip_high in its file set another one."
    scenario = scenario_for(str(write_gripper(tmp_path)), "mug")
    scenario.planner.most_poses = 10
    with pytest.raises(InvalidInputError, match=re.escape(advice)):
        plan_scenario(scenario)
    told = YAML + "grip_low: [-0.01, -0.01, 0.09]\ngrip_high: [0.01, 0.01, 0.11]\n"
    scenario.hand = str(write_gripper(tmp_path, yaml=told))
    with pytest.raises(InvalidInputError, match=r"^Scenario\.object must fit between the hand's fingers, but the hand"):
        plan_scenario(scenario)


def test_damped_joints_get_a_stiffer_spring(tmp_path: Path) -> None:
    path = write_gripper(tmp_path)
    slack = scenario_for(str(path), "cube").controller.finger_stiffness
    model = tmp_path / "two_finger.urdf"
    model.write_text(model.read_text().replace("</joint>", '<dynamics damping="4"/></joint>'))
    scenario = scenario_for(str(path), "cube")
    assert slack == 5.0
    assert scenario.reach.stiffness == scenario.controller.finger_stiffness == pytest.approx(40.0)


def test_sensors_bear_the_moments_of_long_fingertips(tmp_path: Path) -> None:
    assert scenario_for(str(write_gripper(tmp_path)), "cube").sensor.calibration == "SI-12-0.12"
    # At the finger's root, 10 cm from what touches.
    behind = YAML.replace("sensor_frame: left_tip", "sensor_frame: left_finger").replace(
        "{radius: 0.012}", "{radius: 0.012, X_SF: {translation: [-0.06, 0, 0.1]}}", 1
    )
    assert scenario_for(str(write_gripper(tmp_path, yaml=behind)), "cube").sensor.calibration == "SI-50-0.5"


def test_light_joints_get_their_motor_s_inertia(tmp_path: Path) -> None:
    config = load_hand_config(write_gripper(tmp_path))

    def added(step: float) -> dict[str, float]:
        plant = MultibodyPlant(step)
        return add_motor_inertia(plant, add_hand(plant, config), GraspControllerParams())

    assert added(0.001) == {}
    heavy = added(0.02)
    assert set(heavy) == {"left_slide", "right_slide"}
    # Half of what spring and damper do in a step, at 5 cm from the axis, less the finger's own 60 g.
    assert heavy["left_slide"] == pytest.approx(0.5 * 0.02 * (0.02 * 5.0 + 0.02) / 0.05**2 - 0.06)
    shadow = load_hand_config("shadow_like")
    plant = MultibodyPlant(0.004)
    assert add_motor_inertia(plant, add_hand(plant, shadow), GraspControllerParams()) == {}


def test_a_motor_behind_gears_keeps_its_reflected_inertia(tmp_path: Path) -> None:
    """A rotor of 1e-4 kg behind a gear ratio of 10 is reflected as 0.01 kg, which is then not added."""
    plant = MultibodyPlant(0.02)
    hand = add_hand(plant, load_hand_config(write_gripper(tmp_path)))
    actuators = {
        actuator.joint().name(): actuator for actuator in map(plant.get_joint_actuator, plant.GetJointActuatorIndices())
    }
    geared = actuators["left_slide"]
    geared.set_default_rotor_inertia(1e-4)
    geared.set_default_gear_ratio(10.0)
    added = add_motor_inertia(plant, hand, GraspControllerParams())
    assert geared.default_reflected_inertia() == pytest.approx(0.01 + added["left_slide"])


def test_a_motor_bears_what_follows_it_by_the_square_of_its_ratio(tmp_path: Path) -> None:
    yaml = YAML.replace("joints: [right_slide]", "joints: [left_slide]")
    coupled = "  couplings: [{joint: right_slide, follows: left_slide, ratio: %s}]\n  sensor_frame: right_tip"
    for ratio in (0.5, 1.5):
        told = yaml.replace("  sensor_frame: right_tip", coupled % ratio)
        mimic = f'<mimic joint="left_slide" multiplier="{ratio}"/>'
        plant = MultibodyPlant(0.02)
        hand = add_hand(plant, load_hand_config(write_gripper(tmp_path, mimic=mimic, yaml=told)))
        added = add_motor_inertia(plant, hand, GraspControllerParams())
        needed = 0.5 * 0.02 * (0.02 * 5.0 + 0.02) / 0.05**2
        assert added == {"left_slide": pytest.approx(needed - 0.06 * (1.0 + ratio**2))}


def write_rows(folder: Path) -> Path:
    """A hand of two fingers of three turning joints each, whose last links weigh next to nothing; its YAML's path."""
    link = (
        '<link name="{0}"><inertial><mass value="{1}"/>'
        '<inertia ixx="{2}" ixy="0" ixz="0" iyy="{2}" iyz="0" izz="{2}"/></inertial></link>'
    )
    joint = (
        '<joint name="{0}_joint" type="revolute"><parent link="{1}"/><child link="{0}"/><axis xyz="0 1 0"/>'
        '<origin xyz="0 0 0.04"/><limit lower="-1" upper="1" effort="1" velocity="9"/></joint>'
    )
    parts, fingers = [link.format("palm", 0.5, 1e-3)], ""
    for name in ("a", "b"):
        links = [f"{name}{i}" for i in range(3)]
        parts += [link.format(part, 0.02, 1e-6) for part in links]
        parts += [joint.format(part, parent) for part, parent in zip(links, ["palm", *links], strict=False)]
        joints = ", ".join(f"{part}_joint" for part in links)
        fingers += f"- {{name: {name}, joints: [{joints}], sensor_frame: {name}2, weld: {name}2_joint, "
        fingers += "surface: !SphereSurface {radius: 0.01}}\n"
    (folder / "rows.urdf").write_text(f'<robot name="rows">{"".join(parts)}</robot>')
    path = folder / "rows.hand.yaml"
    path.write_text(f"model: rows.urdf\nbase_link: palm\npalm_frame: palm\nfingers:\n{fingers}")
    return path


def test_the_springs_of_joints_in_a_row_do_not_swing_ever_wider(tmp_path: Path) -> None:
    params, step = GraspControllerParams(), 0.004
    plant = MultibodyPlant(step)
    hand = add_hand(plant, load_hand_config(write_rows(tmp_path)), RigidTransform())
    added = add_motor_inertia(plant, hand, params)
    plant.Finalize()
    context, eye = plant.CreateDefaultContext(), np.eye(6)
    # The first joint of each finger has inertia enough for itself, but not for what all three do together.
    assert set(added) == {f"{name}{i}_joint" for name in "ab" for i in range(3)}
    for q in np.random.default_rng(1).uniform(-1.0, 1.0, (5, 6)):
        plant.SetPositions(context, q)
        inertia = plant.CalcMassMatrix(context)  # with that of the rotors
        # A step of explicit springs and dampers maps positions and velocities to the next.
        kick = np.hstack([np.zeros((6, 6)), eye])
        kick -= step * np.linalg.solve(inertia, np.hstack([params.finger_stiffness * eye, params.finger_damping * eye]))
        stride = np.hstack([eye, np.zeros((6, 6))]) + step * kick
        assert np.abs(np.linalg.eigvals(np.vstack([stride, kick]))).max() < 1.0


def test_a_rigid_hand_is_refused_where_the_object_is_rigid_too(tmp_path: Path) -> None:
    hint = '<drake:mesh_resolution_hint value="0.003"/>'
    rigid = f"<drake:proximity_properties><drake:rigid_hydroelastic/>{hint}</drake:proximity_properties>"
    scenario = scenario_for(str(write_gripper(tmp_path, property=rigid)), "cube")
    with pytest.raises(
        InvalidInputError, match=r"must say that .*'left_ball' of link 'left_tip'.* is compliant, not rigid"
    ):
        check_bodies(scenario)
    scenario.plant.contact_model = "hydroelastic_with_fallback"
    check_bodies(scenario)


def test_a_scenario_names_its_own_sensors_file(tmp_path: Path) -> None:
    (tmp_path / "own.yaml").write_text(
        "calibrations: {mine: {range: [1, 1, 1, 20, 20, 20], resolution: [0, 0, 0, 0, 0, 0], noise: "
        "[0.001, 0.001, 0.001, 0.1, 0.1, 0.1]}}"
    )
    scenario = scenario_for(str(write_gripper(tmp_path)), "cube")
    scenario.sensor.file, scenario.sensor.calibration = str(tmp_path / "own.yaml"), "mine"
    scenario.validate()
    assert list(scenario.sensor.model().range) == [1, 1, 1, 20, 20, 20]
    scenario.sensor.calibration = "SI-12-0.12"
    with pytest.raises(InvalidInputError, match=r"own\.yaml: calibration"):
        scenario.validate()


def test_a_sensor_s_file_without_calibrations_is_refused(tmp_path: Path) -> None:
    (tmp_path / "none.yaml").write_text("calibrations: {}\n")
    with pytest.raises(InvalidFileError, match="calibrations must be at least one, not none"):
        sufficient_calibration(1.0, 0.01, tmp_path / "none.yaml")
