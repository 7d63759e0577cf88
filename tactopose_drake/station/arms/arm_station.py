"""Builds a simulated station with a hand on an arm: senses, estimation, decision and control in one diagram."""

import dataclasses
from collections.abc import Callable, Mapping

import numpy as np
from pydrake.common.schema import Rotation, Transform
from pydrake.geometry import Meshcat, MeshcatVisualizer, SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RigidBody
from pydrake.systems.controllers import InverseDynamicsController
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, OutputPort

from tactopose_drake.core.grasping.grasp_plan import GraspPlan
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import finite_array, instance_of, positive_number
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.hand_in_plant import Hand, add_hand
from tactopose_drake.resources import add_model, fixed_pose, make_parser
from tactopose_drake.resources.drake_values import WithDrakeValues
from tactopose_drake.station.arms.arm import Arm, add_arm, hand_inertia, load_arm_config, make_arm_plant, mount_hand
from tactopose_drake.station.grasp import add_planned_grasp
from tactopose_drake.station.scenario import Scenario
from tactopose_drake.station.simulated import Station, add_plant, finish_plant, finish_station
from tactopose_drake.station.simulated_senses import add_palm_pose, add_senses
from tactopose_drake.systems.ports import connect_known, export_outputs
from tactopose_drake.systems.pose_estimation import AddPoseEstimation
from tactopose_drake.systems.pose_tracking import AddPoseTracking


@dataclasses.dataclass(kw_only=True, slots=True, eq=False)
class SceneModel(WithDrakeValues):
    """A model that is fixed in the world."""

    model: str = ""  # URL or path of an SDF or URDF file
    X_WModel: Transform = dataclasses.field(default_factory=Transform)  # pose of its root link


def _thumb_up() -> Transform:
    # The Shadow-like hand's forearm extends 0.165 m behind its origin.
    return Transform(translation=[0.0, 0.0, 0.165], rotation=Rotation(value=Rotation.Rpy(deg=[0.0, 0.0, 180.0])))


@dataclasses.dataclass(kw_only=True, slots=True, eq=False)
class ArmSetup(WithDrakeValues):
    """The arm, the hand's mounting on it, and its surroundings."""

    arm: str = "seven_axis"  # an arm of the package by name, or a *.arm.yaml by path
    X_WBase: Transform = dataclasses.field(default_factory=Transform)  # pose of the arm's base
    X_FBase: Transform = dataclasses.field(default_factory=_thumb_up)  # where the hand's base is welded to the flange
    # Initial joint positions, rad: the hand in front of the arm, its fingers forward.
    q_start: list[float] = dataclasses.field(default_factory=lambda: [0.0, 0.3, 0.0, 1.4, 0.0, -0.13, 0.0])
    stiffness: float = 400.0  # controller's acceleration per position error, 1/s^2
    damping: float = 40.0  # controller's acceleration per velocity error, 1/s
    scene: list[SceneModel] = dataclasses.field(default_factory=list)

    def validate(self) -> None:
        """Raises InvalidInputError if a value is out of its range."""
        finite_array("ArmSetup.q_start", self.q_start, (len(self.q_start),))
        positive_number("ArmSetup.stiffness", self.stiffness)
        positive_number("ArmSetup.damping", self.damping)


@dataclasses.dataclass(frozen=True, eq=False)
class ArmParts:
    """The parts of the diagram under construction that a `Decision` gets.

    Attributes:
        plant: the simulator's plant.
        scene_graph: its SceneGraph.
        arm: the arm in it.
        arm_plant: a plant of the arm alone, which carries the hand as one rigid body.
        arm_alone: the arm in that plant.
        hand: the hand in the simulator's plant.
        object_body: the object in the simulator's plant.
        model: the object's model for estimation.
        palm_pose: port of X_WP.
        senses: ports of the hand's senses by the names of `AddPoseEstimation`'s inputs.
        estimation: the diagram of `AddPoseEstimation` or `AddPoseTracking`; its `prior` or `vision` is not connected.
    """

    plant: MultibodyPlant
    scene_graph: SceneGraph
    arm: Arm
    arm_plant: MultibodyPlant
    arm_alone: Arm
    hand: Hand
    object_body: RigidBody
    model: ObjectModel
    palm_pose: OutputPort
    senses: Mapping[str, OutputPort]
    estimation: Diagram


@dataclasses.dataclass(frozen=True, eq=False)
class ArmStation(Station):
    """A station with the hand on an arm.

    Attributes:
        arm: the arm in the plant.
        setup: the arm's setup.
    """

    arm: Arm
    setup: ArmSetup

    def start(self, context: Context) -> None:
        """Prepares a root context: moves the arm to its initial positions, then as `Station.start`."""
        plant_context = self.plant.GetMyMutableContextFromRoot(context)
        self.plant.SetPositions(plant_context, self.arm.model_instance, np.array(self.setup.q_start))
        super().start(context)


Decision = Callable[[DiagramBuilder, ArmParts], OutputPort]
"""Adds the deciding systems to a diagram; returns the port of the arm's reference: positions, then velocities."""


