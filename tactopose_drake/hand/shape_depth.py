"""Depths of points in Drake's shapes, which are converted to convex shapes."""

import numpy as np
from pydrake.geometry import Box, Capsule, Convex, Cylinder, Ellipsoid, Mesh, Role, SceneGraphInspector, Shape, Sphere
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RigidBody

from tactopose_drake.core.shape import ConvexShape
from tactopose_drake.core.validation import FloatArray


def body_depths(
    plant: MultibodyPlant, inspector: SceneGraphInspector, body: RigidBody, p_BQ: FloatArray
) -> FloatArray | None:
    """The largest depth of each point over all collision shapes of a body; None if it has none.

    Args:
        plant: finalized plant that holds the body.
        inspector: inspector of its geometry.
        body: B.
        p_BQ: the points, shape (n, 3), m.

    Returns:
        The depths, shape (n,), m; negative outside.
    """
    depths = []
    for geometry in inspector.GetGeometries(plant.GetBodyFrameIdOrThrow(body.index()), Role.kProximity):
        shape = convex_shape(inspector.GetShape(geometry))
        if shape is not None:
            depths.append(shape.depths(inspector.GetPoseInFrame(geometry).inverse().multiply(p_BQ.T).T))
    return np.max(depths, axis=0) if depths else None


def convex_shape(shape: Shape) -> ConvexShape | None:
    """Converts a shape of Drake to a convex shape; None for a plane. A mesh counts as its convex hull."""
    if isinstance(shape, Sphere):
        return ConvexShape.capsule(shape.radius(), 0.0)
    if isinstance(shape, Capsule):
        return ConvexShape.capsule(shape.radius(), shape.length())
    if isinstance(shape, Box):
        return ConvexShape.box(shape.size())
    if isinstance(shape, Cylinder):
        return ConvexShape.cylinder(shape.radius(), shape.length())
    if isinstance(shape, Ellipsoid):
        return ConvexShape.ellipsoid(np.array([shape.a(), shape.b(), shape.c()]))
    if isinstance(shape, Mesh | Convex):
        hull = shape.GetConvexHull()
        normals = np.array([hull.face_normal(i) for i in range(hull.num_faces())])
        offsets = np.array([hull.face_normal(i) @ hull.element_centroid(i) for i in range(hull.num_faces())])
        return ConvexShape.hull(normals, offsets)
    return None
