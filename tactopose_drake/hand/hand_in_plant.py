"""Adding a hand to a plant, and looking up the elements that its configuration names."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path

from pydrake.geometry import SceneGraph, SceneGraphInspector
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    BodyIndex,
    FixedOffsetFrame,
    Frame,
    Joint,
    ModelInstanceIndex,
    PrismaticJoint,
    WeldJoint,
)

from tactopose_drake.core.poses import exp_so3
from tactopose_drake.core.sensing.soft_layer import SoftLayer
from tactopose_drake.core.surfaces import Surface
from tactopose_drake.core.validation import instance_of, known_name, told_of
from tactopose_drake.errors import InvalidFileError, InvalidInputError
from tactopose_drake.hand.calibration_file import HandCalibration, load_calibration
from tactopose_drake.hand.contact_gains import thicker
from tactopose_drake.hand.hand_config import HandConfig, HandUncertainty
from tactopose_drake.resources import add_model, make_parser

_LARGEST_SLIDE = 0.1  # largest offset of a prismatic joint, m
_SAME_POSE = 1e-3  # tolerance of a pose, in m and in the rotation matrix, as files are rounded


@dataclasses.dataclass(frozen=True)
class Hand:
    """A hand in a plant: the plant's elements that its configuration names.

    `sensor_frames`, `welds` and `surfaces` are of the fingers with a force-torque sensor, by finger; `layers` of those
    with a soft skin; `pad_frames` of the tactile pads, by pad. `calibration` holds the hand's known errors in a plant
    for estimation; `sensor_frames` and `surfaces` there include them.
    """

    config: HandConfig
    model_instance: ModelInstanceIndex
    palm_frame: Frame
    sensor_frames: Mapping[str, Frame]
    welds: Mapping[str, Joint]
    surfaces: Mapping[str, Surface]
    pad_frames: Mapping[str, Frame]
    layers: Mapping[str, SoftLayer]
    calibration: HandCalibration | None = None

    @property
    def fingers(self) -> tuple[str, ...]:
        """The fingers' names, in the order of the configuration."""
        return tuple(finger.name for finger in self.config.fingers)


def add_hand(plant: MultibodyPlant, config: HandConfig, X_WBase: RigidTransform | None = None) -> Hand:
    """Parses a hand into a plant that is not finalized yet.

    A joint that moves a finger and has no actuator in the model gets one, without a limit.

    Args:
        plant: receives the hand. Coupled joints need a discrete plant with a SAP-family contact approximation, which
            is Drake's default.
        config: the hand's configuration.
        X_WBase: pose at which the hand's base link is welded to the world; None leaves it as in the model, mostly
            free, for the caller to weld to an arm.

    Raises:
        UnknownNameError: if the model lacks a name of the configuration.
        InvalidFileError: if Drake cannot read the model.
        InvalidInputError: if an argument has a wrong type; if the plant is finalized; if a package of the model is not
            installed; if the base link is not the model's root, or the model connects it to the world by a moving joint
            or at another pose; if a finger's weld is a moving joint and its sensor frame is not on the link that this
            moves.
    """
    instance_of("plant", plant, MultibodyPlant)
    instance_of("config", config, HandConfig)
    if X_WBase is not None:
        instance_of("X_WBase", X_WBase, RigidTransform)
    if plant.is_finalized():
        raise InvalidInputError("plant must not be finalized yet, but is.")
    config.validate()
    model_instance = add_model(make_parser(plant, config.packages), config.model)
    hand = find_hand(plant, config, model_instance)
    _check_base(plant, hand)
    # GetJointActuatorIndices(model_instance) returns nothing before the plant is finalized.
    actuators = (plant.get_joint_actuator(index) for index in plant.GetJointActuatorIndices())
    actuated = {actuator.joint().name() for actuator in actuators if actuator.model_instance() == model_instance}
    for name in (name for name in config.driven if name not in actuated):
        plant.AddJointActuator(name, plant.GetJointByName(name, model_instance))
    if X_WBase is not None:
        _fix_base(plant, hand, X_WBase)
    return hand


def add_fixed_hand(plant: MultibodyPlant, config: HandConfig) -> Hand:
    """Like `add_hand`, with the base where the model fixes it to the world, or else at the origin."""
    hand = add_hand(plant, config)
    if joint_to_world(plant, hand) is None:
        _fix_base(plant, hand, RigidTransform())
    return hand


def pose_by_model(config: HandConfig) -> RigidTransform | None:
    """X_WBase of a hand whose model fixes its base to the world; None for other hands.

    Raises:
        UnknownNameError, InvalidFileError, InvalidInputError: as in `add_hand`.
    """
    plant = MultibodyPlant(time_step=0.001)
    joint = joint_to_world(plant, add_hand(plant, config))
    return None if joint is None else _pose_of_child(joint)


