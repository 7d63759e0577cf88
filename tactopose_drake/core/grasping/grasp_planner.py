"""Chooses where in the hand a simulated object is held, and where each fingertip touches it.

This is the simulation's choice of a scene, made with the object's true geometry; estimation never sees it.
"""

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from tactopose_drake.core import poses
from tactopose_drake.core.grasping.finger_reach import FingerReach, Touches
from tactopose_drake.core.grasping.finger_sides import are_apart, sides
from tactopose_drake.core.grasping.grasp_law import ClosingMotion
from tactopose_drake.core.grasping.grasp_score import ContactTerms, GraspScore, ScoreParams, score_grasp
from tactopose_drake.core.grasping.refusals import Refusals
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray, known_name, positive_number
from tactopose_drake.errors import InvalidInputError

_GAP = 0.0005  # between the sides of two fingers, m
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
    """

    X_PO: FloatArray
    fingers: Mapping[str, FingerPlan]
    score: float


def plan_grasps(
    model: ObjectModel,
    hand: HandReach,
    load_P: FloatArray,
    params: PlannerParams,
    generator: np.random.Generator,
    refusals: Refusals | None = None,
) -> list[GraspPlan]:
    """Grasps by falling score; fewer than asked for, or none, where the hand can hardly hold the object.

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
    search = _Search(model, hand, load_P, params, generator, Refusals() if refusals is None else refusals)
    plans: list[GraspPlan] = []
    for _ in range(params.most_poses):
        plan = search.plan_at(_sample_pose(model, hand, -load_P, params, generator))
        if plan is not None:
            plans.append(plan)
        if len(plans) >= params.grasps:
            break
    return sorted(plans, key=lambda plan: -plan.score)


def _sample_pose(
    model: ObjectModel, hand: HandReach, up_P: FloatArray, params: PlannerParams, generator: np.random.Generator
) -> FloatArray:
    """A random pose X_PO (3, 4): upright within the tilt, any spin, a point of the object's axis in the grip region."""
    up = up_P / np.linalg.norm(up_P)
    side = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    side /= np.linalg.norm(side)
    other = np.cross(up, side)
    spin, lean = generator.uniform(-math.pi, math.pi, 2)
    tilt = math.radians(generator.uniform(0.0, params.tilt_deg))
    R_tilt = poses.exp_so3(tilt * (math.cos(lean) * side + math.sin(lean) * other))
    R_PO = R_tilt @ np.column_stack([side, other, up]) @ poses.exp_so3(np.array([0.0, 0.0, spin]))
    low, high = model.vertices[:, 2].min(), model.vertices[:, 2].max()
    # The fingers stand side by side over about twice this length.
    margin = min(0.035, 0.5 * (high - low))
    p_OG = np.array([*model.center_of_mass[:2], generator.uniform(low + margin, high - margin)])
    p_PG = generator.uniform(hand.grip_low, hand.grip_high)
    return poses.make_poses(R_PO, p_PG - R_PO @ p_OG)


@dataclass(frozen=True, eq=False)
class _Search:
    """What a search for grasps goes by."""

    model: ObjectModel
    hand: HandReach
    load_P: FloatArray
    params: PlannerParams
    generator: np.random.Generator
    refusals: Refusals

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
                found = finger.touches(self.model.grid, X_PO, self.generator, self.params.touches, refused)
                if len(found):
                    touches[name] = found
            if name not in touches:
                idle += 1
                if len(self.hand.fingers) - idle < self.least_fingers:
                    return self._refused(f"fewer than {self.least_fingers} fingers can touch it")
                if _least_distance(self.model, X_PO, self.hand.rest_spheres[name]) < clearance:
                    return self._refused("a finger that takes no part is in its way")
        best = self._combine(touches, X_PO[:, :3] @ self.model.center_of_mass + X_PO[:, 3])
        if best is None:
            return self._refused("no choice of touches keeps the fingers apart and the forces in balance")
        chosen, score = best
        left_out = [name for name in touches if name not in chosen]
        if any(_least_distance(self.model, X_PO, self.hand.rest_spheres[name]) < clearance for name in left_out):
            return self._refused("a finger that takes no part is in its way")
        fingers = {}
        for (name, i), force in zip(chosen.items(), score.force, strict=True):
            touch = touches[name]
            motion = ClosingMotion(touch.q_open[i], touch.q[i], touch.closing[i], float(force))
            fingers[name] = FingerPlan(motion, touch.p_PC[i], touch.n_PC[i])
        return GraspPlan(X_PO, fingers, score.value)

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


def _least_distance(model: ObjectModel, X_PO: FloatArray, spheres: Spheres) -> float:
    centres, radius = spheres
    return float((model.grid.distance((centres - X_PO[:, 3]) @ X_PO[:, :3]) - radius).min())
