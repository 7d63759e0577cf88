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
from tactopose_drake.core.searches.pair_proposals import PairProposals
from tactopose_drake.core.searches.pairs.contact_pairs import PairChoice
from tactopose_drake.core.searches.search import (
    PoseSpace,
    Search,
    SearchResult,
    StopSignal,
    is_near,
    join_results,
    never,
)
from tactopose_drake.core.shape.free_spin import turn_alike
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
        candidates: so many poses of pairs of contacts, at most.
        samples: so many random poses of the space join them.
        fewest: without a prior only where fewer candidates come than this; always, if it is None. Near one more samples
            join them, until they are so many.
        kept: so many of all these go on, by their cost; all, if it is None.
    """

    candidates: int = 400
    samples: int = 250
    fewest: int | None = 20
    kept: int | None = None

    def widened(self) -> "Start":
        """Four times as many."""
        kept = None if self.kept is None else 4 * self.kept
        return dataclasses.replace(self, candidates=4 * self.candidates, samples=4 * self.samples, kept=kept)


# Less damping than this changes a step too little to be tried after a refused one: a tenth of the trials are saved.
_LEAST_REFUSED = 0.1
_FIRST_STEPS = LevenbergMarquardt(max_iterations=3, tolerance=3e-4, initial_damping=1e-2, least_refused=_LEAST_REFUSED)
_FURTHER_STEPS = dataclasses.replace(_FIRST_STEPS, max_iterations=4)
# Most poses are on their way to the same few minima: of those that come together on it, one is left.
_ON_THE_WAY = Stage(refinement=_FURTHER_STEPS, kept=20, worth=20.0, apart=1.0)
# So few measured numbers, three of a contact with its normal and one of a point alone, leave many poses that explain
# them, most without a prior: more are followed.
_FEW_NUMBERS, _MANY_ON_THE_WAY = 12, dataclasses.replace(_ON_THE_WAY, kept=80)
# A descent may get stuck where the field has a kink; from the best another one goes on.
_AGAIN = dataclasses.replace(_ON_THE_WAY, kept=3)
# All that come out have arrived: a pose on its way down a valley would count as a mode of its own.
_TO_THE_MINIMUM = LevenbergMarquardt(max_iterations=20, tolerance=1e-3, least_refused=_LEAST_REFUSED)


def global_stages(starts: int = 80, kept: int = 40) -> tuple[Stage, ...]:
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
        choice: how pairs are matched and chosen where there is no prior.
        start, stages: what is refined, and how. These stages are by the touch alone.
        start_but_for_one: the poses that are given beside where one of the contacts may be false.
        on_the_way: what goes on to the minima, by all the evidence.
        near_choice, near_start, near_stages, near_start_but_for_one: the same near a prior.
    """

    model: ObjectModel
    contacts: Contacts
    choice: PairChoice = PairChoice()
    start: Start = Start()
    stages: tuple[Stage, ...] = global_stages()
    start_but_for_one: Start = Start(candidates=150)
    on_the_way: Stage = _ON_THE_WAY
    near_choice: PairChoice = PairChoice(poses=1500)
    near_start: Start = Start(candidates=60, samples=20, fewest=50, kept=30)
    near_stages: tuple[Stage, ...] = near_stages()
    near_start_but_for_one: Start = Start(candidates=30, samples=10, fewest=20)

    @classmethod
    def of(cls, model: ObjectModel, contacts: Contacts) -> "PairSearch":
        """The search for these contacts, wider if they are few.

        It is also wider without normals, since a match of two points then leaves a rotation open.
        """
        search = cls(model=model, contacts=contacts)
        if len(contacts.p_PC) * (1 if contacts.n_PC is None else 3) <= _FEW_NUMBERS:
            search = dataclasses.replace(search, stages=global_stages(320, 160), on_the_way=_MANY_ON_THE_WAY)
        return search if contacts.n_PC is not None else search.widened()

    def widened(self) -> "PairSearch":
        """The search with four times the starts where there is a prior."""
        return dataclasses.replace(
            self,
            near_choice=dataclasses.replace(self.near_choice, poses=4 * self.near_choice.poses),
            near_start=self.near_start.widened(),
            near_stages=near_stages(kept=3 * self.near_stages[0].kept),
            near_start_but_for_one=self.near_start_but_for_one.widened(),
        )

    def minimize(
        self,
        objective: LeastSquaresObjective | DoubtedObjective,
        space: PoseSpace,
        generator: np.random.Generator,
        should_stop: StopSignal = never,
    ) -> SearchResult:
        """The minima that the candidates lead to, by rising cost."""
        near, believed, proposals = is_near(space), objective.believed, self.proposals(space, generator)
        start = self.near_start if near else self.start
        start_but_for_one = self.near_start_but_for_one if near else self.start_but_for_one
        is_one_doubted = objective.but_for_one is not None
        by_all, by_others = proposals.best(start.candidates, start_but_for_one.candidates if is_one_doubted else 0)
        X_PO = self._starts(start, by_all, proposals, generator)
        last, found = self._approach(believed, X_PO, space, should_stop)
        if objective.but_for_one is not None:
            X_PO = self._starts(start_but_for_one, by_others, proposals, generator)
            found = join_results(found, _FIRST_STEPS.refine(objective.but_for_one, X_PO, should_stop))
        if objective is not believed:
            found = found._replace(cost=objective.cost(found.X_PO)).ranked()
        for stage, following in ((last, _FURTHER_STEPS), (self.on_the_way, _TO_THE_MINIMUM)):
            X_PO = self._apart(found, believed, space, stage)
            found = following.refine(objective, X_PO, should_stop)
        best = self._apart(found, believed, space, _AGAIN)
        again = _TO_THE_MINIMUM.refine(objective, best if near else self._with_images(best), should_stop)
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
        self,
        believed: LeastSquaresObjective,
        X_PO: FloatArray,
        space: PoseSpace,
        should_stop: StopSignal,
    ) -> tuple[Stage, SearchResult]:
        """The last of the first stages, and what it leads poses (n, 3, 4) to, with Hessians; it says what goes on.

        These stages are by the touch alone, as the proposals are: other evidence is slow, and tells most once they
        touch. Then it has its say in which of them go on.
        """
        if is_near(space):
            start, quick, stages = self.near_start, believed.quick, self.near_stages
        else:
            start, quick, stages = self.start, believed, self.stages
            if not believed.is_touch:
                quick = SurfaceContact(self.model.grid, self.contacts)
        if start.kept is not None and len(X_PO) > start.kept:
            X_PO = X_PO.take(believed.cost(X_PO).argsort(kind="stable")[: start.kept], axis=0)
        for stage, following in zip(stages, (*stages[1:], None), strict=True):
            found = stage.refinement.refine(quick, X_PO, should_stop)
            if quick is not believed:
                found = found._replace(cost=believed.cost(found.X_PO), hessian=None).ranked()
            if following is not None:
                X_PO = self._apart(found, believed, space, stage)
        if found.hessian is None:
            found = found._replace(hessian=believed.normal_equations(found.X_PO).hessian)
        return stages[-1], found

    def proposals(self, space: PoseSpace, generator: np.random.Generator) -> PairProposals:
        """What pairs of contacts propose for poses of this space."""
        choice = self.near_choice if is_near(space) else self.choice
        return PairProposals.match(self.model, self.contacts, choice, space, generator)

    def _starts(
        self, start: Start, X_PO: FloatArray, proposals: PairProposals, generator: np.random.Generator
    ) -> FloatArray:
        """Those of the proposals (m, 3, 4), and random poses, shape (n, 3, 4)."""
        space = proposals.space
        if is_near(space):
            missing = 0 if start.fewest is None else start.fewest - len(X_PO)
            samples = space.sample(generator, max(start.samples, missing) - 1)
            return np.concatenate([space.center[None], samples, X_PO])
        if start.fewest is None or len(X_PO) < start.fewest:
            X_PO = np.concatenate([X_PO, space.sample(generator, start.samples)])
        if not self.model.continuous_symmetries:
            return X_PO
        # Turns about an axis make no other start of one.
        return proposals.distinct(turn_alike(X_PO, space.center, self.model.symmetries, self.model.symmetry_poses))

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
        return X_PO.take(one_of_each(X_PO, hessian + space.information, _NO_SYMMETRY, stage.apart, stage.kept), axis=0)
