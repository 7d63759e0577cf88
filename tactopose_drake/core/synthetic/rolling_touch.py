"""Fingertips that roll and slide on a moving object: simulated touch over time on the exact mesh, without a simulator.

A fingertip is a sphere whose centre stays one radius from the mesh. Where it rolls or sticks, the touching points have
the same velocity: an object of spatial velocity V and a fingertip with angular velocity w, whose centre is at r n from
the contact, give the centre v = V(p_C) + w x r n. Where it slides, the centre stays, except for keeping in touch. The
contact is the mesh's point nearest to the centre, and its normal points from there to the centre: at an edge, it is
between the faces' normals.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import numpy as np

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.poses import exp_so3, make_poses
from tactopose_drake.core.shape.distance_transform import pack_triangles
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.synthetic.rolling_kernels import nearest_points
from tactopose_drake.core.validation import FloatArray, positive_number


@dataclasses.dataclass(kw_only=True, slots=True)
class FingertipNoise:
    """Errors of a fingertip's measurements: standard deviations along or about each axis."""

    position: float = 0.00075  # of the contact's position, new at each time, m
    normal_deg: float = 4.3  # of its normal, new at each time, deg
    stable_position: float = 0.0005  # of the position, constant: the hand's calibration, m
    stable_normal_deg: float = 2.5  # of the normal, constant, deg
    velocity: float = 0.002  # of the fingertip's velocity at the contact, m/s
    angular_velocity: float = 0.02  # of its angular velocity, rad/s


class RollingTouch:
    """An object in the hand, and the fingertips on it.

    Attributes:
        X_PO: the object's true pose, shape (3, 4).
        p_PF: the fingertips' true centres in P, shape (k, 3), m.
        p_PC: the true contact points, shape (k, 3), m.
        n_PC: the outward normals there, shape (k, 3).
    """

    def __init__(
        self,
        model: ObjectModel,
        X_PO: FloatArray,
        p_OC: FloatArray,
        generator: np.random.Generator,
        noise: FingertipNoise | None = None,
        radius: float = 0.009,
    ) -> None:
        """Places the fingertips on the object, and draws their calibration errors.

        Args:
            model: the object.
            X_PO: its pose, shape (3, 4).
            p_OC: approximate contact points, shape (k, 3), m, in O.
            generator: of the random numbers.
            noise: of the measurements.
            radius: of a fingertip, m.
        """
        self._noise = FingertipNoise() if noise is None else noise
        self._generator, self._radius = generator, radius
        triangles = model.vertices[model.faces]
        self._packed = pack_triangles(triangles)
        self._middle = triangles.mean(axis=1)
        self._reach = np.linalg.norm(triangles - self._middle[:, None], axis=2).max(axis=1)
        self.X_PO = X_PO
        _, n_O = model.grid.distance_and_normal(p_OC)
        n_O = n_O / np.linalg.norm(n_O, axis=1, keepdims=True)
        self.p_PF = (p_OC + radius * n_O) @ X_PO[:, :3].T + X_PO[:, 3]
        self.sources = tuple(f"finger {i}" for i in range(len(p_OC)))
        stable = np.repeat([self._noise.stable_position, math.radians(self._noise.stable_normal_deg)], 3)
        self._bias = generator.normal(size=(len(p_OC), 6)) * stable
        self._tip_velocity = np.zeros((len(p_OC), 6))
        self._touch()

    def move(self, twist: FloatArray, tip_turn: FloatArray, slides: bool, duration: float) -> None:
        """Moves the object for a short time, and the fingertips with it.

        Args:
            twist: the object's spatial velocity [w, v] at P's origin, in P, rad/s and m/s.
            tip_turn: angular velocities of the fingertips, shape (k, 3), rad/s.
            slides: whether the object slides under the fingertips, which then stay, instead of rolling on it.
            duration: s.

        Raises:
            InvalidInputError: a duration that is not above 0.
        """
        duration, before = positive_number("duration", duration), self.p_PF
        if not slides:
            carried = np.cross(twist[:3], self.p_PC) + twist[3:]
            self.p_PF = before + duration * (carried + np.cross(tip_turn, self._radius * self.n_PC))
        R = exp_so3(duration * twist[:3])
        p = R @ self.X_PO[:, 3] + duration * twist[3:]
        self.X_PO = make_poses(R @ self.X_PO[:, :3], p)
        self._touch()
        velocity = (self.p_PF - before) / duration
        turn = np.zeros_like(velocity) if slides else tip_turn
        self._tip_velocity = np.concatenate([turn, velocity - np.cross(turn, before)], axis=1)

    def measure(self) -> tuple[Contacts, Mapping[str, FloatArray]]:
        """The contacts with their noise, and the fingertips' spatial velocities in P by source."""
        noise, count = self._noise, len(self.p_PC)
        p_PC = self.p_PC + self._bias[:, :3] + noise.position * self._generator.normal(size=(count, 3))
        turn = self._bias[:, 3:] + math.radians(noise.normal_deg) * self._generator.normal(size=(count, 3))
        n_PC = (exp_so3(turn) @ self.n_PC[..., None])[..., 0]
        contacts = Contacts(
            p_PC,
            n_PC / np.linalg.norm(n_PC, axis=1, keepdims=True),
            sigma_position=math.hypot(noise.position, noise.stable_position),
            sigma_normal=math.radians(math.hypot(noise.normal_deg, noise.stable_normal_deg)),
        )
        error = self._generator.normal(size=(count, 6)) * np.repeat([noise.angular_velocity, noise.velocity], 3)
        measured = self._tip_velocity + error
        # The error is that of the velocity at the contact; the velocity is given at P's origin.
        measured[:, 3:] -= np.cross(error[:, :3], self.p_PC)
        return contacts, dict(zip(self.sources, measured, strict=True))

    def _touch(self) -> None:
        """Finds the contact points, and moves the centres to one radius from there."""
        R, p = self.X_PO[:, :3], self.X_PO[:, 3]
        q = np.ascontiguousarray((self.p_PF - p) @ R)
        nearest = np.empty_like(q)
        nearest_points(self._packed, self._middle, self._reach, q, nearest)
        away = q - nearest
        n_O = away / np.linalg.norm(away, axis=1, keepdims=True)
        self.p_PC, self.n_PC = nearest @ R.T + p, n_O @ R.T
        self.p_PF = self.p_PC + self._radius * self.n_PC
