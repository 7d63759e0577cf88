"""From evidence to what a search is given: an objective, and the space to look in."""

from typing import NamedTuple

from tactopose_drake.core.evidence import Evidence
from tactopose_drake.core.objectives.base import LeastSquaresObjective, SumObjective
from tactopose_drake.core.objectives.pose_prior import PriorObjective
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.objects import ObjectModel
from tactopose_drake.core.searches.base import PoseSpace, PriorSpace
from tactopose_drake.core.searches.touch_space import TouchSpace


class PoseProblem(NamedTuple):
    """The search for an object's pose from evidence.

    Attributes:
        touch: the contacts' objective by itself.
        likelihood: the objective of all the evidence but the prior.
        objective: that of all the evidence.
        space: the poses that are possible.
    """

    touch: SurfaceContact
    likelihood: LeastSquaresObjective
    objective: LeastSquaresObjective
    space: PoseSpace


def make_problem(model: ObjectModel, evidence: Evidence) -> PoseProblem:
    """Gathers the objectives that the evidence calls for."""
    touch = SurfaceContact(model.grid, evidence.contacts)
    if evidence.prior is None:
        return PoseProblem(touch, touch, touch, TouchSpace(model, evidence.contacts))
    objective = SumObjective([touch, PriorObjective(evidence.prior)])
    return PoseProblem(touch, touch, objective, PriorSpace(evidence.prior))
