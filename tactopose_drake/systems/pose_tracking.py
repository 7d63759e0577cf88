"""A sub-diagram from wrenches, joints and vision to the belief of the object's pose over time."""

import dataclasses

from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem

from tactopose_drake.core.calibration.offset_refinement import OffsetRefinementParams
from tactopose_drake.core.parameter_checks import check_parts, params_of
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import flag, instance_of
from tactopose_drake.hand.collision import HandCollision
from tactopose_drake.hand.hand_config import HandConfig, HandUncertainty
from tactopose_drake.hand.hand_in_plant import Hand, make_hand_plant
from tactopose_drake.systems.belief_inputs import pad_source
from tactopose_drake.systems.fingertip_inertia import FingertipInertia, FingertipInertiaParams
from tactopose_drake.systems.fingertip_velocities import FingertipVelocities
from tactopose_drake.systems.joint_offset_refiner import JointOffsetRefiner
from tactopose_drake.systems.live_pose_belief_estimator import LivePoseBeliefEstimator
from tactopose_drake.systems.plant_senses import add_with_plant, told_hand
from tactopose_drake.systems.pose_belief_estimator import PoseBeliefEstimator, PoseBeliefParams
from tactopose_drake.systems.touch_sensing import TouchParams, add_touch


@dataclasses.dataclass(kw_only=True, slots=True)
class PoseTrackingParams(TouchParams):
    """The parameters of each part."""

    belief: PoseBeliefParams = dataclasses.field(default_factory=PoseBeliefParams)
    # Which forces count as inertial forces of the fingertips, and not as a touch.
    inertia: FingertipInertiaParams = dataclasses.field(default_factory=FingertipInertiaParams)
    use_joint_velocities: bool = True  # whether the object is taken to move with the fingertips; else with the palm
    live: bool = False  # whether the belief is computed in a thread of its own, for hardware; not repeatable
    # Online refinement of the encoders' offsets by fingertips with a force-torque sensor; None: no refinement.
    refinement: OffsetRefinementParams | None = None

    def validate(self) -> None:
        """Raises InvalidInputError if a value is out of its range."""
        TouchParams.validate(self)
        for name in ("use_joint_velocities", "live"):
            flag(f"PoseTrackingParams.{name}", getattr(self, name))
        check_parts(self, belief=PoseBeliefParams, inertia=FingertipInertiaParams)
        if self.refinement is not None:
            check_parts(self, refinement=OffsetRefinementParams)


def AddPoseTracking(
    builder: DiagramBuilder,
    hand: HandConfig,
    model: ObjectModel,
    params: PoseTrackingParams | None = None,
    name: str = "pose_tracking",
    *,
    plant: MultibodyPlant | Hand | None = None,
    simulated_senses: bool = True,
) -> Diagram:
    """Adds the tracking of a held object's pose to a diagram.

    .. pydrake_system::

        name: pose_tracking
        input_ports:
        - wrench_<finger>
        - pressures_<pad>
        - age_<pad>
        - joint_positions
        - joint_velocities
        - prior
        - planes
        - vision
        - palm_pose
        output_ports:
        - object_pose
        - object_pose_vector
        - object_pose_in_world
        - covariance
        - hypotheses
        - status
        - belief
        - contacts
        - fingers_in_contact
        - contact_status
        - contact_solutions
        - patches
        - pads
        - patch_status
        - joint_offsets
        - joint_offset_sigmas

    It can replace the diagram of `AddPoseEstimation`, which documents all ports that are not listed here.

    - joint_velocities: of the joints of joint_positions, rad/s; the port exists only with `use_joint_velocities`, and
      may stay unconnected.
    - vision, palm_pose, and the outputs up to belief: see `PoseBeliefEstimator`.
    - joint_offsets, joint_offset_sigmas: see `JointOffsetRefiner`; only with `refinement`.
    - contacts, fingers_in_contact: without fingers whose own acceleration explains the force, see `FingertipInertia`;
      contact_solutions still has these.

    Args:
        builder: receives the diagram.
        hand: the hand's names, fingertips and model; its kinematics are computed in a plant of its own.
        model: the object.
        params: parameters of each part.
        name: name of the added diagram.
        plant: as in `AddPoseEstimation`.
        simulated_senses: likewise.

    Returns:
        The diagram; connect its remaining ports by name.

    Raises:
        InvalidInputError: if a parameter is out of its range, another system of the builder has the name, or the plant
            is not finalized, is not in the builder, or does not hold exactly one such hand.
    """
    hand = told_hand(hand, plant, simulated_senses)
    return add_with_plant(builder, name, MakePoseTracking(hand, model, params), hand, plant, simulated_senses)


def MakePoseTracking(hand: HandConfig, model: ObjectModel, params: PoseTrackingParams | None = None) -> Diagram:
    """Builds the diagram that `AddPoseTracking` adds."""
    instance_of("hand", hand, HandConfig)
    instance_of("model", model, ObjectModel)
    params = params_of(PoseTrackingParams, params)
    builder = DiagramBuilder()
    kind = LivePoseBeliefEstimator if params.live else PoseBeliefEstimator
    collision = HandCollision(hand, model) if params.check_collisions else None
    belief = builder.AddNamedSystem("pose_belief", kind(model, params.belief, collision))
    plant, parts = make_hand_plant(hand)
    refiner = None
    if params.refinement is not None:
        refining = JointOffsetRefiner(plant, parts, hand.uncertainty or HandUncertainty(), model, params.refinement)
        refiner = _add_refiner(builder, refining, belief)
    tips = [_add_velocities(builder, plant, parts, belief)] if params.use_joint_velocities else []
    if parts.sensor_frames:
        inertia = FingertipInertia(plant, parts, params.inertia, params.belief.period)
        tips.append(builder.AddNamedSystem("fingertip_inertia", inertia))
        if params.use_joint_velocities:
            builder.ConnectInput("joint_velocities", inertia.GetInputPort("joint_velocities"))
    add_touch(builder, plant, parts, params, belief, refiner, tips, collision)
    for port in ("prior", "planes", "vision", "palm_pose"):
        builder.ExportInput(belief.GetInputPort(port), port)
    diagram = builder.Build()
    diagram.set_name("pose_tracking")
    return diagram


def _add_refiner(builder: DiagramBuilder, refining: JointOffsetRefiner, belief: LeafSystem) -> LeafSystem:
    """Adds the refiner of the encoders' offsets, connected to the belief."""
    refiner: LeafSystem = builder.AddNamedSystem("offset_refiner", refining)
    builder.Connect(belief.GetOutputPort("belief"), refiner.GetInputPort("belief"))
    for name in ("joint_offsets", "joint_offset_sigmas"):
        builder.ExportOutput(refiner.GetOutputPort(name), name)
    return refiner


def _add_velocities(builder: DiagramBuilder, plant: MultibodyPlant, hand: Hand, belief: LeafSystem) -> LeafSystem:
    """Adds the computation of the fingertips' velocities, connected to the belief."""
    frames = {**hand.sensor_frames, **{pad_source(pad): frame for pad, frame in hand.pad_frames.items()}}
    moving = FingertipVelocities(plant, frames, hand.palm_frame)
    tips: LeafSystem = builder.AddNamedSystem("fingertip_velocities", moving)
    builder.ExportInput(tips.GetInputPort("joint_velocities"), "joint_velocities")
    builder.Connect(tips.GetOutputPort("tip_velocities"), belief.GetInputPort("tip_velocities"))
    return tips
