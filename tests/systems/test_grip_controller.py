from pathlib import Path

import numpy as np
import pytest
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import RevoluteJoint, SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder

from tactopose_drake.core.grasping import SLIDING_ARM
from tactopose_drake.errors import InvalidInputError, UnknownNameError
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import Hand, add_hand, make_hand_plant
from tactopose_drake.systems.grip_controller import GripController, GripControllerParams, set_motor_gains
from tests.hand.grippers import write_gripper

SPREAD = {"finger_1_spread_joint": 0.5}


class Closing:
    """The hand without an object, its fingers closing."""

    def __init__(self, params: GripControllerParams, block_at: float | None = None) -> None:
        builder = DiagramBuilder()
        self.plant, _ = AddMultibodyPlantSceneGraph(builder, 0.002)
        # Another joint with a position before the hand's.
        door = self.plant.AddRigidBody("door", SpatialInertia.SolidSphereWithMass(0.1, 0.02))
        self.plant.AddJoint(RevoluteJoint("hinge", self.plant.world_frame(), door.body_frame(), [0.0, 0.0, 1.0]))
        self.hand: Hand = add_hand(self.plant, load_hand_config("barrett_like"), RigidTransform())
        set_motor_gains(self.plant, self.hand, params)
        if block_at is not None:
            joint = self.plant.GetJointByName("finger_3_proximal_joint")
            joint.set_position_limits([0.0], [block_at])
        self.plant.Finalize()
        assert self.plant.GetJointByName("hinge").position_start() == 0
        self.controller = builder.AddNamedSystem("controller", GripController(self.plant, self.hand, params))
        instance = self.hand.model_instance
        builder.Connect(self.plant.get_state_output_port(instance), self.controller.GetInputPort("hand_state"))
        desired = self.plant.get_desired_state_input_port(instance)
        builder.Connect(self.controller.GetOutputPort("desired_state"), desired)
        self.diagram = builder.Build()
        self.use(self.diagram.CreateDefaultContext())

    def use(self, context: Context) -> None:
        """Goes on from a context of the diagram."""
        self.context = context
        self.plant_context = self.plant.GetMyMutableContextFromRoot(context)
        self.simulator = Simulator(self.diagram, context)

    def torques(self) -> np.ndarray:
        torques: np.ndarray = self.plant.get_net_actuation_output_port(self.hand.model_instance).Eval(
            self.plant_context
        )
        return torques

    def angle(self, joint: str) -> float:
        return float(self.plant.GetJointByName(joint).get_angle(self.plant_context))

    def holding(self) -> bool:
        context = self.controller.GetMyContextFromRoot(self.context)
        return bool(self.controller.GetOutputPort("holding").Eval(context)[0])

    def status(self) -> str:
        status: str = self.controller.GetOutputPort("status").Eval(self.controller.GetMyContextFromRoot(self.context))
        return status


def test_the_motors_get_their_gains_where_another_was_removed() -> None:
    plant = MultibodyPlant(0.002)
    door = plant.AddRigidBody("door", SpatialInertia.SolidSphereWithMass(0.1, 0.02))
    hinge = plant.AddJoint(RevoluteJoint("hinge", plant.world_frame(), door.body_frame(), [0.0, 0.0, 1.0]))
    motor = plant.AddJointActuator("motor", hinge)
    hand = add_hand(plant, load_hand_config("barrett_like"), RigidTransform())
    plant.RemoveJointActuator(motor)
    set_motor_gains(plant, hand, GripControllerParams(stiffness=40.0, damping=0.5))
    motors = [plant.get_joint_actuator(index) for index in plant.GetJointActuatorIndices()]
    assert len(motors) == 4
    assert {(each.get_controller_gains().p, each.get_controller_gains().d) for each in motors} == {(40.0, 0.5)}