def make_arm_station(
    scenario: Scenario,
    plan: GraspPlan,
    setup: ArmSetup,
    add_decision: Decision,
    *,
    model: ObjectModel | None = None,
    meshcat: Meshcat | None = None,
) -> ArmStation:
    """Builds the diagram.

    Its ports are those of `make_station`, except those of vision, and those that `add_decision` exports.

    Args:
        scenario: hand, object and senses. The pose comes from a belief over time if it has `tracking`, or else from
            independent estimates by `estimation`. `X_WBase`, `vision` and `X_WC` are ignored.
        plan: how the fingers close.
        setup: the arm.
        add_decision: adds the deciding systems, and the vision source, if any.
        model: the object's model; None: it is loaded.
        meshcat: shows the station; None: nothing is shown.

    Raises:
        InvalidInputError: if scenario or setup cannot be built, or the scenario has a grip or an exploration.
    """
    instance_of("scenario", scenario, Scenario)
    instance_of("plan", plan, GraspPlan)
    instance_of("model", model, ObjectModel, type(None))
    scenario.validate()
    setup.validate()
    for name in ("grip", "exploration"):
        if getattr(scenario, name) is not None:
            raise InvalidInputError(f"Scenario.{name} must be None on an arm.")
    model = scenario.object_model() if model is None else model
    builder = DiagramBuilder()
    plant, scene_graph = add_plant(builder, scenario)
    config, X_WBase = load_arm_config(setup.arm), fixed_pose("ArmSetup.X_WBase", setup.X_WBase)
    arm = add_arm(plant, config, X_WBase)
    hand = add_hand(plant, scenario.hand_config())
    mount_hand(plant, arm, hand, fixed_pose("ArmSetup.X_FBase", setup.X_FBase))
    _add_scene(plant, setup)
    object_joint = finish_plant(plant, scene_graph, scenario, hand)
    finite_array("ArmSetup.q_start", setup.q_start, (plant.num_positions(arm.model_instance),))
    object_body = object_joint.child_body()

    senses = add_senses(builder, scenario, plant, hand)
    for name, port in senses.items():
        builder.ExportOutput(port, name)
    start = add_planned_grasp(builder, scenario, plant, hand, senses, plan)
    palm_pose = add_palm_pose(builder, plant, hand)
    estimation = _add_estimation(builder, scenario, hand, model, palm_pose)
    connect_known(builder, senses, estimation)
    export_outputs(builder, estimation)

    arm_plant, arm_alone = make_arm_plant(config, X_WBase, hand_inertia(plant, arm, hand, start.q))
    parts = ArmParts(
        plant, scene_graph, arm, arm_plant, arm_alone, hand, object_body, model, palm_pose, senses, estimation
    )
    _add_arm_control(builder, parts, setup, add_decision(builder, parts))
    if meshcat is not None:
        MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat)
    diagram = finish_station("arm_station", builder, scenario, plant, scene_graph, hand)
    return ArmStation(
        diagram, plant, scene_graph, hand, object_body, object_joint, model, start, plan, scenario, arm, setup
    )


def _add_estimation(
    builder: DiagramBuilder, scenario: Scenario, hand: Hand, model: ObjectModel, palm_pose: OutputPort
) -> Diagram:
    """Adds the tracking, or without it the estimation, and connects its inputs beside the senses."""
    tracked = scenario.tracking
    if tracked is None:
        estimation = AddPoseEstimation(builder, hand.config, model, scenario.estimation)
    else:
        estimation = AddPoseTracking(builder, hand.config, model, tracked)
    if estimation.HasInputPort("palm_pose"):
        builder.Connect(palm_pose, estimation.GetInputPort("palm_pose"))
    if tracked is not None and tracked.use_joint_velocities:
        velocities = builder.GetSubsystemByName("joint_positions").get_output_port(1)
        builder.Connect(velocities, estimation.GetInputPort("joint_velocities"))
    return estimation


def _add_scene(plant: MultibodyPlant, setup: ArmSetup) -> None:
    parser = make_parser(plant)
    for item in setup.scene:
        instance = add_model(parser, item.model)
        root = plant.get_body(plant.GetBodyIndices(instance)[0]).body_frame()
        plant.WeldFrames(plant.world_frame(), root, fixed_pose("SceneModel.X_WModel", item.X_WModel))


def _add_arm_control(builder: DiagramBuilder, parts: ArmParts, setup: ArmSetup, reference: OutputPort) -> None:
    """Adds inverse dynamics control of the arm, with the hand as one rigid body, about the reference."""
    count = parts.arm_plant.num_positions()
    gains = np.full(count, setup.stiffness), np.zeros(count), np.full(count, setup.damping)
    controller = builder.AddNamedSystem(
        "arm_controller", InverseDynamicsController(parts.arm_plant, *gains, has_reference_acceleration=False)
    )
    state = parts.plant.get_state_output_port(parts.arm.model_instance)
    builder.Connect(state, controller.get_input_port_estimated_state())
    builder.Connect(reference, controller.get_input_port_desired_state())
    builder.Connect(
        controller.GetOutputPort("generalized_force"), parts.plant.get_actuation_input_port(parts.arm.model_instance)
    )
    builder.ExportOutput(state, "arm_state")
    builder.ExportOutput(controller.GetOutputPort("generalized_force"), "arm_torque")
