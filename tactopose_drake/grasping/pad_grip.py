"""Simulated grips by a hand with tactile pads: the fingers close on an object, and the pads say what they feel."""

import dataclasses
from pathlib import Path

import numpy as np
from pydrake.common.schema import Transform
from pydrake.geometry import Meshcat, MeshcatVisualizer
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import RigidBody
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from pydrake.systems.primitives import AddRandomInputs, Demultiplexer

from tactopose_drake.core.patches import Patch
from tactopose_drake.core.validation import FloatArray, positive_number
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand import Hand, add_hand, load_hand_config, make_hand_plant, make_parser
from tactopose_drake.resources import model_path, resource_root
from tactopose_drake.systems.grip_controller import GripController, GripControllerParams, set_motor_gains
from tactopose_drake.systems.patch_descriptor import PatchDescriptor, PatchDescriptorParams
from tactopose_drake.systems.patch_display import PatchDisplay
from tactopose_drake.systems.random_sources import seed_random_sources
from tactopose_drake.systems.tactile_array import TactileArray
from tactopose_drake.tactile_pads import load_tactile_pad
from tactopose_drake.typed_yaml import load_typed_yaml


def _default_plant() -> MultibodyPlantConfig:
    return MultibodyPlantConfig(time_step=0.004, contact_model="hydroelastic")


@dataclasses.dataclass(kw_only=True, slots=True)
class PadGrip:
    """A grip as data; only data."""

    hand: str = "barrett_like"  # a hand of the package by name, or a *.hand.yaml by path; it needs pads
    object: str = "soda_can"  # an object of the package by name, or an SDF by path
    X_PO: Transform = dataclasses.field(default_factory=Transform)  # where the object is held while the fingers close
    X_WBase: Transform = dataclasses.field(default_factory=Transform)  # where the hand is; by default palm up
    seed: int = 0  # of the arrays' noise
    closing_time: float = 3.0  # longest, s
    hold_time: float = 0.6  # from the object's release to the reading, s
    most_slip: float = 0.015  # motion of the object's origin since its release, m
    plant: MultibodyPlantConfig = dataclasses.field(default_factory=_default_plant)
    controller: GripControllerParams = dataclasses.field(default_factory=GripControllerParams)
    descriptor: PatchDescriptorParams = dataclasses.field(default_factory=PatchDescriptorParams)

    def validate(self) -> None:
        """Raises InvalidInputError if a value is out of its range, or the object does not exist."""
        for name in ("closing_time", "hold_time", "most_slip"):
            positive_number(f"PadGrip.{name}", getattr(self, name))
        if self.seed < 0:
            raise InvalidInputError(f"PadGrip.seed: is {self.seed}; allowed are integers >= 0.")
        self.controller.validate()
        self.descriptor.validate()
        if not self.object_sdf().is_file():
            known = ", ".join(sorted(shipped.stem for shipped in model_path("objects").glob("*.sdf")))
            raise InvalidInputError(
                f"PadGrip.object: {self.object_sdf()} does not exist; the package's objects are {known}."
            )

    def object_sdf(self) -> Path:
        """The object's model for the simulator."""
        return Path(self.object) if Path(self.object).suffix else model_path("objects", f"{self.object}.sdf")


def load_pad_grip(name_or_path: str | Path) -> PadGrip:
    """Reads a `*.pad_grip.yaml`: one of the package's diagrams by name, or any file by path.

    Raises:
        InvalidFileError: if the file cannot be read or does not fit `PadGrip`.
        InvalidInputError: if a value is out of its range.
    """
    shipped = resource_root() / "diagrams" / f"{name_or_path}.pad_grip.yaml"
    grip = load_typed_yaml(PadGrip, shipped if shipped.is_file() else Path(name_or_path))
    grip.validate()
    return grip


@dataclasses.dataclass(frozen=True, eq=False)
class PadGripResult:
    """How a grip went.

    Attributes:
        reason: "ok", or why the hand does not hold the object.
        patches: what the pads feel at the end, in P, in the order of the hand's description.
        X_PO: true pose of the object at the end.
        q: positions of the hand's joints at the end, shape (nq,), rad.
        slip: how far the object's origin has moved in the palm since its release, m.
        diagram: with outputs `patches`, `patch_status`, `joint_positions`, `contact_results`, `body_poses`.
        simulator: at the end of the run.
    """

    reason: str
    patches: tuple[Patch, ...]
    X_PO: RigidTransform
    q: FloatArray
    slip: float
    diagram: Diagram
    simulator: Simulator

    @property
    def held(self) -> bool:
        """Whether the hand holds the object."""
        return self.reason == "ok"


