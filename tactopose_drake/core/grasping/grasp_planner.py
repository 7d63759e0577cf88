"""Chooses where in the hand a simulated object is held, and where each fingertip touches it.

The simulation sets up its scene with this, from the object's true geometry; estimation never sees it.
"""

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from tactopose_drake.core.grasping.finger_reach import FingerReach
from tactopose_drake.core.grasping.finger_sides import FingerShape, are_apart
from tactopose_drake.core.grasping.finger_touches import FingerTouches
from tactopose_drake.core.grasping.grasp_law import ClosingMotion
from tactopose_drake.core.grasping.grasp_plan import FingerPlan, GraspPlan, Refusals
from tactopose_drake.core.grasping.grasp_score import ContactTerms, GraspScore, ScoreParams, score_grasp
from tactopose_drake.core.grasping.held_pose import least_distance, sample_held_pose, shifted_off
from tactopose_drake.core.parameter_checks import check_numbers
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.shape.sphere_packing import Spheres
from tactopose_drake.core.validation import FloatArray, finite_array, known_name, whole_number
from tactopose_drake.errors import InvalidInputError

_GAP = 0.0005  # least gap between the sides of two fingers, m
_IN_THE_PALM = "the object would be in the palm"
_IN_ITS_WAY = "a finger that takes no part is in its way"
_IMBALANCE_OF_TWO = 0.05  # largest imbalance of a grasp by two fingers, N

TouchesItself = Callable[[Mapping[str, FloatArray]], bool]


@dataclass(kw_only=True, slots=True)
class PlannerParams:
    """How many grasps are searched for, and their constraints."""

    grasps: int = 8  # number of grasps found before the best is taken
    most_poses: int = 250  # largest number of object poses that are tried for them
    touches: int = 14  # number of touches considered per finger and pose
    normal_force: float = 3.0  # desired normal force of each finger, N
    least_force: float = 1.8  # least normal force of each finger, N
    most_force: float = 7.0  # largest normal force of each finger, N
    friction: float = 0.5  # coefficient of friction of the planned grasp, below the true one for a margin
    # Least distance between the axes of two fingers, m; null: their widths decide.
    finger_distance: float | None = None
    palm_clearance: float = 0.004  # least distance of the object from the palm and from idle fingers, m
    tilt_deg: float = 25.0  # largest angle between the object's z axis and up, deg
    least_fingers: int = 4  # least number of fingers that take part; of a hand with fewer, all
    fingers: list[str] = field(default_factory=list)  # names of the fingers that may take part; empty: any
    restarts: int = 2  # number of times that one touch per finger is chosen, with another order of the fingers each
    rounds: int = 2  # number of rounds of each restart, in which every finger's touch is chosen anew

    def validate(self) -> None:
        """Raises InvalidInputError if a value is out of its range."""
        check_numbers("PlannerParams", self, may_be_zero=("tilt_deg",))
        whole_number("PlannerParams.least_fingers", self.least_fingers, least=2)
        if self.least_force > self.most_force:
            raise InvalidInputError(
                f"PlannerParams.least_force must be at most `most_force`, {self.most_force:g} N, not "
                f"{self.least_force:g} N."
            )


@dataclass(frozen=True, eq=False)
class HandReach:
    """A hand as the planner sees it.

    Attributes:
        fingers: by name.
        palm_spheres: the parts of the hand that do not move.
        rest_spheres: by name, each finger in its idle posture.
        grip_low: lower corner of the region where the hand holds things, shape (3,), m, in P.
        grip_high: its upper corner.
    """

    fingers: Mapping[str, FingerReach]
    palm_spheres: Spheres
    rest_spheres: Mapping[str, Spheres]
    grip_low: FloatArray
    grip_high: FloatArray


