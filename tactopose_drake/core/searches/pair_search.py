"""Our global search: contacts taken two at a time say where the object may be, all of them say where it is.

Where two contacts may lie on the object is looked up in its pair features, and gives poses in their thousands. Those
are judged by all contacts on the object's coarse field; the best, as far as they are distinct, start the refinement.

Where two contacts say nothing (there is but one; they nearly coincide; the object is too small for any two), random
poses that touch the object start it; and where there is a prior, random poses under it start it too.
"""

import dataclasses

import numpy as np

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.kernels import mode_kernels
from tactopose_drake.core.objectives.objective import LeastSquaresObjective
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.poses import compose
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.searches.pairs.contact_pairs import PairChoice
from tactopose_drake.core.searches.pairs.contact_tables import contact_table
from tactopose_drake.core.searches.pairs.distinct import distinct_poses
from tactopose_drake.core.searches.pairs.pair_poses import best_poses
from tactopose_drake.core.searches.search import PoseSpace, Search, SearchResult, StopSignal, join_results, never
from tactopose_drake.core.shape.free_spin import nearest_images
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray

# Poses that are still moving lead to the same minimum when they lie within so many standard deviations of each other.
_SAME_MINIMUM = 1.5
# An object that is symmetric within so much of the contacts' sigma is so for any touch. Of the images of one that is
# less so the proposals hold but one; so the images of so many of the best poses are refined, too.
_NOTICED, _IMAGED = 0.1, 2


