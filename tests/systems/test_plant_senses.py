"""Estimation and tracking that take joints, palm and touch from a plant with more in it than the hand."""

from pathlib import Path

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import PdControllerGains
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, PassThrough

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.hand_config import HandConfig, load_hand_config
from tactopose_drake.hand.hand_in_plant import Hand, add_hand, make_hand_plant
from tactopose_drake.hand.hand_joints import HandJoints
from tactopose_drake.resources import model_path
from tactopose_drake.systems.pose_estimation import AddPoseEstimation, PoseEstimationParams
from tactopose_drake.systems.pose_tracking import AddPoseTracking, PoseTrackingParams
from tactopose_drake.systems.touch_exploration import AddTouchExploration
from tests.core.tracking.boxes import make_box
from tests.hand.grippers import write_gripper

X_WBASE = RigidTransform(RollPitchYaw(0.4, -0.3, 0.8), [0.3, 0.2, 1.0])


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    return make_box()


def full_plant(builder: DiagramBuilder, *hands: str) -> tuple[MultibodyPlant, list[Hand]]:
    """Hands between a free object and another; their joints are held where they are."""
    plant, _ = AddMultibodyPlant(MultibodyPlantConfig(time_step=0.004), builder)
    Parser(plant).AddModels(str(model_path("objects", "mug.sdf")))
    added = []
    for place, name in enumerate(hands):
        X_WBase = RigidTransform([0.0, 0.0, 3.0 * place]) @ X_WBASE
        plant.RenameModelInstance(
            (hand := add_hand(plant, load_hand_config(name), X_WBase)).model_instance, f"h{place}"
        )
        added.append(hand)
    Parser(plant).AddModels(str(model_path("objects", "bust.sdf")))
    for index in plant.GetJointActuatorIndices():
        plant.get_joint_actuator(index).set_controller_gains(PdControllerGains(p=5.0, d=0.1))
    plant.Finalize()
    for hand in added:
        count = plant.num_actuators(hand.model_instance)
        hold = builder.AddSystem(ConstantVectorSource(np.zeros(2 * count)))
        builder.Connect(hold.get_output_port(), plant.get_desired_state_input_port(hand.model_instance))
    return plant, added


def evaluated(diagram: Diagram, root, system: Diagram, port: str):
    """What stands at an input port."""
    return system.GetInputPort(port).Eval(system.GetMyContextFromRoot(root))


def test_joints_and_palm_are_those_of_the_hand_in_the_plant(box: ObjectModel) -> None:
    builder = DiagramBuilder()
    plant, (_, hand) = full_plant(builder, "barrett_like", "shadow_like")
    tracking = AddPoseTracking(builder, hand.config, box, PoseTrackingParams(use_hand_volume=False), plant=plant)
    diagram = builder.Build()
    root = diagram.CreateDefaultContext()
    context = plant.GetMyMutableContextFromRoot(root)
    generator = np.random.default_rng(0)
    alone, hand_alone = make_hand_plant(hand.config)
    here, there = HandJoints.of(alone, hand_alone), HandJoints.of(plant, hand)
    q, v = generator.normal(size=(2, alone.num_positions()))
    plant.SetPositions(
        context, hand.model_instance, q[here.positions(there.position)][np.argsort(list(there.position.values()))]
    )
    plant.SetVelocities(
        context, hand.model_instance, v[here.velocities(there.velocity)][np.argsort(list(there.velocity.values()))]
    )
    np.testing.assert_array_equal(evaluated(diagram, root, tracking, "joint_positions"), q)
    np.testing.assert_array_equal(evaluated(diagram, root, tracking, "joint_velocities"), v)
    palm = evaluated(diagram, root, tracking, "palm_pose")
    assert palm.IsNearlyEqualTo(hand.palm_frame.CalcPoseInWorld(context), 1e-12)
    # The kinematics inside agree with the plant's: where a fingertip is in the palm.
    alone_context = alone.CreateDefaultContext()
    alone.SetPositions(alone_context, evaluated(diagram, root, tracking, "joint_positions"))
    for finger, frame in hand.sensor_frames.items():
        inside = alone.CalcRelativeTransform(alone_context, hand_alone.palm_frame, hand_alone.sensor_frames[finger])
        assert inside.IsNearlyEqualTo(plant.CalcRelativeTransform(context, hand.palm_frame, frame), 1e-9)


