"""Builds the diagram of a scenario: a simulated hand with its senses, its controller, and the pose estimation."""

import gc
from collections.abc import Mapping
from dataclasses import dataclass

from pydrake.geometry import (
    DefaultProximityProperties,
    Meshcat,
    MeshcatVisualizer,
    Role,
    SceneGraph,
    SceneGraphConfig,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant
from pydrake.multibody.tree import Joint, ModelInstanceIndex, RigidBody
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, EventStatus, OutputPort

from tactopose_drake.core.grasping.grasp_plan import GraspPlan
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import instance_of
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.contact_properties import let_overlap, make_compliant, make_meshes_rigid, rigid_shapes
from tactopose_drake.hand.hand_in_plant import Hand, add_hand
from tactopose_drake.hand.tactile_pads import load_tactile_pad
from tactopose_drake.resources import add_model, fixed_pose, make_parser, passing_builder
from tactopose_drake.station.grasp import GraspStart, add_grip, add_planned_grasp
from tactopose_drake.station.grasp_planning import plan_scenario
from tactopose_drake.station.motor_inertia import add_motor_inertia
from tactopose_drake.station.scenario import Scenario
from tactopose_drake.station.simulated_senses import (
    add_measured_palm_pose,
    add_noise,
    add_palm_pose,
    add_senses,
    simulate_errors,
)
from tactopose_drake.station.tracking import add_exploration, add_tracking
from tactopose_drake.station.vision_source import add_vision
from tactopose_drake.systems.grip_controller import set_motor_gains
from tactopose_drake.systems.ports import connect_known, export_outputs
from tactopose_drake.systems.pose_display import PoseDisplay, PoseDisplayParams
from tactopose_drake.systems.pose_estimation import AddPoseEstimation
from tactopose_drake.systems.random_sources import seed_random_sources
from tactopose_drake.systems.sense_status import export_sense_statuses


@dataclass(frozen=True, eq=False)
class Station:
    """The diagram of a scenario, and the parts of it that users need.

    Attributes:
        diagram: The diagram, with output ports `hand_state`, `joint_positions`, `wrench_<finger>`, `status_<finger>`
            of its force-torque sensor and all of these joined in `sense_status`, `pressures_<pad>`, `holding`,
            `grasp_status`, `prior`, `hidden_share`, all outputs of `AddPoseEstimation`, `contact_results`,
            `body_poses`, `query`, and for a planned grasp `actuation`. With tracking, it also has `object_pose`,
            `object_pose_in_world`, `covariance`, `hypotheses`, `status` and `belief` of `AddPoseTracking` as
            `tracked_object_pose` and so on; with exploration, all outputs of `AddTouchExploration` as
            `explored_object_pose` and so on.
        plant: the simulator's plant with hand and object.
        scene_graph: its SceneGraph.
        hand: the hand in the plant.
        object_body: the object; its body frame is O.
        object_joint: the object's floating joint, which is locked while the fingers close.
        model: the object's model for estimation.
        grasp_start: the open hand, and the object's pose in it.
        plan: how the fingers close; None for a grip without a plan.
        scenario: the scenario.
    """

    diagram: Diagram
    plant: MultibodyPlant
    scene_graph: SceneGraph
    hand: Hand
    object_body: RigidBody
    object_joint: Joint
    model: ObjectModel
    grasp_start: GraspStart
    plan: GraspPlan | None
    scenario: Scenario

    def start(self, context: Context) -> None:
        """Prepares a root context: opens the hand, locks the object at its pose in the hand, and seeds the noise."""
        plant_context = self.plant.GetMyMutableContextFromRoot(context)
        self.plant.SetPositions(plant_context, self.hand.model_instance, self.grasp_start.q)
        X_WP = self.hand.palm_frame.CalcPoseInWorld(plant_context)
        self.plant.SetFreeBodyPose(plant_context, self.object_body, X_WP @ self.grasp_start.X_PO)
        self.object_joint.Lock(plant_context)
        seed_random_sources(self.diagram, context, self.scenario.seed)

    def release_when_held(self, context: Context) -> EventStatus:
        """For `Simulator.set_monitor`: releases the object once the controller holds it."""
        plant_context = self.plant.GetMyMutableContextFromRoot(context)
        if self.object_joint.is_locked(plant_context) and self.diagram.GetOutputPort("holding").Eval(context)[0]:
            self.object_joint.Unlock(plant_context)
        return EventStatus.Succeeded()

    def object_pose(self, context: Context) -> RigidTransform:
        """The true X_PO in the simulator."""
        plant_context = self.plant.GetMyContextFromRoot(context)
        return self.plant.CalcRelativeTransform(plant_context, self.hand.palm_frame, self.object_body.body_frame())


def make_station(
    scenario: Scenario,
    plan: GraspPlan | None = None,
    *,
    model: ObjectModel | None = None,
    meshcat: Meshcat | None = None,
) -> Station:
    """Builds a scenario's diagram, after freeing diagrams that are no longer used.

    Args:
        scenario: the scenario.
        plan: the grasp; None: the best of `plan_scenario`. A scenario with a grip has none.
        model: the object's model; None: it is loaded.
        meshcat: shows hand, object, contacts, patches, prior and estimate; None: nothing is shown.

    Raises:
        InvalidInputError: if the scenario cannot be built.
    """
    instance_of("scenario", scenario, Scenario)
    instance_of("plan", plan, GraspPlan, type(None))
    instance_of("model", model, ObjectModel, type(None))
    scenario.validate()
    # A diagram and its builder refer to each other and hold a hundred megabytes in few Python objects, so that Python
    # collects such garbage too rarely: a hundred grasps in sequence would need gigabytes.
    gc.collect()
    model = scenario.object_model() if model is None else model
    if scenario.grip is None and plan is None:
        plan = plan_scenario(scenario, model)[0]
    builder = DiagramBuilder()
    plant, scene_graph, hand, object_joint = _add_bodies(builder, scenario)
    object_body = object_joint.child_body()

    senses = add_senses(builder, scenario, plant, hand)
    for name, port in senses.items():
        builder.ExportOutput(port, name)
    if plan is None:
        start = add_grip(builder, scenario, plant, hand)
    else:
        start = add_planned_grasp(builder, scenario, plant, hand, senses, plan)
    seen = add_vision(builder, scenario, plant, scene_graph, hand, object_body, model)
    measured = {}
    if scenario.estimation.estimator.balance:
        measured["palm_pose"] = add_measured_palm_pose(builder, scenario, hand, senses["joint_positions"])
    _add_estimation(builder, scenario, hand, model, {**senses, **measured})
    if scenario.tracking is not None:
        palm = {"palm_pose": add_palm_pose(builder, plant, hand)}
        joints = builder.GetSubsystemByName("joint_positions")
        more = {"joint_velocities": joints.get_output_port(1), "vision": seen, **palm}
        add_tracking(builder, scenario.tracking, hand.config, model, {**senses, **more})
    if scenario.exploration is not None:
        add_exploration(builder, scenario.exploration, hand.config, model, senses["joint_positions"])
    if meshcat is not None:
        _add_display(builder, plant, scene_graph, hand, object_body, model, meshcat)
    diagram = finish_station("station", builder, scenario, plant, scene_graph, hand)
    return Station(diagram, plant, scene_graph, hand, object_body, object_joint, model, start, plan, scenario)


def check_bodies(scenario: Scenario) -> None:
    """Builds only the simulator's bodies and senses, which takes a tenth of a second, to find errors early.

    Raises:
        InvalidInputError: if hand or object cannot be simulated; the message says why.
    """
    with passing_builder() as builder:
        plant, _, hand, _ = _add_bodies(builder, scenario)
        add_senses(builder, scenario, plant, hand)
        if scenario.grip is not None:
            add_grip(builder, scenario, plant, hand)


def _add_bodies(builder: DiagramBuilder, scenario: Scenario) -> tuple[MultibodyPlant, SceneGraph, Hand, Joint]:
    """The finalized plant with hand and object, and the object's joint."""
    plant, scene_graph = add_plant(builder, scenario)
    hand = add_hand(plant, scenario.hand_config(), fixed_pose("Scenario.X_WBase", scenario.X_WBase))
    return plant, scene_graph, hand, finish_plant(plant, scene_graph, scenario, hand)


def add_plant(builder: DiagramBuilder, scenario: Scenario) -> tuple[MultibodyPlant, SceneGraph]:
    """Adds a plant without bodies, in which shapes are compliant unless their files say otherwise."""
    default = DefaultProximityProperties(compliance_type="compliant")
    plant, scene_graph = AddMultibodyPlant(
        plant_config=scenario.plant,
        scene_graph_config=SceneGraphConfig(default_proximity_properties=default),
        builder=builder,
    )
    return plant, scene_graph


def finish_plant(plant: MultibodyPlant, scene_graph: SceneGraph, scenario: Scenario, hand: Hand) -> Joint:
    """Adds the object to a plant that has the hand, completes both for simulation, and finalizes the plant.

    Returns:
        The object's joint.

    Raises:
        InvalidInputError: if hand or object cannot be simulated; the message says why.
    """
    object_instance = add_model(make_parser(plant), scenario.object_sdf())
    make_compliant(plant, scene_graph, hand.model_instance)
    make_meshes_rigid(plant, scene_graph, object_instance)
    simulate_errors(scenario, plant, scene_graph, hand, object_instance)
    if scenario.grip is not None:
        set_motor_gains(plant, hand, scenario.grip.controller)
    else:
        add_motor_inertia(plant, hand, scenario.controller)
    try:
        plant.Finalize()
    except RuntimeError as error:
        raise InvalidInputError(f"Scenario cannot be simulated ({' '.join(str(error).split())}).") from None
    joints = [plant.get_joint(index) for index in plant.GetJointIndices(object_instance)]
    if len(joints) != 1 or joints[0].num_positions() != 7:
        raise InvalidInputError(f"{scenario.object_sdf()} must be one free body, without joints.")
    if scenario.plant.contact_model == "hydroelastic":
        _check_compliance(plant, scene_graph, hand, object_instance)
    return joints[0]


def _check_compliance(
    plant: MultibodyPlant, scene_graph: SceneGraph, hand: Hand, object_instance: ModelInstanceIndex
) -> None:
    """Raises InvalidInputError if hand and object are both rigid, as hydroelastic contact is then impossible."""
    inspector = scene_graph.model_inspector()
    of_hand, of_object = (
        rigid_shapes(plant, inspector, instance) for instance in (hand.model_instance, object_instance)
    )
    if of_hand and of_object:
        raise InvalidInputError(
            f"{hand.config.model} must say that {', '.join(of_hand)} is compliant, not rigid, as the object is rigid "
            "and the contact_model hydroelastic. Leave out <drake:rigid_hydroelastic/>, or choose the contact_model "
            "hydroelastic_with_fallback."
        )


def _add_estimation(
    builder: DiagramBuilder, scenario: Scenario, hand: Hand, model: ObjectModel, senses: Mapping[str, OutputPort]
) -> None:
    """Adds the pose estimation, connected to the senses and vision."""
    estimation = AddPoseEstimation(builder, hand.config, model, scenario.estimation)
    prior = builder.GetSubsystemByName("vision").GetOutputPort("prior")
    connect_known(builder, {**senses, "prior": prior}, estimation)
    export_outputs(builder, estimation)


def finish_station(
    name: str,
    builder: DiagramBuilder,
    scenario: Scenario,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    hand: Hand,
) -> Diagram:
    """Adds noise, the sensors' statuses and the ground truth, builds, and filters collisions that exist at rest."""
    for port in ("contact_results", "body_poses"):
        builder.ExportOutput(plant.GetOutputPort(port), port)
    builder.ExportOutput(scene_graph.get_query_output_port(), "query")
    sensors = {finger: builder.GetSubsystemByName(f"sensor_{finger}") for finger in hand.sensor_frames}
    if sensors:
        export_sense_statuses(builder, {finger: sensor.GetOutputPort("status") for finger, sensor in sensors.items()})
    add_noise(builder, scenario, hand)
    diagram = builder.Build()
    diagram.set_name(name)
    posture = plant.GetMyContextFromRoot(diagram.CreateDefaultContext())
    let_overlap(plant, scene_graph, posture, hand.model_instance)
    return diagram


def _add_display(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    hand: Hand,
    object_body: RigidBody,
    model: ObjectModel,
    meshcat: Meshcat,
) -> None:
    """Shows hand, contacts, patches, prior, estimate and true pose in Meshcat.

    The object itself is not shown, as it would hide the estimate. With tracking, the belief over time is the estimate.
    """
    for geometry in plant.GetVisualGeometriesForBody(object_body):
        scene_graph.RemoveRole(plant.get_source_id(), geometry, Role.kIllustration)
    MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat)
    cells = [len(load_tactile_pad(pad.array).layout) for pad in hand.config.pads]
    params = PoseDisplayParams(max_pads=len(cells), max_cells=max(cells, default=0))
    display = builder.AddNamedSystem("pose_display", PoseDisplay(meshcat, model, hand.palm_frame, params, object_body))
    estimation = builder.GetSubsystemByName("pose_estimation")
    believed = "pose_tracking" if builder.HasSubsystemNamed("pose_tracking") else "pose_estimation"
    for name in ("contacts", *(["patches"] if cells else [])):
        builder.Connect(estimation.GetOutputPort(name), display.GetInputPort(name))
    for name in ("object_pose", "hypotheses"):
        builder.Connect(builder.GetSubsystemByName(believed).GetOutputPort(name), display.GetInputPort(name))
    builder.Connect(builder.GetSubsystemByName("vision").GetOutputPort("prior"), display.GetInputPort("prior"))
    builder.Connect(plant.get_body_poses_output_port(), display.GetInputPort("body_poses"))
