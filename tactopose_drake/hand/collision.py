"""The exact check of an object's poses against a hand's collision geometry.

Drake takes the convex hull of a mesh wherever it measures the distance between two shapes, and so fills a mug. Here the
object's mesh is taken as it is. How deep a point lies in a convex shape is a concave function of the point, so over the
whole object it is greatest either on its surface or at the shape's own deepest point, if that one is in the object. The
two together give the depth for thin walls and for solid bodies alike; both are of the mesh, not of the model's grid.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from pydrake.geometry import Role
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import Context

from tactopose_drake.core.poses import compose, inverse
from tactopose_drake.core.shape import ConvexShape, ObjectModel, build_tree, join_shapes
from tactopose_drake.core.shape.convex_shape_kernels import find_deepest
from tactopose_drake.core.validation import FloatArray, finite_array
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.hand.geometry import BodySpheres
from tactopose_drake.hand.hand_config import HandConfig
from tactopose_drake.hand.hand_in_plant import add_fixed_hand
from tactopose_drake.hand.reading_ranges import ReadingRanges
from tactopose_drake.hand.shape_depth import convex_shape
from tactopose_drake.resources import passing_builder

_TOLERANCE = 2e-5  # m, by which depths may be short


@dataclass(frozen=True, eq=False)
class Collisions:
    """How deep an object reaches into a hand, for each of B poses.

    Attributes:
        depth: the greatest depth of a point of the object below the surface of a shape of the hand, shape (B,), m; 0
            where the two do not touch. It ends at the depth of the shape itself, half its thickness.
        link: the link of the hand that the object reaches deepest into, B of them; None where it touches none.
    """

    depth: FloatArray
    link: tuple[str | None, ...]


class HandCollision:
    """Checks poses of an object against a hand that is posed by its joints.

    Depths are short by 0.02 mm at the most. A mesh of the hand counts as its convex hull; planes are left out.
    """

    def __init__(self, hand: HandConfig, model: ObjectModel) -> None:
        """Builds a plant of the hand.

        Raises:
            InvalidInputError: if the hand has no collision geometry.
        """
        with passing_builder() as builder:
            self._plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.001)
            self._hand = add_fixed_hand(self._plant, hand)
            self._plant.Finalize()
        self._ranges = ReadingRanges.of(self._plant)
        self._inspector = inspector = scene_graph.model_inspector()
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
            raise InvalidInputError(f"hand: {hand.model} has no collision geometry.")
        self._links = [self._plant.get_body(index).name() for index in bodies]
        self._bodies, self._X_GB = list(map(int, bodies)), inverse(np.array(X_BG))
        palm = self._hand.palm_frame
        self._palm, self._X_BP = int(palm.body().index()), palm.GetFixedPoseInBodyFrame().GetAsMatrix34()
        self._shapes, self._tree = join_shapes(shapes), build_tree(model.vertices, model.faces)

    @cached_property
    def spheres(self) -> BodySpheres:
        """`BodySpheres.of_hand` of the hand, which need not be read from its file again."""
        return BodySpheres.from_inspector(self._plant, self._inspector, self._hand.model_instance)

    @property
    def num_positions(self) -> int:
        """The number of the hand's joint positions."""
        return int(self._plant.num_positions(self._hand.model_instance))

    def knows_all(self, q: FloatArray) -> bool:
        """Whether all readings of the hand's joints, shape (nq,), can be true: none is NaN or far beyond its limits."""
        every = np.zeros(self._plant.num_positions())
        self._plant.SetPositionsInArray(self._hand.model_instance, q, every)
        return bool(self._ranges.told(every).all())

    def make_scratch(self) -> Context:
        """What `check` works in; to be used by one thread at a time."""
        return self._plant.CreateDefaultContext()

    def check(
        self, q: ArrayLike, X_PO: ArrayLike, *, enough: float = math.inf, scratch: Context | None = None
    ) -> Collisions:
        """Measures how deep the object reaches into the hand.

        Args:
            q: the hand's joint positions, in the order of a plant of the hand alone, shape (nq,), rad.
            X_PO: poses of the object, shape (B, 3, 4).
            enough: m; of a pose that is deeper no more than that is found out, which saves time: its depth is then a
                lower bound above `enough`.
            scratch: of `make_scratch`; a new one is made otherwise.

        Raises:
            InvalidInputError: a number that is not finite, or a shape that does not fit.
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
    """`HandCollision.check` for once; to check more than once, keep a `HandCollision`."""
    return HandCollision(hand, model).check(q, X_PO)


def keep_clear(estimate: PoseEstimate, collisions: Collisions, tolerance: float) -> tuple[PoseEstimate, bool]:
    """The estimate without the hypotheses that collide.

    Where no other explains the touch, either the hand's shape, its joints or the touch is not what it seems; then all
    stay, and the status is "ambiguous". An estimate that explains nothing stays as it is.

    Args:
        estimate: of the poses that were checked.
        collisions: of its hypotheses.
        tolerance: the depth that is no collision yet, m: soft skin gives way, and poses have errors.

    Returns:
        The estimate, and whether it is clear of the hand.
    """
    clear = [bool(depth <= tolerance) for depth in collisions.depth]
    if estimate.status == "no_solution":
        return estimate, all(clear)
    if any(is_clear and h.explains_touch for is_clear, h in zip(clear, estimate.hypotheses, strict=True)):
        return estimate if all(clear) else estimate.keep(clear), True
    return replace(estimate, status="ambiguous"), False
