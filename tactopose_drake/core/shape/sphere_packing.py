"""Fills convex bodies with spheres, for cheap distance and occlusion queries against a hand.

Every sphere lies within its body, so a point inside a sphere is inside the body; the gaps between spheres are not
covered.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull

from tactopose_drake.core.validation import FloatArray

Spheres = tuple[FloatArray, FloatArray]  # centres (n, 3), of B postures (B, n, 3), and radii (n,), m


@dataclass(frozen=True, kw_only=True)
class PackingParams:
    """How many spheres fill a convex body, and how well."""

    cells_across: int = 12  # of the grid of candidates, across the thinnest side
    core_share: float = 0.7  # of a sphere's radius, within which no other sphere has its centre
    least_share: float = 0.35  # of the largest radius, below which spheres are left out


def pack_capsule(radius: float, length: float) -> Spheres:
    """Spheres of the capsule's radius along its axis z, at most a radius apart.

    Args:
        radius: of the capsule, m.
        length: of its cylindrical part, m.

    Returns:
        Centres (n, 3) in the capsule's frame, whose origin is its middle, and radii (n,), m.
    """
    count = math.ceil(length / radius) + 1
    centres = np.zeros((count, 3))
    centres[:, 2] = np.linspace(-0.5, 0.5, count) * length if count > 1 else 0.0
    return centres, np.full(count, radius)


def pack_box(size: FloatArray) -> Spheres:
    """Spheres of half the thickness, at most half a thickness apart along the other two sides.

    Args:
        size: side lengths, shape (3,), m.

    Returns:
        Centres (n, 3) in the box' frame, whose origin is its middle, and radii (n,), m.
    """
    radius = float(size.min()) / 2
    axes = []
    for side in size:
        reach = side / 2 - radius
        axes.append(np.linspace(-reach, reach, math.ceil(2 * reach / radius) + 1) if reach > 0 else np.zeros(1))
    grid = np.meshgrid(*axes, indexing="ij")
    centres = np.stack([axis.ravel() for axis in grid], axis=1)
    return centres, np.full(len(centres), radius)


def pack_convex(vertices: FloatArray, params: PackingParams = PackingParams()) -> Spheres:
    """Greedily picks the largest inscribed spheres of a convex hull, each with its centre outside the others' cores.

    Args:
        vertices: points whose hull is filled, shape (v, 3), m; not all in one plane.
        params: how many spheres, and how well they fill it.

    Returns:
        Centres (n, 3) in the vertices' frame and radii (n,), m, the largest first.
    """
    halfspaces = ConvexHull(vertices).equations
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    step = float((high - low).min()) / params.cells_across
    axes = [np.linspace(a, b, math.ceil((b - a) / step) + 1) for a, b in zip(low, high, strict=True)]
    shape, spacing = tuple(len(axis) for axis in axes), np.array([axis[1] - axis[0] for axis in axes])
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    candidates = grid.reshape(-1, 3)
    radii = -(candidates @ halfspaces[:, :3].T + halfspaces[:, 3]).max(axis=1)
    order = np.flatnonzero(radii > params.least_share * radii.max())
    order = order[np.argsort(-radii[order], kind="stable")]

    is_free, chosen = np.ones(shape, dtype=np.bool_), []
    for best in order:
        place = np.unravel_index(best, shape)
        if not is_free[place]:
            continue
        chosen.append(best)
        core = params.core_share * radii[best]
        reach = np.ceil(core / spacing).astype(int)
        near = tuple(slice(max(0, i - n), i + n + 1) for i, n in zip(place, reach, strict=True))
        is_free[near] &= np.linalg.norm(grid[near] - candidates[best], axis=-1) >= core
    return candidates[chosen], radii[chosen]