@pytest.mark.parametrize("gravity", [True, False])
def test_a_hand_that_touches_nothing_feels_nothing(box: ObjectModel, gravity: bool) -> None:
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlant(MultibodyPlantConfig(time_step=0.004), builder)
    hand = add_hand(plant, load_hand_config("shadow_like"), X_WBASE)
    plant.set_gravity_enabled(hand.model_instance, gravity)
    for index in plant.GetJointActuatorIndices():
        plant.get_joint_actuator(index).set_controller_gains(PdControllerGains(p=5.0, d=0.1))
    plant.Finalize()
    hold = builder.AddSystem(ConstantVectorSource(np.zeros(2 * plant.num_actuators())))
    builder.Connect(hold.get_output_port(), plant.get_desired_state_input_port(hand.model_instance))
    params = PoseEstimationParams(use_hand_volume=False, check_collisions=False)
    params.estimator.period = 10.0
    estimation = AddPoseEstimation(builder, hand.config, box, params, plant=plant)
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(1.0)
    for finger in hand.sensor_frames:
        F_S = evaluated(simulator.get_system(), simulator.get_context(), estimation, f"wrench_{finger}")
        assert np.linalg.norm(F_S[3:]) < 0.03  # Neither its weight nor what was taken off for it.
    status = estimation.GetOutputPort("contact_status")
    said = status.Eval(estimation.GetMyContextFromRoot(simulator.get_context()))
    assert said.count("the force is below min_force") == 5


def test_pads_feel_by_the_plants_contacts(box: ObjectModel) -> None:
    builder = DiagramBuilder()
    plant, (hand,) = full_plant(builder, "barrett_like")
    params = PoseTrackingParams(use_joint_velocities=False, use_hand_volume=False)
    tracking = AddPoseTracking(builder, hand.config, box, params, plant=plant)
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(0.06)
    for pad in hand.config.pads:
        pressures = evaluated(simulator.get_system(), simulator.get_context(), tracking, f"pressures_{pad.name}")
        np.testing.assert_allclose(pressures, 0.0, atol=500.0)


def test_real_senses_are_left_to_be_connected(box: ObjectModel) -> None:
    builder = DiagramBuilder()
    plant, (hand,) = full_plant(builder, "shadow_like")
    params = PoseEstimationParams(use_hand_volume=False, check_collisions=False)
    estimation = AddPoseEstimation(builder, hand.config, box, params, plant=plant, simulated_senses=False)
    source = builder.AddSystem(ConstantVectorSource(np.arange(6.0)))
    builder.Connect(source.get_output_port(), estimation.GetInputPort("wrench_thumb"))
    diagram = builder.Build()
    root = diagram.CreateDefaultContext()
    np.testing.assert_array_equal(evaluated(diagram, root, estimation, "wrench_thumb"), np.arange(6.0))
    assert not estimation.GetInputPort("wrench_first").HasValue(estimation.GetMyContextFromRoot(root))
    assert estimation.GetInputPort("joint_positions").HasValue(estimation.GetMyContextFromRoot(root))


