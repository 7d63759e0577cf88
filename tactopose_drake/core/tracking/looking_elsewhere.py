"""Where the modes may be that a belief lacks, and how probable that is.

Either the object jumped, or the belief was wrong all along: too sure of its best mode, or without the right one from
the start. What jumped may be anywhere within the Gaussian in which is searched, and a mode that foretold the touch is
rightly far more probable. A belief that was wrong has no right to that: what is found is then weighed among itself.
"""

from typing import NamedTuple

from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.tracking.mode_set import ModeSet
from tactopose_drake.core.tracking.new_modes import SLIPPED, around
from tactopose_drake.core.tracking.pose_belief import PoseBelief
from tactopose_drake.core.tracking.pose_measurement import PoseMeasurement

# Prior probabilities that the object jumped when nothing says so, and when the touch or vision do; and that the belief
# was wrong since the last look.
_UNSEEN_JUMP, _JUMP, _WRONG = 1e-4, 0.1, 0.02
# While all is well every so many-th look is anywhere, the others near the best mode.
_ANYWHERE = 8


class Look(NamedTuple):
    """Where to look.

    Attributes:
        near: a Gaussian; None for anywhere.
        probability: that the object is there and no mode has it, a priori.
        jumped: whether it would have jumped there; otherwise the belief was wrong.
    """

    near: PoseMeasurement | None
    probability: float
    jumped: bool


def where_to_look(
    belief: PoseBelief,
    modes: ModeSet,
    seen: PoseMeasurement | None,
    prior: GaussianPrior | None,
    lost_time: float,
    *,
    troubled: bool,
) -> Look:
    """Where vision or a prior says, near the best mode, or anywhere.

    Args:
        belief: as of now, but for the touch.
        modes: after the touch, by falling weight.
        seen: what vision says now.
        prior: of a belief that has no pose yet.
        lost_time: s without an explanation of the touch, after which the pose is lost.
        troubled: whether the modes do not explain the touch or contradict it.
    """
    near, time = seen, belief.time
    if near is None:
        if not len(modes):
            near = None if prior is None else PoseMeasurement.from_prior(prior, time)
        elif time > belief.touch_time + lost_time:
            near = PoseMeasurement(time, belief.modes.X_PO[0], belief.modes.covariance[0])
        # It slips before it is anywhere: that is asked when near the best there is no explanation.
        elif time < belief.explained_time + 0.5 * lost_time if troubled else belief.searches % _ANYWHERE > 0:
            near = around(modes.X_PO[0], *SLIPPED, time)
    if near is None:
        return Look(None, _UNSEEN_JUMP, True)
    jumped = troubled or seen is not None
    return Look(near, _JUMP if jumped else _WRONG, jumped)
