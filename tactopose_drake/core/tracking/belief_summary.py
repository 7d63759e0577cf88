"""What a belief says at one time: its modes, and its status."""

import dataclasses

import numpy as np

from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture
from tactopose_drake.core.posterior.plausibility import explain_touch
from tactopose_drake.core.posterior.posterior_params import DEFAULT_PARAMS
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.pose_belief import BeliefStatus, PoseBelief
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams


def summarise(
    model: ObjectModel, params: PoseTrackerParams, belief: PoseBelief, evidence: Evidence, *, has_contact: bool
) -> PoseBelief:
    """The belief with poses, probabilities and status by its modes and the evidence of its time."""
    weights = np.exp(belief.modes.log_weight - belief.modes.log_weight.max(initial=-np.inf))
    weights = weights / weights.sum()
    order = np.argsort(-weights, kind="stable")
    mixture = GaussianMixture(belief.modes.X_PO[order], weights[order], belief.modes.covariance[order])
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
    if time < belief.unsettled_time + params.settling_time - 1e-9:
        return "ambiguous", ("the touch is new",)
    return "ok", ()
