"""Our global search: contacts taken two at a time say where the object may be, all of them say where it is.

Where two contacts may lie on the object is looked up in its pair features, and gives poses in their thousands. Those
are judged by all contacts on the object's coarse field; the best, as far as they are distinct, start the refinement.
Where contacts may be false, poses join them that are judged by all contacts but the one that each suits least: a false
one draws all poses of a search toward itself, and none near the truth may be left.

Where two contacts say nothing (there is but one; they nearly coincide; the object is too small for any two), random
poses that touch the object start it; and where there is a prior, random poses under it start it too.
"""

import dataclasses

import numpy as np

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.kernels.mode_kernels import one_of_each
from tactopose_drake.core.objectives.objective import DoubtedObjective, LeastSquaresObjective
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.poses import compose
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.searches.pairs.contact_pairs import PairChoice
from tactopose_drake.core.searches.pairs.contact_tables import contact_table
from tactopose_drake.core.searches.pairs.distinct import distinct_poses
from tactopose_drake.core.searches.pairs.pair_poses import best_poses
from tactopose_drake.core.searches.search import PoseSpace, Search, SearchResult, StopSignal, join_results, never
from tactopose_drake.core.shape.free_spin import nearest_images, turn_alike
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray

_NO_SYMMETRY = np.eye(3, 4)[None]
# Poses that are still moving lead to the same minimum when they lie within so many standard deviations of each other.
_SAME_MINIMUM = 1.5
# Poses that cost so much more than the best are not part of any answer, while all are still moving.
_WORTH = 60.0
# An object that is symmetric within so much of the contacts' sigma is so for any touch. Of the images of one that is
# less so the proposals hold but one; so the images of so many of the best poses are refined, too.
_NOTICED, _IMAGED = 0.1, 2


@dataclasses.dataclass(frozen=True, kw_only=True)
class Stage:
    """A round of refinement, and which of its poses go on to the next.

    Attributes:
        refinement: what is done with each pose.
        kept: so many of the best go on, at most.
        worth: poses that cost so much more than the best are not part of any answer.
        apart: of poses within so many standard deviations of each other the best goes on.
    """

    refinement: LevenbergMarquardt
    kept: int
    worth: float = _WORTH
    apart: float = _SAME_MINIMUM


@dataclasses.dataclass(frozen=True, kw_only=True)
class Start:
    """The poses that the first stage is given.

    Attributes:
        choice: how pairs are matched and chosen.
        candidates: so many of their poses, at most.
        samples: so many random poses of the space join them.
        fewest: without a prior only where fewer candidates come than this; always, if it is None. Near one more samples
            join them, until they are so many.
        kept: so many of all these go on, by their cost; all, if it is None.
    """

    choice: PairChoice = PairChoice()
    candidates: int = 600
    samples: int = 250
    fewest: int | None = 20
    kept: int | None = None


# Less damping than this changes a step too little to be tried after a refused one: a tenth of the trials are saved.
_LEAST_REFUSED = 0.1
_FIRST_STEPS = LevenbergMarquardt(max_iterations=3, tolerance=3e-4, initial_damping=1e-2, least_refused=_LEAST_REFUSED)
_FURTHER_STEPS = dataclasses.replace(_FIRST_STEPS, max_iterations=4)
# Most poses are on their way to the same few minima: of those that come together on it, one is left.
_ON_THE_WAY = Stage(refinement=_FURTHER_STEPS, kept=30, worth=20.0, apart=1.0)
# A descent may get stuck where the field has a kink; from the best another one goes on.
_AGAIN = dataclasses.replace(_ON_THE_WAY, kept=3)
# All that come out have arrived: a pose on its way down a valley would count as a mode of its own.
_TO_THE_MINIMUM = LevenbergMarquardt(max_iterations=20, tolerance=1e-3, least_refused=_LEAST_REFUSED)


def global_stages(starts: int = 100, kept: int = 40) -> tuple[Stage, ...]:
    """The first stages without a prior.

    Args:
        starts: poses left after the first steps.
        kept: that go on by all the evidence.
    """
    return (
        Stage(refinement=dataclasses.replace(_FIRST_STEPS, max_iterations=1), kept=starts),
        Stage(refinement=_FURTHER_STEPS, kept=kept, worth=40.0),
    )


