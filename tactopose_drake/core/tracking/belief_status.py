"""What a belief is worth, in a word and a remark."""

from tactopose_drake.core.posterior.pose_modes import MOST_OF_THE_MASS
from tactopose_drake.core.tracking.pose_belief import BeliefStatus, PoseBelief
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams


def judge(belief: PoseBelief, is_felt: bool, params: PoseTrackerParams) -> tuple[BeliefStatus, tuple[str, ...]]:
    """The status, and why, of a belief whose touch is felt or not."""
    time = belief.time
    if not is_felt:
        if not belief.has_pose:
            return "lost", ("nothing is touched",)
        since = time - max(belief.touch_time, belief.vision.believed_time)
        if since > params.forget_time:
            return "lost", (f"nothing was touched or seen for {since:.1f} s",)
        return "no_contact", ()
    if not belief.has_pose:
        return "lost", ("no pose explains the touch",)
    if time > belief.explained_time + params.lost_time:
        return "lost", ("no pose explains the touch",)
    if time < belief.slip_time + params.slip_time or not belief.explains_touch[0]:
        return "slipping", ()
    if belief.probability[0] < MOST_OF_THE_MASS:
        return "ambiguous", ()
    return "ok", ()