def test_a_plant_without_the_hand_with_two_or_unfinished_is_refused(box: ObjectModel) -> None:
    params = PoseEstimationParams(use_hand_volume=False, check_collisions=False)
    config = load_hand_config("shadow_like")
    builder = DiagramBuilder()
    plant, _ = full_plant(builder, "barrett_like")
    with pytest.raises(
        InvalidInputError,
        match=r"plant must have a model that is the hand, but none is. .*h0: .* must be one of .*, not",
    ):
        AddPoseEstimation(builder, config, box, params, plant=plant)
    # What was not added has no name that is taken: another hand's estimation may be added instead.
    added = AddPoseEstimation(builder, load_hand_config("barrett_like"), box, params, plant=plant)
    assert [each for each in builder.GetSystems() if each.get_name() == "pose_estimation"] == [added]
    empty = MultibodyPlant(0.0)
    empty.Finalize()
    with pytest.raises(
        InvalidInputError, match=r"plant must have a model that is the hand, but none is\. None of them has a joint\.$"
    ):
        AddPoseTracking(DiagramBuilder(), config, box, PoseTrackingParams(use_hand_volume=False), plant=empty)
    builder = DiagramBuilder()
    plant, _ = full_plant(builder, "shadow_like", "shadow_like")
    with pytest.raises(
        InvalidInputError,
        match=r"plant must have one model that is the hand, not several, h0, h1\. Pass the hand itself",
    ):
        AddPoseEstimation(builder, config, box, params, plant=plant)
    plant, _ = AddMultibodyPlant(MultibodyPlantConfig(time_step=0.004), DiagramBuilder())
    with pytest.raises(InvalidInputError, match="plant must be finalized, but is not"):
        AddPoseEstimation(DiagramBuilder(), config, box, params, plant=plant)
    with pytest.raises(InvalidInputError, match="plant must be a MultibodyPlant, not a str"):
        AddPoseEstimation(DiagramBuilder(), config, box, params, plant="plant")


@pytest.mark.parametrize("add", [AddPoseEstimation, AddPoseTracking])
def test_of_two_hands_alike_each_can_be_meant(add, box: ObjectModel) -> None:  # type: ignore[no-untyped-def]
    builder = DiagramBuilder()
    plant, hands = full_plant(builder, "shadow_like", "shadow_like")
    params = (PoseEstimationParams if add is AddPoseEstimation else PoseTrackingParams)(
        use_hand_volume=False, check_collisions=False
    )
    for i, hand in enumerate(hands):
        add(builder, hand.config, box, params, name=f"of_{i}", plant=hand)
    diagram = builder.Build()
    root = diagram.CreateDefaultContext()
    context = plant.GetMyMutableContextFromRoot(root)
    for i, hand in enumerate(hands):
        plant.SetPositions(context, hand.model_instance, np.full(24, 0.1 + i))
    for i in range(len(hands)):
        joints = evaluated(diagram, root, diagram.GetSubsystemByName(f"of_{i}"), "joint_positions")
        np.testing.assert_array_equal(joints, np.full(24, 0.1 + i))


BARE = PoseEstimationParams(use_hand_volume=False, check_collisions=False)


