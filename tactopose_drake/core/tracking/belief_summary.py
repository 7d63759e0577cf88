"""What a belief says at one time: its modes within the constraints of that time, and its status.

The hand's volume, silent pads, friction and balance bound the pose at one time, and again alike at the next. Their
errors are of geometry and models and stay the same from frame to frame. Counted at each frame anew they would soon
outweigh all else. Therefore they are no part of what is handed on: at each time the modes are seen through them once.
"""

import dataclasses

import numpy as np

from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.objectives.objective import LeastSquaresObjective, SumObjective
from tactopose_drake.core.objectives.pose_gaussian import PoseGaussian
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture
from tactopose_drake.core.posterior.plausibility import explain_touch
from tactopose_drake.core.posterior.posterior_params import DEFAULT_PARAMS
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.searches.pose_problem import balance_term, bounding_terms
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.pose_belief import BeliefStatus, PoseBelief
from tactopose_drake.core.tracking.tracked_modes import TrackedModes
from tactopose_drake.core.tracking.tracker_params import ConstraintParams, PoseTrackerParams


def summarise(
    model: ObjectModel, params: PoseTrackerParams, belief: PoseBelief, evidence: Evidence, *, has_contact: bool
) -> PoseBelief:
    """The belief with poses, probabilities and status by its modes and the evidence of its time."""
    mixture = constrain_modes(model, evidence, belief.modes, params.constraints)
    explains = np.ones(len(mixture), dtype=np.bool_)
    if has_contact and len(mixture):
        explains = explain_touch(model, evidence, mixture.X_PO, params.plausibility)
    belief = dataclasses.replace(
        belief,
        mixture=mixture,
        explains_touch=explains,
        explained_time=belief.time if has_contact and explains[:1].any() else belief.explained_time,
    )
    status, remarks = judge(belief, params, has_contact=has_contact)
    if belief.vision.remark:
        remarks = (*remarks, belief.vision.remark)
    return dataclasses.replace(belief, status=status, remarks=remarks)


def constrain_modes(
    model: ObjectModel, evidence: Evidence, modes: TrackedModes, params: ConstraintParams
) -> GaussianMixture:
    """What the modes say of the pose with what bounds it now, by falling weight."""
    X_PO, covariance, log_weight = modes.X_PO.copy(), modes.covariance.copy(), modes.log_weight.copy()
    terms = bounding_terms(model, evidence)
    if evidence.balance is not None:
        terms.append(balance_term(model, evidence))
    if terms and len(modes):
        bounds: LeastSquaresObjective = SumObjective(terms)
        cost = bounds.cost(np.ascontiguousarray(X_PO))
        log_weight -= cost
        refinement = LevenbergMarquardt(max_iterations=params.max_iterations, tolerance=params.tolerance)
        for b in np.flatnonzero((cost > params.least_cost) & (modes.log_weight > np.log(params.least_share))):
            objective = SumObjective([PoseGaussian(X_PO[b], covariance[b]), *terms])
            found = refinement.refine(objective, X_PO[b : b + 1])
            hessian = objective.normal_equations(found.X_PO).hessian[0]
            log_determinant = np.linalg.slogdet(hessian)[1] + np.linalg.slogdet(covariance[b])[1]
            X_PO[b], covariance[b] = found.X_PO[0], np.linalg.inv(hessian)
            # Laplace's approximation of the mode's mass within the bounds.
            log_weight[b] += cost[b] - found.cost[0] - 0.5 * log_determinant
    weights = np.exp(log_weight - log_weight.max(initial=-np.inf))
    weights /= weights.sum()
    order = np.argsort(-weights, kind="stable")
    return GaussianMixture(X_PO[order], weights[order], covariance[order])


def judge(belief: PoseBelief, params: PoseTrackerParams, *, has_contact: bool) -> tuple[BeliefStatus, tuple[str, ...]]:
    """The status, and why, of a belief that has contacts or not."""
    time = belief.time
    if not has_contact:
        if not belief.has_pose:
            return "lost", ("nothing is touched",)
        since = time - max(belief.touch_time, belief.vision.accepted_time)
        if since > params.unobserved_time:
            return "lost", (f"nothing was touched or seen for {since:.1f} s",)
        return "no_contact", ()
    if not belief.has_pose or time > belief.explained_time + params.lost_time:
        return "lost", ("no pose explains the touch",)
    if time < belief.slip_time + params.slip_time or not belief.explains_touch[0]:
        return "slipping", ()
    if belief.probability[0] < DEFAULT_PARAMS.modes.answer_share:
        return "ambiguous", ()
    return "ok", ()
