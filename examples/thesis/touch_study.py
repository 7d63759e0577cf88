"""Exploration until the pose is unique: ambiguous grasps, and fingers that touch the object again.

A grasp of three or four planned fingertips is felt with noise, and the pose is estimated from it and a prior with the
errors of a camera. The grasp counts as ambiguous if the touch determines every likely pose, but at most 80 % of the
belief is within 10 mm and 15 degrees of one pose and its symmetry images. Then one finger after the other moves until
it touches the object: a finger that does not hold the object, or one that may let go because the others keep force
closure. Its contact, or the free space that it moved through, is added to the evidence, and the pose is estimated
again, until 95 % of the belief is within the tolerance. A single hypothesis whose covariance is wider than the
tolerance does not count as one pose.

The finger and its motion are chosen by the expected information, or at random among the same allowed motions. The
object is assumed to rest in the hand meanwhile, and collisions between fingers are ignored.

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016, section 6.3.
"""

import dataclasses
import functools
import itertools
from collections.abc import Callable, Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

import tactopose_drake as tp
from tactopose_drake.core.exploration import (
    GuardedMoves,
    Hold,
    Tolerance,
    choose_by_chance,
    choose_touch,
    merged_modes,
    nearest_twins,
    resolved_share,
)
from tactopose_drake.core.grasping import GraspPlan, HandReach, PlannerParams, ReachParams, plan_grasps
from tactopose_drake.core.poses import exp_so3, inverse, retract, transform_points
from tactopose_drake.core.posterior import GaussianMixture
from tactopose_drake.hand import load_hand_config, make_hand_reach, rest_positions
from tactopose_drake.resources import model_path

Array = NDArray[np.float64]

OBJECTS = ("bust", "screwdriver", "spray_bottle")
# Tries of one planned grasp, with other fingers and other noise, until one is ambiguous.
FEELS = 8
FRICTION = 0.8
SIGMA_POSITION, SIGMA_NORMAL = 0.0009, np.radians(5.0)
GUESS_TRANSLATION, GUESS_ROTATION = 0.033, np.radians(16.0)  # standard deviations along and about each axis
MOVES = 200  # number of motions of each finger
PLACES = 40  # number of places along each motion
AMBIGUOUS, UNIQUE = 0.8, 0.95
MOST_TOUCHES = 60
# Modes of less probability are left out of the expected information.
LEAST_PROBABILITY = 0.01
TOLERANCE = Tolerance(translation=0.010, rotation=np.radians(15.0))


@dataclasses.dataclass(frozen=True, eq=False)
class Grasp:
    """A grasp with its measured contacts.

    Attributes:
        model: the object.
        X_PO: its true pose, shape (3, 4).
        contacts: the measured contacts.
        fingers: names of the fingers that touch.
        start: joint positions from which each finger of the hand starts to move: lifted off, or at rest, rad.
        hand: the volume of the palm and of the fingers that hold.
        resting: spheres (n, 4) that fill the other fingers, which touch nothing; centres and radii, m.
        prior: the prior of the pose.
    """

    model: tp.ObjectModel
    X_PO: Array
    contacts: tp.Contacts
    fingers: tuple[str, ...]
    start: Mapping[str, Array]
    hand: tp.HandGeometry
    resting: Array
    prior: tp.PosePrior


@dataclasses.dataclass(frozen=True, eq=False)
class Exploration:
    """The result of one exploration.

    Attributes:
        touches: number of touches; None if the pose was not unique after the maximum number.
        right: whether the final pose is the true one.
        share: share of the belief about one pose, before and after each touch.
    """

    touches: int | None
    right: bool
    share: tuple[float, ...]


@functools.cache
def hand_reach() -> HandReach:
    """The reach of the five-fingered hand."""
    return make_hand_reach(load_hand_config("shadow_like"), ReachParams())