def near_stages(kept: int = 40) -> tuple[Stage, ...]:
    """The first stage near a prior, of which so many poses go on by all the evidence."""
    return (Stage(refinement=_FIRST_STEPS, kept=kept, worth=40.0),)


@dataclasses.dataclass(frozen=True, kw_only=True)
class PairSearch(Search):
    """Poses from pairs of contacts, refined in stages of fewer and fewer.

    Attributes:
        model: the object.
        contacts: the touch that poses are proposed from. What is minimised is the objective's business.
        start, stages: what is refined, and how, where there is no prior. These stages are by the touch alone.
        near_start, near_stages: the same near a prior.
        start_but_for_one, near_start_but_for_one: the poses that are given where one of the contacts may be false.
    """

    model: ObjectModel
    contacts: Contacts
    start: Start = Start(choice=PairChoice(poses=24000))
    stages: tuple[Stage, ...] = global_stages()
    near_start: Start = Start(choice=PairChoice(poses=1500), candidates=120, samples=40, fewest=100, kept=100)
    near_stages: tuple[Stage, ...] = near_stages()
    start_but_for_one: Start = Start(candidates=200)
    near_start_but_for_one: Start = Start(choice=PairChoice(poses=1500), candidates=120, samples=20, fewest=40)

    def widened(self) -> Search:
        """The search with four times the starts where there is a prior."""
        start = self.near_start
        return dataclasses.replace(
            self,
            near_start=dataclasses.replace(
                start,
                choice=dataclasses.replace(start.choice, poses=4 * start.choice.poses),
                candidates=4 * start.candidates,
                samples=4 * start.samples,
                kept=None if start.kept is None else 4 * start.kept,
            ),
            near_stages=near_stages(kept=3 * self.near_stages[0].kept),
        )

    def minimize(
        self,
        objective: LeastSquaresObjective | DoubtedObjective,
        space: PoseSpace,
        generator: np.random.Generator,
        should_stop: StopSignal = never,
    ) -> SearchResult:
        """The minima that the candidates lead to, by rising cost."""
        is_near, believed = space.reach[0] < np.pi, objective.believed
        last, found = self._approach(believed, space, generator, should_stop)
        if objective.but_for_one is not None:
            X_PO = self._starts_but_for_one(space, generator)
            found = join_results(found, _FIRST_STEPS.refine(objective.but_for_one, X_PO, should_stop))
        if objective is not believed:
            found = found._replace(cost=objective.cost(found.X_PO)).ranked()
        for stage, following in ((last, _FURTHER_STEPS), (_ON_THE_WAY, _TO_THE_MINIMUM)):
            X_PO = self._apart(found, believed, space, stage)
            found = following.refine(objective, X_PO, should_stop)
        best = self._apart(found, believed, space, _AGAIN)
        again = _TO_THE_MINIMUM.refine(objective, best if is_near else self._with_images(best), should_stop)
        return join_results(found, again).ranked()

    def minimize_with_doubt(
        self,
        objective: DoubtedObjective,
        space: PoseSpace,
        generator: np.random.Generator,
        should_stop: StopSignal = never,
    ) -> SearchResult:
        """The same where contacts may be false."""
        return self.minimize(objective, space, generator, should_stop)

    def _approach(
        self, believed: LeastSquaresObjective, space: PoseSpace, generator: np.random.Generator, should_stop: StopSignal
    ) -> tuple[Stage, SearchResult]:
        """The last of the first stages, and what it leads to, with Hessians, of which it says what goes on.

        These stages are by the touch alone, as the proposals are: other evidence is slow, and tells most once they
        touch. Then it has its say in which of them go on.
        """
        if space.reach[0] < np.pi:
            X_PO, quick, stages = self._starts_near(self.near_start, space, generator), believed.quick, self.near_stages
            # They are enough.
            X_PO = X_PO[believed.cost(X_PO).argsort(kind="stable")[: self.near_start.kept]]
        else:
            X_PO, quick, stages = self._starts_anywhere(self.start, space, generator), believed, self.stages
            if not believed.is_touch:
                quick = SurfaceContact(self.model.grid, self.contacts)
        for stage, following in zip(stages, (*stages[1:], None), strict=True):
            found = stage.refinement.refine(quick, X_PO, should_stop)
            if quick is not believed:
                found = found._replace(cost=believed.cost(found.X_PO), hessian=None).ranked()
            if following is not None:
                X_PO = self._apart(found, believed, space, stage)
        if found.hessian is None:
            found = found._replace(hessian=believed.normal_equations(found.X_PO).hessian)
        return stages[-1], found

    def _starts_anywhere(
        self, start: Start, space: PoseSpace, generator: np.random.Generator, spared: int = 0
    ) -> FloatArray:
        """Proposals, and random poses where there are few of those; turns about an axis make no other start of one."""
        X_PO = self.propose(start.choice, start.candidates, space, generator, spared)
        if start.fewest is None or len(X_PO) < start.fewest:
            X_PO = np.concatenate([X_PO, space.sample(generator, start.samples)])
        if not self.model.continuous_symmetries:
            return X_PO
        X_PO = turn_alike(X_PO, space.center, self.model.symmetries, self.model.symmetry_poses)
        return X_PO[distinct_poses(X_PO, start.choice.offset * self.model.pair_features.spacing, start.choice.bend)]

    def _starts_near(
        self, start: Start, space: PoseSpace, generator: np.random.Generator, spared: int = 0
    ) -> FloatArray:
        """The prior's own pose and samples with the proposals."""
        near = self.propose(start.choice, start.candidates, space, generator, spared)
        missing = 0 if start.fewest is None else start.fewest - len(near)
        samples = space.sample(generator, max(start.samples, missing) - 1)
        return np.concatenate([space.center[None], samples, near])

    def _starts_but_for_one(self, space: PoseSpace, generator: np.random.Generator) -> FloatArray:
        """Poses (n, 3, 4) that suit all contacts but one, whichever each suits least."""
        if space.reach[0] < np.pi:
            return self._starts_near(self.near_start_but_for_one, space, generator, spared=1)
        return self._starts_anywhere(self.start_but_for_one, space, generator, spared=1)

    def _with_images(self, X_PO: FloatArray) -> FloatArray:
        """Poses (n, 3, 4), and images of the first by half turns, which many objects nearly stand, and by symmetries.

        Of the symmetries those are taken that the touch may tell apart.
        """
        misfits = self.model.symmetry_misfits
        noticed = self.model.symmetry_poses[misfits > _NOTICED * np.min(self.contacts.sigma_position)]
        turns = np.concatenate([noticed, self.model.half_turns])
        return np.concatenate([X_PO, compose(X_PO[:_IMAGED, None], turns).reshape(-1, 3, 4)])

    def _apart(
        self, found: SearchResult, believed: LeastSquaresObjective, space: PoseSpace, stage: Stage
    ) -> FloatArray:
        """The poses (n, 3, 4) that go on: of those that are no steps on the way to the same minimum the best.

        By the local models where all is as told: along a direction that hardly changes the cost, poses far apart belong
        together.
        """
        count = int(found.cost.searchsorted(found.cost[0] + stage.worth, side="right"))
        X_PO = found.X_PO[:count]
        hessian = believed.normal_equations(X_PO).hessian if found.hessian is None else found.hessian[:count]
        return X_PO[one_of_each(X_PO, hessian + space.information, _NO_SYMMETRY, stage.apart, stage.kept)]

    def propose(
        self, choice: PairChoice, count: int, space: PoseSpace, generator: np.random.Generator, spared: int = 0
    ) -> FloatArray:
        """Distinct poses within the space's reach that lay two contacts on the surface and suit all, best first.

        But for one, whichever each suits least, where one is spared.
        """
        features, field = self.model.pair_features, self.model.coarse_field
        offset, bend = choice.offset * features.spacing, choice.bend
        table = contact_table(field, self.contacts, offset, 2.0 * bend)
        pairs = choice.choose(features, self.contacts, generator)
        # Without a prior all poses that lay a contact on the surface are within reach.
        turns, reach = self.model.symmetry_turns, space.reach if space.reach[0] < np.pi else (np.pi, np.inf)
        if len(self.model.continuous_symmetries) > 1:
            turns, reach = turns[:1], (np.pi, reach[1])  # A sphere's rotation is always within reach.
        X_PO, _ = best_poses(pairs, features, field, table, count, space.center, reach, turns, spared)
        if len(self.model.symmetry_turns) > 1:
            # Near the prior; without one, wherever, but of all that look the same only one.
            X_PO = nearest_images(X_PO, space.center, self.model.symmetry_turns, self.model.symmetries)
        return X_PO[distinct_poses(X_PO, offset, bend)]
