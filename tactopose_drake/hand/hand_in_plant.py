"""How a hand gets into a plant, and where in it what its configuration names is found."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path

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
from tactopose_drake.core.validation import known_name, told_of
from tactopose_drake.errors import InvalidFileError, InvalidInputError, UnknownNameError
from tactopose_drake.hand.calibration_file import HandCalibration, load_calibration
from tactopose_drake.hand.contact_gains import thicker
from tactopose_drake.hand.hand_config import HandConfig, HandUncertainty
from tactopose_drake.resources import add_model, make_parser

_LARGEST_SLIDE = 0.1  # m, of the offset of a joint that slides
_SAME_POSE = 1e-3  # m, and of the rotation's matrix: files are rounded


@dataclasses.dataclass(frozen=True)
class Hand:
    """A hand in a plant: where the names of its configuration have led.

    `sensor_frames`, `welds` and `surfaces` are those of the fingers with a force-torque sensor, by finger, `layers` of
    those with a soft skin; `pad_frames` are those of the tactile pads, by pad. `calibration` is what is known of the
    hand's errors, in a plant that estimates by its readings; there, `sensor_frames` and `surfaces` are where it has
    found them.
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
        config: which hand.
        X_WBase: where to weld the hand's base link; None leaves it as the model has it, mostly free, for the caller to
            weld on an arm.

    Raises:
        UnknownNameError: if the model lacks a name of the configuration.
        InvalidFileError: if Drake cannot read the model.
        InvalidInputError: if a package of the model is not installed, the base link is not the model's root, the model
            itself fixes it to the world elsewhere or moves it there, or a weld is a joint that moves and the sensor is
            not behind it.
    """
    config.validate()
    model_instance = add_model(make_parser(plant, config.packages), config.model)
    hand = find_hand(plant, config, model_instance)
    _check_base(plant, hand)
    # Asked for one model's actuators, an unfinished plant says that there is none.
    actuators = (plant.get_joint_actuator(index) for index in plant.GetJointActuatorIndices())
    actuated = {actuator.joint().name() for actuator in actuators if actuator.model_instance() == model_instance}
    driven = dict.fromkeys(name for finger in config.fingers for name in finger.joints)  # fingers may share one
    for name in (name for name in driven if name not in actuated):
        plant.AddJointActuator(name, plant.GetJointByName(name, model_instance))
    if X_WBase is not None:
        _fix_base(plant, hand, X_WBase)
    return hand


def add_fixed_hand(plant: MultibodyPlant, config: HandConfig) -> Hand:
    """`add_hand`, its base where the model itself fixes it to the world, or at the origin: for what is seen from P."""
    hand = add_hand(plant, config)
    if joint_to_world(plant, hand) is None:
        _fix_base(plant, hand, RigidTransform())
    return hand


def pose_by_model(config: HandConfig) -> RigidTransform | None:
    """X_WBase of a hand whose model itself fixes its base to the world; None of one that may stand anywhere.

    Raises:
        UnknownNameError, InvalidFileError, InvalidInputError: as `add_hand`.
    """
    plant = MultibodyPlant(time_step=0.001)
    joint = joint_to_world(plant, add_hand(plant, config))
    return None if joint is None else _pose_of_child(joint)


def joint_to_world(plant: MultibodyPlant, hand: Hand) -> WeldJoint | None:
    """The joint that fixes the hand's base to the world; None where there is none."""
    base = plant.GetFrameByName(hand.config.base_link, hand.model_instance).body()
    joint = joints_by_child(plant, hand).get(base.index())
    is_to_world = isinstance(joint, WeldJoint) and joint.parent_body().index() == plant.world_body().index()
    return joint if is_to_world else None


def _pose_of_child(joint: WeldJoint) -> RigidTransform:
    """Of a body that is fixed to the world, there."""
    X_WF, X_BM = (frame.GetFixedPoseInBodyFrame() for frame in (joint.frame_on_parent(), joint.frame_on_child()))
    return X_WF @ joint.X_FM() @ X_BM.inverse()


def _fix_base(plant: MultibodyPlant, hand: Hand, X_WBase: RigidTransform) -> None:
    """Welds the base to the world; raises InvalidInputError if the model has fixed it elsewhere."""
    base, joint = hand.config.base_link, joint_to_world(plant, hand)
    if joint is None:
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(base, hand.model_instance), X_WBase)
    elif not _pose_of_child(joint).IsNearlyEqualTo(X_WBase, _SAME_POSE):
        raise InvalidInputError(
            f"X_WBase: is not where the joint {joint.name()!r} of {hand.config.model} fixes {base!r} to the world; "
            "allowed are None and that pose, or any where the model is without this joint."
        )