def joint_to_world(plant: MultibodyPlant, hand: Hand) -> WeldJoint | None:
    """The joint that fixes the hand's base to the world; None if there is none."""
    base = plant.GetFrameByName(hand.config.base_link, hand.model_instance).body()
    joint = joints_by_child(plant, hand).get(base.index())
    is_to_world = isinstance(joint, WeldJoint) and joint.parent_body().index() == plant.world_body().index()
    return joint if is_to_world else None


def _pose_of_child(joint: WeldJoint) -> RigidTransform:
    """Pose in the world of a body that a joint fixes to the world."""
    X_WF, X_BM = (frame.GetFixedPoseInBodyFrame() for frame in (joint.frame_on_parent(), joint.frame_on_child()))
    return X_WF @ joint.X_FM() @ X_BM.inverse()


def _fix_base(plant: MultibodyPlant, hand: Hand, X_WBase: RigidTransform) -> None:
    """Welds the base to the world; raises InvalidInputError if the model has fixed it elsewhere."""
    base, joint = hand.config.base_link, joint_to_world(plant, hand)
    if joint is None:
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(base, hand.model_instance), X_WBase)
    elif not _pose_of_child(joint).IsNearlyEqualTo(X_WBase, _SAME_POSE):
        raise InvalidInputError(
            f"X_WBase must be None, or the pose in which the joint {joint.name()!r} of {hand.config.model} fixes "
            f"{base!r} to the world, or any pose if this joint is removed from the model."
        )


def _check_base(plant: MultibodyPlant, hand: Hand) -> None:
    """Raises InvalidInputError if a joint of the model moves the base link."""
    joints, name = joints_by_child(plant, hand), hand.config.base_link
    base = root = plant.GetFrameByName(name, hand.model_instance).body()
    while root.index() in joints and joints[root.index()].parent_body().model_instance() == hand.model_instance:
        root = joints[root.index()].parent_body()
    if root.index() != base.index():
        raise InvalidInputError(
            f"HandConfig.base_link must be the model's root, {root.name()!r}, not {name!r}, which the joint "
            f"{joints[base.index()].name()!r} carries."
        )
    if base.index() in joints and not isinstance(joints[base.index()], WeldJoint):
        raise InvalidInputError(
            f"HandConfig.base_link must have a fixed joint to the world, or none, not {name!r}, which the joint "
            f"{joints[base.index()].name()!r} moves in the world."
        )


def joints_of(plant: MultibodyPlant, hand: Hand) -> list[Joint]:
    """All joints of the hand, also those that do not move, in the plant's order."""
    return [plant.get_joint(index) for index in plant.GetJointIndices(hand.model_instance)]


def sliding_joints(plant: MultibodyPlant, hand: Hand) -> frozenset[str]:
    """Names of the hand's prismatic joints, whose positions are in m."""
    return frozenset(joint.name() for joint in joints_of(plant, hand) if isinstance(joint, PrismaticJoint))


def joints_by_child(plant: MultibodyPlant, hand: Hand) -> dict[BodyIndex, Joint]:
    """The hand's joints by the index of their child bodies."""
    return {joint.child_body().index(): joint for joint in joints_of(plant, hand)}


def measured_joints(plant: MultibodyPlant, hand: Hand) -> tuple[str, ...]:
    """Names of the joints that have an encoder: those that move and are not coupled to another."""
    moving = (joint.name() for joint in joints_of(plant, hand) if joint.num_positions() == 1)
    return tuple(name for name in moving if name not in hand.config.couplings)


def find_hand(plant: MultibodyPlant, config: HandConfig, model_instance: ModelInstanceIndex) -> Hand:
    """Looks up a hand that is already in a plant.

    Raises:
        UnknownNameError: if the model lacks a name of the configuration.
        InvalidInputError: if an argument has a wrong type; if a finger's weld is a moving joint and its sensor frame is
            not on the link that it moves.
    """
    instance_of("plant", plant, MultibodyPlant)
    instance_of("config", config, HandConfig)
    instance_of("model_instance", model_instance, ModelInstanceIndex)
    frames = {plant.get_frame(index).name(): plant.get_frame(index) for index in plant.GetFrameIndices(model_instance)}
    joints = {plant.get_joint(index).name(): plant.get_joint(index) for index in plant.GetJointIndices(model_instance)}
    sensing = [config.finger(name) for name in config.sensing]
    for finger in config.fingers:
        needed = [*finger.joints, *(coupling.joint for coupling in finger.couplings)]
        needed += [finger.weld] if finger in sensing else []
        for name in needed:
            known_name(f"each joint of finger {finger.name!r}", name, sorted(joints))
    pads = {pad.name: pad.frame for pad in config.pads}
    named = {"base_link": config.base_link, "palm_frame": config.palm_frame}
    named |= {f"fingers[{finger.name}].sensor_frame": finger.sensor_frame for finger in sensing}
    named |= {f"pads[{name}].frame": frame for name, frame in pads.items()}
    for key, name in named.items():
        known_name(f"HandConfig.{key}", name, sorted(frames))
    for finger in sensing:
        tip, is_fixed = joints[finger.weld].child_body(), isinstance(joints[finger.weld], WeldJoint)
        if not is_fixed and frames[finger.sensor_frame].body().index() != tip.index():
            fixed = ", ".join(sorted(name for name, joint in joints.items() if isinstance(joint, WeldJoint))) or "none"
            raise InvalidInputError(
                f"HandConfig.fingers[{finger.name}].weld must be a joint that is fixed ({fixed}), not {finger.weld!r}, "
                f"which moves. Or give a sensor frame on the link {tip.name()!r} that it moves."
            )
    return Hand(
        config,
        model_instance,
        frames[config.palm_frame],
        {finger.name: frames[finger.sensor_frame] for finger in sensing},
        {finger.name: joints[finger.weld] for finger in sensing},
        {finger.name: finger.surface.make() for finger in sensing},
        {name: frames[frame] for name, frame in pads.items()},
        {finger.name: finger.layer.make(finger.name, finger.surface.make()) for finger in sensing if finger.layer},
    )


