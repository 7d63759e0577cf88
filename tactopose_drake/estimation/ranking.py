"""Ranking of objects by their likelihood; objects of equal shape share a rank.

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016.
"""

import math
from collections.abc import Sequence
from typing import Literal, cast, get_args

from tactopose_drake.core.identification.shape_equality import find_alignment
from tactopose_drake.core.posterior.posterior_params import DEFAULT_PARAMS
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.statuses import Status
from tactopose_drake.core.validation import known_name
from tactopose_drake.estimation.identities import Identity
from tactopose_drake.estimation.results import PoseEstimate

Likelihood = Literal["evidence", "inverse_cost"]

# Lower bound of the cost in the thesis' likelihood; exact contacts may have a cost of 0.
_LEAST_COST = 1e-6


def check_likelihood(name: str, value: str) -> Likelihood:
    """Checks the name of a likelihood.

    Args:
        name: name of the value in messages.
        value: "evidence" or "inverse_cost".

    Raises:
        UnknownNameError: if it is neither.
    """
    return cast(Likelihood, known_name(name, value, get_args(Likelihood)))


def group_equal_shapes(models: Sequence[ObjectModel]) -> list[int]:
    """The group of each object, as the index of its first member; objects of a group have the same shape."""
    groups: list[int] = []
    for i, model in enumerate(models):
        equal = (k for k in range(i) if groups[k] == k and find_alignment(model, models[k]) is not None)
        groups.append(next(equal, i))
    return groups


def evidence_of_shapes(estimates: Sequence[PoseEstimate], groups: Sequence[int]) -> list[float]:
    """The evidence of each shape; of several objects with the same shape, the largest one."""
    return [
        max(estimate.log_evidence for estimate, group in zip(estimates, groups, strict=True) if group == shape)
        for shape in dict.fromkeys(groups)
    ]


def likelihood_weights(estimates: Sequence[PoseEstimate], likelihood: Likelihood) -> list[float]:
    """Likelihoods up to a common factor."""
    if likelihood == "evidence":
        most = max(estimate.log_evidence for estimate in estimates)
        return [math.exp(estimate.log_evidence - most) for estimate in estimates]
    lowest = [min(hypothesis.cost for hypothesis in estimate.hypotheses) for estimate in estimates]
    return [1.0 / max(cost, _LEAST_COST) for cost in lowest]  # [B16] section 6.2.1


def rank_objects(
    indices: Sequence[int],
    names: Sequence[str],
    estimates: Sequence[PoseEstimate],
    groups: Sequence[int],
    weights: Sequence[float],
    known: float,
) -> list[Identity]:
    """The objects by falling likelihood; those of one group are adjacent and get the mean of their likelihoods.

    `known` is the probability that the touched object is any of them.
    """
    # fsum makes the sums independent of the order, to the last bit.
    total = math.fsum(weights)
    members = {group: [i for i, other in enumerate(groups) if other == group] for group in dict.fromkeys(groups)}
    share = {group: math.fsum(weights[i] for i in own) / len(own) / total for group, own in members.items()}
    evidence = {group: max(estimates[i].log_evidence for i in own) for group, own in members.items()}
    identities: list[Identity] = []
    for group in sorted(members, key=lambda group: (-share[group], -evidence[group], names[group])):
        rank = len(identities) + 1
        identities += [
            Identity(
                names[i], indices[i], rank, share[group], share[group] * known, estimates[i].log_evidence, estimates[i]
            )
            for i in members[group]
        ]
    return identities


def status_of_ranking(identities: Sequence[Identity], touches: int, unknown: float) -> Status:
    """The status of a ranking, given the number of contacts and felt patches, and the probability of an unknown object.

    An answer needs the same probability as one mode of an estimate: for "ok" the first object, together with those of
    equal shape, for "no_solution" the unknown one.
    """
    first, params = identities[0], DEFAULT_PARAMS.modes
    assert first.estimate is not None
    if first.estimate.status == "no_solution" or unknown >= params.answer_share:
        return "no_solution"
    share = sum(identity.probability for identity in identities if identity.rank == first.rank)
    # Fewer contacts leave so many poses that the evidence, a sum over them, is not well known.
    is_known = touches >= params.fewest_contacts
    return "ok" if is_known and share >= params.answer_share else "ambiguous"
