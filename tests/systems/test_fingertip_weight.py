"""The weight of the fingertips at their sensors, and taking its turning off."""

from pathlib import Path

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.systems.analysis import Simulator

from tactopose_drake.hand.fingertip_weights import FingertipWeights
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.systems.fingertip_weight import FingertipWeight
from tests import held_cube
from tests.hand.grippers import write_gripper

TOUCH = np.array([0.01, -0.02, 0.03, 1.0, 2.0, -3.0])
R_WBASE = RotationMatrix(RollPitchYaw(np.pi, -np.pi / 2, 0.3))


@pytest.fixture(scope="module")
def hand():
    return make_hand_plant(load_hand_config("shadow_like"))


def test_the_weight_points_down_and_acts_in_the_centre_of_mass(hand) -> None:
    plant, parts = hand
    weights = FingertipWeights(plant, parts, R_WBASE).wrenches(held_cube.Q)
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, held_cube.Q)
    for finger, frame in parts.sensor_frames.items():
        tip = parts.welds[finger].child_body()
        R_WS = R_WBASE @ frame.CalcRotationMatrixInWorld(context)
        np.testing.assert_allclose(R_WS @ weights[finger][3:], [0, 0, -9.81 * tip.get_mass(context)], atol=1e-12)
        X_STip = plant.CalcRelativeTransform(context, frame, tip.body_frame())
        p_Scm = X_STip @ tip.CalcCenterOfMassInBodyFrame(context)
        np.testing.assert_allclose(weights[finger][:3], np.cross(p_Scm, weights[finger][3:]), atol=1e-12)


def test_what_is_fixed_on_a_fingertip_weighs_too(tmp_path: Path) -> None:
    path, model = write_gripper(tmp_path), tmp_path / "two_finger.urdf"
    cover = (
        '<link name="cover"><inertial><origin xyz="0.004 0 0"/><mass value="0.03"/><inertia ixx="1e-6" ixy="0" '
        'ixz="0" iyy="1e-6" iyz="0" izz="1e-6"/></inertial></link><joint name="glue" type="fixed">'
        '<parent link="left_tip"/><child link="cover"/><origin xyz="0 0 0.008" rpy="0 0 1.5707963267948966"/></joint>'
    )
    model.write_text(model.read_text().replace("</robot>", f"{cover}</robot>"))
    plant, parts = make_hand_plant(load_hand_config(path))
    weights = FingertipWeights(plant, parts, RotationMatrix()).wrenches(np.zeros(2))
    np.testing.assert_allclose(weights["left"], [-9.81 * 0.03 * 0.004, 0, 0, 0, 0, -9.81 * 0.04], atol=1e-12)
    np.testing.assert_allclose(weights["right"], [0, 0, 0, 0, 0, -9.81 * 0.01], atol=1e-12)


def test_a_touch_comes_out_whole_however_the_finger_has_turned(hand) -> None:
    plant, parts = hand
    weights = FingertipWeights(plant, parts, R_WBASE)
    system = FingertipWeight(weights, ("thumb", "first"), plant.num_positions())
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    q_tare = np.zeros(plant.num_positions())
    at_tare = weights.wrenches(q_tare)
    for q in (q_tare, held_cube.Q, -0.3 * held_cube.Q):
        system.GetInputPort("joint_positions").FixValue(context, q_tare if q is q_tare else q)
        for finger in ("thumb", "first"):
            measured = TOUCH + weights.wrenches(q)[finger] - at_tare[finger]  # as a sensor that was tared at q_tare
            system.GetInputPort(f"wrench_{finger}").FixValue(context, measured)
        if q is q_tare:
            simulator.Initialize()
        for finger in ("thumb", "first"):
            np.testing.assert_allclose(system.GetOutputPort(f"wrench_{finger}").Eval(context), TOUCH, atol=1e-12)
    # There was something to take off.
    assert np.linalg.norm(weights.wrenches(held_cube.Q)["first"][3:] - at_tare["first"][3:]) > 0.005


