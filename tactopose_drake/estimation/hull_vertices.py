"""The vertices of a convex hull as an array; Drake gives them one by one."""

import numpy as np
from pydrake.geometry import PolygonSurfaceMesh

from tactopose_drake.core.validation import FloatArray


def hull_vertices(hull: PolygonSurfaceMesh) -> FloatArray:
    """The vertices of the hull of a shape, in the shape's frame, shape (n, 3), m."""
    return np.array([hull.vertex(i) for i in range(hull.num_vertices())])