def gripper_plant(builder: DiagramBuilder, config: HandConfig, urdf: str) -> MultibodyPlant:
    """A plant with the gripper as another file has it; its names are those of the hand."""
    plant, _ = AddMultibodyPlant(MultibodyPlantConfig(time_step=0.004), builder)
    (model,) = Parser(plant).AddModelsFromString(urdf, "urdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(config.base_link, model), X_WBASE)
    plant.Finalize()
    return plant


@pytest.mark.parametrize(
    ("told", "other", "message"),
    [
        (
            'xyz="-0.06 0 0.1"',
            'xyz="-0.06 0 0.14"',
            "sensor of finger 'left' within .*, not 40.0 mm and 0.0 deg off",
        ),
        (
            'xyz="-0.06 0 0.1"',
            'xyz="-0.06 0 0.1" rpy="0 0.5 0"',
            "sensor of finger 'left' within .*, not 0.0 mm and 28.6 deg off",
        ),
        (
            '<axis xyz="-1 0 0"/>',
            '<axis xyz="0 1 0"/>',
            "sensor of finger 'right' within .*, not .* mm and 0.0 deg off",
        ),
        (
            '"left_slide" type="prismatic"',
            '"left_slide" type="revolute"',
            "'left_slide' as a prismatic one, like .*, not a revolute one",
        ),
    ],
)
@pytest.mark.parametrize("add", [AddPoseEstimation, AddPoseTracking])
def test_a_hand_of_another_geometry_is_refused(add, told, other, message, box: ObjectModel, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    config = load_hand_config(write_gripper(tmp_path))
    urdf = (tmp_path / "two_finger.urdf").read_text()
    assert told in urdf
    builder = DiagramBuilder()
    plant = gripper_plant(builder, config, urdf.replace(told, other))
    params = BARE if add is AddPoseEstimation else PoseTrackingParams(use_hand_volume=False, check_collisions=False)
    with pytest.raises(InvalidInputError, match=f"^plant must .*{message}"):
        add(builder, config, box, params, plant=plant)
    assert len(builder.GetSystems()) == 2  # Plant and scene.


@pytest.mark.parametrize("add", [AddPoseEstimation, AddPoseTracking])
def test_a_sensor_frame_on_another_finger_is_refused(add, box: ObjectModel, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    config = load_hand_config(write_gripper(tmp_path))
    config.fingers[0].sensor_frame, config.fingers[1].sensor_frame = "right_tip", "left_tip"
    builder = DiagramBuilder()
    plant = gripper_plant(builder, config, (tmp_path / "two_finger.urdf").read_text())
    params = BARE if add is AddPoseEstimation else PoseTrackingParams(use_hand_volume=False, check_collisions=False)
    with pytest.raises(InvalidInputError, match=r"^the sensor frame 'right_tip' .* left_tip, not on 'right_tip'"):
        add(builder, config, box, params, plant=plant)
    assert len(builder.GetSystems()) == 2  # Plant and scene.


def test_a_hand_whose_file_is_rounded_is_the_same(box: ObjectModel, tmp_path: Path) -> None:
    config = load_hand_config(write_gripper(tmp_path))
    urdf = (tmp_path / "two_finger.urdf").read_text()
    builder = DiagramBuilder()
    plant = gripper_plant(builder, config, urdf.replace('xyz="-0.06 0 0.1"', 'xyz="-0.06004 0 0.1" rpy="0.001 0 0"'))
    estimation = AddPoseEstimation(builder, config, box, BARE, plant=plant)
    assert estimation in builder.GetSystems()


def test_another_builders_plant_and_a_switch_that_is_none_leave_the_builder_as_it_was(box: ObjectModel) -> None:
    builder, other = DiagramBuilder(), DiagramBuilder()
    plant, (hand,) = full_plant(other, "shadow_like")
    with pytest.raises(InvalidInputError, match=r"^plant must be one that was added to the same builder"):
        AddPoseEstimation(builder, hand.config, box, BARE, plant=plant)
    with pytest.raises(InvalidInputError, match=r"^simulated_senses must be True or False, not 'no'"):
        AddPoseEstimation(builder, hand.config, box, BARE, simulated_senses="no")
    assert builder.empty()


@pytest.mark.parametrize("hand_name", ["shadow_like", "barrett_like"])
def test_the_names_of_all_that_is_added_must_be_free(hand_name: str, box: ObjectModel) -> None:
    builder = DiagramBuilder()
    _, (hand,) = full_plant(builder, hand_name)
    params = PoseTrackingParams(use_hand_volume=False, check_collisions=False)
    before = len(builder.GetSystems())
    AddPoseTracking(builder, hand.config, box, params, "first", plant=hand)
    parts = sorted(system.get_name().removeprefix("first") for system in builder.GetSystems()[before:])
    assert parts[0] == ""
    for part in reversed(parts[1:]):
        builder.AddNamedSystem(f"second{part}", PassThrough(1))
        systems = builder.GetSystems()
        with pytest.raises(
            InvalidInputError, match=f"^name must be .*, not 'second', as another .* is called 'second{part}'"
        ):
            AddPoseTracking(builder, hand.config, box, params, "second", plant=hand)
        assert builder.GetSystems() == systems
    builder.Build()


@pytest.mark.parametrize("add", [AddPoseEstimation, AddPoseTracking, AddTouchExploration])
def test_a_second_one_needs_another_name(add, box: ObjectModel) -> None:  # type: ignore[no-untyped-def]
    builder = DiagramBuilder()
    config = load_hand_config("shadow_like")
    first = add(builder, config, box)
    name = first.get_name()
    with pytest.raises(
        InvalidInputError, match=rf"^name must be one that no other system .* such as '{name}_2', not '{name}'"
    ):
        add(builder, config, box)
    assert builder.GetSystems() == [first]
    add(builder, config, box, name=f"{name}_2")
    builder.Build()
