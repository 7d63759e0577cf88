"""How an object moves in the hand, from how the fingertips that hold it move.

Where a fingertip rolls on the object or sticks to it, the points of both that touch have the same velocity: three rows
of the grasp matrix [P11] for each contact. A fingertip has some area, by which it also resists to spin about the
normal: a fourth row. A fingertip that slides says only that it does not leave the surface. What the rows leave open,
and their error, is a random walk.

Source: [P11] D. Prattichizzo and J. Trinkle, Grasping, in Springer Handbook of Robotics, 2008, section 28.2 (grasp
matrix; hard and soft finger contacts).
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.poses import compose, exp_so3, inverse, log_so3, skew
from tactopose_drake.core.validation import FloatArray, positive_number


class Motion(NamedTuple):
    """A small rigid motion of the object in P, a rotation about the origin of P and then a translation.

    Attributes:
        twist: [rotation vector, translation], shape (6,), rad and m.
        covariance: of the twist, shape (6, 6).
    """

    twist: FloatArray
    covariance: FloatArray

    @property
    def pose(self) -> FloatArray:
        """The motion as a pose that acts from the left, X_PO_after = pose X_PO_before, shape (3, 4)."""
        return np.column_stack([exp_so3(self.twist[:3]), self.twist[3:]])


@dataclasses.dataclass(kw_only=True, slots=True)
class MotionNoise:
    """Random walks: what is unknown of a motion after a second; of any time t it is the root of t times that."""

    palm_translation: float = 0.002  # of an object that moves with the palm, m/s^0.5
    palm_rotation: float = 0.03  # likewise, rad/s^0.5
    rolling: float = 0.003  # of the object's surface under a fingertip that holds it, m/s^0.5
    twisting: float = 0.2  # of its turn under the fingertip about the normal, rad/s^0.5
    slipping: float = 0.01  # of the surface under a fingertip that slides, m/s^0.5
    free_translation: float = 0.03  # of an object in the directions in which nothing holds it, m/s^0.5
    free_rotation: float = 0.3  # likewise, rad/s^0.5
    friction: float | None = None  # coefficient from which on a fingertip slides; None: it is not known

    def validate(self) -> None:
        """Raises InvalidInputError if a number is not positive."""
        for field in dataclasses.fields(self):
            if getattr(self, field.name) is not None:
                positive_number(f"MotionNoise.{field.name}", getattr(self, field.name))


def move_with_palm(noise: MotionNoise, duration: float, *, slips: bool) -> Motion:
    """The motion of an object that nothing is known to move, held by still fingers.

    Args:
        noise: the random walks.
        duration: s.
        slips: whether it has been found to slip.
    """
    translation, rotation = noise.palm_translation, noise.palm_rotation
    if slips:
        rotation *= noise.slipping / translation
        translation = noise.slipping
    return Motion(np.zeros(6), np.diag(np.repeat([rotation**2, translation**2], 3)) * duration)


def move_freely(
    noise: MotionNoise, duration: float, X_WP_before: FloatArray | None = None, X_WP: FloatArray | None = None
) -> Motion:
    """The motion of an object that nothing holds: it rests in the world, about, while the palm moves.

    Args:
        noise: the random walks.
        duration: s.
        X_WP_before: the palm's pose before, shape (3, 4); None where it is not known.
        X_WP: that after, shape (3, 4); likewise.
    """
    twist = np.zeros(6)
    if X_WP_before is not None and X_WP is not None:
        X_PP = compose(inverse(X_WP), X_WP_before)
        twist = np.concatenate([log_so3(X_PP[:, :3]), X_PP[:, 3]])
    return Motion(twist, np.diag(_free_variances(noise)) * duration)


def move_with_fingertips(
    contacts: Contacts,
    sources: Sequence[str],
    tip_velocity: Mapping[str, FloatArray],
    noise: MotionNoise,
    duration: float,
    *,
    slips: bool,
) -> Motion:
    """The motion of least squares by the contacts' velocities; contacts of unknown velocity say nothing.

    Args:
        contacts: where the fingertips touch, in P.
        sources: the name of each contact's fingertip.
        tip_velocity: spatial velocities [w, v] of the fingertips at the origin of P, by name, rad/s and m/s.
        noise: the random walks.
        duration: s; small, so that the contacts stay about where they are.
        slips: whether the object has been found to slip: then no fingertip holds it by friction.
    """
    known = np.array([source in tip_velocity for source in sources], dtype=np.bool_)
    velocity = np.array([tip_velocity[source] for source in sources if source in tip_velocity]).reshape(-1, 6)
    p_PC = contacts.p_PC[known]
    tangential = np.full(len(p_PC), noise.rolling)
    if slips:
        # An object slips as a whole: the fingertips' errors are one, which more of them do not average out.
        tangential[:] = noise.slipping * math.sqrt(len(p_PC))
    turning = np.full(len(p_PC), noise.twisting)
    if noise.friction is not None and contacts.f_PC is not None and contacts.n_PC is not None:
        tangential[_slides(contacts.n_PC[known], contacts.f_PC[known], noise.friction)] = noise.slipping
    turning *= tangential / noise.rolling

    arms = np.concatenate([-skew(p_PC), np.tile(np.eye(3), (len(p_PC), 1, 1))], axis=2)
    weight = 1.0 / tangential[:, None, None] ** 2 * np.eye(3)
    rows = [np.zeros((0, 6))]
    if contacts.n_PC is not None:
        # Along the normal they stay together, whether they slide or not.
        n_PC = contacts.n_PC[known]
        weight = weight + (noise.rolling**-2 - tangential**-2)[:, None, None] * n_PC[:, :, None] * n_PC[:, None, :]
        rows.append(np.concatenate([n_PC, np.zeros_like(n_PC)], axis=1) / turning[:, None])
    spin = np.concatenate(rows)
    wanted = np.einsum("kij,kj->ki", arms, velocity)
    information = np.einsum("kia,kij,kjb->ab", arms, weight, arms) + spin.T @ spin
    information[np.diag_indices(6)] += 1.0 / _free_variances(noise)
    right = np.einsum("kia,kij,kj->a", arms, weight, wanted)
    if len(spin):
        right = right + spin.T @ np.einsum("ka,ka->k", spin, velocity)
    covariance = np.linalg.inv(information)
    return Motion(covariance @ right * duration, 0.5 * (covariance + covariance.T) * duration)


def _slides(n_PC: FloatArray, f_PC: FloatArray, friction: float) -> FloatArray:
    """Which forces f_PC (k, 3) leave the friction cone about n_PC (k, 3), or are hardly within it."""
    along = np.einsum("ki,ki->k", n_PC, f_PC)
    across = np.linalg.norm(f_PC - along[:, None] * n_PC, axis=1)
    slides: FloatArray = across > 0.9 * friction * along
    return slides


def _free_variances(noise: MotionNoise) -> FloatArray:
    return np.repeat([noise.free_rotation**2, noise.free_translation**2], 3)
