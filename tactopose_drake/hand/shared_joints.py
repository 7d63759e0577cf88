"""Joints that several fingers share, such as a common spread."""

import dataclasses
from collections import Counter

import numpy as np

from tactopose_drake.core.grasping.serial_chain import SerialChain
from tactopose_drake.hand.hand_config import HandConfig


def shared_joints(config: HandConfig) -> dict[str, list[str]]:
    """The fingers that share a joint, by the joint's name."""
    fingers: dict[str, list[str]] = {}
    for finger in config.fingers:
        for joint in finger.joints:
            fingers.setdefault(joint, []).append(finger.name)
    return {joint: names for joint, names in fingers.items() if len(names) > 1}


def held_joints(config: HandConfig) -> dict[str, list[str]]:
    """The shared joints that are held still during a grasp, because each of their fingers has joints of its own."""
    shared = shared_joints(config)
    own = Counter(finger.name for finger in config.fingers for joint in finger.joints if joint not in shared)
    return {joint: names for joint, names in shared.items() if all(own[name] for name in names)}


def with_held_joints(chain: SerialChain, config: HandConfig, finger: str) -> SerialChain:
    """A finger's kinematics for planned grasps, with the held joints fixed at their rest positions.

    Fingers are planned independently, and might otherwise need different positions of a shared joint.

    Args:
        chain: the finger's kinematics.
        config: the hand.
        finger: the finger's name.
    """
    held = held_joints(config)
    is_held = np.array([name in held for name in config.finger(finger).joints])
    rest = np.array([config.rest_positions.get(name, 0.0) for name in config.finger(finger).joints])
    rest = np.clip(rest, chain.lower, chain.upper)
    return dataclasses.replace(
        chain,
        coupling=np.where(is_held, 0.0, chain.coupling),
        offset=chain.offset + chain.coupling @ np.where(is_held, rest, 0.0),
        lower=np.where(is_held, rest, chain.lower),
        upper=np.where(is_held, rest, chain.upper),
    )