@dataclasses.dataclass(frozen=True, kw_only=True)
class PairSearch(Search):
    """Poses from pairs of contacts, refined in rounds of fewer and fewer.

    Attributes:
        model: the object.
        contacts: the touch that poses are proposed from. What is minimised is the objective's business.
        choice: how pairs are matched and chosen.
        candidates: so many of their poses, at most, go to the refinement.
        fewest: where fewer come, as many random poses as `candidates` join them.
        starts: so many are left after the first steps.
        kept: so many take some more.
        settled: so many are refined to convergence.
        near_choice, near_candidates: the same where there is a prior.
        near_samples: so many poses of the prior join them.
        near_starts, near_kept: of all these so many are refined, and so many to convergence.
        polished, near_polished: so many of the best are refined until they hardly move.
        first, second, third, near_first: the first steps without a prior, and with one.
        last, polish: the refinement to convergence, and that of the best.
    """

    model: ObjectModel
    contacts: Contacts
    choice: PairChoice = PairChoice()
    candidates: int = 250
    fewest: int = 20
    starts: int = 150
    kept: int = 100
    settled: int = 30
    polished: int = 6
    near_choice: PairChoice = PairChoice(poses=2500)
    near_candidates: int = 80
    near_samples: int = 120
    near_starts: int = 120
    near_kept: int = 40
    near_polished: int = 3
    near_first: LevenbergMarquardt = LevenbergMarquardt(max_iterations=4, initial_damping=1e-2)
    first: LevenbergMarquardt = LevenbergMarquardt(max_iterations=1, initial_damping=1e-2)
    second: LevenbergMarquardt = LevenbergMarquardt(max_iterations=4, initial_damping=1e-2)
    third: LevenbergMarquardt = LevenbergMarquardt(max_iterations=4, tolerance=1e-3)
    last: LevenbergMarquardt = LevenbergMarquardt(max_iterations=15, tolerance=1e-3)
    polish: LevenbergMarquardt = LevenbergMarquardt(max_iterations=40, tolerance=1e-4)

    def widened(self) -> Search:
        """The search with four times the starts where there is a prior."""
        return dataclasses.replace(
            self,
            near_candidates=4 * self.near_candidates,
            near_samples=4 * self.near_samples,
            near_starts=4 * self.near_starts,
            near_kept=3 * self.near_kept,
        )

    def minimize(
        self,
        objective: LeastSquaresObjective,
        space: PoseSpace,
        generator: np.random.Generator,
        should_stop: StopSignal = never,
    ) -> SearchResult:
        """The minima that the candidates lead to, by rising cost."""
        if space.reach[0] < np.pi:
            return self._minimize_near(objective, space, generator, should_stop)
        X_PO = self.propose(self.choice, self.candidates, space, generator)
        if len(X_PO) < self.fewest:
            X_PO = np.concatenate([X_PO, space.sample(generator, self.candidates)])
        # The first steps are by the touch alone, as the proposals are: other evidence is slow, and tells most once they
        # touch. Then it has its say in which of them go on.
        if objective.is_touch:
            touching = self.first.refine(objective, X_PO, should_stop)
        else:
            touching = self.first.refine(SurfaceContact(self.model.grid, self.contacts), X_PO, should_stop)
            touching = touching._replace(cost=objective.cost(touching.X_PO)).ranked()
        first = self._distinct(touching, self.starts)
        second = self._apart(self.second.refine(objective, first, should_stop), objective, space, self.kept)
        third = self.third.refine(objective, second, should_stop)
        last = self.last.refine(objective, self._apart(third, objective, space, self.settled), should_stop)
        best = self._distinct(last, self.polished)
        polished = self.polish.refine(objective, np.concatenate([best, self._images(best[:_IMAGED])]), should_stop)
        return join_results(third, last, polished).ranked(self.kept)

    def _minimize_near(
        self,
        objective: LeastSquaresObjective,
        space: PoseSpace,
        generator: np.random.Generator,
        should_stop: StopSignal,
    ) -> SearchResult:
        """Where there is a prior: its own samples start with the proposals, and fewer poses are enough."""
        samples = space.sample(generator, self.near_samples - 1)
        near = self.propose(self.near_choice, self.near_candidates, space, generator)
        X_PO = np.concatenate([space.center[None], samples, near])
        starts = X_PO[np.argsort(objective.cost(X_PO), kind="stable")[: self.near_starts]]
        first = self._apart(self.near_first.refine(objective, starts, should_stop), objective, space, self.near_kept)
        last = self.last.refine(objective, first, should_stop)
        polished = self.polish.refine(objective, self._distinct(last, self.near_polished), should_stop)
        return join_results(last, polished).ranked()

    def _images(self, X_PO: FloatArray) -> FloatArray:
        """Poses (n, 3, 4) by those of the object's symmetries that the touch may tell apart, shape (m, 3, 4)."""
        misfits = self.model.symmetry_misfits
        turns = self.model.symmetry_poses[misfits > _NOTICED * np.min(self.contacts.sigma_position)]
        return compose(X_PO[:, None], turns[None]).reshape(-1, 3, 4)

    def _distinct(self, found: SearchResult, count: int) -> FloatArray:
        """The best poses (count, 3, 4), or fewer, of those that are further apart than the samples blur them."""
        length, angle = 0.5 * self.choice.offset * self.model.pair_features.spacing, 0.5 * self.choice.bend
        return found.X_PO[distinct_poses(found.X_PO, length, angle)][:count]

    def _apart(self, found: SearchResult, objective: LeastSquaresObjective, space: PoseSpace, count: int) -> FloatArray:
        """The best poses (count, 3, 4), or fewer, of those that are no steps on the way to the same minimum.

        By the local models: along a direction that hardly changes the cost, poses far apart belong together.
        """
        information = objective.normal_equations(found.X_PO).hessian + space.information
        apart = np.empty(len(found.cost), dtype=np.bool_)
        mode_kernels.mark_distinct(found.X_PO, information, np.eye(3, 4)[None], _SAME_MINIMUM**2, apart)
        return found.X_PO[apart][:count]

    def propose(self, choice: PairChoice, count: int, space: PoseSpace, generator: np.random.Generator) -> FloatArray:
        """Distinct poses within the space's reach that lay two contacts on the surface and suit all, best first."""
        features, field = self.model.pair_features, self.model.coarse_field
        offset, bend = choice.offset * features.spacing, choice.bend
        table = contact_table(field, self.contacts, offset, 2.0 * bend)
        pairs = choice.choose(features, self.contacts, generator)
        turns, reach = self.model.symmetry_turns, space.reach
        if sum(symmetry.is_continuous for symmetry in self.model.symmetries) > 1:
            turns, reach = turns[:1], (np.pi, reach[1])  # A sphere's rotation is always within reach.
        X_PO, _ = best_poses(pairs, features, field, table, count, space.center, reach, turns)
        if len(self.model.symmetry_turns) > 1:
            # Near the prior; without one, wherever, but of all that look the same only one.
            X_PO = nearest_images(X_PO, space.center, self.model.symmetry_turns, self.model.symmetries)
        return X_PO[distinct_poses(X_PO, offset, bend)]
