"""Chooses where in the hand a simulated object is held, and where each fingertip touches it.

This is the simulation's choice of a scene, made with the object's true geometry; estimation never sees it.
"""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from tactopose_drake.core.grasping.finger_reach import FingerReach
from tactopose_drake.core.grasping.finger_sides import are_apart, sides
from tactopose_drake.core.grasping.finger_touches import Touches
from tactopose_drake.core.grasping.grasp_law import ClosingMotion
from tactopose_drake.core.grasping.grasp_score import ContactTerms, GraspScore, ScoreParams, score_grasp
from tactopose_drake.core.grasping.held_pose import sample_held_pose
from tactopose_drake.core.grasping.refusals import Refusals
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray, known_name, positive_number
from tactopose_drake.errors import InvalidInputError

_GAP = 0.0005  # between the sides of two fingers, m
_IN_ITS_WAY = "a finger that takes no part is in its way"
_IMBALANCE_OF_TWO = 0.05  # the most of what two fingers hold, N

Spheres = tuple[FloatArray, FloatArray]  # centres in P (n, 3) and radii (n,), m


@dataclass(kw_only=True, slots=True)
class PlannerParams:
    """How many grasps are looked for, and what they must keep."""

    grasps: int = 8  # to find before the best is taken
    most_poses: int = 250  # object poses to look at for them
    touches: int = 14  # touches a finger and pose
    normal_force: float = 3.0  # wanted of each finger, N
    least_force: float = 1.8  # N
    most_force: float = 7.0  # N
    friction: float = 0.5  # of the planned grasp, below the true one for the sake of a margin
    # Least distance between the axes of two fingers, m; null: their widths decide.
    finger_distance: float | None = None
    palm_clearance: float = 0.004  # m
    tilt_deg: float = 25.0  # largest angle between the object's z axis and up, deg
    least_fingers: int = 4  # that take part; of a hand with fewer, all
    fingers: list[str] = field(default_factory=list)  # of which these; empty: any
    restarts: int = 2  # of the choice of one touch a finger, each from another order of the fingers
    rounds: int = 2  # of each, in which every finger's touch is chosen anew

    def validate(self) -> None:
        """Raises InvalidInputError if a value is out of its range."""
        for name in PlannerParams.__dataclass_fields__:
            if name == "fingers":
                continue
            if name != "finger_distance" or self.finger_distance is not None:
                positive_number(f"PlannerParams.{name}", getattr(self, name), allow_zero=name == "tilt_deg")
        if self.least_fingers < 2:
            raise InvalidInputError(f"PlannerParams.least_fingers: is {self.least_fingers}; allowed are numbers >= 2.")


@dataclass(frozen=True, eq=False)
class HandReach:
    """What the planner knows of a hand.

    Attributes:
        fingers: by name.
        palm_spheres: the parts of the hand that do not move.
        rest_spheres: each finger where it waits if it takes no part, by name.
        grip_low: lower corner of the region where the hand holds things, shape (3,), m, in P.
        grip_high: its upper corner.
    """

    fingers: Mapping[str, FingerReach]
    palm_spheres: Spheres
    rest_spheres: Mapping[str, Spheres]
    grip_low: FloatArray
    grip_high: FloatArray


@dataclass(frozen=True, eq=False)
class FingerPlan:
    """What one finger is to do, and where it is meant to touch: point (3,), m, and object's normal (3,), in P."""

    motion: ClosingMotion
    p_PC: FloatArray
    n_PC: FloatArray


@dataclass(frozen=True, eq=False)
class GraspPlan:
    """An object's pose in the palm, and the fingers that touch it.

    Attributes:
        X_PO: shape (3, 4).
        fingers: by name; fingers that take no part are absent.
        score: larger is better.
        waiting: actuated joint positions, shape (m,), rad or m, of the fingers that take no part and would be in the
            object's way where they usually wait, by name.
    """

    X_PO: FloatArray
    fingers: Mapping[str, FingerPlan]
    score: float
    waiting: Mapping[str, FloatArray] = field(default_factory=dict)


def plan_grasps(
    model: ObjectModel,
    hand: HandReach,
    load_P: FloatArray,
    params: PlannerParams,
    generator: np.random.Generator,
    refusals: Refusals | None = None,
) -> list[GraspPlan]:
    """Grasps by falling score; fewer than asked for, or none, where the hand can hardly hold the object.

    The fingertips touch with their round ends, where a touch tells most of where it is, and fingers that take no part
    wait where they usually do. Only where no grasp is found so, the straight parts of fingertips may touch too, and
    idle fingers make way.

    Args:
        model: the object.
        hand: the hand.
        load_P: the object's weight, shape (3,), N, in P.
        params: see there.
        generator: source of all random choices.
        refusals: why poses are not taken is counted there.
    """
    params.validate()
    for name in params.fingers:
        known_name("PlannerParams.fingers", name, hand.fingers)
    refusals = Refusals() if refusals is None else refusals
    plans: list[GraspPlan] = []
    for is_free in (False, True):
        search = _Search(model, hand, load_P, params, generator, refusals, is_free)
        for _ in range(params.most_poses):
            X_PO = sample_held_pose(model, (hand.grip_low, hand.grip_high), -load_P, params.tilt_deg, generator)
            plan = search.plan_at(X_PO)
            if plan is not None:
                plans.append(plan)
            if len(plans) >= params.grasps:
                break
        has_straight_parts = any(finger.geometry.p_SL is not None for finger in hand.fingers.values())
        if plans or not (has_straight_parts or refusals.poses[_IN_ITS_WAY]):
            break
    return sorted(plans, key=lambda plan: -plan.score)


