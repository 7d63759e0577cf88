"""The prediction step: how an object moves in the hand, and what that makes of what is believed.

Where a fingertip rolls on the object or sticks to it, the points of both that touch have the same velocity: three rows
of the grasp matrix [P08] for each contact. A fingertip has some area, by which it also resists to spin about the
normal: a fourth row. A fingertip that slides says only that it does not leave the surface. What the rows leave open,
and their error, is a random walk.

A pose of vision comes late, as an out-of-sequence measurement. Its time's belief is gone, but how the object moved
since then is known from the fingertips, alike for every mode: by that motion the pose is predicted to now, and what is
unknown of the motion is added to its covariance. What the touch has told of the motion meanwhile is not counted; it is
little beside the error of vision. This costs one step, where a replay of all touch since then would cost as many
updates as vision is late.

Source: [P08] D. Prattichizzo and J. Trinkle, Grasping, in Springer Handbook of Robotics, 2008, section 28.2 (grasp
matrix; hard and soft finger contacts).
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping, Sequence

import numpy as np

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.kernels import prediction_kernels
from tactopose_drake.core.kernels.matrix_kernels import inverses
from tactopose_drake.core.kernels.pose_kernels import retract
from tactopose_drake.core.plain_values import copied
from tactopose_drake.core.poses import RANDOM_ROTATION_VARIANCE, compose, inverse, log_so3, skew
from tactopose_drake.core.tracking.frame import PoseMeasurement
from tactopose_drake.core.tracking.tracked_modes import TrackedModes
from tactopose_drake.core.tracking.tracker_params import MotionNoise
from tactopose_drake.core.validation import FloatArray

_ORIGIN = np.eye(3, 4)[None]


@dataclasses.dataclass(frozen=True, eq=False)
class Motion:
    """A small rigid motion of the object in P, a rotation about the origin of P and then a translation.

    Attributes:
        twist: [rotation vector, translation], shape (6,), rad and m.
        covariance: of the twist, shape (6, 6).
    """

    twist: FloatArray
    covariance: FloatArray

    @functools.cached_property
    def pose(self) -> FloatArray:
        """The motion as a pose that acts from the left, X_PO_after = pose X_PO_before, shape (3, 4)."""
        pose = np.empty((3, 4))
        retract(_ORIGIN, self.twist[None], pose[None])
        return pose

    @functools.cached_property
    def adjoint(self) -> FloatArray:
        """What the motion makes of a small twist before it, shape (6, 6)."""
        pose = self.pose
        adjoint = np.zeros((6, 6))
        adjoint[:3, :3] = adjoint[3:, 3:] = pose[:, :3]
        adjoint[3:, :3] = skew(pose[:, 3]) @ pose[:, :3]
        return adjoint

    @functools.cached_property
    def increment_map(self) -> FloatArray:
        """What the motion makes of the increments (w, v) from a pose, shape (6, 6): w stays, v turns with it."""
        turn = np.eye(6)
        turn[3:, 3:] = self.pose[:, :3]
        return turn

    def of_poses(self, X_PO: FloatArray) -> FloatArray:
        """What the motion makes of poses (..., 3, 4)."""
        moved: FloatArray = self.pose[:, :3] @ X_PO
        moved[..., 3] += self.pose[:, 3]
        return moved


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
    return Motion(np.zeros(6), np.diag(_three_each(rotation**2, translation**2)) * duration)


def move_freely(
    noise: MotionNoise,
    duration: float,
    max_sigma_translation: float,
    X_WP_before: FloatArray | None = None,
    X_WP: FloatArray | None = None,
) -> Motion:
    """The motion of an object that nothing holds: it rests in the world, about, while the palm moves.

    However long that is, the random walk ends where nothing is known of the pose any more.

    Args:
        noise: the random walks.
        duration: s.
        max_sigma_translation: of a translation with this standard deviation nothing is known, m.
        X_WP_before: the palm's pose before, shape (3, 4); None where it is not known.
        X_WP: that after, shape (3, 4); likewise.
    """
    twist = np.zeros(6)
    if X_WP_before is not None and X_WP is not None:
        X_PP = compose(inverse(X_WP), X_WP_before)
        twist = np.concatenate([log_so3(X_PP[:, :3]), X_PP[:, 3]])
    free = _three_each(noise.free_rotation**2, noise.free_translation**2)
    variances = np.minimum(free * duration, _three_each(RANDOM_ROTATION_VARIANCE, max_sigma_translation**2))
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
    """The motion of least squares by the contacts' velocities; contacts of unknown velocity say nothing.

    What their velocities leave open is known from their speed. An object that resting fingertips have held for a while
    rests, or it would have fallen: its random walk is that of `move_with_palm`. The faster they move, the more it is
    that of an object that nothing holds.

    Args:
        contacts: where the fingertips touch, in P.
        sources: the name of each contact's fingertip.
        tip_velocity: spatial velocities [w, v] of the fingertips at the origin of P, by name, rad/s and m/s.
        noise: the random walks.
        duration: s; small, so that the contacts stay about where they are.
        slips: whether the object has been found to slip: then no fingertip holds it by friction.
        settled: whether the same fingertips have touched for a while.
    """
    known = [row for row, source in enumerate(sources) if source in tip_velocity]
    velocity = np.array([tip_velocity[sources[row]] for row in known]).reshape(-1, 6)
    of_rows = np.empty((len(known), 3))
    of_rows[:, 0] = across = _tangential_noise(contacts, known, noise, slips)
    # Along the normal they stay together, whether they slide or not.
    of_rows[:, 1], of_rows[:, 2] = noise.rolling, across * (noise.twisting / noise.rolling)
    n_PC = np.zeros((len(known), 3)) if contacts.n_PC is None else contacts.n_PC[known]
    held = settled and not slips and len(known) > 1  # One fingertip may touch what lies on a table.
    freedom = _freedom(noise, contacts.p_PC[known], velocity) if held else 1.0
    rotation = noise.palm_rotation + freedom * (noise.free_rotation - noise.palm_rotation)
    translation = noise.palm_translation + freedom * (noise.free_translation - noise.palm_translation)
    information, right = np.diag(1.0 / _three_each(rotation**2, translation**2)), np.zeros(6)
    prediction_kernels.add_velocities(contacts.p_PC[known], n_PC, velocity, of_rows, information, right)
    covariance = inverses(information[None])[0][0]
    return Motion(covariance @ right * duration, covariance * duration)


def _freedom(noise: MotionNoise, p_PC: FloatArray, velocity: FloatArray) -> float:
    """How free an object is where fingertips at p_PC (k, 3) with velocities (k, 6) leave its motion open, in [0, 1]."""
    at_contacts = velocity[:, 3:] + np.cross(velocity[:, :3], p_PC)
    speed = math.sqrt(np.einsum("ki,ki->k", at_contacts, at_contacts).max())
    return min(1.0, speed / noise.still_speed)


def _tangential_noise(contacts: Contacts, known: list[int], noise: MotionNoise, slips: bool) -> FloatArray:
    """The random walk across the normal of the contacts that are known, by whether they roll or slide."""
    tangential = np.full(len(known), noise.rolling)
    if slips:
        # An object slips as a whole: the fingertips' errors are one, which more of them do not average out.
        tangential[:] = noise.slipping * math.sqrt(len(known))
    if noise.friction is not None and contacts.f_PC is not None and contacts.n_PC is not None:
        n_PC, f_PC = contacts.n_PC[known], contacts.f_PC[known]
        along = np.einsum("ki,ki->k", n_PC, f_PC)
        across = np.linalg.norm(f_PC - along[:, None] * n_PC, axis=1)
        slides = across > noise.friction_margin * noise.friction * along
        tangential[slides] = np.maximum(tangential[slides], noise.slipping)
    return tangential


def _three_each(rotation: float, translation: float) -> FloatArray:
    """Variances (6,) of the coordinates of an increment, by those of each of its rotations and translations."""
    return np.array([rotation, rotation, rotation, translation, translation, translation])


def predict_poses(X_PO: FloatArray, covariance: FloatArray, motion: Motion) -> tuple[FloatArray, FloatArray]:
    """Poses (n, 3, 4) and covariances (n, 6, 6) of their increments, after a motion.

    With X exp'd by the increment (w, v) and the motion (E, t) acting from the left, w stays and v becomes E v; a small
    twist (r, s) after it is the increment (R^T r, s + r x p).
    """
    return _carry(X_PO, covariance, np.empty((len(X_PO), 6, 0)), motion)[:2]


def error_of_motion(X_PO: FloatArray, motion: Motion) -> FloatArray:
    """What the error of a motion that ended at poses (n, 3, 4) makes of the increments' covariance, (n, 6, 6)."""
    return predict_poses(X_PO, np.zeros((len(X_PO), 6, 6)), Motion(np.zeros(6), motion.covariance))[1]


