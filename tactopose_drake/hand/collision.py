"""Exact collision checks of an object's poses against a hand's collision geometry.

When Drake measures the distance between two shapes it replaces a mesh by its convex hull, which fills a mug. Here the
object's true mesh is used. The depth of a point in a convex shape is a concave function of the point, so over the whole
object it is largest either on the object's surface or at the shape's deepest point, if that is in the object. Together
the two give the depth for thin walls and solid bodies alike. Both use the mesh, not the model's distance grid.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from pydrake.geometry import Role
from pydrake.systems.framework import Context

from tactopose_drake.core.poses import compose, inverse
from tactopose_drake.core.shape import ConvexShape, ObjectModel, build_tree, join_shapes
from tactopose_drake.core.shape.convex_shape_kernels import find_deepest
from tactopose_drake.core.validation import FloatArray, finite_array
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.hand.geometry import BodySpheres
from tactopose_drake.hand.hand_config import HandConfig
from tactopose_drake.hand.hand_in_plant import make_hand_with_shapes
from tactopose_drake.hand.reading_ranges import ReadingRanges
from tactopose_drake.hand.shape_depth import convex_shape

_TOLERANCE = 2e-5  # m, by which depths may be too small


@dataclass(frozen=True, eq=False)
class Collisions:
    """Penetration of an object into a hand, for each of B poses.

    Attributes:
        depth: the largest depth of a point of the object below the surface of a shape of the hand, shape (B,), m; 0
            if they do not touch. It is at most the depth of the shape itself, half its thickness.
        link: the link of the hand with the deepest penetration, B of them; None if there is none.
    """

    depth: FloatArray
    link: tuple[str | None, ...]


class HandCollision:
    """Checks poses of an object against a hand at given joint positions.

    Depths may be too small by up to 0.02 mm. A mesh of the hand counts as its convex hull; planes are ignored.
    """

    def __init__(self, hand: HandConfig, model: ObjectModel) -> None:
        """Builds a plant of the hand.

        Raises:
            InvalidInputError: if the hand has no collision geometry.
        """
        self._plant, self._inspector, self._hand = make_hand_with_shapes(hand)
        self._ranges, inspector = ReadingRanges.of(self._plant), self._inspector
        shapes: list[ConvexShape] = []
        bodies, X_BG = [], []
        for index in self._plant.GetBodyIndices(self._hand.model_instance):
            for geometry in inspector.GetGeometries(self._plant.GetBodyFrameIdOrThrow(index), Role.kProximity):
                shape = convex_shape(inspector.GetShape(geometry))
                if shape is not None:
                    shapes.append(shape)
                    bodies.append(index)
                    X_BG.append(inspector.GetPoseInFrame(geometry).GetAsMatrix34())
        if not shapes:
            raise InvalidInputError(f"hand must have collision geometry, but {hand.model} has none.")
        self._links = [self._plant.get_body(index).name() for index in bodies]
        self._bodies, self._X_GB = list(map(int, bodies)), inverse(np.array(X_BG))
        palm = self._hand.palm_frame
        self._palm, self._X_BP = int(palm.body().index()), palm.GetFixedPoseInBodyFrame().GetAsMatrix34()
        self._shapes, self._tree = join_shapes(shapes), build_tree(model.vertices, model.faces)

    @cached_property
    def spheres(self) -> BodySpheres:
        """The result of `BodySpheres.of_hand`, without reading the hand's file again."""
        return BodySpheres.from_inspector(self._plant, self._inspector, self._hand.model_instance)

    @property
    def num_positions(self) -> int:
        """The number of the hand's joint positions."""
        return int(self._plant.num_positions(self._hand.model_instance))

    def knows_all(self, q: FloatArray) -> bool:
        """Whether all readings of the hand's joints, shape (nq,), are known: none is NaN or far beyond its limits."""
        every = np.zeros(self._plant.num_positions())
        self._plant.SetPositionsInArray(self._hand.model_instance, q, every)
        return bool(self._ranges.told(every).all())

    def make_scratch(self) -> Context:
        """Creates a scratch context for `check`; use it in one thread at a time."""
        return self._plant.CreateDefaultContext()

    def check(
        self, q: ArrayLike, X_PO: ArrayLike, *, enough: float = math.inf, scratch: Context | None = None
    ) -> Collisions:
        """Computes how deep the object penetrates the hand.

        Args:
            q: the hand's joint positions, in the order of a plant of the hand alone, shape (nq,), rad.
            X_PO: poses of the object, shape (B, 3, 4), m.
            enough: depth, m, beyond which only a lower bound above it is computed, which saves time.
            scratch: a context from `make_scratch`; None: a new one is created.

        Raises:
            InvalidInputError: if a number is not finite, or a shape is wrong.
        """
        q = finite_array("q", q, (self.num_positions,))
        X_PO = finite_array("X_PO", X_PO, (None, 3, 4))
        context = self.make_scratch() if scratch is None else scratch
        self._plant.SetPositions(context, self._hand.model_instance, q)
        X_WB = np.array([X.GetAsMatrix34() for X in self._plant.get_body_poses_output_port().Eval(context)])
        X_GW = compose(self._X_GB, inverse(X_WB[self._bodies]))
        X_GP = compose(X_GW, compose(X_WB[self._palm], self._X_BP))
        depth, deepest = np.empty(len(X_PO)), np.empty(len(X_PO), dtype=np.int64)
        X_GO = np.ascontiguousarray(compose(X_GP, X_PO[:, None]))
        find_deepest(self._tree, self._shapes, X_GO, _TOLERANCE, enough, depth, deepest)
        links = tuple(self._links[s] if d > 0.0 else None for s, d in zip(deepest, depth, strict=True))
        return Collisions(depth, links)


def check_collisions(hand: HandConfig, model: ObjectModel, q: ArrayLike, X_PO: ArrayLike) -> Collisions:
    """Builds a `HandCollision` and calls its `check` once; for repeated checks, keep a `HandCollision`."""
    return HandCollision(hand, model).check(q, X_PO)


def keep_clear(estimate: PoseEstimate, collisions: Collisions, tolerance: float) -> tuple[PoseEstimate, bool]:
    """Removes hypotheses that collide with the hand from an estimate.

    If every hypothesis that explains the touch collides, the hand's shape, its joints or the touch must be wrong; all
    are then kept, and the status is "ambiguous". An estimate with the status "no_solution" is returned unchanged.

    Args:
        estimate: the estimate whose poses were checked.
        collisions: the collisions of its hypotheses.
        tolerance: largest depth that does not count as a collision, m, for soft skin and errors of poses.

    Returns:
        The estimate, and whether it is free of collisions.
    """
    clear = [bool(depth <= tolerance) for depth in collisions.depth]
    if estimate.status == "no_solution":
        return estimate, all(clear)
    if any(is_clear and h.explains_touch for is_clear, h in zip(clear, estimate.hypotheses, strict=True)):
        return estimate if all(clear) else estimate.keep(clear), True
    return replace(estimate, status="ambiguous"), False