def test_a_touch_comes_out_whole_on_an_arm_that_turns_the_palm(hand) -> None:
    plant, parts = hand
    weights = FingertipWeights(plant, parts, RotationMatrix())
    system = FingertipWeight(weights, ("thumb", "first"), plant.num_positions())
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    # Where the arm holds the palm is told, and so no joint between base and palm matters.
    q = held_cube.Q.copy()
    q[plant.GetJointByName("WRJ1").position_start()] = np.nan
    system.GetInputPort("joint_positions").FixValue(context, q)
    palms = [RotationMatrix(RollPitchYaw(*angles)) for angles in ((0.0, 0.0, 0.0), (np.pi, 0.4, 1.0), (0.3, -1.2, 2.0))]
    at_tare = weights.wrenches(q, palms[0])
    for palm in palms:
        system.GetInputPort("palm_pose").FixValue(context, AbstractValue.Make(RigidTransform(palm, [1.0, 2.0, 3.0])))
        for finger in ("thumb", "first"):
            measured = TOUCH + weights.wrenches(q, palm)[finger] - at_tare[finger]
            system.GetInputPort(f"wrench_{finger}").FixValue(context, measured)
        if palm is palms[0]:
            simulator.Initialize()
        for finger in ("thumb", "first"):
            np.testing.assert_allclose(system.GetOutputPort(f"wrench_{finger}").Eval(context), TOUCH, atol=1e-12)
    # Upside down, the weight at the sensor is the other way round.
    assert np.linalg.norm(weights.wrenches(q, palms[1])["first"][3:] - at_tare["first"][3:]) > 0.1


def test_a_context_that_is_initialised_again_keeps_the_tare(hand) -> None:
    plant, parts = hand
    system = FingertipWeight(FingertipWeights(plant, parts, R_WBASE), ("thumb", "first"), plant.num_positions())
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    for finger in ("thumb", "first"):
        system.GetInputPort(f"wrench_{finger}").FixValue(context, TOUCH)
    # The thumb's joints are not known at first: it has no tare until they are.
    q = np.zeros(plant.num_positions())
    q[plant.GetJointByName("THJ4").position_start()] = np.nan
    system.GetInputPort("joint_positions").FixValue(context, q)
    simulator.Initialize()
    system.GetInputPort("joint_positions").FixValue(context, held_cube.Q)
    before = system.GetOutputPort("wrench_first").Eval(context)
    assert np.abs(before - TOUCH).max() > 1e-4
    assert np.isnan(system.GetOutputPort("wrench_thumb").Eval(context)).all()
    again = context.Clone()
    Simulator(system, again).Initialize()
    np.testing.assert_array_equal(system.GetOutputPort("wrench_first").Eval(again), before)
    np.testing.assert_allclose(system.GetOutputPort("wrench_thumb").Eval(again), TOUCH)


def test_while_the_palm_pose_is_not_known_there_is_no_reading(hand) -> None:
    plant, parts = hand
    weights = FingertipWeights(plant, parts, RotationMatrix())
    system = FingertipWeight(weights, ("thumb",), plant.num_positions())
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    unknown = RigidTransform(np.full(3, np.nan))  # its rotation is the identity, which says nothing
    system.GetInputPort("joint_positions").FixValue(context, held_cube.Q)
    system.GetInputPort("wrench_thumb").FixValue(context, TOUCH)
    felt = system.GetOutputPort("wrench_thumb")
    system.GetInputPort("palm_pose").FixValue(context, AbstractValue.Make(unknown))
    simulator.Initialize()  # nor is the tare's weight known
    assert np.isnan(felt.Eval(context)).all()
    turned = RigidTransform(RotationMatrix.MakeXRotation(1.0), [1.0, 2.0, 3.0])
    system.GetInputPort("palm_pose").FixValue(context, AbstractValue.Make(turned))
    simulator.Initialize()
    np.testing.assert_allclose(felt.Eval(context), TOUCH, atol=1e-12)
    system.GetInputPort("palm_pose").FixValue(context, AbstractValue.Make(unknown))
    assert np.isnan(felt.Eval(context)).all()


