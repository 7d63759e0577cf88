"""The searches that `estimate_pose` offers, by name."""

import dataclasses
from collections.abc import Callable

from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.posterior.plausibility import degrees_of_freedom
from tactopose_drake.core.searches.baselines.gradient_descent import GradientDescent
from tactopose_drake.core.searches.baselines.hand_clearance import HandClearance
from tactopose_drake.core.searches.baselines.monte_carlo import MonteCarlo
from tactopose_drake.core.searches.baselines.scaling_series import ScalingSeries
from tactopose_drake.core.searches.baselines.simulated_annealing import SimulatedAnnealing
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.searches.pair_search import PairSearch
from tactopose_drake.core.searches.patch_searches import patch_search
from tactopose_drake.core.searches.search import Search
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.estimation.mathematical_program import Direct, PoseProgram

# Particles that Monte Carlo evaluates at once if there is evidence beside contacts; up to 100 reach the same costs.
_PARTICLES_AT_ONCE = 20
# Particles of Monte Carlo with patches: each costs some twenty times as much, and four times as many find no more.
_PARTICLES_OF_PADS, _POPULATION_OF_PADS = 75_000, 3_750


def _pair_search(model: ObjectModel, evidence: Evidence) -> PairSearch:
    if evidence.felt:
        search = patch_search(model, evidence.felt, evidence.contacts)
        return search.of_one_contact() if len(evidence.touch) == 1 else search
    search = PairSearch.of(model, evidence.contacts)
    return search.of_one_contact() if evidence.planes and len(evidence.contacts) == 1 else search


def _monte_carlo(model: ObjectModel, evidence: Evidence) -> MonteCarlo:
    """Monte Carlo with a scale equal to the true pose's expected cost: half the number of measured quantities.

    It evaluates one particle at a time, as the thesis does, or several if there is more evidence than contacts.
    """
    one_each = (evidence.hand, evidence.untouched, evidence.balance, evidence.friction)
    more_is_known = any(known is not None for known in (*one_each, *evidence.patches, *evidence.planes))
    search = MonteCarlo(
        scale=0.5 * degrees_of_freedom(evidence),
        batch=_PARTICLES_AT_ONCE if more_is_known else 1,
        is_possible=None if evidence.hand is None else HandClearance(model.samples.points, evidence.hand),
    )
    if not evidence.felt:
        return search
    few = dataclasses.replace(search.anywhere, particles=_PARTICLES_OF_PADS, population=_POPULATION_OF_PADS)
    return dataclasses.replace(search, anywhere=few)


METHODS: dict[str, Callable[[ObjectModel, Evidence], Search]] = {
    "pair_search": _pair_search,
    "levenberg_marquardt": lambda model, evidence: LevenbergMarquardt(),
    "gradient_descent": lambda model, evidence: GradientDescent(length=model.size / 2),
    "mathematical_program": lambda model, evidence: PoseProgram(length=model.size / 2),
    "monte_carlo": _monte_carlo,
    "direct": lambda model, evidence: Direct(),
    "simulated_annealing": lambda model, evidence: SimulatedAnnealing(),
    "scaling_series": lambda model, evidence: ScalingSeries(),
}
"""Functions that make the searches, given the object and the evidence."""
GLOBAL_METHODS = frozenset({"pair_search", "monte_carlo", "direct", "simulated_annealing", "scaling_series"})
"""The methods that need no prior."""
