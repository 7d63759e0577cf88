"""The pressure on a pad, from Drake's hydroelastic contact surfaces."""

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import ContactSurface
from pydrake.math import RigidTransform

from tactopose_drake.core.sensing.tactile_array import PressureField


def pressure_field(surface: ContactSurface, X_TW: RigidTransform, *, pad_is_M: bool) -> PressureField:
    """The pressure on one side of a contact surface.

    Args:
        surface: contact surface of triangles or polygons, in the world.
        X_TW: pose of the world in the pad's frame.
        pad_is_M: whether the pad is the geometry M; the surface's normals point out of N and into M.
    """
    if surface.is_triangle():
        mesh, field = surface.tri_mesh_W(), surface.tri_e_MN()
        corners = [[triangle.vertex(k) for k in range(3)] for triangle in mesh.triangles()]
        faces = np.insert(np.array(corners, dtype=np.int64).reshape(-1, 3), 0, 3, axis=1).ravel()
    else:
        mesh, field = surface.poly_mesh_W(), surface.poly_e_MN()
        faces = np.array(mesh.face_data(), dtype=np.int64)
    vertices = range(mesh.num_vertices())
    p_WV = np.array([mesh.vertex(i) for i in vertices])
    pressure = np.array([field.EvaluateAtVertex(i) for i in vertices])
    return PressureField(X_TW.multiply(p_WV.T).T, pressure, _turned(faces) if pad_is_M else faces)


def _turned(faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """The same polygons with reversed vertex order."""
    turned = faces.copy()
    start = 0
    while start < len(faces):
        end = start + 1 + faces[start]
        turned[start + 1 : end] = faces[start + 1 : end][::-1]
        start = end
    return turned
