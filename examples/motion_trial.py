"""Tracks the pose of one object that moves in the hand, and evaluates the belief at each instant.

The contacts are on the true mesh. The belief begins with a prior whose errors are drawn from its standard deviations;
it knows the standard deviations of the contacts' noise and of the fingertips' velocities. The hand's calibration may be
worse than the belief assumes, and one of the fingers may touch something else. A mode is right if the truth, or a
symmetry image of it, is in the ellipsoid with 99.9 % of its Gaussian.
"""

import dataclasses
import time

import numpy as np
from motion_families import FAMILIES, PERIOD
from nearest_images import least_error, nearest_increments
from numpy.typing import NDArray
from scipy.stats import chi2

import tactopose_drake as tp
from tactopose_drake.core.evidence import Evidence
from tactopose_drake.core.objectives import SurfaceContact
from tactopose_drake.core.poses import make_poses, random_rotations, retract
from tactopose_drake.core.posterior import free_directions
from tactopose_drake.core.synthetic import FingertipNoise, RollingTouch
from tactopose_drake.core.tracking import Frame, PoseBelief, PoseTracker

Array = NDArray[np.float64]
UNIQUE = 0.99
WRONG = 0.020, np.radians(20.0)  # m, rad


@dataclasses.dataclass(frozen=True)
class Instant:
    """The belief at one time, compared with the truth.

    Attributes:
        time: time, s.
        status: status of the belief.
        right: whether one of the modes is right.
        best_right: whether the best mode is right.
        unique: whether one mode has more than 99 % of the probability, and the status is not "lost".
        square: normalized estimation error squared of the best mode.
        translation, rotation: error of the best mode, m and rad.
        said_translation, said_rotation: root mean square errors by its covariance, m and rad.
        ok_but_wrong: whether the status is "ok" while the best mode is off by 20 mm or 20 degrees, apart from the
            directions that the touch leaves free.
        seconds: CPU time of the update.
        slides: whether the object truly slid.
    """

    time: float
    status: str
    right: bool
    best_right: bool
    unique: bool
    square: float
    translation: float
    rotation: float
    said_translation: float
    said_rotation: float
    ok_but_wrong: bool
    seconds: float
    slides: bool


def judge(
    model: tp.ObjectModel, belief: PoseBelief, contacts: tp.Contacts, X_true: Array, seconds: float, slides: bool
) -> Instant:
    """Compares a belief with the truth."""
    dimensions = 6 - sum(symmetry.is_continuous for symmetry in model.symmetries)
    right: list[bool] = []
    square, error, covariance = np.nan, np.full(6, np.nan), np.full((6, 6), np.nan)
    for b in range(len(belief.X_PO)):
        information = np.linalg.inv(belief.covariance[b])
        u = nearest_increments(model, belief.X_PO[b], information, X_true[None])[0]
        right.append(bool(u @ information @ u < chi2.ppf(0.999, dimensions)))
        if b == 0:
            square, covariance = u @ information @ u, belief.covariance[0]
            error = least_error(model, belief.X_PO[0], X_true)
    return Instant(
        belief.time,
        belief.status,
        any(right),
        bool(right and right[0]),
        bool(len(belief.X_PO) and belief.probability[0] > UNIQUE and belief.status != "lost"),
        float(square) * 6.0 / dimensions,
        float(np.linalg.norm(error[3:])),
        float(np.linalg.norm(error[:3])),
        float(np.sqrt(np.trace(covariance[3:, 3:]))),
        float(np.sqrt(np.trace(covariance[:3, :3]))),
        belief.status == "ok" and is_wrong(model, belief.X_PO[0], contacts, X_true),
        seconds,
        slides,
    )


def is_wrong(model: tp.ObjectModel, X_PO: Array, contacts: tp.Contacts, X_true: Array) -> bool:
    """Whether a pose is off by 20 mm or 20 degrees, apart from the directions that the touch leaves free."""
    hessian = SurfaceContact(model.grid, contacts).normal_equations(X_true[None]).hessian
    error = least_error(model, X_PO, X_true, free_directions(hessian, model.size)[0])
    return bool(np.linalg.norm(error[3:]) > WRONG[0] or np.linalg.norm(error[:3]) > WRONG[1])


class FalseFinger:
    """A finger whose contact is constantly wrong."""

    def __init__(self, seed: int, count: int, fault: str) -> None:
        """Draws the finger and its error.

        Args:
            seed: random seed.
            count: number of fingers.
            fault: "off" if its point is 10 to 30 mm off, "flipped" if its normal is flipped, or "none".
        """
        generator = np.random.default_rng([seed, 99])
        self._finger, way = int(generator.integers(count)), generator.normal(size=3)
        self._off = generator.uniform(0.010, 0.030) * way / np.linalg.norm(way)
        self._fault = fault

    def measured(self, contacts: tp.Contacts) -> tuple[Array, Array]:
        """The measured points and normals (k, 3), with the fault."""
        p_PC, n_PC = contacts.p_PC.copy(), contacts.n_PC.copy()
        if self._fault == "off":
            p_PC[self._finger] += self._off
        elif self._fault == "flipped":
            n_PC[self._finger] *= -1.0
        return p_PC, n_PC


def run_motion(family: str, seed: int, steps: int, calibration: float = 1.0, fault: str = "none") -> list[Instant]:
    """Moves one object, and tracks it.

    Args:
        family: family of motions.
        seed: random seed.
        steps: number of steps of 10 ms.
        calibration: ratio of the hand's constant errors to the assumed ones.
        fault: fault of one of the fingers, see `FalseFinger`.
    """
    generator = np.random.default_rng([sorted(FAMILIES).index(family), seed])
    model, p_OC, motion = FAMILIES[family](generator, steps)
    R_PO = random_rotations(generator, 1)[0]
    X_PO = make_poses(R_PO, 0.03 * generator.normal(size=3) - R_PO @ model.vertices.mean(axis=0))
    told = FingertipNoise()
    noise = dataclasses.replace(
        told,
        stable_position=calibration * told.stable_position,
        stable_normal_deg=calibration * told.stable_normal_deg,
    )
    touch = RollingTouch(model, X_PO, p_OC, generator, noise)
    guess = tp.PosePrior(X_PO)
    guess = tp.PosePrior(retract(X_PO, generator.normal(size=6) * guess.sigmas))
    tracker, false = PoseTracker(model), FalseFinger(seed, len(p_OC), fault)
    belief, instants = tracker.start(0.0), []
    for i, step in enumerate(motion(touch)):
        touch.move(step.twist, step.tip_turn, step.slides, PERIOD)
        measured, velocities = touch.measure()
        true, contacts = (
            tp.Contacts(
                *points_and_normals,
                sigma_position=np.hypot(told.position, told.stable_position),
                sigma_normal=np.radians(np.hypot(told.normal_deg, told.stable_normal_deg)),
            )
            for points_and_normals in ((measured.p_PC, measured.n_PC), false.measured(measured))
        )
        started = time.process_time()
        frame = Frame(PERIOD * (i + 1), Evidence(contacts, prior=guess), touch.sources, velocities)
        belief = tracker.step(belief, frame)
        instants.append(judge(model, belief, true, touch.X_PO, time.process_time() - started, step.slides))
    return instants
