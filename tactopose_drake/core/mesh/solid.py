"""Checks that a mesh is the surface of a body: closed, oriented, and with a physically possible volume and inertia."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactopose_drake.core.mesh.bodies import face_areas, volumes
from tactopose_drake.core.mesh.topology import AnyIntArray, half_edges
from tactopose_drake.core.plain_values import counted
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.errors import InvalidMeshError

DENSITY = 1000.0
"""Assumed density if no mass is given, kg/m^3."""

_FLAT_BODY = 1e-6  # volume over area, as a share of the size, below which a body is flat
_ROUNDING = 1e-9  # relative tolerance of the integrals


@dataclass(frozen=True, eq=False)
class SolidProperties:
    """Integrals over a uniform body of density `DENSITY`.

    Attributes:
        volume: m^3.
        centroid: shape (3,), m.
        inertia: about the centroid, shape (3, 3), kg m^2.
    """

    volume: float
    centroid: FloatArray
    inertia: FloatArray


def solid_properties(vertices: FloatArray, faces: AnyIntArray) -> SolidProperties:
    """Computes volume, centroid and inertia of a mesh that must be the surface of a body.

    Args:
        vertices: shape (v, 3), m.
        faces: vertex indices, anticlockwise seen from outside, shape (f, 3).

    Raises:
        InvalidMeshError: if a number is not finite, an index out of range, an edge does not belong to two faces, once
            in each direction, or volume, centroid or inertia are physically impossible.
    """
    if not len(faces) or faces.min() < 0 or faces.max() >= len(vertices) or not np.isfinite(vertices).all():
        raise InvalidMeshError("must have faces, all of them of finite vertices that exist.")
    _check_closed(faces)
    lower, upper = vertices.min(axis=0), vertices.max(axis=0)
    size = float(np.linalg.norm(upper - lower))
    middle = 0.5 * (lower + upper)
    area = float(face_areas(vertices, faces).sum())
    if volumes(vertices, faces)[0] <= _FLAT_BODY * size * area:
        raise InvalidMeshError("must enclose a volume, but is flat.")
    volume, centroid, inertia = _integrals((vertices - middle)[faces])
    centroid += middle
    moments = np.linalg.eigvalsh(inertia)
    # The mean squared distances from the three principal planes, which are positive for any body.
    squares = (0.5 * moments.sum() - moments) / (DENSITY * volume)
    margin = _ROUNDING * size
    if (
        not np.all((squares > 0.0) & (squares < size**2))
        or np.any((centroid < lower - margin) | (centroid > upper + margin))
        or volume > (1.0 + _ROUNDING) * float(np.prod(upper - lower))
    ):
        raise InvalidMeshError(
            f"must not pass through itself, but parts of it are inside out: the integrals over it are those of no body "
            f"(volume {volume:.3g} m^3, principal moments {', '.join(f'{moment:.3g}' for moment in moments)} kg m^2 at "
            f"{DENSITY:g} kg/m^3)."
        )
    return SolidProperties(volume, centroid, inertia)


def _integrals(corners: FloatArray) -> tuple[float, FloatArray, FloatArray]:
    """Volume, centroid, and inertia about it, of the tetrahedra between the origin and triangles (f, 3, 3)."""
    weight = np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
    sums = corners.sum(axis=1)
    volume = float(weight.sum())
    centroid = np.einsum("f,fi->i", weight, sums) / (4.0 * volume)
    squares = np.einsum("f,fi,fj->ij", weight, sums, sums) + np.einsum("f,fci,fcj->ij", weight, corners, corners)
    squares = squares / 20.0 - volume * np.outer(centroid, centroid)
    return volume, centroid, DENSITY * (np.trace(squares) * np.eye(3) - squares)


def _check_closed(faces: AnyIntArray) -> None:
    """Rejects a mesh with edges that do not belong to two faces, once in each direction."""
    start, end = half_edges(faces.astype(np.int64))
    stride = int(faces.max()) + 1
    there, back = np.sort(start * stride + end), np.sort(end * stride + start)
    repeated = int(np.count_nonzero(there[1:] == there[:-1])) + int(np.count_nonzero(start == end))
    alone = 0 if np.array_equal(there, back) else int(np.setdiff1d(there, back).size)
    if repeated or alone or not np.array_equal(there, back):
        raise InvalidMeshError(
            f"must be closed after all repairs, but {counted(alone, 'edge has', 'edges have')} no face beyond, "
            f"{counted(repeated, 'edge is', 'edges are')} of more than two faces."
        )
