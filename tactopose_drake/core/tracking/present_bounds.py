"""What bounds the pose at one time, and again alike at the next: the hand's volume, silent pads, friction, balance.

Its errors are of geometry and models and stay the same from frame to frame. Counted at each frame anew they would soon
outweigh all else. Therefore they are no part of what is handed on: at each time the modes are seen through them once.
"""

import numpy as np

from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.objectives.objective import LeastSquaresObjective, SumObjective
from tactopose_drake.core.objectives.pose_gaussian import PoseGaussian
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.searches.pose_problem import balance_term, bounding_terms
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.mode_set import ModeSet
from tactopose_drake.core.validation import FloatArray

# A cost that moves no mode, and a share of the mass that is not worth a look.
_NOTHING, _LEAST_SHARE = 1e-3, 1e-4
_REFINEMENT = LevenbergMarquardt(max_iterations=10, tolerance=1e-3)


def bound_modes(model: ObjectModel, evidence: Evidence, modes: ModeSet) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The modes' poses (n, 3, 4), covariances (n, 6, 6) and shares (n,), with what bounds the pose now."""
    X_PO, covariance, log_weight = modes.X_PO.copy(), modes.covariance.copy(), modes.log_weight.copy()
    terms = bounding_terms(model, evidence)
    if evidence.balance is not None:
        terms.append(balance_term(model, evidence))
    if terms and len(modes):
        bounds: LeastSquaresObjective = SumObjective(terms)
        cost = bounds.cost(np.ascontiguousarray(X_PO))
        log_weight -= cost
        worth = (cost > _NOTHING) & (modes.log_weight > np.log(_LEAST_SHARE))
        for b in np.flatnonzero(worth):
            objective = SumObjective([PoseGaussian(X_PO[b], covariance[b]), *terms])
            found = _REFINEMENT.refine(objective, X_PO[b : b + 1])
            hessian = objective.normal_equations(found.X_PO).hessian[0]
            prior_part = np.linalg.slogdet(covariance[b])[1]
            X_PO[b], covariance[b] = found.X_PO[0], np.linalg.inv(hessian)
            log_weight[b] += cost[b] - found.cost[0] - 0.5 * (np.linalg.slogdet(hessian)[1] + prior_part)
    share = np.exp(log_weight - log_weight.max(initial=-np.inf)) if len(modes) else log_weight
    return X_PO, covariance, share / share.sum() if len(modes) else share
