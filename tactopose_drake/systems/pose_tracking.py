"""From wrenches, joints and vision to the belief of the object's pose over time: one diagram to put into another."""

import dataclasses

from pydrake.systems.framework import Diagram, DiagramBuilder

from tactopose_drake.core.objects import ObjectModel
from tactopose_drake.hand import HandConfig, make_hand_plant
from tactopose_drake.hand_geometry import BodySpheres
from tactopose_drake.systems.contact_solver import ContactSolver, ContactSolverParams
from tactopose_drake.systems.contacts_in_palm import ContactsInPalm, ContactsInPalmParams
from tactopose_drake.systems.fingertip_velocities import FingertipVelocities
from tactopose_drake.systems.hand_volume import HandVolume
from tactopose_drake.systems.live_pose_belief import LivePoseBeliefEstimator
from tactopose_drake.systems.patch_descriptor import PatchDescriptor, PatchDescriptorParams
from tactopose_drake.systems.pose_belief import PoseBeliefEstimator, PoseBeliefParams


@dataclasses.dataclass(kw_only=True, slots=True)
class PoseTrackingParams:
    """The parameters of each part."""

    solver: ContactSolverParams = dataclasses.field(default_factory=ContactSolverParams)
    contacts: ContactsInPalmParams = dataclasses.field(default_factory=ContactsInPalmParams)
    patches: PatchDescriptorParams = dataclasses.field(default_factory=PatchDescriptorParams)  # of a hand with pads
    belief: PoseBeliefParams = dataclasses.field(default_factory=PoseBeliefParams)
    use_hand_volume: bool = True  # whether it is evidence that the object is not in the hand, nor at silent fingertips
    use_joint_velocities: bool = True  # whether the object is taken to move with the fingertips; else with the palm
    live: bool = False  # whether the belief is computed in a thread of its own, for hardware; not repeatable

    def validate(self) -> None:
        """Raises InvalidInputError if a value is out of its range."""
        for part in (self.solver, self.contacts, self.patches, self.belief):
            part.validate()


def AddPoseTracking(
    builder: DiagramBuilder,
    hand: HandConfig,
    model: ObjectModel,
    params: PoseTrackingParams | None = None,
    name: str = "pose_tracking",
) -> Diagram:
    """Adds the belief of a held object's pose to a diagram under construction.

    .. pydrake_system::

        name: pose_tracking
        input_ports:
        - wrench_<finger>
        - pressures_<pad>
        - joint_positions
        - joint_velocities
        - vision
        - palm_pose
        output_ports:
        - object_pose
        - object_pose_in_world
        - covariance
        - hypotheses
        - status
        - belief
        - contacts
        - fingers_in_contact
        - contact_status

    - wrench_<finger>, pressures_<pad>, joint_positions: as those of `AddPoseEstimation`.
    - joint_velocities: of the same joints, rad/s; there is such a port only where `use_joint_velocities`.
    - vision, palm_pose, and the outputs up to belief: of `PoseBeliefEstimator`.
    - contacts, fingers_in_contact, contact_status: of `ContactsInPalm` (its `status`).

    Args:
        builder: receives the diagram.
        hand: the hand's names, fingertips and model; its kinematics are computed in a plant of its own.
        model: the object.
        params: parameters of each part.
        name: of the diagram in the other.

    Returns:
        The diagram; its ports are to be connected by name.
    """
    return builder.AddNamedSystem(name, MakePoseTracking(hand, model, params))


def MakePoseTracking(hand: HandConfig, model: ObjectModel, params: PoseTrackingParams | None = None) -> Diagram:
    """The diagram that `AddPoseTracking` adds, by itself."""
    params = PoseTrackingParams() if params is None else params
    params.validate()
    plant, parts = make_hand_plant(hand)
    builder = DiagramBuilder()
    solver = builder.AddNamedSystem("contact_solver", ContactSolver(parts.surfaces, params.solver))
    contacts = builder.AddNamedSystem(
        "contacts_in_palm", ContactsInPalm(plant, parts.sensor_frames, parts.palm_frame, params.contacts)
    )
    kind = LivePoseBeliefEstimator if params.live else PoseBeliefEstimator
    belief = builder.AddNamedSystem("pose_belief", kind(model, params.belief))
    builder.Connect(solver.GetOutputPort("contact_solutions"), contacts.GetInputPort("contact_solutions"))
    for port in ("contacts", "fingers_in_contact"):
        builder.Connect(contacts.GetOutputPort(port), belief.GetInputPort(port))
    posed_too = []
    if hand.pads:
        descriptor = builder.AddNamedSystem("patch_descriptor", PatchDescriptor(plant, parts, params.patches))
        builder.Connect(descriptor.GetOutputPort("patches"), belief.GetInputPort("patches"))
        posed_too.append(descriptor)
        for pad in hand.pads:
            builder.ExportInput(descriptor.GetInputPort(f"pressures_{pad.name}"), f"pressures_{pad.name}")
    if params.use_hand_volume:
        volume = builder.AddNamedSystem("hand_volume", HandVolume(plant, parts, BodySpheres.of_hand(hand)))
        builder.Connect(contacts.GetOutputPort("fingers_untouched"), volume.GetInputPort("fingers_untouched"))
        for port in ("hand", "untouched"):
            builder.Connect(volume.GetOutputPort(port), belief.GetInputPort(port))
        posed_too.append(volume)
    if params.use_joint_velocities:
        tips = builder.AddNamedSystem(
            "fingertip_velocities", FingertipVelocities(plant, parts.sensor_frames, parts.palm_frame)
        )
        builder.Connect(tips.GetOutputPort("tip_velocities"), belief.GetInputPort("tip_velocities"))
        posed_too.append(tips)

    for finger in parts.sensor_frames:
        builder.ExportInput(solver.GetInputPort(f"wrench_{finger}"), f"wrench_{finger}")
    builder.ExportInput(contacts.GetInputPort("joint_positions"), "joint_positions")
    for system in posed_too:
        builder.ConnectInput("joint_positions", system.GetInputPort("joint_positions"))
    if params.use_joint_velocities:
        builder.ExportInput(tips.GetInputPort("joint_velocities"), "joint_velocities")
    for port in ("vision", "palm_pose"):
        builder.ExportInput(belief.GetInputPort(port), port)
    for index in range(belief.num_output_ports()):
        port = belief.get_output_port(index)
        builder.ExportOutput(port, port.get_name())
    for port, exported in (
        ("contacts", "contacts"),
        ("fingers_in_contact", "fingers_in_contact"),
        ("status", "contact_status"),
    ):
        builder.ExportOutput(contacts.GetOutputPort(port), exported)
    diagram = builder.Build()
    diagram.set_name("pose_tracking")
    return diagram
