"""The hand as spheres, at one instant and fixed on its bodies."""

import dataclasses
import functools
import itertools
from collections.abc import Collection, Sequence
from typing import Self

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Box, Capsule, Convex, Cylinder, Ellipsoid, Mesh, Role, SceneGraphInspector, Shape, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, Frame, ModelInstanceIndex
from pydrake.systems.framework import Context

from tactopose_drake.core.evidence import hand_geometry
from tactopose_drake.core.searches import spread_out
from tactopose_drake.core.shape.sphere_packing import Spheres, pack_box, pack_capsule, pack_convex
from tactopose_drake.core.validation import FloatArray, instance_of
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.estimation.hull_vertices import hull_vertices
from tactopose_drake.hand.geometry_query import geometry_query
from tactopose_drake.hand.hand_config import HandConfig
from tactopose_drake.hand.hand_in_plant import make_hand_with_shapes

# Points of the unit circle and latitudes of the unit sphere that approximate a cylinder and an ellipsoid.
_CIRCLE = np.stack([np.cos(np.arange(24) * np.pi / 12), np.sin(np.arange(24) * np.pi / 12)], axis=1)
_LATITUDES = np.linspace(-np.pi / 2, np.pi / 2, 13)
# The corners of a cube and the middles of its edges.
_BOX_EDGES = np.array([sides for sides in itertools.product((-1, 0, 1), repeat=3) if np.count_nonzero(sides) >= 2])
_CORNER = 0.0005  # radius of the spheres that represent corners, m
_KEPT = 64  # hulls whose spheres are cached
_MOST_CORNERS = 30  # of a hull
_HARDLY = (0.0015, 0.003, 0.0045, 0.006)  # increasing protrusions below which a sphere is dropped, m


class HandGeometry(hand_geometry.HandGeometry):
    """Spheres that fill the hand at one instant, given or made from a plant.

    Attributes:
        p_PH: centres in the palm frame, shape (h, 3), m; coordinates up to 10 m.
        radius: radii, shape (h,), m, from 1e-6 to 10.
        sigma: standard deviation of the hand's surface from the spheres', by errors of joints, links and packing, m,
            from 1e-7 to 10.

    Raises:
        InvalidInputError: if there is no sphere, a number is not finite or out of its range, or a shape is wrong.
    """

    @classmethod
    def from_plant(cls, plant: MultibodyPlant, context: Context, palm_frame: Frame) -> Self:
        """Fills the collision geometry of the palm's model instance at the context's joint positions.

        Each call packs the spheres again; for a moving hand, keep a `BodySpheres` instead.

        Args:
            plant: finalized plant that is connected to a SceneGraph.
            context: the plant's context in that diagram.
            palm_frame: P.

        Raises:
            InvalidInputError: if an argument has a wrong type or is of another plant, the plant is not finalized or not
                connected to a SceneGraph, or the hand has no collision geometry.
        """
        instance_of("plant", plant, MultibodyPlant)
        instance_of("context", context, Context)
        instance_of("palm_frame", palm_frame, Frame)
        if palm_frame.GetParentPlant() is not plant:
            raise InvalidInputError(f"palm_frame must be of this plant, but {palm_frame.name()!r} is of another.")
        inspector = geometry_query(plant, context).inspector()
        spheres = BodySpheres.from_inspector(plant, inspector, palm_frame.model_instance())
        if not len(spheres.radius):
            raise InvalidInputError(f"palm_frame must be of a hand with collision geometry, not {palm_frame.name()!r}.")
        X_PW = palm_frame.CalcPoseInWorld(context).inverse()
        X_WB = plant.get_body_poses_output_port().Eval(context)
        return cls(X_PW.multiply(spheres.positions(X_WB).T).T, spheres.radius)