def ambiguous_grasps(name: str, first_seed: int = 0) -> Iterator[tuple[Grasp, tp.PoseEstimate]]:
    """Ambiguous grasps of an object, at most one a plan, and the estimates from them, seed by seed."""
    model = tp.ObjectModel.from_mesh(model_path("objects", f"{name}.obj"))
    for seed in itertools.count(first_seed):
        generator = np.random.default_rng((seed, 7))
        params = PlannerParams(grasps=1, most_poses=60)
        for plan in plan_grasps(model, hand_reach(), np.array([0.0, 0.0, -2.0]), params, generator):
            for _ in range(FEELS):
                grasp = feel(model, plan, generator)
                if grasp is None:
                    continue
                estimate = estimate_again(grasp, grasp.contacts, grasp.resting)
                if is_ambiguous(model, estimate):
                    yield grasp, estimate
                    break


def is_ambiguous(model: tp.ObjectModel, estimate: tp.PoseEstimate) -> bool:
    """Whether several poses are left, each of them determined."""
    determined = all(len(h.free_directions) == 0 for h in estimate.hypotheses if h.probability > LEAST_PROBABILITY)
    return estimate.status != "no_solution" and determined and share_of(model, estimate) < AMBIGUOUS


def feel(model: tp.ObjectModel, plan: GraspPlan, generator: np.random.Generator) -> Grasp | None:
    """Three or four of the plan's fingers, the thumb among them, with measured contacts.

    None if they do not hold the object, or another finger at rest would penetrate it.
    """
    names = [name for name in plan.fingers if name != "thumb"]
    if "thumb" not in plan.fingers or len(names) < 2:
        return None
    count = min(int(generator.integers(2, 4)), len(names))
    fingers = ("thumb", *generator.permutation(names)[:count])
    touches = [plan.fingers[name] for name in fingers]
    p_PC = np.array([touch.p_PC for touch in touches])
    if not tp.grasp_quality(model, tp.Contacts(p_PC), plan.X_PO, friction=FRICTION).force_closure:
        return None
    contacts = measure(p_PC, np.array([touch.n_PC for touch in touches]), generator)
    reach = hand_reach()
    config = load_hand_config("shadow_like")
    start = {
        name: plan.fingers[name].motion.q_open if name in fingers else rest_positions(config, name)
        for name in reach.fingers
    }
    resting = np.concatenate(
        [np.zeros((0, 4)), *(spheres_of(name, start[name]) for name in start if name not in fingers)]
    )
    p_OH = transform_points(inverse(plan.X_PO), resting[:, :3])
    if (model.grid.distance(p_OH) < resting[:, 3]).any():
        return None
    held_by = [spheres_of(name, plan.fingers[name].motion.q_touch) for name in fingers]
    hand = np.concatenate([np.column_stack(reach.palm_spheres), *held_by])
    off = generator.normal(size=6) * np.repeat([GUESS_ROTATION, GUESS_TRANSLATION], 3)
    prior = tp.PosePrior(retract(plan.X_PO, off), GUESS_TRANSLATION, GUESS_ROTATION)
    return Grasp(model, plan.X_PO, contacts, fingers, start, tp.HandGeometry(hand[:, :3], hand[:, 3]), resting, prior)


def spheres_of(finger: str, q: Array) -> Array:
    """Spheres (n, 4) that fill a finger at joint positions q, rad: centres and radii, m."""
    geometry = hand_reach().fingers[finger].geometry
    return np.column_stack([geometry.spheres(q[None])[0], geometry.radius])


def measure(p_PC: Array, n_PC: Array, generator: np.random.Generator) -> tp.Contacts:
    """The contacts with noise."""
    turn = exp_so3(SIGMA_NORMAL * generator.normal(size=n_PC.shape))
    p_measured = p_PC + SIGMA_POSITION * generator.normal(size=p_PC.shape)
    return tp.Contacts(p_measured, np.einsum("kij,kj->ki", turn, n_PC))


def estimate_again(grasp: Grasp, contacts: tp.Contacts, free: Array) -> tp.PoseEstimate:
    """The pose estimated from all contacts, and from the spheres (n, 4) that felt nothing."""
    return tp.estimate_pose(grasp.model, contacts, prior=grasp.prior, hand=grasp.hand, untouched=felt_nothing(free))


def felt_nothing(free: Array) -> tp.HandGeometry | None:
    """Spheres (n, 4) in which the object is not; None if there are none."""
    return tp.HandGeometry(free[:, :3], free[:, 3]) if len(free) else None


