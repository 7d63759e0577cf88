"""The motion of an object in the hand: with the palm, with the fingertips, or freely.

Where a fingertip rolls on the object or sticks to it, the touching points of both have the same velocity: three rows of
the grasp matrix [P08] for each contact. A fingertip of some area also resists spin about the normal: a fourth row. A
sliding fingertip only stays on the surface. What the rows leave undetermined, and their error, is a random walk.

Source: [P08] D. Prattichizzo and J. Trinkle, Grasping, in Springer Handbook of Robotics, 2008, section 28.2 (grasp
matrix; hard and soft finger contacts).
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.kernels.matrix_kernels import inverses
from tactopose_drake.core.motion import prediction_kernels
from tactopose_drake.core.motion.rigid_motion import Motion, three_each
from tactopose_drake.core.poses import RANDOM_ROTATION_VARIANCE, compose, inverse, log_so3
from tactopose_drake.core.validation import FloatArray


@dataclasses.dataclass(kw_only=True, slots=True)
class MotionNoise:
    """Random walks: standard deviations after one second; they grow with the square root of time."""

    palm_translation: float = 0.002  # translation of an object that moves with the palm, m/s^0.5
    palm_rotation: float = 0.03  # rotation of an object that moves with the palm, rad/s^0.5
    rolling: float = 0.003  # displacement of the object's surface under a fingertip that holds it, m/s^0.5
    twisting: float = 0.2  # rotation of the object about the normal under a fingertip that holds it, rad/s^0.5
    slipping: float = 0.01  # displacement of the surface under a fingertip that slides, m/s^0.5
    free_translation: float = 0.03  # translation of an object in the directions in which nothing holds it, m/s^0.5
    free_rotation: float = 0.3  # rotation of an object in the directions in which nothing holds it, rad/s^0.5
    still_speed: float = 0.01  # speed of fingertips that hold an object, m/s: the slower, the more it rests in the palm
    longest_gap: float = 10.0  # time between frames after which the object is assumed not to have been held, s
    friction: float | None = None  # coefficient of friction above which a fingertip slides; None if unknown
    friction_margin: float = 0.9  # share of the friction cone within which it surely holds, as forces are noisy


def move_with_palm(noise: MotionNoise, duration: float, *, slips: bool) -> Motion:
    """The motion of an object held by still fingers, of which nothing else is known.

    Args:
        noise: the random walks.
        duration: s.
        slips: whether a slip has been detected.
    """
    translation, rotation = noise.palm_translation, noise.palm_rotation
    if slips:
        rotation *= noise.slipping / translation
        translation = noise.slipping
    return Motion(np.zeros(6), np.diag(three_each(rotation**2, translation**2)) * duration)


def move_freely(
    noise: MotionNoise,
    duration: float,
    max_sigma_translation: float,
    X_WP_before: FloatArray | None = None,
    X_WP: FloatArray | None = None,
) -> Motion:
    """The motion of an object that nothing holds: it rests in the world, roughly, while the palm moves.

    The random walk is bounded where nothing is known of the pose any more.

    Args:
        noise: the random walks.
        duration: s.
        max_sigma_translation: upper bound on the standard deviation of a translation, m.
        X_WP_before: the palm's pose before, shape (3, 4), or None if unknown.
        X_WP: the palm's pose after, shape (3, 4), or None if unknown.
    """
    twist = np.zeros(6)
    if X_WP_before is not None and X_WP is not None:
        X_PP = compose(inverse(X_WP), X_WP_before)
        twist = np.concatenate([log_so3(X_PP[:, :3]), X_PP[:, 3]])
    free = three_each(noise.free_rotation**2, noise.free_translation**2)
    variances = np.minimum(free * duration, three_each(RANDOM_ROTATION_VARIANCE, max_sigma_translation**2))
    return Motion(twist, np.diag(variances))


def move_with_fingertips(
    contacts: Contacts,
    sources: Sequence[str],
    tip_velocity: Mapping[str, FloatArray],
    noise: MotionNoise,
    duration: float,
    *,
    slips: bool,
    settled: bool = False,
) -> Motion:
    """The least-squares motion from the velocities at the contacts; contacts of unknown velocity do not count.

    What these velocities leave undetermined depends on their speed. An object that resting fingertips have held for a
    while rests, or it would have fallen: its random walk is that of `move_with_palm`. The faster they move, the closer
    it is to that of an object that nothing holds.

    Args:
        contacts: where the fingertips touch, in P.
        sources: the name of each contact's fingertip.
        tip_velocity: spatial velocities [w, v] of the fingertips at the origin of P, by name, rad/s and m/s.
        noise: the random walks.
        duration: s; short enough for the contacts to stay about where they are.
        slips: whether a slip has been detected: then no fingertip holds it by friction.
        settled: whether the same fingertips have touched for a while.
    """
    known = [row for row, source in enumerate(sources) if source in tip_velocity]
    velocity = np.array([tip_velocity[sources[row]] for row in known]).reshape(-1, 6)
    of_rows = np.empty((len(known), 3))
    of_rows[:, 0] = across = _tangential_noise(contacts, known, noise, slips)
    # Along the normal surfaces stay together, whether they slide or not.
    of_rows[:, 1], of_rows[:, 2] = noise.rolling, across * (noise.twisting / noise.rolling)
    held = settled and not slips and len(known) > 1  # A single fingertip may touch an object lying on a table.
    freedom = _freedom(noise, contacts.p_PC[known], velocity) if held else 1.0
    rotation = noise.palm_rotation + freedom * (noise.free_rotation - noise.palm_rotation)
    translation = noise.palm_translation + freedom * (noise.free_translation - noise.palm_translation)
    information, right = np.diag(1.0 / three_each(rotation**2, translation**2)), np.zeros(6)
    prediction_kernels.add_velocities(
        contacts.p_PC[known], contacts.normals_or_zeros[known], velocity, of_rows, information, right
    )
    covariance = inverses(information[None])[0][0]
    return Motion(covariance @ right * duration, covariance * duration)


def _freedom(noise: MotionNoise, p_PC: FloatArray, velocity: FloatArray) -> float:
    """Interpolates, in [0, 1], between a held and a free object by the speed of fingertips at p_PC (k, 3)."""
    at_contacts = velocity[:, 3:] + np.cross(velocity[:, :3], p_PC)
    speed = math.sqrt(np.einsum("ki,ki->k", at_contacts, at_contacts).max())
    return min(1.0, speed / noise.still_speed)


def _tangential_noise(contacts: Contacts, known: list[int], noise: MotionNoise, slips: bool) -> FloatArray:
    """Random walk across the normal of each known contact, which depends on whether it rolls or slides."""
    tangential = np.full(len(known), noise.rolling)
    if slips:
        # An object slips as a whole: the fingertips' errors are common, and more of them do not average out.
        tangential[:] = noise.slipping * math.sqrt(len(known))
    if noise.friction is not None and contacts.f_PC is not None and contacts.n_PC is not None:
        n_PC, f_PC = contacts.n_PC[known], contacts.f_PC[known]
        along = np.einsum("ki,ki->k", n_PC, f_PC)
        across = np.linalg.norm(f_PC - along[:, None] * n_PC, axis=1)
        slides = across > noise.friction_margin * noise.friction * along
        tangential[slides] = np.maximum(tangential[slides], noise.slipping)
    return tangential