def test_fingers_close_at_their_speed_and_the_spread_goes_where_it_is_told() -> None:
    hand = Closing(GripControllerParams(fixed=SPREAD, closing_speed=2.0))
    hand.simulator.AdvanceTo(0.4)
    for finger in (1, 2, 3):
        assert hand.angle(f"finger_{finger}_proximal_joint") == pytest.approx(0.8, abs=0.03)
        assert hand.angle(f"finger_{finger}_distal_joint") == pytest.approx(0.8 / 3, abs=0.015)
    assert hand.angle("finger_1_spread_joint") == pytest.approx(0.5, abs=0.01)
    assert hand.angle("finger_2_spread_joint") == pytest.approx(0.5, abs=0.01)
    assert not hand.holding()


def test_a_blocked_finger_pushes_with_the_stall_torque_and_the_hand_holds_when_all_are_blocked() -> None:
    hand = Closing(GripControllerParams(fixed=SPREAD, closing_speed=2.0, stall_torque=0.8), block_at=0.3)
    hand.simulator.AdvanceTo(0.5)
    assert hand.angle("finger_3_proximal_joint") == pytest.approx(0.3, abs=0.01)
    index = [
        hand.plant.get_joint_actuator(i).joint().name()
        for i in hand.plant.GetJointActuatorIndices(hand.hand.model_instance)
    ].index("finger_3_proximal_joint")
    assert 0.75 < hand.torques()[index] < 1.3
    assert not hand.holding()
    assert hand.status() == "closing: finger_1_proximal_joint, finger_2_proximal_joint"
    hand.simulator.AdvanceTo(1.4)  # the others come to their own limits
    assert hand.holding()
    assert hand.status() == "holding"


