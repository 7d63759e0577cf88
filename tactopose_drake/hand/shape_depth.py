"""How deep a point lies below the surface of one of Drake's convex shapes, or of those of a link."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from pydrake.geometry import Box, Capsule, Convex, Cylinder, Ellipsoid, Mesh, Role, SceneGraphInspector, Shape, Sphere
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RigidBody

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.estimation.hull_vertices import hull_vertices


@dataclass(frozen=True, eq=False)
class ShapeDepth:
    """The depth below a shape's surface, in the shape's own frame G.

    Attributes:
        at: the depth of a point p_GQ, shape (3,), m, in m; negative outside.
        deepest: the point of the greatest depth, or for a hull one well inside, shape (3,), m.
    """

    at: Callable[[FloatArray], float]
    deepest: FloatArray


def body_depths(
    plant: MultibodyPlant, inspector: SceneGraphInspector, body: RigidBody, p_BQ: FloatArray
) -> FloatArray | None:
    """The depths of points in the collision shapes of a body, where these are deepest; None where it has none.

    Args:
        plant: finalized plant that holds the body.
        inspector: of the geometry.
        body: B.
        p_BQ: the points, shape (n, 3), m.

    Returns:
        Shape (n,), m.
    """
    depths = []
    for geometry in inspector.GetGeometries(plant.GetBodyFrameIdOrThrow(body.index()), Role.kProximity):
        depth = shape_depth(inspector.GetShape(geometry))
        if depth is not None:
            p_GQ = inspector.GetPoseInFrame(geometry).inverse().multiply(p_BQ.T).T
            depths.append([depth.at(p) for p in p_GQ])
    return np.max(depths, axis=0) if depths else None


def shape_depth(shape: Shape) -> ShapeDepth | None:
    """The depth in a shape; None for a plane. A mesh counts as its convex hull.

    Exact within the shape, but for the ellipsoid's: that is right to first order below the surface.
    """
    origin = np.zeros(3)
    if isinstance(shape, Sphere):
        radius = shape.radius()
        return ShapeDepth(lambda p: radius - float(np.linalg.norm(p)), origin)
    if isinstance(shape, Capsule):
        radius, half = shape.radius(), shape.length() / 2
        return ShapeDepth(lambda p: radius - math.hypot(p[0], p[1], max(0.0, abs(p[2]) - half)), origin)
    if isinstance(shape, Box):
        extent = shape.size() / 2
        return ShapeDepth(lambda p: float(np.min(extent - np.abs(p))), origin)
    if isinstance(shape, Cylinder):
        radius, half = shape.radius(), shape.length() / 2
        return ShapeDepth(lambda p: min(radius - math.hypot(p[0], p[1]), half - abs(p[2])), origin)
    if isinstance(shape, Ellipsoid):
        semi_axes = np.array([shape.a(), shape.b(), shape.c()])
        return ShapeDepth(lambda p: _depth_in_ellipsoid(semi_axes, p), origin)
    if isinstance(shape, Mesh | Convex):
        hull = shape.GetConvexHull()
        normals = np.array([hull.face_normal(i) for i in range(hull.num_faces())])
        offsets = np.array([hull.face_normal(i) @ hull.element_centroid(i) for i in range(hull.num_faces())])
        return ShapeDepth(lambda p: float(np.min(offsets - normals @ p)), hull_vertices(hull).mean(axis=0))
    return None


def _depth_in_ellipsoid(semi_axes: FloatArray, p_GQ: FloatArray) -> float:
    """Value over slope of the implicit surface |p / semi_axes| = 1; at most the smallest semi-axis."""
    share = float(np.linalg.norm(p_GQ / semi_axes))
    slope = float(np.linalg.norm(p_GQ / semi_axes**2))
    smallest = float(semi_axes.min())
    return min(smallest, share * (1.0 - share) / slope) if slope else smallest
