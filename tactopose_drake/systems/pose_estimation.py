"""From wrenches, pads' pressures and joint positions to the object's pose: one diagram to put into another."""

import dataclasses

from pydrake.systems.framework import Diagram, DiagramBuilder

from tactopose_drake.collision import HandCollision
from tactopose_drake.core.objects import ObjectModel
from tactopose_drake.hand import HandConfig, make_hand_plant
from tactopose_drake.hand_geometry import BodySpheres
from tactopose_drake.systems.contact_solver import ContactSolver, ContactSolverParams
from tactopose_drake.systems.contacts_in_palm import ContactsInPalm, ContactsInPalmParams
from tactopose_drake.systems.hand_volume import HandVolume
from tactopose_drake.systems.patch_descriptor import PatchDescriptor, PatchDescriptorParams
from tactopose_drake.systems.pose_estimator import PoseEstimator, PoseEstimatorParams


@dataclasses.dataclass(kw_only=True, slots=True)
class PoseEstimationParams:
    """The parameters of each part."""

    solver: ContactSolverParams = dataclasses.field(default_factory=ContactSolverParams)
    contacts: ContactsInPalmParams = dataclasses.field(default_factory=ContactsInPalmParams)
    patches: PatchDescriptorParams = dataclasses.field(default_factory=PatchDescriptorParams)  # of a hand with pads
    estimator: PoseEstimatorParams = dataclasses.field(default_factory=PoseEstimatorParams)
    use_hand_volume: bool = True  # whether it is evidence that the object is not in the hand, nor at silent fingertips
    check_collisions: bool = True  # whether hypotheses that collide with the hand are dropped

    def validate(self) -> None:
        """Raises InvalidInputError if a value is out of its range."""
        for part in (self.solver, self.contacts, self.patches, self.estimator):
            part.validate()


def AddPoseEstimation(
    builder: DiagramBuilder,
    hand: HandConfig,
    model: ObjectModel,
    params: PoseEstimationParams | None = None,
    name: str = "pose_estimation",
) -> Diagram:
    """Adds the estimation of a held object's pose to a diagram under construction.

    .. pydrake_system::

        name: pose_estimation
        input_ports:
        - wrench_<finger>
        - pressures_<pad>
        - age_<pad>
        - joint_positions
        - prior
        output_ports:
        - object_pose
        - hypotheses
        - status
        - contacts
        - fingers_in_contact
        - contact_status
        - contact_solutions
        - patches
        - patch_status

    - wrench_<finger>: one per finger of the hand, F_S on the fingertip about its sensor's origin, as a sensor measures
      it: [m_x, m_y, m_z, f_x, f_y, f_z], N m and N; NaN where there is no reading. May stay
      unconnected for a finger without a sensor.
    - pressures_<pad>: one per tactile pad of the hand, of its cells, Pa; NaN where there is no reading. May stay
      unconnected.
    - age_<pad>: of those pressures, s; an old frame counts for nothing. May stay unconnected.
    - joint_positions: measured positions of the hand's joints, in the order of a plant of the hand alone, rad.
    - prior: `PosePrior` X_PO; may stay unconnected where the method needs none.
    - object_pose, hypotheses, status: of `PoseEstimator`.
    - contacts, fingers_in_contact, contact_status: of `ContactsInPalm` (its `status`).
    - contact_solutions: of `ContactSolver`.
    - patches, patch_status: of `PatchDescriptor` (its `status`); only where the hand has pads.

    Args:
        builder: receives the diagram.
        hand: the hand's names, fingertips and model; its kinematics are computed in a plant of its own.
        model: the object.
        params: parameters of each part.
        name: of the diagram in the other.

    Returns:
        The diagram; its ports are to be connected by name.
    """
    return builder.AddNamedSystem(name, MakePoseEstimation(hand, model, params))


def MakePoseEstimation(hand: HandConfig, model: ObjectModel, params: PoseEstimationParams | None = None) -> Diagram:
    """The diagram that `AddPoseEstimation` adds, by itself."""
    params = PoseEstimationParams() if params is None else params
    params.validate()
    plant, parts = make_hand_plant(hand)
    builder = DiagramBuilder()
    solver = builder.AddNamedSystem("contact_solver", ContactSolver(parts.surfaces, params.solver))
    contacts = builder.AddNamedSystem(
        "contacts_in_palm", ContactsInPalm(plant, parts.sensor_frames, parts.palm_frame, params.contacts)
    )
    collision = HandCollision(hand, model) if params.check_collisions else None
    estimator = builder.AddNamedSystem("pose_estimator", PoseEstimator(model, params.estimator, collision))
    builder.Connect(solver.GetOutputPort("contact_solutions"), contacts.GetInputPort("contact_solutions"))
    builder.Connect(contacts.GetOutputPort("contacts"), estimator.GetInputPort("contacts"))
    builder.Connect(contacts.GetOutputPort("status"), estimator.GetInputPort("contact_status"))
    posed_too = [] if collision is None else [estimator]
    if hand.pads:
        descriptor = builder.AddNamedSystem("patch_descriptor", PatchDescriptor(plant, parts, params.patches))
        builder.Connect(descriptor.GetOutputPort("patches"), estimator.GetInputPort("patches"))
        builder.Connect(descriptor.GetOutputPort("status"), estimator.GetInputPort("patch_status"))
        posed_too.append(descriptor)
        for pad in hand.pads:
            for port in (f"pressures_{pad.name}", f"age_{pad.name}"):
                builder.ExportInput(descriptor.GetInputPort(port), port)
        builder.ExportOutput(descriptor.GetOutputPort("patches"), "patches")
        builder.ExportOutput(descriptor.GetOutputPort("status"), "patch_status")
    if params.use_hand_volume:
        volume = builder.AddNamedSystem("hand_volume", HandVolume(plant, parts, BodySpheres.of_hand(hand)))
        builder.Connect(contacts.GetOutputPort("fingers_untouched"), volume.GetInputPort("fingers_untouched"))
        builder.Connect(volume.GetOutputPort("hand"), estimator.GetInputPort("hand"))
        builder.Connect(volume.GetOutputPort("untouched"), estimator.GetInputPort("untouched"))
        posed_too.append(volume)

    for finger in parts.sensor_frames:
        builder.ExportInput(solver.GetInputPort(f"wrench_{finger}"), f"wrench_{finger}")
    builder.ExportInput(contacts.GetInputPort("joint_positions"), "joint_positions")
    for system in posed_too:
        builder.ConnectInput("joint_positions", system.GetInputPort("joint_positions"))
    builder.ExportInput(estimator.GetInputPort("prior"), "prior")
    for port in ("object_pose", "hypotheses", "status"):
        builder.ExportOutput(estimator.GetOutputPort(port), port)
    for port, exported in (
        ("contacts", "contacts"),
        ("fingers_in_contact", "fingers_in_contact"),
        ("status", "contact_status"),
    ):
        builder.ExportOutput(contacts.GetOutputPort(port), exported)
    builder.ExportOutput(solver.GetOutputPort("contact_solutions"), "contact_solutions")
    diagram = builder.Build()
    diagram.set_name("pose_estimation")
    return diagram