@dataclass(frozen=True, eq=False)
class _Search:
    """What a search for grasps goes by.

    `is_free` says that straight parts of fingertips may touch, and that idle fingers may wait anywhere.
    """

    model: ObjectModel
    hand: HandReach
    load_P: FloatArray
    params: PlannerParams
    generator: np.random.Generator
    refusals: Refusals
    is_free: bool

    @cached_property
    def least_fingers(self) -> int:
        return min(self.params.least_fingers, len(self.hand.fingers))

    @cached_property
    def scoring(self) -> ScoreParams:
        # Two fingers hold no torque about the line between them.
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
        """The best grasp of the object in a pose; None where there is none, and why is counted."""
        clearance = self.params.palm_clearance
        if _least_distance(self.model, X_PO, self.hand.palm_spheres) < clearance:
            return self._refused("the object would be in the palm")
        touches: dict[str, Touches] = {}
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
                if self._waiting(name, X_PO, {}) is None:
                    return self._refused(_IN_ITS_WAY)
        if self.is_free and not _oppose(touches):
            return self._refused("no two fingers press against each other")
        best = self._combine(touches, X_PO[:, :3] @ self.model.center_of_mass + X_PO[:, 3])
        if best is None:
            return self._refused("no choice of touches keeps the fingers apart and the forces in balance")
        chosen, score = best
        taken = {name: touches[name].take(np.array([i])) for name, i in chosen.items()}
        waiting = {name: self._waiting(name, X_PO, taken) for name in self.hand.fingers if name not in chosen}
        if any(q is None for q in waiting.values()):
            return self._refused(_IN_ITS_WAY)
        fingers = {}
        for (name, touch), force in zip(taken.items(), score.force, strict=True):
            motion = ClosingMotion(touch.q_open[0], touch.q[0], touch.closing[0], float(force))
            fingers[name] = FingerPlan(motion, touch.p_PC[0], touch.n_PC[0])
        return GraspPlan(
            X_PO, fingers, score.value, {name: q for name, q in waiting.items() if q is not None and len(q)}
        )

    def _waiting(self, name: str, X_PO: FloatArray, taken: Mapping[str, Touches]) -> FloatArray | None:
        """Where an idle finger waits, beside those that touch: empty where it usually does; None: it has no place."""
        clearance = self.params.palm_clearance
        if _least_distance(self.model, X_PO, self.hand.rest_spheres[name]) >= clearance:
            return np.zeros(0)
        if not self.is_free:
            return None
        q = self.hand.fingers[name].waiting(self.model.grid, X_PO, clearance)
        free = np.ones(len(q), dtype=bool)
        for other, touch in taken.items():
            both = np.concatenate([touch.q, touch.q_open])
            free &= are_apart(self._sides(name, q), self._sides(other, both), _GAP).all(axis=1)
        return q[free][0] if free.any() else None

    def _refused(self, reason: str) -> GraspPlan | None:
        self.refusals.poses[reason] += 1
        return None

    def _combine(self, touches: Mapping[str, Touches], p_PG: FloatArray) -> tuple[dict[str, int], GraspScore] | None:
        """The best choice found of one touch a finger, by changing one finger at a time."""
        placed = {name: self._sides(name, touch.q) for name, touch in touches.items()}
        apart = {(a, b): are_apart(placed[a], placed[b], _GAP) for a, b in itertools.combinations(touches, 2)}
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

    def _sides(self, finger: str, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Spheres that stand for a finger in some postures, to keep fingers apart."""
        geometry = self.hand.fingers[finger].geometry
        if self.params.finger_distance is None:
            return sides(geometry, q)
        axis = geometry.axis(q)
        return axis, np.full(axis.shape[1], 0.5 * (self.params.finger_distance - _GAP))


def _oppose(touches: Mapping[str, Touches]) -> bool:
    """Whether some touches of two fingers press against each other, without which no forces are in balance."""
    return any(float((a.n_PC @ b.n_PC.T).min()) < 0.0 for a, b in itertools.combinations(touches.values(), 2))


def _least_distance(model: ObjectModel, X_PO: FloatArray, spheres: Spheres) -> float:
    centres, radius = spheres
    return float((model.grid.distance((centres - X_PO[:, 3]) @ X_PO[:, :3]) - radius).min())
