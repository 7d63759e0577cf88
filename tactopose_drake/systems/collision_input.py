"""The check of poses against the hand as it stands, for systems that are told its joints."""

import dataclasses

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, LeafSystem

from tactopose_drake.core.evidence.hand_geometry import HandGeometry
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.hand.collision import Collisions, HandCollision
from tactopose_drake.systems.collectable_system import declare_cache

_SIGMAS = 3.0  # of where the hand is, by which the object may be in it
_DEEP = 0.02  # m; how much deeper it is makes no difference


@dataclasses.dataclass(frozen=True, eq=False)
class PosedHandCollision:
    """The check at one time.

    Attributes:
        collision: of the hand and the object.
        q: the hand's joint positions, shape (nq,), rad.
        tolerance: the depth that is no collision yet, m.
        scratch: what the check works in; for one thread at a time.
    """

    collision: HandCollision
    q: FloatArray
    tolerance: float
    scratch: Context

    def check(self, X_PO: FloatArray) -> Collisions:
        """How deep the object reaches into the hand at poses (B, 3, 4); of what is deeper than allowed, that it is."""
        return self.collision.check(self.q, X_PO, enough=self.tolerance, scratch=self.scratch)

    def depth(self, X_PO: FloatArray) -> FloatArray:
        """How deep the object reaches into the hand at poses (B, 3, 4), shape (B,), m; at least, where that is deep."""
        return self.collision.check(self.q, X_PO, enough=_DEEP, scratch=self.scratch).depth


class CollisionInput:
    """The input port `joint_positions` of a system that checks poses against the hand."""

    def __init__(self, system: LeafSystem, collision: HandCollision, least_tolerance: float) -> None:
        """Declares the port, and a cache entry for what the check works in.

        Args:
            system: the one that checks.
            collision: of the hand and the object.
            least_tolerance: depth that is no collision yet, m; three sigma of where the hand is, if that is more.
        """
        self._collision, self._least_tolerance = collision, least_tolerance
        self._positions = system.DeclareVectorInputPort("joint_positions", collision.num_positions)
        self._scratch = declare_cache(
            system,
            "scratch of the collision check",
            lambda: AbstractValue.Make(collision.make_scratch()),
            lambda context, value: None,
            {system.nothing_ticket()},
        )

    def posed(self, context: Context, hand: HandGeometry | None) -> PosedHandCollision | None:
        """The check now; None where a joint position is not known.

        Args:
            context: the system's.
            hand: the hand's volume, which says how far it may be off; None where that is not known.
        """
        if not self._positions.HasValue(context):
            return None
        q: FloatArray = np.array(self._positions.Eval(context))
        if not np.all(np.isfinite(q)):
            return None
        tolerance = max(self._least_tolerance, 0.0 if hand is None else _SIGMAS * hand.sigma)
        return PosedHandCollision(self._collision, q, tolerance, self._scratch.Eval(context))
