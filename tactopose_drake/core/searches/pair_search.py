"""The global search: pairs of contacts propose poses, and all contacts together select among them.

The places where two contacts may lie on the object are looked up in its pair features, which gives thousands of poses.
These are ranked by all contacts on the object's coarse field; the best distinct ones start the refinement. Where
contacts may be outliers, the starts include poses ranked by all contacts but the one that fits each worst: an outlier
biases all poses of a search toward itself, and might leave none near the truth.

Where pairs are uninformative (there is one contact; they nearly coincide; the object is too small for any two), random
poses that touch the object are used; and where there is a prior, random poses drawn from it are used too.
"""

import dataclasses
import math

import numpy as np

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.kernels.mode_kernels import NO_SYMMETRY, Minima, best_of_each
from tactopose_drake.core.objectives.objective import DoubtedObjective, LeastSquaresObjective
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.poses import compose
from tactopose_drake.core.searches.levenberg_marquardt import LEAST_REFUSED, TO_THE_MINIMUM, LevenbergMarquardt
from tactopose_drake.core.searches.pair_proposals import PairProposals
from tactopose_drake.core.searches.pairs.contact_pairs import PairChoice
from tactopose_drake.core.searches.search import (
    PoseSpace,
    Search,
    SearchResult,
    StopSignal,
    is_near_prior,
    join_results,
    never,
)
from tactopose_drake.core.shape.free_spin import turn_alike
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray

# Unconverged poses within this many standard deviations of each other are assumed to lead to the same minimum.
_SAME_MINIMUM = 1.5
# Unconverged poses that cost more than the best by this are dropped.
_WORTH = 60.0
# Symmetries that displace the surface by less than this share of the contacts' sigma hold for any touch. Of the images
# under other symmetries the proposals contain only one; so the images of this many of the best poses are refined, too.
_NOTICED, _IMAGED = 0.1, 2


@dataclasses.dataclass(frozen=True, kw_only=True)
class Stage:
    """A round of refinement, and which of its poses go on to the next.

    Attributes:
        refinement: applied to each pose.
        kept: most poses that go on, the best ones.
        worth: poses that cost more than the best by this are dropped.
        apart: of poses within this many standard deviations of each other only the best goes on.
    """

    refinement: LevenbergMarquardt
    kept: int
    worth: float = _WORTH
    apart: float = _SAME_MINIMUM


@dataclasses.dataclass(frozen=True, kw_only=True)
class Start:
    """The start poses of the first stage.

    Attributes:
        candidates: most poses from pairs of contacts.
        samples: number of random poses of the space that are added.
        fewest: without a prior, random poses are added only if there are fewer candidates than this; always, if None.
            Near a prior, more random poses are added to reach this number.
        kept: how many of all these go on, by their cost; all, if None.
    """

    candidates: int = 400
    samples: int = 250
    fewest: int | None = 20
    kept: int | None = None

    def widened(self) -> "Start":
        """Four times as many start poses."""
        kept = None if self.kept is None else 4 * self.kept
        return dataclasses.replace(self, candidates=4 * self.candidates, samples=4 * self.samples, kept=kept)


_FIRST_STEPS = LevenbergMarquardt(max_iterations=3, tolerance=3e-4, initial_damping=1e-2, least_refused=LEAST_REFUSED)
_FURTHER_STEPS = dataclasses.replace(_FIRST_STEPS, max_iterations=4)
# Most poses are on their way to the same few minima: of those that come together, one is kept.
_ON_THE_WAY = Stage(refinement=_FURTHER_STEPS, kept=20, worth=20.0, apart=1.0)
# So few measured numbers, three for a contact with its normal and one for a point alone, leave many poses that explain
# them, most without a prior: more are followed.
_FEW_NUMBERS, _MANY_ON_THE_WAY = 12, dataclasses.replace(_ON_THE_WAY, kept=80)
# More are also followed if all contacts lie within this share of the object's size of their middle, as they then fit it
# in many places. Contacts that are more than so many times as uncertain as the best decide little, and do not count.
_CLOSE_TOGETHER, _MUCH_ROUGHER = 0.15, 4.0
# A descent may get stuck at a kink of the field; it is restarted from the best poses.
_AGAIN = dataclasses.replace(_ON_THE_WAY, kept=3)


def global_stages(starts: int = 80, kept: int = 40) -> tuple[Stage, ...]:
    """The first stages without a prior.

    Args:
        starts: number of poses kept after the first step.
        kept: number that go on to all the evidence.
    """
    return (
        Stage(refinement=dataclasses.replace(_FIRST_STEPS, max_iterations=1), kept=starts),
        Stage(refinement=_FURTHER_STEPS, kept=kept, worth=40.0),
    )


def near_stages(kept: int = 40) -> tuple[Stage, ...]:
    """The first stage near a prior, after which `kept` poses go on to all the evidence."""
    return (Stage(refinement=_FIRST_STEPS, kept=kept, worth=40.0),)