@dataclasses.dataclass(frozen=True, eq=False)
class BodySpheres:
    """Spheres that are fixed on the bodies of a hand.

    Attributes:
        body: index of each sphere's body B in the plant, shape (h,).
        p_BH: centres in B, shape (h, 3), m.
        radius: radii, shape (h,), m.
    """

    body: NDArray[np.int64]
    p_BH: FloatArray
    radius: FloatArray

    @classmethod
    def from_inspector(
        cls, plant: MultibodyPlant, inspector: SceneGraphInspector, model_instance: ModelInstanceIndex
    ) -> Self:
        """Fills the collision geometry of one model instance. A mesh counts as its convex hull; planes are ignored."""
        body, centres, radii = [np.zeros(0, dtype=np.int64)], [np.zeros((0, 3))], [np.zeros(0)]
        for index in plant.GetBodyIndices(model_instance):
            frame = plant.GetBodyFrameIdOrThrow(index)
            for geometry in inspector.GetGeometries(frame, Role.kProximity):
                p_GH, radius = _pack(inspector.GetShape(geometry))
                body.append(np.full(len(radius), int(index)))
                centres.append(inspector.GetPoseInFrame(geometry).multiply(p_GH.T).T)
                radii.append(radius)
        return cls(np.concatenate(body), np.concatenate(centres), np.concatenate(radii))

    @classmethod
    def of_hand(cls, config: HandConfig) -> Self:
        """Fills a hand; the body indices are those of any plant that holds this hand alone."""
        plant, inspector, hand = make_hand_with_shapes(config)
        return cls.from_inspector(plant, inspector, hand.model_instance)

    def of(self, bodies: Collection[int]) -> Self:
        """The spheres on the given bodies."""
        chosen = np.isin(self.body, sorted(bodies))
        return type(self)(self.body[chosen], self.p_BH[chosen], self.radius[chosen])

    def joined(self, others: Self) -> Self:
        """These spheres and others."""
        return type(self)(
            np.concatenate([self.body, others.body]),
            np.concatenate([self.p_BH, others.p_BH]),
            np.concatenate([self.radius, others.radius]),
        )

    def thinned(self, most: int) -> Self:
        """Drops spheres that protrude least from larger ones of the same body, until about `most` are left."""
        kept = np.arange(len(self.radius))
        for hardly in _HARDLY:
            if len(kept) > most:
                kept = np.array(self._that_stick_out(hardly))
        return type(self)(self.body[kept], self.p_BH[kept], self.radius[kept])

    def _that_stick_out(self, least: float) -> list[int]:
        """Indices of spheres, largest first, that protrude from each earlier one on the same body by `least`, m."""
        kept: list[int] = []
        for i in np.argsort(-self.radius, kind="stable"):
            rest = [k for k in kept if self.body[k] == self.body[i]]
            out = np.linalg.norm(self.p_BH[rest] - self.p_BH[i], axis=1) + self.radius[i] - self.radius[rest]
            if out.min(initial=np.inf) > least:
                kept.append(int(i))
        return kept

    def positions(self, X_WB: Sequence[RigidTransform]) -> FloatArray:
        """Centres in the world, shape (h, 3), m, for the poses of all bodies (the plant's port `body_poses`)."""
        bodies, of_sphere = self._bodies
        X = np.array([X_WB[index].GetAsMatrix34() for index in bodies]).reshape(-1, 3, 4)[of_sphere]
        p_WH: FloatArray = np.einsum("hij,hj->hi", X[:, :, :3], self.p_BH) + X[:, :, 3]
        return p_WH

    @functools.cached_property
    def _bodies(self) -> tuple[NDArray[np.int64], NDArray[np.intp]]:
        """The bodies that have spheres, and the index among them of each sphere's body."""
        bodies, of_sphere = np.unique(self.body, return_inverse=True)
        return bodies, of_sphere


def corner_spheres(plant: MultibodyPlant, inspector: SceneGraphInspector, bodies: Sequence[int]) -> BodySpheres:
    """Small spheres at corners of boxes and hulls, and at the middles of boxes' edges, which packed spheres leave out.

    Args:
        plant: finalized plant that holds the hand.
        inspector: inspector of its geometry.
        bodies: indices of the bodies whose shapes are used.
    """
    body, centres = [np.zeros(0, dtype=np.int64)], [np.zeros((0, 3))]
    for index in bodies:
        for geometry in inspector.GetGeometries(plant.GetBodyFrameIdOrThrow(BodyIndex(index)), Role.kProximity):
            shape = inspector.GetShape(geometry)
            points = np.zeros((0, 3))
            if isinstance(shape, Box):
                points = (0.5 * np.asarray(shape.size()) - _CORNER) * _BOX_EDGES
            elif isinstance(shape, Mesh | Convex):
                vertices = hull_vertices(shape.GetConvexHull())
                points = vertices[spread_out(vertices, _MOST_CORNERS)]
            body.append(np.full(len(points), index, dtype=np.int64))
            centres.append(inspector.GetPoseInFrame(geometry).multiply(points.T).T)
    return BodySpheres(np.concatenate(body), np.concatenate(centres), np.full(sum(map(len, body)), _CORNER))


def _pack(shape: Shape) -> Spheres:
    if isinstance(shape, Sphere):
        return np.zeros((1, 3)), np.array([shape.radius()])
    if isinstance(shape, Capsule):
        return pack_capsule(shape.radius(), shape.length())
    if isinstance(shape, Box):
        return pack_box(shape.size())
    if isinstance(shape, Cylinder):
        ends = [np.column_stack([shape.radius() * _CIRCLE, np.full(24, z)]) for z in (-0.5, 0.5)]
        return _pack_hull((np.concatenate(ends) * [1, 1, shape.length()]).tobytes())
    if isinstance(shape, Ellipsoid):
        rings = [np.column_stack([np.cos(a) * _CIRCLE, np.full(24, np.sin(a))]) for a in _LATITUDES]
        return _pack_hull((np.concatenate(rings) * [shape.a(), shape.b(), shape.c()]).tobytes())
    if isinstance(shape, Mesh | Convex):
        return _pack_hull(hull_vertices(shape.GetConvexHull()).tobytes())
    return np.zeros((0, 3)), np.zeros(0)


@functools.lru_cache(maxsize=_KEPT)
def _pack_hull(vertices: bytes) -> Spheres:
    """The spheres in a hull. Cached, since a hull of a thousand vertices takes half a second and fingers are alike."""
    centres, radii = pack_convex(np.frombuffer(vertices).reshape(-1, 3))
    for values in (centres, radii):
        values.setflags(write=False)
    return centres, radii
