"""Objects by falling likelihood, from what is estimated of each: those of equal shape share theirs.

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016.
"""

import math
from collections.abc import Sequence
from typing import Literal, cast, get_args

from tactopose_drake.core.identification.shape_equality import find_alignment
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.statuses import Status
from tactopose_drake.core.validation import known_name
from tactopose_drake.estimation.identities import Identity
from tactopose_drake.estimation.results import PoseEstimate

Likelihood = Literal["evidence", "inverse_cost"]

# The thesis' likelihood of a cost below this, which exact contacts may have, is that of this.
_LEAST_COST = 1e-6
# The probability that the first object, with those that equal it, must have to be called the answer; and that the
# object is an unknown one, to be told that.
_MOST = 0.9
# Fewer contacts leave so many poses that their sum is not well known.
_FEWEST = 3


def check_likelihood(name: str, value: str) -> Likelihood:
    """The name of a likelihood.

    Args:
        name: what the value is of.
        value: "evidence" or "inverse_cost".

    Raises:
        UnknownNameError: if it is neither.
    """
    return cast(Likelihood, known_name(name, value, get_args(Likelihood)))


def group_equal_shapes(models: Sequence[ObjectModel]) -> list[int]:
    """For each object the number of its group; objects of one group have the same shape."""
    groups: list[int] = []
    for i, model in enumerate(models):
        equal = (k for k in range(i) if groups[k] == k and find_alignment(model, models[k]) is not None)
        groups.append(next(equal, i))
    return groups


def evidence_of_shapes(estimates: Sequence[PoseEstimate], groups: Sequence[int]) -> list[float]:
    """The evidence of each shape: of objects that have the same, that of the best sampled one."""
    return [
        max(estimate.log_evidence for estimate, group in zip(estimates, groups, strict=True) if group == shape)
        for shape in dict.fromkeys(groups)
    ]


def likelihood_weights(estimates: Sequence[PoseEstimate], likelihood: Likelihood) -> list[float]:
    """What the likelihoods are in proportion to."""
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
    """The objects by falling likelihood; those of one group next to each other, and with the mean of theirs.

    `known` is the probability that it is any of them.
    """
    # Sums that do not depend on the order, to the last bit.
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
    """What is known of the first one, from so many contacts and patches that are felt."""
    first = identities[0]
    assert first.estimate is not None
    if first.estimate.status == "no_solution" or unknown >= _MOST:
        return "no_solution"
    share = sum(identity.probability for identity in identities if identity.rank == first.rank)
    return "ok" if share >= _MOST and touches >= _FEWEST else "ambiguous"