def same_pose(model: tp.ObjectModel, X_PO: Array, X_reference: Array) -> NDArray[np.bool_]:
    """Which poses (n, 3, 4) are equal to another one (3, 4) within the tolerance, up to the object's symmetries."""
    return nearest_twins(model, X_PO, X_reference, TOLERANCE).same


def share_of(model: tp.ObjectModel, estimate: tp.PoseEstimate) -> float:
    """The share of the belief within the tolerance of one pose."""
    return resolved_share(model, estimate.modes, TOLERANCE)


def sample_moves(grasp: Grasp, generator: np.random.Generator) -> dict[str, GuardedMoves]:
    """Motions of each finger from its start to random goals within its joints' limits."""
    moves = {}
    for name, finger in hand_reach().fingers.items():
        chain = finger.geometry.chain
        q_goal = generator.uniform(chain.lower, chain.upper, (MOVES, len(chain.lower)))
        moves[name] = GuardedMoves.of_finger(finger.geometry, grasp.start[name], q_goal, PLACES)
    return moves


Choice = tuple[str, int]
Chooser = Callable[[Grasp, GaussianMixture, dict[str, GuardedMoves], np.random.Generator], Choice | None]


def choose_best(
    grasp: Grasp, belief: GaussianMixture, moves: dict[str, GuardedMoves], generator: np.random.Generator
) -> Choice | None:
    """Chooses by the expected information."""
    found = choose_touch(grasp.model, Hold(grasp.contacts, grasp.fingers, FRICTION), belief, moves)
    return None if found is None else (found.finger, found.move)


def choose_at_random(
    grasp: Grasp, belief: GaussianMixture, moves: dict[str, GuardedMoves], generator: np.random.Generator
) -> Choice | None:
    """Chooses one of the allowed motions that touch the object at the most probable pose."""
    hold = Hold(grasp.contacts, grasp.fingers, FRICTION)
    found = choose_by_chance(grasp.model, hold, belief, moves, generator)
    return None if found is None else (found.finger, found.move)


CHOOSERS: dict[str, Chooser] = {"by information": choose_best, "at random": choose_at_random}


def explore(grasp: Grasp, estimate: tp.PoseEstimate, chooser: Chooser, seed: int) -> Exploration:
    """Touches until the pose is unique. Motions and noise depend on the seed alone, not on the chooser."""
    generator, noise = np.random.default_rng((seed, 1)), np.random.default_rng((seed, 2))
    choice_generator = np.random.default_rng((seed, 3))
    contacts, free = grasp.contacts, grasp.resting
    shares = [share_of(grasp.model, estimate)]
    touches = 0
    while shares[-1] < UNIQUE and touches < MOST_TOUCHES:
        moves = sample_moves(grasp, generator)
        choice = chooser(grasp, estimate.modes, moves, choice_generator)
        touches += 1
        if choice is not None:
            contacts, free = touch(grasp, moves[choice[0]].take(np.array([choice[1]])), contacts, free, noise)
            estimate = estimate_again(grasp, contacts, free)
        shares.append(share_of(grasp.model, estimate))
    best = merged_modes(grasp.model, estimate.modes, TOLERANCE).X_PO[:1]
    is_right = same_pose(grasp.model, best, grasp.X_PO)[0]
    return Exploration(touches if shares[-1] >= UNIQUE else None, bool(is_right), tuple(shares))


def touch(
    grasp: Grasp, move: GuardedMoves, contacts: tp.Contacts, free: Array, noise: np.random.Generator
) -> tuple[tp.Contacts, Array]:
    """Makes a motion; returns the contacts with a new one, or the free spheres (n, 4) with those that it passed."""
    felt = move.feel(grasp.model, grasp.X_PO[None])
    if not felt.is_hit[0, 0]:
        swept = move.tip[0, ::3]
        return contacts, np.concatenate([free, np.column_stack([swept, np.full(len(swept), move.radius)])])
    new = measure(felt.p_PC[0], felt.n_PC[0], noise)
    assert contacts.n_PC is not None
    assert new.n_PC is not None
    joined = tp.Contacts(np.concatenate([contacts.p_PC, new.p_PC]), np.concatenate([contacts.n_PC, new.n_PC]))
    return joined, free
