"""The compiled inner loops of guarded moves, over poses and motions.

Poses are (B, 3, 4). A distance reads only the first of the grid's four channels.
"""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import kernel
from tactopose_drake.core.kernel_types import (
    Floats1,
    Floats2,
    Floats3,
    Floats4,
    Longs1,
    OutFlags1,
    OutFlags2,
    OutFloats2,
    OutLongs2,
)
from tactopose_drake.core.kernels.grid_kernels import Grid, cell


class Finger(NamedTuple):
    """A finger along m motions with s stops each, in P; all arrays are read-only.

    Attributes:
        tip: the fingertip's centre, shape (m, s, 3), m.
        tip_radius: m.
        body: centres of the spheres that fill the rest, shape (m, s, b, 3), m.
        body_radius: shape (b,), m.
    """

    tip: Floats3
    tip_radius: float
    body: Floats4
    body_radius: Floats1


@kernel
def _distance(grid: Grid, X: Floats2, p: Floats1) -> float:
    """Distance of a point p (3,) in P from the object at pose X (3, 4); outside the grid, plus that from the grid."""
    values, origin, inverse_spacing = grid
    dx, dy, dz = p[0] - X[0, 3], p[1] - X[1, 3], p[2] - X[2, 3]
    x = X[0, 0] * dx + X[1, 0] * dy + X[2, 0] * dz
    y = X[0, 1] * dx + X[1, 1] * dy + X[2, 1] * dz
    z = X[0, 2] * dx + X[1, 2] * dy + X[2, 2] * dz
    i, fx, ox = cell(x, origin[0], inverse_spacing, values.shape[0] - 1.0)
    j, fy, oy = cell(y, origin[1], inverse_spacing, values.shape[1] - 1.0)
    k, fz, oz = cell(z, origin[2], inverse_spacing, values.shape[2] - 1.0)
    d00 = values[i, j, k, 0] + fz * (values[i, j, k + 1, 0] - values[i, j, k, 0])
    d01 = values[i, j + 1, k, 0] + fz * (values[i, j + 1, k + 1, 0] - values[i, j + 1, k, 0])
    d10 = values[i + 1, j, k, 0] + fz * (values[i + 1, j, k + 1, 0] - values[i + 1, j, k, 0])
    d11 = values[i + 1, j + 1, k, 0] + fz * (values[i + 1, j + 1, k + 1, 0] - values[i + 1, j + 1, k, 0])
    d0, d1 = d00 + fy * (d01 - d00), d10 + fy * (d11 - d10)
    return d0 + fx * (d1 - d0) + np.sqrt(ox * ox + oy * oy + oz * oz) / inverse_spacing


@kernel
def first_hits(
    grid: Grid,
    tip: Floats3,
    radius: float,
    X: Floats3,
    place: OutLongs2,
    before: OutFloats2,
    after: OutFloats2,
) -> None:
    """Finds the first stop of each motion's tip (m, s, 3) within a radius of the object: place (B, m), or s if none.

    The gaps to the object at that stop and at the one before are written to after and before (B, m), which are
    unchanged if nothing is hit. The first stop never counts: a motion that starts inside the object and is still inside
    at its second stop has its hit there.
    """
    places = tip.shape[1]
    for b in range(X.shape[0]):
        for m in range(tip.shape[0]):
            last, place[b, m] = 0.0, places
            for s in range(places):
                gap = _distance(grid, X[b], tip[m, s]) - radius
                if gap <= 0.0 and s > 0:
                    place[b, m], before[b, m], after[b, m] = s, max(last, 0.0), gap
                    break
                last = gap


@kernel
def are_clear(
    grid: Grid,
    finger: Finger,
    X: Floats3,
    clear: OutFlags2,
) -> None:
    """Fills clear (B, m): the tip (m, s, 3) starts off the object, and no body sphere (m, s, b, 3) hits it first."""
    tip, tip_radius, body, body_radius = finger
    for b in range(X.shape[0]):
        for m in range(tip.shape[0]):
            clear[b, m] = True
            for s in range(tip.shape[1]):
                if _distance(grid, X[b], tip[m, s]) <= tip_radius:
                    if s == 0:
                        clear[b, m] = False
                    break
                for i in range(body.shape[2]):
                    if _distance(grid, X[b], body[m, s, i]) <= body_radius[i]:
                        clear[b, m] = False
                        break
                if not clear[b, m]:
                    break


@kernel
def stay_apart(
    finger: Finger,
    p: Floats2,
    radius: Floats1,
    end: Longs1,
    apart: OutFlags1,
) -> None:
    """Whether each motion's spheres, tip (m, s, 3) and body (m, s, b, 3), avoid other spheres p (h, 3).

    Stops after `end` (m,) do not count, nor do pairs that overlap where the motion starts, as these are joined.
    """
    tip, tip_radius, body, body_radius = finger
    spheres = body.shape[2]
    for m in range(tip.shape[0]):
        apart[m] = True
        for i in range(spheres + 1):
            for j in range(p.shape[0]):
                reach = radius[j] + (tip_radius if i == spheres else body_radius[i])
                for s in range(end[m] + 1):
                    at = tip[m, s] if i == spheres else body[m, s, i]
                    dx, dy, dz = at[0] - p[j, 0], at[1] - p[j, 1], at[2] - p[j, 2]
                    if dx * dx + dy * dy + dz * dz <= reach * reach:
                        apart[m] = s == 0
                        break
                if not apart[m]:
                    break
            if not apart[m]:
                break