def plan_grasps(
    model: ObjectModel,
    hand: HandReach,
    load_P: FloatArray,
    params: PlannerParams,
    generator: np.random.Generator,
    refusals: Refusals | None = None,
    touches_itself: TouchesItself = lambda positions: False,
) -> list[GraspPlan]:
    """Plans grasps, in descending order of score; fewer than wanted, or none, if the hand can hardly hold the object.

    Fingertips touch with their round ends, where a touch locates the contact best, and idle fingers stay in their usual
    posture. Only if there is no such grasp, the straight parts of fingertips may touch too, idle fingers make way, and
    objects that would be in the palm are held farther out.

    Args:
        model: the object.
        hand: the hand.
        load_P: the object's weight, shape (3,), N, in P; its direction tells which way is down.
        params: constraints, and effort.
        generator: source of all random choices.
        refusals: counts the reasons for which poses were rejected.
        touches_itself: whether the hand's links collide, given actuated joint positions of some fingers, by name, shape
            (m,), rad or m, with the others in their usual idle posture.

    Raises:
        InvalidInputError: a load that is zero or not finite, or a parameter out of its range.
        UnknownNameError: a finger that the hand does not have.
    """
    params.validate()
    load_P = finite_array("load_P", load_P, (3,))
    if not load_P.any():
        raise InvalidInputError("load_P must not be zero, as it tells which way is down; it may be small.")
    for name in params.fingers:
        known_name("each name in PlannerParams.fingers", name, hand.fingers)
    refusals = Refusals() if refusals is None else refusals
    plans: list[GraspPlan] = []
    for is_free in (False, True):
        search = _Search(model, hand, load_P, params, generator, refusals, touches_itself, is_free)
        for _ in range(params.most_poses):
            X_PO = sample_held_pose(model, (hand.grip_low, hand.grip_high), -load_P, params.tilt_deg, generator)
            plan = search.plan_at(
                shifted_off(model, X_PO, hand.palm_spheres, params.palm_clearance) if is_free else X_PO
            )
            if plan is not None:
                plans.append(plan)
            if len(plans) >= params.grasps:
                break
        has_straight_parts = any(finger.geometry.p_SL is not None for finger in hand.fingers.values())
        if plans or not (has_straight_parts or refusals.poses[_IN_ITS_WAY] or refusals.poses[_IN_THE_PALM]):
            break
    return sorted(plans, key=lambda plan: -plan.score)


