"""A belief's modes as the hypotheses of an estimate."""

import numpy as np
from pydrake.math import RigidTransform

from tactopose_drake.core.kernels.matrix_kernels import inverses
from tactopose_drake.core.posterior.modes import free_directions
from tactopose_drake.core.posterior.moved_origin import about_middle, has_far_origin
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.statuses import STATUS_OF_BELIEF
from tactopose_drake.core.tracking.pose_belief import PoseBelief
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.estimation.far_origins import directions_of_origin
from tactopose_drake.estimation.pose_hypothesis import PoseHypothesis
from tactopose_drake.estimation.results import PoseEstimate, status_of


def estimate_of(belief: PoseBelief, model: ObjectModel, duration: float = 0.0) -> PoseEstimate | None:
    """A belief's modes as hypotheses; None where there are none.

    Args:
        belief: the belief.
        model: the object; directions known to less than a tenth of its size are free.
        duration: the estimate's `duration`, s.
    """
    if not belief.has_pose:
        return None
    hypotheses = tuple(
        PoseHypothesis(
            RigidTransform(X_PO), -float(np.log(max(share, 1e-300))), min(float(share), 1.0), covariance, rows, bool(ok)
        )
        for X_PO, share, covariance, rows, ok in zip(
            belief.X_PO, belief.probability, belief.covariance, _free(belief, model), belief.explains_touch, strict=True
        )
    )
    status = STATUS_OF_BELIEF[belief.status]
    # A slipping belief may have several poses, or none that explains the touch.
    status = status_of(hypotheses, undetermined=False) if status == "ok" else status
    return PoseEstimate(hypotheses, status, duration)


def _free(belief: PoseBelief, model: ObjectModel) -> list[FloatArray]:
    """The free directions of each mode, computed about the object's middle where its origin is far away."""
    _, near = about_middle(model, belief.mixture)
    free = free_directions(inverses(near.covariance)[0], model.size)
    if not has_far_origin(model):
        return free
    return [directions_of_origin(rows, X[:, :3], model.middle) for rows, X in zip(free, belief.X_PO, strict=True)]