def simulate_pad_grip(grip: PadGrip, meshcat: Meshcat | None = None) -> PadGripResult:
    """Closes the fingers on the object while it is held in its place, lets it go, and reads the pads.

    Args:
        grip: what to simulate.
        meshcat: where to show and record it; nothing is shown without.

    Raises:
        InvalidInputError: if the grip cannot be built.
    """
    grip.validate()
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlant(config=grip.plant, builder=builder)
    config = load_hand_config(grip.hand)
    hand = add_hand(plant, config, grip.X_WBase.GetDeterministicValue())
    (object_instance,) = make_parser(plant).AddModels(str(grip.object_sdf()))
    set_motor_gains(plant, hand, grip.controller)
    plant.Finalize()
    (object_joint,) = (plant.get_joint(index) for index in plant.GetJointIndices(object_instance))
    body = object_joint.child_body()

    controller = builder.AddNamedSystem("grip_controller", GripController(plant, hand, grip.controller))
    state = plant.get_state_output_port(hand.model_instance)
    builder.Connect(state, controller.GetInputPort("hand_state"))
    builder.Connect(controller.GetOutputPort("desired_state"), plant.get_desired_state_input_port(hand.model_instance))
    _add_senses(builder, plant, hand, grip)
    if meshcat is not None:
        MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat)
        display = builder.AddNamedSystem("patch_display", PatchDisplay(meshcat, hand))
        patches = builder.GetSubsystemByName("patch_descriptor").GetOutputPort("patches")
        builder.Connect(patches, display.GetInputPort("patches"))
        builder.Connect(plant.get_body_poses_output_port(), display.GetInputPort("body_poses"))
    diagram = builder.Build()
    diagram.set_name("pad_grip")

    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    plant_context = plant.GetMyMutableContextFromRoot(context)
    _set_fixed_joints(plant, hand, plant_context, grip.controller)
    X_WP = hand.palm_frame.CalcPoseInWorld(plant_context)
    plant.SetFreeBodyPose(plant_context, body, X_WP @ grip.X_PO.GetDeterministicValue())
    object_joint.Lock(plant_context)
    seed_random_sources(diagram, context, grip.seed)
    if meshcat is not None:
        meshcat.StartRecording()
    holding = controller.GetOutputPort("holding")
    while not holding.Eval(controller.GetMyContextFromRoot(context))[0] and context.get_time() < grip.closing_time:
        simulator.AdvanceTo(context.get_time() + 0.02)
    closed = bool(holding.Eval(controller.GetMyContextFromRoot(context))[0])
    object_joint.Unlock(plant_context)
    p_PO_release = _pose(plant, hand, plant_context, body).translation()
    simulator.AdvanceTo(context.get_time() + grip.hold_time)
    if meshcat is not None:
        meshcat.StopRecording()
        meshcat.PublishRecording()

    X_PO = _pose(plant, hand, plant_context, body)
    slip = float(np.linalg.norm(X_PO.translation() - p_PO_release))
    reason = "ok" if closed else "the fingers did not close in time"
    if closed and slip > grip.most_slip:
        reason = f"the object slipped by {1e3 * slip:.1f} mm"
    patches = diagram.GetOutputPort("patches").Eval(context)
    q = plant.GetPositions(plant_context, hand.model_instance)
    return PadGripResult(reason, patches, X_PO, q, slip, diagram, simulator)


def _add_senses(builder: DiagramBuilder, plant: MultibodyPlant, hand: Hand, grip: PadGrip) -> None:
    """The tactile arrays and the descriptor of what they feel."""
    descriptor = builder.AddNamedSystem(
        "patch_descriptor", PatchDescriptor(*make_hand_plant(hand.config), grip.descriptor)
    )
    pads = {pad.name: load_tactile_pad(pad.array) for pad in hand.config.pads}
    for name, pad in pads.items():
        array = builder.AddNamedSystem(f"tactile_array_{name}", TactileArray(plant, hand.pad_frames[name], pad))
        builder.Connect(plant.get_contact_results_output_port(), array.GetInputPort("contact_results"))
        builder.Connect(plant.get_body_poses_output_port(), array.GetInputPort("body_poses"))
        builder.Connect(array.GetOutputPort("pressures"), descriptor.GetInputPort(f"pressures_{name}"))
    sizes = [plant.num_positions(hand.model_instance), plant.num_velocities(hand.model_instance)]
    positions = builder.AddNamedSystem("joint_positions", Demultiplexer(sizes))
    builder.Connect(plant.get_state_output_port(hand.model_instance), positions.get_input_port())
    builder.Connect(positions.get_output_port(0), descriptor.GetInputPort("joint_positions"))
    builder.ExportOutput(positions.get_output_port(0), "joint_positions")
    for port, exported in (("patches", "patches"), ("status", "patch_status")):
        builder.ExportOutput(descriptor.GetOutputPort(port), exported)
    for port in ("contact_results", "body_poses"):
        builder.ExportOutput(plant.GetOutputPort(port), port)
    AddRandomInputs(min(pad.period for pad in pads.values()), builder)


def _set_fixed_joints(plant: MultibodyPlant, hand: Hand, context: Context, params: GripControllerParams) -> None:
    """Starts the joints that do not close, and those that follow them, where they stay."""
    for finger in hand.config.fingers:
        followers = {coupling.joint: coupling for coupling in finger.couplings}
        for name, position in params.fixed.items():
            plant.GetJointByName(name, hand.model_instance).set_angle(context, position)
            for joint, coupling in followers.items():
                if coupling.follows == name:
                    plant.GetJointByName(joint, hand.model_instance).set_angle(context, coupling.ratio * position)


def _pose(plant: MultibodyPlant, hand: Hand, context: Context, body: RigidBody) -> RigidTransform:
    return plant.CalcRelativeTransform(context, hand.palm_frame, body.body_frame())