def with_gripper(folder: Path) -> tuple[DiagramBuilder, MultibodyPlant, Hand]:
    """A plant that is not finalized yet with a gripper of two fingers that slide."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 0.002)
    return builder, plant, add_hand(plant, load_hand_config(write_gripper(folder)), RigidTransform())


def closing(
    builder: DiagramBuilder, plant: MultibodyPlant, hand: Hand, params: GripControllerParams
) -> tuple[GripController, Simulator]:
    set_motor_gains(plant, hand, params)
    plant.Finalize()
    controller = builder.AddSystem(GripController(plant, hand, params))
    builder.Connect(plant.get_state_output_port(hand.model_instance), controller.get_input_port())
    desired = plant.get_desired_state_input_port(hand.model_instance)
    builder.Connect(controller.GetOutputPort("desired_state"), desired)
    return controller, Simulator(builder.Build())


def test_joints_that_slide_close_as_ones_that_turn_on_an_arm(tmp_path: Path) -> None:
    params = GripControllerParams(closing_speed=1.5, stall_torque=0.5)
    builder, plant, hand = with_gripper(tmp_path)
    plant.GetJointByName("right_slide").set_position_limits([0.0], [0.01])
    controller, simulator = closing(builder, plant, hand, params)
    plant_context = plant.GetMyContextFromRoot(simulator.get_context())
    status = controller.GetOutputPort("status")
    simulator.AdvanceTo(0.3)
    left = plant.GetJointByName("left_slide")
    assert left.get_translation(plant_context) == pytest.approx(0.3 * 1.5 * SLIDING_ARM, abs=1e-3)
    assert status.Eval(controller.GetMyContextFromRoot(simulator.get_context())) == "closing: left_slide"
    forces = plant.get_net_actuation_output_port(hand.model_instance).Eval(plant_context)
    assert forces[1] == pytest.approx(params.stall_torque / SLIDING_ARM, rel=0.1)
    simulator.AdvanceTo(1.0)
    assert left.get_translation(plant_context) == pytest.approx(0.045, abs=1e-3)
    assert status.Eval(controller.GetMyContextFromRoot(simulator.get_context())) == "holding"


def test_joints_of_no_finger_stay_where_they_are() -> None:
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 0.002)
    hand = add_hand(plant, load_hand_config("shadow_like"), RigidTransform())
    wrist = plant.GetJointByName("WRJ1")
    wrist.set_default_angle(-0.2)
    controller, simulator = closing(builder, plant, hand, GripControllerParams(stall_torque=20.0))
    simulator.AdvanceTo(0.3)
    plant_context = plant.GetMyContextFromRoot(simulator.get_context())
    assert wrist.get_angle(plant_context) == pytest.approx(-0.2, abs=0.03)  # it gives way a little
    assert plant.GetJointByName("FFJ3").get_angle(plant_context) > 0.3
    status = controller.GetOutputPort("status").Eval(controller.GetMyContextFromRoot(simulator.get_context()))
    assert "WRJ" not in status


def test_a_joint_may_close_towards_smaller_positions(tmp_path: Path) -> None:
    params = GripControllerParams(falling=["left_slide"], stall_torque=0.5)
    builder, plant, hand = with_gripper(tmp_path)
    plant.GetJointByName("left_slide").set_default_translation(0.04)
    controller, simulator = closing(builder, plant, hand, params)
    simulator.AdvanceTo(0.3)
    plant_context = plant.GetMyContextFromRoot(simulator.get_context())
    left, right = (plant.GetJointByName(f"{name}_slide").get_translation(plant_context) for name in ("left", "right"))
    assert left == pytest.approx(0.04 - right, abs=1e-3)
    assert right == pytest.approx(0.3 * params.closing_speed * SLIDING_ARM, abs=1e-3)
    simulator.AdvanceTo(1.0)
    forces = plant.get_net_actuation_output_port(hand.model_instance).Eval(plant_context)
    assert min(-forces[0], forces[1]) > 0.9 * params.stall_torque / SLIDING_ARM, "both press against their limits"
    assert controller.GetOutputPort("holding").Eval(controller.GetMyContextFromRoot(simulator.get_context()))[0] == 1.0


def test_the_commands_start_where_the_hand_is() -> None:
    hand = Closing(GripControllerParams(fixed=SPREAD))
    hand.plant.GetJointByName("finger_2_proximal_joint").set_angle(hand.plant_context, 0.9)
    hand.plant.GetJointByName("finger_2_distal_joint").set_angle(hand.plant_context, 0.3)
    hand.simulator.Initialize()
    desired = hand.controller.GetOutputPort("desired_state").Eval(hand.controller.GetMyContextFromRoot(hand.context))
    np.testing.assert_allclose(desired, [0.5, 0, 0.9, 0, 0, 1.5, 1.5, 1.5])


def test_a_context_that_is_initialised_again_goes_on_as_it_was() -> None:
    hand = Closing(GripControllerParams(fixed=SPREAD, closing_speed=2.0, stall_torque=0.8))
    for until, has_stalled in ((0.3, False), (1.6, True)):  # before, the closing joints lag behind their commands
        hand.simulator.AdvanceTo(until)
        assert hand.holding() == has_stalled
        again = hand.context.Clone()
        hand.simulator.AdvanceTo(until + 0.1)
        torques = hand.torques()
        hand.use(again)
        hand.simulator.AdvanceTo(until + 0.1)
        np.testing.assert_array_equal(hand.torques(), torques)
    assert (torques > 0.7).sum() == 3, "three motors press"


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"closing_speed": 0.0}, "closing_speed must be .*, not 0"),
        ({"stall_torque": -1.0}, "stall_torque must be .*, not -1"),
        ({"stiffness": np.nan}, "stiffness must be .*, not nan"),
        ({"damping": -0.1}, "damping must be .*, not -0.1"),
        ({"period": 0.0}, "period must be .*, not 0"),
        ({"fixed": SPREAD, "falling": list(SPREAD)}, "falling must not have 'finger_1_spread_joint', which is fixed"),
        ({"fixed": {"finger_1_spread_joint": np.inf}}, r"fixed\[finger_1_spread_joint\] must be .*, not inf"),
    ],
)
def test_a_bad_parameter_is_named(values: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        GripControllerParams(**values).validate()


def test_a_joint_without_a_motor_can_neither_be_fixed_nor_close() -> None:
    plant, hand = make_hand_plant(load_hand_config("barrett_like"))
    assert isinstance(plant, MultibodyPlant)
    with pytest.raises(UnknownNameError, match=r"must be one of finger_1_spread.*, not 'finger_2_spread_joint'"):
        GripController(plant, hand, GripControllerParams(fixed={"finger_2_spread_joint": 0.1}))
    with pytest.raises(UnknownNameError, match=r"falling must be one of .*, not 'finger_2_spread_joint'"):
        GripController(plant, hand, GripControllerParams(falling=["finger_2_spread_joint"]))
