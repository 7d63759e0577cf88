"""Builds the diagram of a scenario: a simulated hand with its senses, a grasp controller, and the pose estimation."""

from dataclasses import dataclass

import numpy as np
from pydrake.geometry import Meshcat, MeshcatVisualizer, SceneGraph
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant
from pydrake.multibody.tree import Joint, RigidBody
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, EventStatus
from pydrake.systems.primitives import AddRandomInputs, Demultiplexer

from tactopose_drake.core.grasping.grasp_planner import GraspPlan
from tactopose_drake.core.objects import ObjectModel
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.grasping.grasp_planning import plan_scenario
from tactopose_drake.grasping.hand_reach import rest_positions
from tactopose_drake.hand import Hand, add_hand, load_hand_config, make_parser
from tactopose_drake.scenario import Scenario
from tactopose_drake.systems.force_torque_sensor import ForceTorqueSensor, load_force_torque_model
from tactopose_drake.systems.grasp_controller import GraspController, hand_layout
from tactopose_drake.systems.pose_display import PoseDisplay
from tactopose_drake.systems.pose_estimation import AddPoseEstimation
from tactopose_drake.systems.random_sources import seed_random_sources
from tactopose_drake.systems.simulated_vision import SimulatedVision

# A push below any that occurs: the hand's open posture.
_OPEN = -np.inf


@dataclass(frozen=True, eq=False)
class Station:
    """The diagram of a scenario, and the parts of it that one wants to get at.

    Attributes:
        diagram: ports `hand_state`, `wrench_<finger>`, `actuation`, `holding`, `grasp_status`, `prior`, `hidden_share`,
            `object_pose`, `hypotheses`, `status`, `contacts`, `fingers_in_contact`, `contact_status`,
            `contact_solutions`, `contact_results`, `body_poses`, `query`.
        plant: the simulator's plant: hand and object.
        scene_graph: their geometry.
        hand: the hand in the plant.
        object_body: the object; its body frame is O.
        object_joint: its six degrees of freedom; locked, it holds the object while the fingers close.
        model: the object's model for estimation.
        plan: where the object is held, and how the fingers close.
        scenario: what all this was made from.
    """

    diagram: Diagram
    plant: MultibodyPlant
    scene_graph: SceneGraph
    hand: Hand
    object_body: RigidBody
    object_joint: Joint
    model: ObjectModel
    plan: GraspPlan
    scenario: Scenario

    def start(self, context: Context) -> None:
        """Prepares a root context: hand open, object held in its place in the hand, noise seeded."""
        plant_context = self.plant.GetMyMutableContextFromRoot(context)
        controller = self.diagram.GetSubsystemByName("grasp_controller")
        q = controller.commanded(np.full(len(self.plan.fingers), _OPEN))
        first, _, names = hand_layout(self.plant, self.hand)
        index = {
            name: self.plant.GetJointByName(name, self.hand.model_instance).position_start() - first for name in names
        }
        for finger in self.hand.config.fingers:
            for coupling in finger.couplings:
                q[index[coupling.joint]] = coupling.ratio * q[index[coupling.follows]]
        self.plant.SetPositions(plant_context, self.hand.model_instance, q)
        X_WP = self.hand.palm_frame.CalcPoseInWorld(plant_context)
        self.plant.SetFreeBodyPose(plant_context, self.object_body, X_WP @ planned_pose(self.plan))
        self.object_joint.Lock(plant_context)
        seed_random_sources(self.diagram, context, self.scenario.seed)

    def release_when_held(self, context: Context) -> EventStatus:
        """For `Simulator.set_monitor`: lets the object go once the controller holds it."""
        plant_context = self.plant.GetMyMutableContextFromRoot(context)
        if self.object_joint.is_locked(plant_context) and self.diagram.GetOutputPort("holding").Eval(context)[0]:
            self.object_joint.Unlock(plant_context)
        return EventStatus.Succeeded()

    def object_pose(self, context: Context) -> RigidTransform:
        """The simulator's own X_PO."""
        plant_context = self.plant.GetMyContextFromRoot(context)
        return self.plant.CalcRelativeTransform(plant_context, self.hand.palm_frame, self.object_body.body_frame())


def planned_pose(plan: GraspPlan) -> RigidTransform:
    """X_PO of a plan."""
    return RigidTransform(RotationMatrix(plan.X_PO[:, :3]), plan.X_PO[:, 3])


def make_station(
    scenario: Scenario,
    plan: GraspPlan | None = None,
    *,
    model: ObjectModel | None = None,
    meshcat: Meshcat | None = None,
) -> Station:
    """Builds a scenario's diagram.

    Args:
        scenario: what to build.
        plan: the grasp; by default the best of `plan_scenario`.
        model: of the scenario's object, if it is at hand already.
        meshcat: where to show hand, object, contacts, prior and estimate; nothing is shown without.

    Raises:
        InvalidInputError: if the scenario cannot be built.
    """
    scenario.validate()
    model = ObjectModel.from_mesh(scenario.object_mesh()) if model is None else model
    plan = plan_scenario(scenario, model)[0] if plan is None else plan
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlant(config=scenario.plant, builder=builder)
    hand = add_hand(plant, load_hand_config(scenario.hand), scenario.X_WBase.GetDeterministicValue())
    (object_instance,) = make_parser(plant).AddModels(str(scenario.object_sdf()))
    plant.Finalize()
    (object_joint,) = (plant.get_joint(index) for index in plant.GetJointIndices(object_instance))
    object_body = object_joint.child_body()

    _add_grasp(builder, scenario, plant, hand, plan)
    _add_estimation(builder, scenario, plant, scene_graph, hand, object_body, model)
    if meshcat is not None:
        _add_display(builder, plant, scene_graph, hand, model, meshcat)
    for port in ("contact_results", "body_poses"):
        builder.ExportOutput(plant.GetOutputPort(port), port)
    builder.ExportOutput(scene_graph.get_query_output_port(), "query")
    AddRandomInputs(scenario.sensor.period, builder)
    diagram = builder.Build()
    diagram.set_name("station")
    return Station(diagram, plant, scene_graph, hand, object_body, object_joint, model, plan, scenario)