def _carry(
    X_PO: FloatArray, covariance: FloatArray, cross: FloatArray, motion: Motion
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Likewise, with covariances (n, 6, m) of the increments with what else there is."""
    X_after, before = motion.of_poses(X_PO), (np.ascontiguousarray(covariance), np.ascontiguousarray(cross))
    after = np.empty_like(before[0]), np.empty_like(before[1])
    prediction_kernels.carry(motion.increment_map, motion.covariance, X_after, *before, *after)
    return X_after, *after


def predict_modes(modes: TrackedModes, motion: Motion, max_sigma_translation: float) -> TrackedModes:
    """The modes after a motion of the object; what is no knowledge any more does not grow further.

    Args:
        modes: before.
        motion: of the object.
        max_sigma_translation: of a translation with this standard deviation nothing is known, m.
    """
    X_PO, covariance, cross = _carry(modes.X_PO, modes.covariance, modes.cross_covariance, motion)
    limits = _three_each(RANDOM_ROTATION_VARIANCE, max_sigma_translation**2)
    is_beyond = np.diagonal(covariance, axis1=1, axis2=2) > limits
    for b in np.flatnonzero(is_beyond.any(axis=1)) if is_beyond.any() else ():
        shrink = _shrink(covariance[b], limits)
        covariance[b], cross[b] = shrink @ covariance[b] @ shrink.T, shrink @ cross[b]
    most = motion.increment_map @ modes.most_information @ motion.increment_map.T  # The map is orthogonal.
    return copied(modes, X_PO=X_PO, covariance=covariance, cross_covariance=cross, most_information=most)


def _shrink(covariance: FloatArray, limits: FloatArray) -> FloatArray:
    """The map (6, 6) of increments after which no direction of rotation or of translation is above its limit."""
    shrink = np.eye(6)
    for part in (slice(0, 3), slice(3, 6)):
        values, vectors = np.linalg.eigh(covariance[part, part])
        scale = np.sqrt(np.minimum(1.0, limits[part] / np.maximum(values, 1e-300)))
        shrink[part, part] = vectors @ np.diag(scale) @ vectors.T
    return shrink


@dataclasses.dataclass(frozen=True, eq=False)
class MotionHistory:
    """The latest motions, oldest first; motion i went from times[i] to times[i + 1]."""

    times: tuple[float, ...]
    motions: tuple[Motion, ...] = ()

    def followed_by(self, motion: Motion, time: float, length: float) -> MotionHistory:
        """The history with the motion up to a time, s, without what ended more than a length, s, before that."""
        first = next((i for i, end in enumerate(self.times[1:]) if end >= time - length), len(self.motions))
        return MotionHistory((*self.times[first:], time), (*self.motions[first:], motion))

    def predict(self, measurement: PoseMeasurement) -> PoseMeasurement | None:
        """A late measurement as of the history's end; None where the history does not reach back to its time.

        Of the motion during which it was taken the later part counts.
        """
        if not self.times[0] <= measurement.time <= self.times[-1]:
            return None
        X_PO, covariance = measurement.X_PO, measurement.covariance
        for start, end, motion in zip(self.times, self.times[1:], self.motions, strict=False):
            if end > measurement.time:
                share = (end - max(start, measurement.time)) / (end - start)
                part = Motion(share * motion.twist, share * motion.covariance)
                X_PO, covariance = predict_poses(X_PO[None], covariance[None], part)
                X_PO, covariance = X_PO[0], covariance[0]
        return measurement.moved_to(self.times[-1], X_PO, covariance)
