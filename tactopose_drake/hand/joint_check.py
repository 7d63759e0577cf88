"""Check that the joints in a hand's file are those that move its fingers."""

from collections.abc import Iterator

import numpy as np
from pydrake.multibody.plant import MultibodyPlant

from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.coupling_check import lacking_couplings
from tactopose_drake.hand.findings import Entry, Finding, Verdict, fault
from tactopose_drake.hand.finger_chain import checked_limits, finger_chain, joints_towards
from tactopose_drake.hand.hand_config import FingerConfig
from tactopose_drake.hand.hand_in_plant import Hand, joints_of
from tactopose_drake.hand.hand_reach import REST_ROUNDING
from tactopose_drake.hand.shared_joints import held_joints, shared_joints


def check_joints(plant: MultibodyPlant, hand: Hand) -> Iterator[Finding]:
    """Compares the joints of a hand's file with those that move each finger's sensor in the model."""
    joints = joints_of(plant, hand)
    moving = sorted((joint.position_start(), joint.name()) for joint in joints if joint.num_positions())
    yield Finding("joints", f"order of joint_positions: {', '.join(name for _, name in moving)}")
    without_couplings = lacking_couplings(plant, hand)
    for finger in hand.config.fingers:
        part = f"finger {finger.name}"
        if not finger.sensor_frame:
            yield Finding(part, "has no force-torque sensor: it is not used in planned grasps", "note")
            continue
        order = _order(plant, hand, finger)
        try:
            chain = finger_chain(plant, hand, finger.name)
        except InvalidInputError as error:
            # Missing couplings are reported by the check of couplings.
            if finger.name not in without_couplings:
                better = (Entry(finger.name, "joints", order),) if order else ()
                yield Finding(part, fault(part, error).text, "fault", better)
            continue
        if idle := [name for name in finger.joints if name not in order]:
            text = f"its joints have {', '.join(idle)}, by which its sensor frame {finger.sensor_frame!r} does not move"
            yield Finding(part, f"{text}; they are {', '.join(order)}", "fault", (Entry(finger.name, "joints", order),))
            continue
        if list(order) == finger.joints:
            path = joints_towards(plant, hand, hand.sensor_frames[finger.name])
            yield Finding(part, f"its joints lead from the palm outwards: {', '.join(path)}")
        else:
            text = f"its joints are {', '.join(finger.joints)}; from the palm outwards they are {', '.join(order)}"
            yield Finding(part, text, "note")
        try:
            limits = checked_limits(finger, chain)
        except InvalidInputError as error:
            # Pose estimation needs no limits; only planned grasps do.
            verdict: Verdict = "note" if has_unlimited_joints(plant, hand, finger) else "fault"
            yield Finding(part, fault(part, error).text, verdict)
        else:
            yield Finding(part, limits)
    yield from _rest(plant, hand)
    yield from _shared(hand)


def has_unlimited_joints(plant: MultibodyPlant, hand: Hand, finger: FingerConfig) -> bool:
    """Whether a finger has joints without limits, such as continuous ones, for which no grasps can be planned."""
    joints = [plant.GetJointByName(name, hand.model_instance) for name in finger.joints]
    limits = [limit for joint in joints for limit in (*joint.position_lower_limits(), *joint.position_upper_limits())]
    return not np.all(np.isfinite(limits))


def _order(plant: MultibodyPlant, hand: Hand, finger: FingerConfig) -> tuple[str, ...]:
    """The actuated joints that move a finger's sensor, from the palm outwards."""
    path = joints_towards(plant, hand, hand.sensor_frames[finger.name])
    follows = {coupling.joint: coupling.follows for coupling in finger.couplings}
    return tuple(dict.fromkeys(follows.get(name, name) for name in path))


def _rest(plant: MultibodyPlant, hand: Hand) -> Iterator[Finding]:
    said = hand.config.rest_positions
    for name in hand.config.driven:
        joint, position = plant.GetJointByName(name, hand.model_instance), said.get(name, 0.0)
        low, high = joint.position_lower_limits()[0], joint.position_upper_limits()[0]
        if low - REST_ROUNDING <= position <= high + REST_ROUNDING:
            continue
        verdict: Verdict = "fault" if name in said else "note"
        what = f"has {name!r} at" if name in said else f"lacks {name!r}, which rests at"
        text = f"`rest_positions` {what} {position:g}, beyond its limits, {low:.3g} to {high:.3g}"
        yield Finding("joints", text, verdict)


def _shared(hand: Hand) -> Iterator[Finding]:
    held = held_joints(hand.config)
    for joint, fingers in shared_joints(hand.config).items():
        text = f"{joint!r} moves the fingers {', '.join(fingers)} together; planned grasps "
        if joint in held:
            rest = hand.config.rest_positions.get(joint, 0.0)
            text += f"leave it where it rests, at {rest:g}: name another place in `rest_positions`"
        else:
            text += "take each by itself, and hold only what lies in the middle between them"
        yield Finding("joints", text, "note")