@dataclasses.dataclass(frozen=True, kw_only=True)
class PairSearch(Search):
    """Poses from pairs of contacts, refined in stages of fewer and fewer.

    Attributes:
        model: the object.
        contacts: the touch that poses are proposed from; the objective may include other evidence.
        choice: how pairs are matched and chosen without a prior.
        start, stages: start poses and first stages, by the touch alone.
        start_but_for_one: additional start poses if one of the contacts may be false.
        on_the_way: the stage before the final refinement, by all the evidence.
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
        """The search for these contacts; wider if they are few, or have no normals to determine the spin."""
        search = cls(model=model, contacts=contacts)
        if _tell_as_little_as_few(contacts, model.size):
            search = dataclasses.replace(search, stages=global_stages(320, 160), on_the_way=_MANY_ON_THE_WAY)
        return search if contacts.n_PC is not None else search.widened()

    def of_one_contact(self) -> "PairSearch":
        """The search where a single pad is felt, or a contact beside planes: no pair proposes poses, more are drawn."""
        return dataclasses.replace(
            self,
            start=dataclasses.replace(self.start, samples=1000),
            stages=global_stages(640, 320),
            on_the_way=dataclasses.replace(self.on_the_way, kept=160),
            near_start=dataclasses.replace(self.near_start, samples=200, fewest=200, kept=200),
            near_stages=near_stages(kept=80),
        )

    def widened(self) -> "PairSearch":
        """The search with four times as many start poses near a prior."""
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
        """Returns the minima that the candidates lead to, in ascending order of cost."""
        near, believed, proposals = is_near_prior(space), objective.believed, self.proposals(space, generator)
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
            found = found._replace(cost=objective.cost(found.X_PO))
        for stage, following in ((last, _FURTHER_STEPS), (self.on_the_way, TO_THE_MINIMUM)):
            X_PO = self._apart(found, believed, space, stage)
            found = following.refine_each(objective, X_PO, should_stop)
        best = self._apart(found, believed, space, _AGAIN)
        again = TO_THE_MINIMUM.refine_each(objective, best if near else self._with_images(best), should_stop)
        return join_results(found, again).ranked()

    def minimize_with_doubt(
        self,
        objective: DoubtedObjective,
        space: PoseSpace,
        generator: np.random.Generator,
        should_stop: StopSignal = never,
    ) -> SearchResult:
        """The same with contacts that may be outliers."""
        return self.minimize(objective, space, generator, should_stop)

    def _approach(
        self,
        believed: LeastSquaresObjective,
        X_PO: FloatArray,
        space: PoseSpace,
        should_stop: StopSignal,
    ) -> tuple[Stage, SearchResult]:
        """Runs the first stages on poses (n, 3, 4); returns the last of them and its result, with Hessians.

        These stages use the touch alone, as the proposals do: other evidence is slow to evaluate, and says most about
        poses that touch. Its cost then decides which of them go on.
        """
        if is_near_prior(space):
            start, quick, stages = self.near_start, believed.quick, self.near_stages
        else:
            start, quick, stages = self.start, believed.quick, self.stages
            if quick is believed and not believed.is_touch:
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
        """Proposals by pairs of contacts for poses of this space."""
        choice = self.near_choice if is_near_prior(space) else self.choice
        return PairProposals.match(self.model, self.contacts, choice, space, generator)

    def _starts(
        self, start: Start, X_PO: FloatArray, proposals: PairProposals, generator: np.random.Generator
    ) -> FloatArray:
        """The start poses (n, 3, 4): proposals (m, 3, 4) and random poses."""
        space = proposals.space
        if is_near_prior(space):
            missing = 0 if start.fewest is None else start.fewest - len(X_PO)
            samples = space.sample(generator, max(start.samples, missing) - 1)
            return np.concatenate([space.center[None], samples, X_PO])
        if start.fewest is None or len(X_PO) < start.fewest:
            X_PO = np.concatenate([X_PO, space.sample(generator, start.samples)])
        if not self.model.continuous_symmetries:
            return X_PO
        # Rotations about a symmetry axis make no different start.
        return proposals.distinct(turn_alike(X_PO, space.center, self.model.symmetries, self.model.symmetry_poses))

    def _with_images(self, X_PO: FloatArray) -> FloatArray:
        """Poses (n, 3, 4), with images of the first ones under distinguishable symmetries and what is roughly one.

        Many objects are nearly symmetric under half turns.
        """
        misfits = self.model.symmetry_misfits
        noticed = self.model.symmetry_poses[misfits > _NOTICED * np.min(self.contacts.sigma_position)]
        turns = np.concatenate([noticed, self.model.half_turns, self.model.likenesses])
        return np.concatenate([X_PO, compose(X_PO[:_IMAGED, None], turns).reshape(-1, 3, 4)])

    def _apart(
        self, found: SearchResult, believed: LeastSquaresObjective, space: PoseSpace, stage: Stage
    ) -> FloatArray:
        """The poses (n, 3, 4) that go on: the best of each set that leads to the same minimum.

        Distances are by the local quadratic models without outliers: along a direction that hardly changes the cost,
        poses far apart belong together.
        """
        X_PO, cost, hessian = found.X_PO, found.cost, found.hessian
        if hessian is None:
            worth = cost <= cost.min() + stage.worth
            X_PO, cost, hessian = X_PO[worth], cost[worth], believed.normal_equations(X_PO[worth]).hessian
        minima, limits = Minima(X_PO, cost, hessian), (stage.apart, stage.kept, stage.worth)
        return X_PO.take(best_of_each(minima, space.information, NO_SYMMETRY, *limits).chosen, axis=0)


def _tell_as_little_as_few(contacts: Contacts, size: float) -> bool:
    """Whether there are few contacts, few that are precise, or all of them lie in a small region of the object."""
    sigmas = np.asarray(contacts.sigma_position).tolist()
    rough, numbers = _MUCH_ROUGHER * min(sigmas, default=math.inf), 1 if contacts.n_PC is None else 3
    if numbers * sum(sigma <= rough for sigma in sigmas) <= _FEW_NUMBERS:
        return True
    middle = contacts.p_PC.mean(axis=0)
    return max(math.dist(point, middle) for point in contacts.p_PC.tolist()) < _CLOSE_TOGETHER * size
