"""Chooses where in the hand a simulated object is held, and where each fingertip touches it.

This is the simulation's choice of a scene, made with the object's true geometry; estimation never sees it.
"""

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core import poses
from tactopose_drake.core.grasping.finger_reach import FingerReach, Touches
from tactopose_drake.core.grasping.grasp_law import ClosingMotion
from tactopose_drake.core.grasping.grasp_score import GraspScore, ScoreParams, score_grasp
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray, positive_number
from tactopose_drake.errors import InvalidInputError

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
    finger_distance: float = 0.0185  # least distance between the axes of two fingers, m
    palm_clearance: float = 0.004  # m
    tilt_deg: float = 25.0  # largest angle between the object's z axis and up, deg
    least_fingers: int = 4  # that take part
    restarts: int = 2  # of the choice of one touch a finger, each from another order of the fingers
    rounds: int = 2  # of each, in which every finger's touch is chosen anew

    def validate(self) -> None:
        """Raises InvalidInputError if a value is out of its range."""
        for name in PlannerParams.__dataclass_fields__:
            positive_number(f"PlannerParams.{name}", getattr(self, name), allow_zero=name == "tilt_deg")
        if self.least_fingers < 3:
            raise InvalidInputError(f"PlannerParams.least_fingers: is {self.least_fingers}; allowed are numbers >= 3.")


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
) -> list[GraspPlan]:
    """Grasps by falling score; fewer than asked for, or none, where the hand can hardly hold the object.

    Args:
        model: the object.
        hand: the hand.
        load_P: the object's weight, shape (3,), N, in P.
        params: see there.
        generator: source of all random choices.
    """
    params.validate()
    plans: list[GraspPlan] = []
    for _ in range(params.most_poses):
        plan = _plan_at(model, hand, _sample_pose(model, hand, -load_P, params, generator), load_P, params, generator)
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


def _plan_at(
    model: ObjectModel,
    hand: HandReach,
    X_PO: FloatArray,
    load_P: FloatArray,
    params: PlannerParams,
    generator: np.random.Generator,
) -> GraspPlan | None:
    if _least_distance(model, X_PO, hand.palm_spheres) < params.palm_clearance:
        return None
    touches: dict[str, Touches] = {}
    idle = 0
    for name, finger in hand.fingers.items():
        found = finger.touches(model.grid, X_PO, generator, params.touches)
        if len(found):
            touches[name] = found
        else:
            idle += 1
            at_rest = _least_distance(model, X_PO, hand.rest_spheres[name])
            if len(hand.fingers) - idle < params.least_fingers or at_rest < params.palm_clearance:
                return None
    p_PG = X_PO[:, :3] @ model.center_of_mass + X_PO[:, 3]
    scoring = ScoreParams(
        friction=params.friction,
        normal_force=params.normal_force,
        least_force=params.least_force,
        most_force=params.most_force,
    )
    best = _combine(touches, p_PG, load_P, scoring, params, generator)
    if best is None:
        return None
    chosen, score = best
    left_out = [name for name in touches if name not in chosen]
    if any(_least_distance(model, X_PO, hand.rest_spheres[name]) < params.palm_clearance for name in left_out):
        return None
    fingers = {}
    for (name, i), force in zip(chosen.items(), score.force, strict=True):
        touch = touches[name]
        motion = ClosingMotion(touch.q_open[i], touch.q[i], touch.closing[i], float(force))
        fingers[name] = FingerPlan(motion, touch.p_PC[i], touch.n_PC[i])
    return GraspPlan(X_PO, fingers, score.value)


def _combine(
    touches: Mapping[str, Touches],
    p_PG: FloatArray,
    load_P: FloatArray,
    scoring: ScoreParams,
    params: PlannerParams,
    generator: np.random.Generator,
) -> tuple[dict[str, int], GraspScore] | None:
    """The best choice found of one touch a finger, by changing one finger at a time."""
    apart = {
        (a, b): _apart(touches[a], touches[b], params.finger_distance) for a, b in itertools.permutations(touches, 2)
    }

    def judge(chosen: Mapping[str, int]) -> GraspScore:
        rows = [(touches[name].p_PC[i], touches[name].n_PC[i], touches[name].cost[i]) for name, i in chosen.items()]
        p, n, cost = (np.array(column) for column in zip(*rows, strict=True))
        return score_grasp(p - p_PG, n, float(cost.sum()), load_P, scoring)

    names = list(touches)
    best: tuple[dict[str, int], GraspScore] | None = None
    for _ in range(params.restarts):
        chosen: dict[str, int] = {}
        for _ in range(params.rounds):
            for k in generator.permutation(len(names)):
                others = {name: i for name, i in chosen.items() if name != names[k]}
                free = np.ones(len(touches[names[k]]), dtype=bool)
                for name, i in others.items():
                    free &= apart[name, names[k]][i]
                options = [{**others, names[k]: int(i)} for i in np.flatnonzero(free)]
                if options:
                    chosen = max(options, key=lambda option: judge(option).value)
        if len(chosen) >= params.least_fingers:
            score = judge(chosen)
            if score.balanced and (best is None or score.value > best[1].value):
                best = chosen, score
    return best


def _apart(a: Touches, b: Touches, least: float) -> NDArray[np.bool_]:
    """Which touches of two fingers keep the fingers apart, shape (len(a), len(b))."""
    gap = np.linalg.norm(a.body_points[:, None, :, None] - b.body_points[None, :, None, :], axis=-1)
    return np.asarray(gap.min(axis=(2, 3)) > least)


def _least_distance(model: ObjectModel, X_PO: FloatArray, spheres: Spheres) -> float:
    centres, radius = spheres
    return float((model.grid.distance((centres - X_PO[:, 3]) @ X_PO[:, :3]) - radius).min())
