"""Touches of the table by a held object, and the table's plane in the palm after the fingers have moved."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.math import RigidTransform

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.plane_contact import PlaneContact
from tactopose_drake.core.motion.object_motion import MotionNoise, move_with_fingertips
from tactopose_drake.core.poses import log_so3

Poses = Mapping[str, RigidTransform]


@dataclass(frozen=True, eq=False)
class TableTouch:
    """The table in the palm when the held object touched it.

    Attributes:
        plane: the table's plane at that time.
        contacts: contacts of the fingertips on the object.
        fingers: names of the fingers, in the order of the contacts.
        X_PS: poses of the fingertips' sensors, by finger.
    """

    plane: PlaneContact
    contacts: Contacts
    fingers: tuple[str, ...]
    X_PS: Poses

    def as_of(self, X_PS: Poses, sigma_moved: float) -> PlaneContact:
        """The plane, moved with the object as the fingertips have moved since.

        A hand is compliant: its fingers sag in different directions as it leans, and the held object moves with them.

        Args:
            X_PS: current poses of the fingertips' sensors, by finger.
            sigma_moved: standard deviation of the object's further motion along the plane's normal, m.
        """
        velocities = {finger: _twist(X_PS[finger] @ self.X_PS[finger].inverse()) for finger in self.fingers}
        moved = move_with_fingertips(self.contacts, self.fingers, velocities, MotionNoise(), 1.0, slips=False).pose
        p_PQ = moved[:, :3] @ self.plane.p_PQ + moved[:, 3]
        return PlaneContact(p_PQ, moved[:, :3] @ self.plane.n_P, math.hypot(self.plane.sigma, sigma_moved))


def touched_planes(touches: Sequence[TableTouch], X_PS: Poses, sigma_moved: float) -> tuple[PlaneContact, ...]:
    """The planes that an object has touched so far, moved with the object.

    Args:
        touches: the touches in their order.
        X_PS: current poses of the fingertips' sensors, by finger.
        sigma_moved: standard deviation of the object's motion in the hand by each touch, beyond the fingertips'
            motion, m. Successive touches move it in the same direction, so that it grows in proportion to the number
            of later touches rather than to its square root.
    """
    later = range(len(touches) - 1, -1, -1)
    return tuple(touch.as_of(X_PS, sigma_moved * count) for touch, count in zip(touches, later, strict=True))


def forces_on_hand(contacts: Contacts, fingers: Sequence[str], n_P: np.ndarray) -> dict[str, float]:
    """Force of the held object on each finger along a direction (3,), N, by finger; empty without forces.

    Along the table's normal, they sum to the table's force minus the object's weight.
    """
    return {} if contacts.f_PC is None else dict(zip(fingers, map(float, contacts.f_PC @ n_P), strict=True))


def rise_of_force(before: Mapping[str, float], now: Mapping[str, float]) -> float:
    """By how much the forces on the fingers that are felt both times have risen in all, N.

    What a finger carried whose sensor has failed since is no force of a table.
    """
    return sum(force - before[finger] for finger, force in now.items() if finger in before)


def _twist(X: RigidTransform) -> np.ndarray:
    """The twist [w, v] that produces a small motion within a second."""
    matrix = X.GetAsMatrix34()
    return np.concatenate([log_so3(matrix[:, :3]), matrix[:, 3]])
