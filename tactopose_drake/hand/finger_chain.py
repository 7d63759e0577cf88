"""The kinematics of one finger as a serial chain, for batches of joint positions."""

import dataclasses
import math

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, Frame, PrismaticJoint, RevoluteJoint, WeldJoint

from tactopose_drake.core.grasping.serial_chain import SerialChain
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.hand_config import FingerConfig
from tactopose_drake.hand.hand_in_plant import Hand, joints_by_child

_MOST_TURNED = 2.0 * math.pi + 1e-3  # rad


def finger_chain(plant: MultibodyPlant, hand: Hand, finger: str) -> SerialChain:
    """The kinematics of one finger from palm to sensor, for batches of joint positions.

    Args:
        plant: finalized plant that holds the hand.
        hand: the hand in it.
        finger: the finger's name.

    Raises:
        InvalidInputError: if a joint between palm and sensor is not revolute, prismatic or fixed, or is not among the
            finger's joints, or the palm does not carry the sensor.
    """
    config = hand.config.finger(finger)
    links, X_last = _links(plant, hand, finger)
    follows = [_following(config, link.joint.name()) for link in links]
    actuated = [plant.GetJointByName(name, hand.model_instance) for name in config.joints]
    return SerialChain(
        np.array([link.X_parent.GetAsMatrix34() for link in links]),
        np.array([_axis(link.joint) for link in links]),
        np.array([link.X_child.GetAsMatrix34() for link in links]),
        np.array([ratios for ratios, _ in follows]),
        X_last.GetAsMatrix34(),
        np.array([joint.position_lower_limits()[0] for joint in actuated]),
        np.array([joint.position_upper_limits()[0] for joint in actuated]),
        tuple(link.joint.child_body().name() for link in links),
        frozenset(i for i, link in enumerate(links) if isinstance(link.joint, PrismaticJoint)),
        np.array([offset for _, offset in follows]),
    )


def checked_limits(finger: FingerConfig, chain: SerialChain) -> str:
    """Describes the limits of a finger's actuated joints, and checks them.

    Raises:
        InvalidInputError: if a joint has no limits, cannot move between them, or may rotate by more than a turn from 0.
    """
    slides = chain.arms != 1.0
    limits = zip(finger.joints, chain.lower, chain.upper, np.where(slides, "m", "rad"), strict=True)
    shown = ", ".join(f"{name} {low:.3g} to {high:.3g} {unit}" for name, low, high, unit in limits)
    text = f"joint limits: {shown}"
    if not np.all(np.isfinite([*chain.lower, *chain.upper])) or not np.all(chain.lower < chain.upper):
        raise InvalidInputError(
            f"finger {finger.name!r}: joint limits must be finite and differ for planned grasps, not {shown}."
        )
    if np.any(np.maximum(-chain.lower, chain.upper)[~slides] > _MOST_TURNED):
        raise InvalidInputError(
            f"finger {finger.name!r}: joint limits of revolute joints must be from -2 pi to 2 pi rad, not {shown} "
            "(these may be degrees)."
        )
    return text


@dataclasses.dataclass
class _Link:
    """A moving joint, the pose of its frame in the preceding link, and of the child body in its frame."""

    joint: RevoluteJoint | PrismaticJoint
    X_parent: RigidTransform
    X_child: RigidTransform


def _links(plant: MultibodyPlant, hand: Hand, finger: str) -> tuple[list[_Link], RigidTransform]:
    """The moving joints from the palm frame to the finger's sensor frame, and that frame's pose in the last link.

    Raises:
        InvalidInputError: as in `finger_chain`.
    """
    joint_of_child = joints_by_child(plant, hand)
    sensor_frame, body = hand.sensor_frames[finger], hand.sensor_frames[finger].body()
    X_last: RigidTransform = sensor_frame.GetFixedPoseInBodyFrame()
    links: list[_Link] = []
    on_palm = welded_bodies(plant, hand.palm_frame)
    while body.index() not in on_palm:
        if body.index() not in joint_of_child:
            raise InvalidInputError(
                f"finger {finger!r}: its sensor frame {sensor_frame.name()!r} must be carried by the palm's link "
                f"{hand.palm_frame.body().name()!r}."
            )
        joint = joint_of_child[body.index()]
        X_parent = joint.frame_on_parent().GetFixedPoseInBodyFrame()
        X_child = joint.frame_on_child().GetFixedPoseInBodyFrame().inverse()
        if isinstance(joint, WeldJoint):
            # A fixed joint is part of the constant pose of the link after it.
            fixed = X_parent @ joint.X_FM() @ X_child
            if links:
                links[-1].X_parent = fixed @ links[-1].X_parent
            else:
                X_last = fixed @ X_last
        elif isinstance(joint, RevoluteJoint | PrismaticJoint):
            links.append(_Link(joint, X_parent, X_child))
        else:
            raise InvalidInputError(
                f"joint {joint.name()!r} must be revolute, prismatic or fixed on a finger, not {joint.type_name()}."
            )
        body = joint.parent_body()
    if not links:
        raise InvalidInputError(
            f"finger {finger!r}: its sensor frame {sensor_frame.name()!r} must be moved by a joint, but none does."
        )
    X_PBody = plant.CalcRelativeTransform(plant.CreateDefaultContext(), hand.palm_frame, body.body_frame())
    links[-1].X_parent = X_PBody @ links[-1].X_parent
    return links[::-1], X_last


def joints_towards(plant: MultibodyPlant, hand: Hand, frame: Frame, start: str | None = None) -> list[str]:
    """The joints that move a frame, from the palm outwards.

    Args:
        plant: finalized plant that holds the hand.
        hand: the hand in it.
        frame: a frame on the hand.
        start: name of the link from which the joints are listed; None: the palm's.
    """
    joint_of_child = joints_by_child(plant, hand)
    first = hand.palm_frame if start is None else plant.GetFrameByName(start, hand.model_instance)
    body, names, on_first = frame.body(), [], welded_bodies(plant, first)
    while body.index() not in on_first and body.index() in joint_of_child:
        joint = joint_of_child[body.index()]
        if joint.num_positions():
            names.append(joint.name())
        body = joint.parent_body()
    return names[::-1]


def welded_bodies(plant: MultibodyPlant, frame: Frame) -> set[BodyIndex]:
    """The body of a frame, and the bodies that are welded to it."""
    return {body.index() for body in plant.GetBodiesWeldedTo(frame.body())}


def _axis(joint: RevoluteJoint | PrismaticJoint) -> FloatArray:
    """The axis along which a joint slides or about which it turns, in its frame, shape (3,)."""
    axis: FloatArray = joint.translation_axis() if isinstance(joint, PrismaticJoint) else joint.revolute_axis()
    return axis


def _following(config: FingerConfig, joint: str) -> tuple[list[float], float]:
    """The coefficients of a joint's position in the finger's actuated joints, and its offset."""
    follows = {coupling.joint: coupling for coupling in config.couplings}
    leader = follows[joint].follows if joint in follows else joint
    if leader not in config.joints:
        raise InvalidInputError(f"finger {config.name!r}: joint {joint!r} must be one of its joints {config.joints}.")
    ratio, offset = (follows[joint].ratio, follows[joint].offset) if joint in follows else (1.0, 0.0)
    return [ratio * (name == leader) for name in config.joints], offset