@dataclass(frozen=True, eq=False)
class _Search:
    """A search for grasps.

    `is_free` means that straight parts of fingertips may touch, that idle fingers may wait anywhere, and that the
    object may be farther out than the grip region.
    """

    model: ObjectModel
    hand: HandReach
    load_P: FloatArray
    params: PlannerParams
    generator: np.random.Generator
    refusals: Refusals
    touches_itself: TouchesItself
    is_free: bool

    @cached_property
    def least_fingers(self) -> int:
        return min(self.params.least_fingers, len(self.hand.fingers))

    @cached_property
    def scoring(self) -> ScoreParams:
        # Two fingers cannot resist a torque about the line between them.
        usual = ScoreParams.most_imbalance
        return ScoreParams(
            friction=self.params.friction,
            normal_force=self.params.normal_force,
            least_force=self.params.least_force,
            most_force=self.params.most_force,
            least_contacts=min(3, self.least_fingers),
            most_imbalance=_IMBALANCE_OF_TWO if self.least_fingers == 2 else usual,
        )

    def plan_at(self, X_PO: FloatArray) -> GraspPlan | None:
        """The best grasp of the object at a pose; None if there is none, with the reason counted."""
        clearance = self.params.palm_clearance
        if least_distance(self.model, X_PO, self.hand.palm_spheres) < clearance:
            return self._refused(_IN_THE_PALM)
        touches: dict[str, FingerTouches] = {}
        idle = 0
        for name, finger in self.hand.fingers.items():
            if not self.params.fingers or name in self.params.fingers:
                refused = self.refusals.touches[name]
                found = finger.touches(
                    self.model.grid, X_PO, self.generator, self.params.touches, refused, with_sides=self.is_free
                )
                if len(found):
                    touches[name] = found
            if name not in touches:
                idle += 1
                if len(self.hand.fingers) - idle < self.least_fingers:
                    return self._refused(f"fewer than {self.least_fingers} fingers can touch it")
                if self._is_in_the_way(name, X_PO) and not (self.is_free and len(self._ways_out(name, X_PO))):
                    return self._refused(_IN_ITS_WAY)
        if self.is_free and not _oppose(touches):
            return self._refused("no two fingers press against each other")
        best = self._combine(touches, X_PO[:, :3] @ self.model.center_of_mass + X_PO[:, 3])
        if best is None:
            return self._refused("no choice of touches keeps the fingers apart and the forces in balance")
        chosen, score = best
        taken = {name: touches[name].take(np.array([i])) for name, i in chosen.items()}
        waiting = self._making_way(X_PO, taken)
        if waiting is None:
            return self._refused(_IN_ITS_WAY)
        postures = [{name: getattr(touch, q)[0] for name, touch in taken.items()} for q in ("q_open", "q")]
        if any(self.touches_itself({**waiting, **posture}) for posture in postures):
            return self._refused("the hand would touch itself")
        fingers = {}
        for (name, touch), force in zip(taken.items(), score.force, strict=True):
            motion = ClosingMotion(touch.q_open[0], touch.q[0], touch.closing[0], float(force))
            fingers[name] = FingerPlan(motion, touch.p_PC[0], touch.n_PC[0])
        return GraspPlan(X_PO, fingers, score.value, waiting)

    def _is_in_the_way(self, name: str, X_PO: FloatArray) -> bool:
        """Whether an idle finger in its usual posture is too close to the object."""
        return least_distance(self.model, X_PO, self.hand.rest_spheres[name]) < self.params.palm_clearance

    def _ways_out(self, name: str, X_PO: FloatArray) -> FloatArray:
        """Other postures in which an idle finger is off the object: joint positions, shape (n, m)."""
        return self.hand.fingers[name].waiting(self.model.grid, X_PO, self.params.palm_clearance)

    def _making_way(self, X_PO: FloatArray, taken: Mapping[str, FingerTouches]) -> dict[str, FloatArray] | None:
        """Postures of idle fingers that must make way, clear of all other fingers; None if one has no place."""
        placed = [self._shape(name, np.concatenate([touch.q, touch.q_open])) for name, touch in taken.items()]
        leaving, resting = [], list[Spheres]()
        for name in (name for name in self.hand.fingers if name not in taken):
            centres, radius = self.hand.rest_spheres[name]
            rest = centres[None], radius
            if self._is_in_the_way(name, X_PO):
                leaving.append(name)
            else:
                resting.append(rest)
        if leaving and not self.is_free:
            return None
        waiting: dict[str, FloatArray] = {}
        for name in leaving:
            q = self._ways_out(name, X_PO)
            shape = self._shape(name, q)
            free = np.ones(len(q), dtype=bool)
            for other in placed:
                free &= shape.apart(other, _GAP).all(axis=1)
            for rest in resting:
                free &= are_apart(shape.sides, rest, _GAP).all(axis=1)
            if not free.any():
                return None
            waiting[name] = q[free][0]
            placed.append(self._shape(name, waiting[name][None]))
        return waiting

    def _refused(self, reason: str) -> GraspPlan | None:
        self.refusals.poses[reason] += 1
        return None

    def _combine(
        self, touches: Mapping[str, FingerTouches], p_PG: FloatArray
    ) -> tuple[dict[str, int], GraspScore] | None:
        """The best choice found of one touch per finger, by coordinate ascent over the fingers."""
        placed = {name: self._shape(name, touch.q) for name, touch in touches.items()}
        apart = {(a, b): placed[a].apart(placed[b], _GAP) for a, b in itertools.combinations(touches, 2)}
        apart |= {(b, a): free.T for (a, b), free in apart.items()}

        terms = {name: ContactTerms.of(touch.p_PC - p_PG, touch.n_PC, self.scoring) for name, touch in touches.items()}

        def judge(chosen: Mapping[str, int]) -> GraspScore:
            contacts = ContactTerms.one_of_each([terms[name] for name in chosen], list(chosen.values()))
            cost = np.array([touches[name].cost[i] for name, i in chosen.items()])
            return score_grasp(contacts, float(cost.sum()), self.load_P, self.scoring)

        names = list(touches)
        best: tuple[dict[str, int], GraspScore] | None = None
        for _ in range(self.params.restarts):
            chosen: dict[str, int] = {}
            for _ in range(self.params.rounds):
                for k in self.generator.permutation(len(names)):
                    others = {name: i for name, i in chosen.items() if name != names[k]}
                    free = np.ones(len(touches[names[k]]), dtype=bool)
                    for name, i in others.items():
                        free &= apart[name, names[k]][i]
                    options = [{**others, names[k]: int(i)} for i in np.flatnonzero(free)]
                    if options:
                        chosen = max(options, key=lambda option: judge(option).value)
            if len(chosen) >= self.least_fingers:
                score = judge(chosen)
                if score.balanced and (best is None or score.value > best[1].value):
                    best = chosen, score
        return best

    def _shape(self, finger: str, q: FloatArray) -> FingerShape:
        """A finger in some postures, for collision tests between fingers."""
        geometry, distance = self.hand.fingers[finger].geometry, self.params.finger_distance
        if distance is None:
            return FingerShape.of(geometry, q)
        return FingerShape.of_axis(geometry, q, 0.5 * (distance - _GAP))


def _oppose(touches: Mapping[str, FingerTouches]) -> bool:
    """Whether any touches of two fingers press against each other, without which forces cannot balance."""
    return any(float((a.n_PC @ b.n_PC.T).min()) < 0.0 for a, b in itertools.combinations(touches.values(), 2))
