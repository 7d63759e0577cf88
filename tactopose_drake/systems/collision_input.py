"""Collision checks of poses against the hand, for systems with an input of its joint positions."""

import dataclasses

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, LeafSystem

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.hand.collision import Collisions, HandCollision
from tactopose_drake.systems.collectable_system import declare_cache

_DEEP = 0.02  # m; deeper penetrations need not be told apart


@dataclasses.dataclass(frozen=True, eq=False)
class PosedHandCollision:
    """The collision check at one time.

    Attributes:
        collision: the collision checker of hand and object.
        q: the hand's joint positions, shape (nq,), rad.
        scratch: the checker's scratch context; for one thread at a time.
    """

    collision: HandCollision
    q: FloatArray
    scratch: Context

    def check(self, X_PO: FloatArray, enough: float) -> Collisions:
        """`HandCollision.check` of poses (B, 3, 4)."""
        return self.collision.check(self.q, X_PO, enough=enough, scratch=self.scratch)

    def depth(self, X_PO: FloatArray) -> FloatArray:
        """Penetration depth of the object into the hand at poses (B, 3, 4), shape (B,), m; a lower bound if deep."""
        return self.check(X_PO, _DEEP).depth


class CollisionInput:
    """The input port `joint_positions` of a system that checks poses against the hand."""

    def __init__(self, system: LeafSystem, collision: HandCollision) -> None:
        """Declares the port, and a cache entry for the scratch context."""
        self._collision = collision
        self._positions = system.DeclareVectorInputPort("joint_positions", collision.num_positions)
        self._scratch = declare_cache(
            system,
            "scratch of the collision check",
            lambda: AbstractValue.Make(collision.make_scratch()),
            lambda context, value: None,
            {system.nothing_ticket()},
        )

    def posed(self, context: Context) -> PosedHandCollision | None:
        """The check at the joint positions in the system's context; None if any of them is unknown."""
        if not self._positions.HasValue(context):
            return None
        q: FloatArray = np.array(self._positions.Eval(context))
        known = self._collision.knows_all(q)
        return PosedHandCollision(self._collision, q, self._scratch.Eval(context)) if known else None
