"""Prediction of the belief: the object's motion since, and what follows it beside the modes and the keyframes."""

import dataclasses

import numpy as np

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.motion.object_motion import move_freely, move_with_fingertips, move_with_palm
from tactopose_drake.core.motion.rigid_motion import Motion, MotionHistory, predict_poses
from tactopose_drake.core.times import has_exceeded, has_passed
from tactopose_drake.core.tracking.frame import Frame, PoseMeasurement
from tactopose_drake.core.tracking.pose_belief import PoseBelief
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams


def motion_since(
    params: PoseTrackerParams, belief: PoseBelief, frame: Frame, contacts: Contacts, *, slips: bool, is_over: bool
) -> Motion:
    """The object's motion since the belief's time.

    Args:
        params: what is assumed of it.
        belief: before the motion.
        frame: all that is sensed now.
        contacts: its contacts.
        slips: whether the object slips in the hand.
        is_over: whether the last touch has ended.
    """
    duration, noise = frame.time - belief.time, params.noise
    # If the palm's pose is known, an object that is not touched rests in the world.
    if not len(contacts) and frame.X_WP is None and not is_over:
        return move_with_palm(noise, duration, slips=slips)
    if not len(contacts) or duration > noise.longest_gap:
        motion = move_freely(noise, duration, params.mixture.max_sigma_translation, belief.X_WP, frame.X_WP)
        # Before it is felt, the object rests in the world: late poses from vision tell as much as those of now.
        rests = belief.touch_time == -np.inf and not len(contacts)
        is_known = rests and belief.X_WP is not None and frame.X_WP is not None
        return dataclasses.replace(motion, covariance=np.zeros((6, 6))) if is_known else motion
    if frame.tip_velocity is None:
        return move_with_palm(noise, duration, slips=slips)
    forces = frame.evidence.contacts if len(frame.evidence.contacts) == len(contacts) else contacts
    felt = min(belief.felt_time.get(name, -np.inf) for name in frame.names)
    is_steady = not has_exceeded(belief.time, felt, params.flicker_time)
    settled = is_steady and has_passed(belief.time, belief.joined_time, params.settling_time)
    return move_with_fingertips(forces, frame.names, frame.tip_velocity, noise, duration, slips=slips, settled=settled)


def unknown_past(params: PoseTrackerParams, time: float) -> MotionHistory:
    """The history of an object of which nothing is known before a time, s: it may have moved freely.

    It reaches back as far as pictures count, so that one from before the first frame is used.
    """
    length = params.vision.max_age
    motion = move_freely(params.noise, length, params.mixture.max_sigma_translation)
    return MotionHistory((time - length, time), (motion,))


def follow_motion(params: PoseTrackerParams, belief: PoseBelief, motion: Motion, time: float) -> MotionHistory:
    """The history of a belief followed by the motion up to a time, s.

    Before any touch, a motion over a long gap is replaced by free motion. It may be that since the clock's zero, whose
    covariance is bounded, so that hardly any of it would fall to the last second.
    """
    duration = time - belief.time
    if duration > params.noise.longest_gap and belief.touch_time == -np.inf:
        return unknown_past(params, time)
    return belief.history.followed_by(motion, time, params.vision.max_age) if duration > 0.0 else belief.history


def move_standing(belief: PoseBelief, motion: Motion, time: float, *, was_taken: bool) -> PoseMeasurement | None:
    """The fused pose from vision after a motion of the object; before it is felt, it rests and stays as well known.

    Args:
        belief: before the motion.
        motion: since then.
        time: now, s.
        was_taken: whether the object has left the touch and may have been moved, so that older poses do not apply.
    """
    if belief.standing is None or (was_taken and belief.vision.accepted_time <= belief.touch_time):
        return None
    if belief.touch_time == -np.inf:
        motion = dataclasses.replace(motion, covariance=np.zeros((6, 6)))
    X_PO, covariance = predict_poses(belief.standing.X_PO[None], belief.standing.covariance[None], motion)
    return belief.standing.moved_to(time, X_PO[0], covariance[0])