def make_hand_plant(config: HandConfig) -> tuple[MultibodyPlant, Hand]:
    """Makes a finalized plant of the hand alone, for kinematics from joint positions.

    Its base is where the model fixes it to the world, or else at the origin. If the configuration names a calibration,
    it is applied.

    Raises:
        UnknownNameError, InvalidFileError, InvalidInputError: as in `add_hand`, and if the calibration does not fit.
    """
    plant = MultibodyPlant(time_step=0.001)
    hand = add_fixed_hand(plant, config)
    if config.calibration:
        calibration = load_calibration(Path(config.calibration))
        uncertainty = config.uncertainty or HandUncertainty()
        for name in (finger.name for finger in config.fingers if finger.tared and finger.name in calibration.fingers):
            calibration.fingers[name] = calibration.fingers[name].after_tare(
                uncertainty.sensor_moment, uncertainty.sensor_force
            )
        with told_of(f"{config.calibration}: ", InvalidFileError):
            hand = _calibrated(plant, hand, calibration)
    plant.Finalize()
    return plant, hand


def make_hand_with_shapes(
    config: HandConfig, X_WBase: RigidTransform | None = None
) -> tuple[MultibodyPlant, SceneGraphInspector, Hand]:
    """Makes a finalized plant of the hand alone, without its calibration, and an inspector of the hand's shapes.

    The plant is not part of a diagram, so that its contexts know nothing of the shapes.

    Args:
        config: configuration of the hand.
        X_WBase: pose of its base in the world; None: as `add_fixed_hand` fixes it.

    Raises:
        InvalidInputError: as in `add_hand`.
    """
    plant, scene_graph = MultibodyPlant(time_step=0.001), SceneGraph()
    plant.RegisterAsSourceForSceneGraph(scene_graph)
    hand = add_fixed_hand(plant, config) if X_WBase is None else add_hand(plant, config, X_WBase)
    plant.Finalize()
    return plant, scene_graph.model_inspector(), hand


def _calibrated(plant: MultibodyPlant, hand: Hand, calibration: HandCalibration) -> Hand:
    """The hand in a plant that is not finalized, with calibrated sensor frames and fingertips.

    Raises:
        InvalidInputError: if the calibration is of another hand, makes a fingertip's radius negative, or has an offset
            out of its range.
    """
    calibration.check_names(measured_joints(plant, hand), hand.sensor_frames)
    sliding = sliding_joints(plant, hand)
    for name, offset in calibration.joint_offsets.items():
        if name in sliding and abs(offset.value) > _LARGEST_SLIDE:
            raise InvalidInputError(
                f"joint_offsets.{name}.value must be from {-_LARGEST_SLIDE:g} to {_LARGEST_SLIDE:g} m for a prismatic "
                f"joint, not {offset.value:g} m."
            )
    frames, surfaces = dict(hand.sensor_frames), dict(hand.surfaces)
    for finger, found in calibration.fingers.items():
        turned, moved = found.mounting[:3], found.mounting[3:]
        X_SM = RigidTransform(RotationMatrix(exp_so3(turned)), moved)
        frames[finger] = plant.AddFrame(
            FixedOffsetFrame(f"{frames[finger].name()}_as_calibrated", frames[finger], X_SM, hand.model_instance)
        )
        with told_of(f"fingers.{finger}.radius: the fingertip's "):
            surfaces[finger] = thicker(surfaces[finger], found.radius.value)
    return dataclasses.replace(hand, sensor_frames=frames, surfaces=surfaces, calibration=calibration)