def _check_base(plant: MultibodyPlant, hand: Hand) -> None:
    """Raises InvalidInputError if a joint of the model moves the base link."""
    joints, name = joints_by_child(plant, hand), hand.config.base_link
    base = root = plant.GetFrameByName(name, hand.model_instance).body()
    while root.index() in joints and joints[root.index()].parent_body().model_instance() == hand.model_instance:
        root = joints[root.index()].parent_body()
    if root.index() != base.index():
        raise InvalidInputError(
            f"HandConfig.base_link: is {name!r}, which the joint {joints[base.index()].name()!r} carries; allowed is "
            f"the model's root, {root.name()!r}."
        )
    if base.index() in joints and not isinstance(joints[base.index()], WeldJoint):
        raise InvalidInputError(
            f"HandConfig.base_link: is {name!r}, which the joint {joints[base.index()].name()!r} moves in the world; "
            "allowed is a fixed joint, or none."
        )


def joints_by_child(plant: MultibodyPlant, hand: Hand) -> dict[BodyIndex, Joint]:
    """The hand's joints by the index of the body that each one moves."""
    joints = [plant.get_joint(index) for index in plant.GetJointIndices(hand.model_instance)]
    return {joint.child_body().index(): joint for joint in joints}


def measured_joints(plant: MultibodyPlant, hand: Hand) -> tuple[str, ...]:
    """The joints that an encoder measures: those that move and follow no other."""
    joints = [plant.get_joint(index) for index in plant.GetJointIndices(hand.model_instance)]
    followers = hand.config.couplings
    return tuple(joint.name() for joint in joints if joint.num_positions() == 1 and joint.name() not in followers)


def find_hand(plant: MultibodyPlant, config: HandConfig, model_instance: ModelInstanceIndex) -> Hand:
    """Looks up a hand that is already in a plant.

    Raises:
        UnknownNameError: if the model lacks a name of the configuration.
        InvalidInputError: if a weld is a joint that moves and the sensor is not behind it.
    """
    frames = {plant.get_frame(index).name(): plant.get_frame(index) for index in plant.GetFrameIndices(model_instance)}
    joints = {plant.get_joint(index).name(): plant.get_joint(index) for index in plant.GetJointIndices(model_instance)}
    sensing = [finger for finger in config.fingers if finger.sensor_frame]
    for finger in config.fingers:
        needed = [*finger.joints, *(coupling.joint for coupling in finger.couplings)]
        needed += [finger.weld] if finger in sensing else []
        for name in needed:
            if name not in joints:
                raise UnknownNameError(f"joint of finger {finger.name!r}", name, sorted(joints))
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
                f"HandConfig.fingers[{finger.name}].weld: the joint {finger.weld!r} moves; allowed are those that are "
                f"fixed ({fixed}), or a sensor frame on the link {tip.name()!r} that it moves."
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
    """A finalized plant of the hand alone, for kinematics from joint positions.

    Its base is where the model itself fixes it to the world, or else at the origin. It is the hand as it is known
    to be: with its calibration, where the configuration names one.

    Raises:
        UnknownNameError, InvalidFileError, InvalidInputError: as `add_hand`, and if the calibration does not fit.
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
        try:
            hand = _calibrated(plant, hand, calibration)
        except InvalidInputError as error:
            raise InvalidFileError(f"{config.calibration}: {error}") from None
    plant.Finalize()
    return plant, hand


def _calibrated(plant: MultibodyPlant, hand: Hand, calibration: HandCalibration) -> Hand:
    """The hand in an unfinished plant with its sensors' frames and fingertips where a calibration has found them.

    Raises:
        InvalidInputError: if the calibration is of another hand, leaves nothing of a fingertip, or an offset is out of
            its range.
    """
    calibration.check_names(measured_joints(plant, hand), hand.sensor_frames)
    for name, offset in calibration.joint_offsets.items():
        slides = isinstance(plant.GetJointByName(name, hand.model_instance), PrismaticJoint)
        if slides and abs(offset.value) > _LARGEST_SLIDE:
            raise InvalidInputError(
                f"joint_offsets.{name}.value: is {offset.value:g} m, of a joint that slides; allowed are numbers from "
                f"{-_LARGEST_SLIDE:g} to {_LARGEST_SLIDE:g} m."
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
