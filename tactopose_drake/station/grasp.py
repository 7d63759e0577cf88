"""How a station's hand grasps the object: by a planned grasp of its fingertips, or by closing until it stalls."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder, OutputPort

from tactopose_drake.core.grasping.grasp_plan import GraspPlan
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.hand.hand_in_plant import Hand
from tactopose_drake.hand.hand_joints import HandJoints
from tactopose_drake.hand.hand_reach import check_rest_positions, check_within_limits, rest_posture
from tactopose_drake.resources import drawn_pose
from tactopose_drake.station.scenario import Scenario
from tactopose_drake.systems.grasp_controller import GraspController
from tactopose_drake.systems.grip_controller import GripController

# A push below all that occur, which gives the hand's open posture.
_OPEN = -np.inf


@dataclass(frozen=True, eq=False)
class GraspStart:
    """The start of a grasp.

    Attributes:
        q: joint positions of the open hand, shape (nq,), rad.
        X_PO: pose of the object, which is fixed there until the fingers have closed.
    """

    q: FloatArray
    X_PO: RigidTransform


def add_planned_grasp(
    builder: DiagramBuilder,
    scenario: Scenario,
    plant: MultibodyPlant,
    hand: Hand,
    senses: Mapping[str, OutputPort],
    plan: GraspPlan,
) -> GraspStart:
    """Adds a controller that closes the fingers as planned, using their wrenches.

    Raises:
        InvalidInputError: if a joint's rest position is beyond its limits.
    """
    check_rest_positions(plant, hand)
    motions = {finger: part.motion for finger, part in plan.fingers.items()}
    controller = builder.AddNamedSystem(
        "grasp_controller",
        GraspController(plant, hand, motions, rest_posture(plant, hand, plan.waiting), scenario.controller),
    )
    for finger in motions:
        builder.Connect(senses[f"wrench_{finger}"], controller.GetInputPort(f"wrench_{finger}"))
    builder.Connect(controller.GetOutputPort("actuation"), plant.get_actuation_input_port(hand.model_instance))
    builder.ExportOutput(controller.GetOutputPort("actuation"), "actuation")
    _connect_controller(builder, plant, hand, controller)
    q = controller.commanded(np.full(len(motions), _OPEN))
    q = HandJoints.of(plant, hand).with_followers(q, hand.config.couplings)
    return GraspStart(q, planned_pose(plan))


def add_grip(builder: DiagramBuilder, scenario: Scenario, plant: MultibodyPlant, hand: Hand) -> GraspStart:
    """Adds a controller that closes the fingers until they stall; needs `set_motor_gains` before.

    Raises:
        InvalidInputError: if a joint's rest position, or one that it is kept at, is beyond its limits.
    """
    check_rest_positions(plant, hand)
    assert scenario.grip is not None
    params = scenario.grip.controller
    controller = builder.AddNamedSystem("grip_controller", GripController(plant, hand, params))
    check_within_limits("GripControllerParams.fixed", params.fixed, plant, hand)
    builder.Connect(controller.GetOutputPort("desired_state"), plant.get_desired_state_input_port(hand.model_instance))
    _connect_controller(builder, plant, hand, controller)
    q, joints = rest_posture(plant, hand), HandJoints.of(plant, hand)
    for joint, position in params.fixed.items():
        q[joints.position[joint]] = position
    X_PO = drawn_pose(f"Grip.X_PO[{scenario.object}]", scenario.grip.X_PO[scenario.object], scenario.seed)
    return GraspStart(joints.with_followers(q, hand.config.couplings), X_PO)


def planned_pose(plan: GraspPlan) -> RigidTransform:
    """X_PO of a plan."""
    return RigidTransform(RotationMatrix(plan.X_PO[:, :3]), plan.X_PO[:, 3])


def _connect_controller(
    builder: DiagramBuilder, plant: MultibodyPlant, hand: Hand, controller: GraspController | GripController
) -> None:
    """Connects and exports the ports that both controllers have in common."""
    state = plant.get_state_output_port(hand.model_instance)
    builder.Connect(state, controller.GetInputPort("hand_state"))
    builder.ExportOutput(state, "hand_state")
    builder.ExportOutput(controller.GetOutputPort("holding"), "holding")
    builder.ExportOutput(controller.GetOutputPort("status"), "grasp_status")
