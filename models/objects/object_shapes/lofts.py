"""Solids swept around the z axis: surfaces of revolution, also with a cross-section that is not round."""

from collections.abc import Callable, Sequence

import numpy as np
import trimesh
from numpy.typing import NDArray

Array = NDArray[np.float64]


def rounded_profile(corners: Sequence[tuple[float, float, float]], step: float, arc_step: float = 0.3) -> Array:
    """A polyline with its corners rounded by arcs.

    Args:
        corners: (r, z, fillet radius) of each corner, in m; the first and last are ends and are not rounded.
        step: longest distance of neighbouring points on the straight parts, m.
        arc_step: largest change of direction from point to point on the arcs, rad.

    Returns:
        Points (r, z), shape (n, 2), m.

    Raises:
        ValueError: a fillet does not fit between its neighbours.
    """
    points = np.array(corners, dtype=float)[:, :2]
    trims = [_fillet_trim(points[i - 1 : i + 2], corners[i][2]) for i in range(1, len(points) - 1)]
    trims = [0.0, *trims, 0.0]
    pieces = [points[:1]]
    for i in range(1, len(points)):
        length = float(np.linalg.norm(points[i] - points[i - 1]))
        if trims[i - 1] + trims[i] > length + 1e-9:
            raise ValueError(f"corners {i - 1} and {i}: their fillets need {trims[i - 1] + trims[i]} m of {length} m.")
        along = (points[i] - points[i - 1]) / length
        start, end = points[i - 1] + trims[i - 1] * along, points[i] - trims[i] * along
        count = max(1, round(float(np.linalg.norm(end - start)) / step))
        pieces.append(start + np.linspace(0, 1, count + 1)[1:, None] * (end - start))
        if trims[i] > 0:
            pieces.append(_fillet_arc(points[i - 1 : i + 2], corners[i][2], arc_step)[1:])
    profile = np.concatenate(pieces)
    distinct = np.linalg.norm(np.diff(profile, axis=0), axis=1) > 1e-5
    return profile[np.concatenate([[True], distinct])]


def _directions(corner: Array) -> tuple[Array, Array, float]:
    """Unit directions into and out of the middle one of three points, and the angle (rad) between the two."""
    into, out = corner[1] - corner[0], corner[2] - corner[1]
    into, out = into / np.linalg.norm(into), out / np.linalg.norm(out)
    return into, out, float(np.arccos(np.clip(into @ out, -1, 1)))


def _fillet_trim(corner: Array, radius: float) -> float:
    return radius * float(np.tan(_directions(corner)[2] / 2))


def _fillet_arc(corner: Array, radius: float, arc_step: float) -> Array:
    into, out, turn = _directions(corner)
    start = corner[1] - into * _fillet_trim(corner, radius)
    side = np.sign(into[0] * out[1] - into[1] * out[0]) * np.array([-into[1], into[0]])
    angle = np.linspace(0, turn, max(2, int(np.ceil(turn / arc_step))) + 1)[:, None]
    return start + radius * (np.sin(angle) * into + (1 - np.cos(angle)) * side)


def loft(
    profile: Array, segments: int, radius_at: Callable[[Array, Array, Array], Array] | None = None
) -> trimesh.Trimesh:
    """The solid between the z axis and a profile that is swept once around it.

    Args:
        profile: points (r, z), shape (n, 2), m; starts and ends on the axis and runs counter-clockwise
            (bottom, outside, top), so that the faces look outwards.
        segments: number of points around the axis.
        radius_at: r(theta, r, z) for a cross-section that is not round; broadcasts.

    Returns:
        A closed mesh, outward faces.

    Raises:
        ValueError: the profile's ends are not on the axis.
    """
    if np.any(np.abs(profile[[0, -1], 0]) > 1e-12):
        raise ValueError(f"profile: ends at radii {profile[[0, -1], 0]}, but both must lie on the axis.")
    rings = profile[1:-1]
    theta = np.arange(segments) * (2 * np.pi / segments)
    r, z = np.broadcast_arrays(rings[:, :1], rings[:, 1:])
    if radius_at is not None:
        r = radius_at(theta[None, :], r, z)
    ring_points = np.stack(np.broadcast_arrays(r * np.cos(theta), r * np.sin(theta), z), axis=-1)
    bottom, top = [[0, 0, profile[0, 1]]], [[0, 0, profile[-1, 1]]]
    vertices = np.concatenate([bottom, ring_points.reshape(-1, 3), top])

    here = np.arange(segments)
    after = (here + 1) % segments
    faces = [np.stack([np.zeros_like(here), 1 + after, 1 + here], axis=1)]
    for ring in range(len(rings) - 1):
        low, high = 1 + ring * segments, 1 + (ring + 1) * segments
        faces.append(np.stack([low + here, low + after, high + after], axis=1))
        faces.append(np.stack([low + here, high + after, high + here], axis=1))
    last = 1 + (len(rings) - 1) * segments
    faces.append(np.stack([last + here, last + after, np.full_like(here, len(vertices) - 1)], axis=1))
    return trimesh.Trimesh(vertices, np.concatenate(faces), process=False)
