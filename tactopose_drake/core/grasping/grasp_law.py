"""The control law by which fingers close on an object until each carries its set force, and then hold.

Each finger has one control variable, its push, N. Below zero the commanded joint positions lie between the open posture
and that of first touch; above zero they go beyond, so that the joints' springs press the fingertip with about `push` N
against whatever is there. The push grows until the measured force reaches the set force.
"""

from dataclasses import dataclass

import numpy as np

from tactopose_drake.core.validation import FloatArray


@dataclass(frozen=True, eq=False)
class ClosingMotion:
    """How one finger closes.

    Attributes:
        q_open: joint positions before closing, shape (m,), rad.
        q_touch: joint positions at about first touch, shape (m,), rad.
        closing: change of the commanded positions per newton of push, shape (m,), rad/N.
        set_force: force that the fingertip is to carry, N.
    """

    q_open: FloatArray
    q_touch: FloatArray
    closing: FloatArray
    set_force: float


@dataclass(frozen=True, kw_only=True)
class GraspLaw:
    """Gains of the law."""

    approach_push: float = 4.0  # push between open and touch, N
    push_rate: float = 8.0  # largest rate of change of the push, N/s
    carry_share: float = 0.1  # relative tolerance within which a finger carries its set force
    slack_share: float = 0.7  # when holding, a finger with less than this share presses on
    most_push_share: float = 3.0  # largest push over the set force


def commanded_positions(motion: ClosingMotion, push: float, law: GraspLaw) -> FloatArray:
    """Joint positions to command, shape (m,), rad."""
    if push >= 0.0:
        return motion.q_touch + push * motion.closing
    share = min(-push / law.approach_push, 1.0)
    return motion.q_touch + share * (motion.q_open - motion.q_touch)


def update_push(push: float, force: float, set_force: float, holding: bool, period: float, law: GraspLaw) -> float:
    """The push of the next period, N.

    Args:
        push: now, N.
        force: measured magnitude of the fingertip's force, N; NaN without a reading, which counts as no force while the
            fingers close, and leaves the push unchanged when holding.
        set_force: N.
        holding: whether all fingers have closed; the grasp is then left alone, except for fingers that go slack.
            Controlling each force to its set value would push the released object about, as the measured forces never
            balance exactly.
        period: s.
        law: gains.
    """
    lack = (set_force - (0.0 if np.isnan(force) else force)) / set_force
    if holding and (np.isnan(force) or lack < 1.0 - law.slack_share):
        return push
    # The rate decreases over the last half of the set force, so that the measured force does not overshoot.
    rate = law.push_rate * float(np.clip(2.0 * lack, -1.0, 1.0))
    return max(-law.approach_push, min(push + period * rate, law.most_push_share * set_force))


def joint_torques(
    q: FloatArray, v: FloatArray, q_commanded: FloatArray, stiffness: FloatArray, damping: FloatArray
) -> FloatArray:
    """Joint torques of a spring and a damper per joint, shape (n,), N m."""
    torques: FloatArray = stiffness * (q_commanded - q) - damping * v
    return torques