def _add_grasp(builder: DiagramBuilder, scenario: Scenario, plant: MultibodyPlant, hand: Hand, plan: GraspPlan) -> None:
    """The sensors and the grasp controller."""
    motions = {finger: part.motion for finger, part in plan.fingers.items()}
    controller = builder.AddNamedSystem(
        "grasp_controller", GraspController(plant, hand, motions, _rest(plant, hand), scenario.controller)
    )
    state = plant.get_state_output_port(hand.model_instance)
    builder.Connect(state, controller.GetInputPort("hand_state"))
    builder.Connect(controller.GetOutputPort("actuation"), plant.get_actuation_input_port(hand.model_instance))
    builder.ExportOutput(state, "hand_state")
    for port, exported in (("actuation", "actuation"), ("holding", "holding"), ("status", "grasp_status")):
        builder.ExportOutput(controller.GetOutputPort(port), exported)
    sensor_model = load_force_torque_model(scenario.sensor.calibration)
    for finger in hand.sensor_frames:
        sensor = builder.AddNamedSystem(
            f"sensor_{finger}",
            ForceTorqueSensor(
                plant, hand.welds[finger], hand.sensor_frames[finger], sensor_model, scenario.sensor.period
            ),
        )
        builder.Connect(plant.get_reaction_forces_output_port(), sensor.GetInputPort("reaction_forces"))
        builder.Connect(plant.get_body_poses_output_port(), sensor.GetInputPort("body_poses"))
        builder.ExportOutput(sensor.GetOutputPort("wrench"), f"wrench_{finger}")
        if finger in motions:
            builder.Connect(sensor.GetOutputPort("wrench"), controller.GetInputPort(f"wrench_{finger}"))


def _add_estimation(
    builder: DiagramBuilder,
    scenario: Scenario,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    hand: Hand,
    object_body: RigidBody,
    model: ObjectModel,
) -> None:
    """The vision source and the pose estimation."""
    vision = builder.AddNamedSystem(
        "vision",
        SimulatedVision(
            plant,
            scene_graph.model_inspector(),
            object_body=object_body,
            object_model=model,
            palm_frame=hand.palm_frame,
            X_WC=scenario.X_WC.GetDeterministicValue(),
            params=scenario.vision,
        ),
    )
    builder.Connect(plant.get_body_poses_output_port(), vision.GetInputPort("body_poses"))
    estimation = AddPoseEstimation(builder, hand.config, model, scenario.estimation)
    for finger in hand.sensor_frames:
        wrench = builder.GetSubsystemByName(f"sensor_{finger}").GetOutputPort("wrench")
        builder.Connect(wrench, estimation.GetInputPort(f"wrench_{finger}"))
    positions = builder.AddNamedSystem(
        "joint_positions",
        Demultiplexer([plant.num_positions(hand.model_instance), plant.num_velocities(hand.model_instance)]),
    )
    builder.Connect(plant.get_state_output_port(hand.model_instance), positions.get_input_port())
    builder.Connect(positions.get_output_port(0), estimation.GetInputPort("joint_positions"))
    builder.Connect(vision.GetOutputPort("prior"), estimation.GetInputPort("prior"))
    for port in ("prior", "hidden_share"):
        builder.ExportOutput(vision.GetOutputPort(port), port)
    for index in range(estimation.num_output_ports()):
        port = estimation.get_output_port(index)
        builder.ExportOutput(port, port.get_name())


def _add_display(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    hand: Hand,
    model: ObjectModel,
    meshcat: Meshcat,
) -> None:
    """Hand, object, contacts, prior and estimate in Meshcat."""
    MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat)
    display = builder.AddNamedSystem("pose_display", PoseDisplay(meshcat, model, hand.palm_frame))
    estimation = builder.GetSubsystemByName("pose_estimation")
    builder.Connect(estimation.GetOutputPort("contacts"), display.GetInputPort("contacts"))
    builder.Connect(estimation.GetOutputPort("object_pose"), display.GetInputPort("object_pose"))
    builder.Connect(builder.GetSubsystemByName("vision").GetOutputPort("prior"), display.GetInputPort("prior"))
    builder.Connect(plant.get_body_poses_output_port(), display.GetInputPort("body_poses"))


def _rest(plant: MultibodyPlant, hand: Hand) -> FloatArray:
    """The hand's joint positions when no finger takes part, shape (nq,), rad."""
    first, _, _ = hand_layout(plant, hand)
    q = np.zeros(plant.num_positions(hand.model_instance))
    for finger in hand.config.fingers:
        for name, position in zip(finger.joints, rest_positions(hand.config, finger.name), strict=True):
            q[plant.GetJointByName(name, hand.model_instance).position_start() - first] = position
    return q