def test_the_weight_by_the_palm_is_that_by_the_base(hand) -> None:
    plant, parts = hand
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, held_cube.Q)
    R_WP = R_WBASE @ parts.palm_frame.CalcRotationMatrixInWorld(context)
    weights = FingertipWeights(plant, parts, R_WBASE)
    by_base, by_palm = weights.wrenches(held_cube.Q), weights.wrenches(held_cube.Q, R_WP)
    for finger, wrench in by_base.items():
        np.testing.assert_allclose(by_palm[finger], wrench, atol=1e-12)


def test_a_joint_that_is_not_known_spares_the_other_fingers(hand) -> None:
    plant, parts = hand
    q = held_cube.Q.copy()
    q[plant.GetJointByName("THJ4").position_start()] = np.nan
    wrenches = FingertipWeights(plant, parts, RotationMatrix()).wrenches(q)
    assert np.isnan(wrenches["thumb"]).all()
    assert all(np.isfinite(wrench).all() for finger, wrench in wrenches.items() if finger != "thumb")
    q[plant.GetJointByName("WRJ1").position_start()] = np.nan  # the wrist turns them all
    wrenches = FingertipWeights(plant, parts, RotationMatrix()).wrenches(q)
    assert all(np.isnan(wrench).all() for wrench in wrenches.values())


def test_a_reading_that_cannot_be_true_counts_for_nothing(hand) -> None:
    plant, parts = hand
    q = held_cube.Q.copy()
    q[plant.GetJointByName("THJ4").position_start()] = 40.0
    wrenches = FingertipWeights(plant, parts, RotationMatrix()).wrenches(q)
    assert np.isnan(wrenches["thumb"]).all()
    assert all(np.isfinite(wrench).all() for finger, wrench in wrenches.items() if finger != "thumb")


def test_contexts_share_no_kinematics(hand) -> None:
    plant, parts = hand
    weights = FingertipWeights(plant, parts, R_WBASE)
    system = FingertipWeight(weights, ("thumb",), plant.num_positions())
    one, other = system.CreateDefaultContext(), system.CreateDefaultContext()
    for context, q in ((one, 0.0 * held_cube.Q), (other, held_cube.Q)):
        system.GetInputPort("joint_positions").FixValue(context, q)
        system.GetInputPort("wrench_thumb").FixValue(context, TOUCH)
        Simulator(system, context).Initialize()
    system.GetInputPort("joint_positions").FixValue(one, held_cube.Q)
    turned = weights.wrenches(held_cube.Q)["thumb"] - weights.wrenches(0.0 * held_cube.Q)["thumb"]
    np.testing.assert_allclose(system.GetOutputPort("wrench_thumb").Eval(one), TOUCH - turned, atol=1e-12)
    np.testing.assert_allclose(system.GetOutputPort("wrench_thumb").Eval(other), TOUCH, atol=1e-12)


def test_joints_that_are_known_only_later_make_the_tare_then(hand) -> None:
    plant, parts = hand
    system = FingertipWeight(FingertipWeights(plant, parts, R_WBASE), ("thumb",), plant.num_positions())
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    system.GetInputPort("wrench_thumb").FixValue(context, TOUCH)
    system.GetInputPort("joint_positions").FixValue(context, np.full(plant.num_positions(), np.nan))
    simulator.Initialize()
    simulator.AdvanceTo(0.1)
    assert np.isnan(system.GetOutputPort("wrench_thumb").Eval(context)).all()
    system.GetInputPort("joint_positions").FixValue(context, held_cube.Q)
    simulator.AdvanceTo(0.2)
    simulator.AdvanceTo(0.3)
    np.testing.assert_allclose(system.GetOutputPort("wrench_thumb").Eval(context), TOUCH, atol=1e-12)
