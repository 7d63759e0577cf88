"""Trials of section 4.3.1 of the thesis: simulated grasps with noise on the contacts, and the errors of estimates.

Noise: Gaussian, with one standard deviation along each axis of a contact point, and one of a small rotation of the
normal about each axis. "Random Gaussian noise [...] with means of 0.9 mm and 5 deg" could also be the mean magnitude of
the error. Ours is the harder interpretation: with a standard deviation of 0.9 mm along each axis, the mean distance is
1.4 mm, and with 5 deg about each axis, the mean angle is 6.3 deg.

Prior: for pose correction, a Gaussian displacement of the true pose whose mean distance and mean angle are those of the
thesis, 33.2 mm and 16 deg. The estimate is given its standard deviation along each axis, and those of the contacts.

Fingers: trials with fewer fingers leave out some of a grasp's five, chosen at random, but never the thumb, nor, on the
wine glass, the little finger, which was placed on the stem on purpose. A trial draws all its random numbers from its
own seed, independently of the fingers and the noise, so that the cells of a table differ in these alone.

Error: the distance between the origins of the object's frame, and the total angle, 2 acos(q_w); if the object is a
solid of revolution, the minimum of this angle over rotations about its axis ("the angle error discarded the error
around the vertical axis").

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016, section 4.3.1.
"""

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from grasp_library import FINGERS, Array, SimulatedGrasp

import tactopose_drake as tp
from tactopose_drake.core.poses import exp_so3, increments_between, retract
from tactopose_drake.core.shape import turn_toward

ALWAYS_TOUCHING = {"bust": ("thumb",), "wine_glass": ("thumb", "little")}
# Mean length of a vector of three normal random numbers of variance 1.
MEAN_LENGTH = math.sqrt(8.0 / math.pi)
GUESS_SIGMA_TRANSLATION = 0.0332 / MEAN_LENGTH  # m, along each axis
GUESS_SIGMA_ROTATION = math.radians(16.0) / MEAN_LENGTH
MOST_TRANSLATION, MOST_ROTATION = 0.01, math.radians(15.0)  # maximum errors of a success


class Noise(NamedTuple):
    """Standard deviations of contact points along each axis, m, and of normals about each axis, rad."""

    position: float
    normal: float

    def __str__(self) -> str:
        return f"{1e3 * self.position:.2g} mm, {math.degrees(self.normal):.2g}°"


@dataclasses.dataclass(frozen=True)
class Trial:
    """The possible inputs of an estimate, and the true pose.

    Attributes:
        contacts: the contacts with noise.
        prior: the displaced pose; None for global estimation.
        hand: the hand's volume.
        X_PO: the true pose, shape (3, 4).
    """

    contacts: tp.Contacts
    prior: tp.PosePrior | None
    hand: tp.HandGeometry
    X_PO: Array


class Errors(NamedTuple):
    """Distances, m, and angles, rad, of poses from the truth, shape (B,) each."""

    translation: Array
    rotation: Array

    @property
    def success(self) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        """Which poses are within 10 mm and 15 degrees, shape (B,)."""
        return (self.translation < MOST_TRANSLATION) & (self.rotation < MOST_ROTATION)


def make_trial(
    name: str, grasp: SimulatedGrasp, fingers: int, noise: Noise, seed: tuple[int, int], guess: bool
) -> Trial:
    """Makes one trial.

    Args:
        name: name of the object.
        grasp: grasp by all five fingers.
        fingers: number of fingers that touch.
        noise: noise of the contacts.
        seed: seed of all random numbers.
        guess: whether there is a displaced pose to correct.
    """
    generator = np.random.default_rng(seed)
    order = generator.permutation(len(FINGERS))
    unit = generator.normal(size=(2, len(FINGERS), 3))
    increment = generator.normal(size=6) * np.repeat([GUESS_SIGMA_ROTATION, GUESS_SIGMA_TRANSLATION], 3)
    kept = [finger for finger in order if FINGERS[finger] in ALWAYS_TOUCHING[name]]
    chosen = [*kept, *(finger for finger in order if finger not in kept)][:fingers]
    n_PC = np.einsum("kij,kj->ki", exp_so3(noise.normal * unit[1]), grasp.n_PC)
    contacts = tp.Contacts(
        (grasp.p_PC + noise.position * unit[0])[chosen],
        n_PC[chosen],
        sigma_position=noise.position,
        sigma_normal=noise.normal,
    )
    prior = tp.PosePrior(retract(grasp.X_PO, increment), GUESS_SIGMA_TRANSLATION, GUESS_SIGMA_ROTATION)
    return Trial(contacts, prior if guess else None, tp.HandGeometry(grasp.p_PH, grasp.radius), grasp.X_PO)


def pose_errors(model: tp.ObjectModel, X_PO: Array, X_PO_true: Array) -> Errors:
    """Errors of poses (B, 3, 4) from the true one (3, 4), without rotations about the axis of a solid of revolution."""
    increments = increments_between(X_PO_true, turn_toward(X_PO, X_PO_true, model.symmetries))
    return Errors(np.linalg.norm(increments[:, 3:], axis=1), np.linalg.norm(increments[:, :3], axis=1))
