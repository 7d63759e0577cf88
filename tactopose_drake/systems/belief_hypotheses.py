"""A belief's modes as the hypotheses of an estimate."""

import numpy as np
from pydrake.math import RigidTransform

from tactopose_drake.core.kernels.matrix_kernels import inverses
from tactopose_drake.core.posterior.hypotheses import free_directions
from tactopose_drake.core.posterior.posterior_params import DEFAULT_PARAMS
from tactopose_drake.core.statuses import STATUS_OF_BELIEF
from tactopose_drake.core.tracking.pose_belief import PoseBelief
from tactopose_drake.estimation.pose_hypothesis import PoseHypothesis
from tactopose_drake.estimation.results import PoseEstimate


def estimate_of(belief: PoseBelief, size: float, duration: float = 0.0) -> PoseEstimate | None:
    """A belief's modes as hypotheses; None where there are none.

    Args:
        belief: the belief.
        size: the object's, m; directions known to less than a tenth of it are free.
        duration: what is given as the estimate's, s.
    """
    if not belief.has_pose:
        return None
    free = free_directions(inverses(belief.covariance)[0], size)
    hypotheses = tuple(
        PoseHypothesis(
            RigidTransform(X_PO), -float(np.log(max(share, 1e-300))), min(float(share), 1.0), covariance, rows, bool(ok)
        )
        for X_PO, share, covariance, rows, ok in zip(
            belief.X_PO, belief.probability, belief.covariance, free, belief.explains_touch, strict=True
        )
    )
    status = STATUS_OF_BELIEF[belief.status]
    if status == "ok" and belief.probability[0] < DEFAULT_PARAMS.modes.answer_share:
        status = "ambiguous"
    return PoseEstimate(hypotheses, status, duration)
