"""A touch of the table by what a hand holds, and where the table is in the palm once the fingers have moved on."""

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
        plane: as it was then.
        contacts: of the fingertips on the object.
        fingers: their names, in the order of the contacts.
        X_PS: poses of the fingertips' sensors, by finger.
    """

    plane: PlaneContact
    contacts: Contacts
    fingers: tuple[str, ...]
    X_PS: Poses

    def as_of(self, X_PS: Poses, sigma_moved: float) -> PlaneContact:
        """The plane as the object has it that has moved with the fingertips to where they are now.

        A hand is compliant: its fingers sag this way or that as it leans, and what they hold goes with them.

        Args:
            X_PS: where the fingertips' sensors are now, by finger.
            sigma_moved: standard deviation of what else the object has moved by, along the plane's normal, m.
        """
        velocities = {finger: _twist(X_PS[finger] @ self.X_PS[finger].inverse()) for finger in self.fingers}
        moved = move_with_fingertips(self.contacts, self.fingers, velocities, MotionNoise(), 1.0, slips=False).pose
        p_PQ = moved[:, :3] @ self.plane.p_PQ + moved[:, 3]
        return PlaneContact(p_PQ, moved[:, :3] @ self.plane.n_P, math.hypot(self.plane.sigma, sigma_moved))


def touched_planes(touches: Sequence[TableTouch], X_PS: Poses, sigma_moved: float) -> tuple[PlaneContact, ...]:
    """The planes that an object has touched, one after the other, as it has them now.

    Args:
        touches: in their order.
        X_PS: where the fingertips' sensors are now, by finger.
        sigma_moved: standard deviation of what a touch moves the object by in the hand beyond the fingertips' motion,
            m. What turns it once turns it the same way at the next touch: it grows with how many touches came after,
            rather than with the root of that.
    """
    later = range(len(touches) - 1, -1, -1)
    return tuple(touch.as_of(X_PS, sigma_moved * count) for touch, count in zip(touches, later, strict=True))


def force_on_hand(contacts: Contacts, n_P: np.ndarray) -> float:
    """Force of the held object on the hand along a direction (3,), N: along the table's normal, what that presses with.

    While nothing but the hand touches the object, it is less by its weight.
    """
    return 0.0 if contacts.f_PC is None else float(np.sum(contacts.f_PC @ n_P))


def _twist(X: RigidTransform) -> np.ndarray:
    """The small motion [w, v] that a pose is, within a second."""
    matrix = X.GetAsMatrix34()
    return np.concatenate([log_so3(matrix[:, :3]), matrix[:, 3]])
