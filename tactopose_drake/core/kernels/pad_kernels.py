"""A tactile pad's cells, compiled: their places at a pose and a misplacement, and the distance grid's values there.

A pad is a run of cells. Each is a point in P that is on the surface (side 0), not inside of it (side -1), or not
outside of it (side 1). The pad is misplaced about its middle by u = (turn, shift), in standard deviations: a cell with
the arm l from the middle moves to l + sigma_rotation turn x l + sigma_position shift. The prior of u is a Gaussian with
a given information matrix: the identity if its components are independent with unit variance.

`grid` is (values, origin, 1 / spacing). `pads` is (points (n, 3), normals (n, 3), traits (n, 4), starts (k + 1,),
middles (k, 3), excess (k, 6, 6), stretches (k, 3)). A cell's traits are its side, weight, depth and half its width;
starts are the index of each pad's first cell, and n; the excess is that of the information on u, in P, over the
identity; stretches are as of `find_stretch`. `sigmas` is (sigma_rotation, sigma_position). The starts are unsigned,
because loops over unsigned numbers need no check for negative indices.
"""

from typing import NamedTuple, TypeAlias

import numpy as np

from tactopose_drake.core.compilation import inlined, kernel, part
from tactopose_drake.core.kernel_types import (
    Floats1,
    Floats2,
    Floats3,
    OutFloats1,
    OutFloats2,
    Unsigned,
    UnsignedLongs1,
)
from tactopose_drake.core.kernels.grid_kernels import SOFT_LENGTH, Grid, cell, interpolate
from tactopose_drake.core.kernels.pose_kernels import rotate_to_object, to_object

Run: TypeAlias = tuple[Unsigned, Unsigned]
"""The indices of a pad's first cell and of the one past its last."""


class Pads(NamedTuple):
    """All pads' cells in P, one pad after the other.

    Attributes:
        points: shape (n, 3), m.
        normals: out of the pad, shape (n, 3).
        traits: side, weight, depth and half the width of each, shape (n, 4).
        starts: the first cell of each pad, and one past the last pad's last, shape (k + 1,).
        middles: of the pads, shape (k, 3), m.
        excess: of the information on each pad's misplacement, in P, over the identity, shape (k, 6, 6).
        stretches: of each pad's cells, in P, shape (k, 3).
    """

    points: Floats2
    normals: Floats2
    traits: Floats2
    starts: UnsignedLongs1
    middles: Floats2
    excess: Floats3
    stretches: Floats2


class Cells(NamedTuple):
    """Scratch: n cells at one pose, in O.

    Attributes:
        arms: from the pad's middle, shape (n, 3).
        outward: normals out of the pad, shape (n, 3).
        places: positions with the misplacement, shape (n, 3).
        clear: distance from the object to each cell that feels nothing, without misplacement, shape (n,).
        weights: of the cells, 0 for those that do not count, shape (n,).
        residual: weighted distances, shape (n,).
        slopes: derivatives of the residual with respect to the place, of the interpolated distance, shape (n, 3).
        normals: the weighted interpolated unit normal, in place of the slopes, shape (n, 3).
        by_pad, by_pose: derivatives of the residual by the misplacement and by the pose's (w, R^T v), shape (n, 6).
    """

    arms: OutFloats2
    outward: OutFloats2
    places: OutFloats2
    clear: OutFloats1
    weights: OutFloats1
    residual: OutFloats1
    slopes: OutFloats2
    normals: OutFloats2
    by_pad: OutFloats2
    by_pose: OutFloats2


class Pad(NamedTuple):
    """Scratch: a pad's misplacement.

    Attributes:
        middle: of the pad in O, shape (3,).
        stretch: of its cells in O, shape (3,).
        information: on the misplacement, in O, shape (6, 6).
        u: the misplacement, in standard deviations, shape (6,).
        g, H: gradient (6,) and Hessian (lower triangle of (6, 6)) of the pad's cost at u.
        L: a Cholesky factor, shape (6, 6).
        step, trial: of the minimisation, shape (6,).
    """

    middle: OutFloats1
    stretch: OutFloats1
    information: OutFloats2
    u: OutFloats1
    g: OutFloats1
    H: OutFloats2
    L: OutFloats2
    step: OutFloats1
    trial: OutFloats1


@kernel
def scratch(n: int) -> tuple[Cells, Pad]:
    """Allocates scratch for n cells and a pad."""
    cells = Cells(
        np.empty((n, 3)),
        np.empty((n, 3)),
        np.empty((n, 3)),
        np.empty(n),
        np.empty(n),
        np.empty(n),
        np.empty((n, 3)),
        np.empty((n, 3)),
        np.empty((n, 6)),
        np.empty((n, 6)),
    )
    pad = Pad(
        np.empty(3),
        np.empty(3),
        np.empty((6, 6)),
        np.empty(6),
        np.empty(6),
        np.empty((6, 6)),
        np.empty((6, 6)),
        np.empty(6),
        np.empty(6),
    )
    return cells, pad


@part
def enter(pads: Pads, k: int, X: Floats2, cells: Cells, pad: Pad) -> None:
    """Transforms a pad to O at the pose X: its middle, stretch and prior information, and its cells' arms and normals.

    Resets what is known of the cells' clearance.
    """
    points, normals, starts, middles = pads[0], pads[1], pads[3], pads[4]
    _turn_information(pads[5][k], X, pad.information)
    to_object(X, middles[k], pad.middle)
    rotate_to_object(X, pads[6][k], pad.stretch)
    for i in range(starts[k], starts[k + 1]):
        to_object(X, points[i], cells.arms[i])
        rotate_to_object(X, normals[i], cells.outward[i])
        cells.clear[i] = 0.0
        for a in range(3):
            cells.arms[i, a] -= pad.middle[a]


@part
def _turn_information(excess: Floats2, X: Floats2, information: OutFloats2) -> None:
    """The information (6, 6) on a misplacement in O, from its excess (6, 6) in P: blocks R^T E R, plus the identity."""
    for a in range(6):
        for c in range(6):
            first, second = 3 * (a // 3), 3 * (c // 3)
            total = 0.0
            for i in range(3):
                for j in range(3):
                    total += X[i, a - first] * excess[first + i, second + j] * X[j, c - second]
            information[a, c] = total + 1.0 if a == c else total


@part
def misplace(u: Floats1, sigmas: tuple[float, float], run: Run, cells: Cells, pad: Pad) -> None:
    """Writes the places of the cells of a pad that is misplaced by u."""
    arms, places = cells.arms, cells.places
    x, y, z = sigmas[0] * u[0], sigmas[0] * u[1], sigmas[0] * u[2]
    a, b, c = pad.middle[0] + sigmas[1] * u[3], pad.middle[1] + sigmas[1] * u[4], pad.middle[2] + sigmas[1] * u[5]
    for i in range(run[0], run[1]):
        places[i, 0] = a + arms[i, 0] + y * arms[i, 2] - z * arms[i, 1]
        places[i, 1] = b + arms[i, 1] + z * arms[i, 0] - x * arms[i, 2]
        places[i, 2] = c + arms[i, 2] + x * arms[i, 1] - y * arms[i, 0]


@part
def weigh_cells(grid: Grid, traits: Floats2, run: Run, cells: Cells, pad: Pad) -> None:
    """Computes the cells' weights at their places, the residuals, and the slopes of these.

    A cell that feels nothing does not count until it has moved as far as its clearance from the object.
    """
    values, origin, inverse_spacing = grid
    flat = values.reshape(-1)
    nx, ny, nz = values.shape[0], values.shape[1], values.shape[2]
    sy, sx = np.uintp(4 * nz), np.uintp(4 * nz * ny)
    places, slopes, arms, outward, middle = cells.places, cells.slopes, cells.arms, cells.outward, pad.middle
    weights, residual, clear, stretch = cells.weights, cells.residual, cells.clear, pad.stretch
    for i in range(run[0], run[1]):
        moved = 0.0
        for a in range(3):
            moved += (places[i, a] - middle[a] - arms[i, a]) ** 2
        if moved < clear[i] ** 2:
            weights[i] = residual[i] = slopes[i, 0] = slopes[i, 1] = slopes[i, 2] = 0.0
            continue
        ix, fx, ox = cell(places[i, 0], origin[0], inverse_spacing, nx - 1.0)
        iy, fy, oy = cell(places[i, 1], origin[1], inverse_spacing, ny - 1.0)
        iz, fz, oz = cell(places[i, 2], origin[2], inverse_spacing, nz - 1.0)
        at = np.uintp(4 * ((ix * ny + iy) * nz + iz))
        distance, dx, dy, dz = interpolate(flat, at, sx, sy, fx, fy, fz)
        dx, dy, dz = dx * inverse_spacing, dy * inverse_spacing, dz * inverse_spacing
        if ox != 0.0 or oy != 0.0 or oz != 0.0:
            way = np.sqrt(ox * ox + oy * oy + oz * oz)
            distance += way / inverse_spacing
            dx, dy, dz = ox / way if ox != 0.0 else dx, oy / way if oy != 0.0 else dy, oz / way if oz != 0.0 else dz
        slopes[i, 0], slopes[i, 1], slopes[i, 2] = dx, dy, dz
        side, weight = traits[i, 0], traits[i, 1]
        if side * distance < 0.0:
            if moved == 0.0:
                clear[i] = max(distance, 0.0)
            weight = 0.0
        elif side >= 0.0:
            dot = -dx * outward[i, 0] - dy * outward[i, 1] - dz * outward[i, 2]
            across, rise = 0.0, 0.0
            for a in range(3):
                across += slopes[i, a] * stretch[a]
                rise += outward[i, a] * stretch[a]
            slack = _slack(dot, dx * dx + dy * dy + dz * dz, across + dot * rise, traits[i, 2], traits[i, 3])
            if slack > 0.0:
                weight /= np.sqrt(1.0 + (weight * slack) ** 2 / 3.0)
        weights[i], residual[i] = weight, weight * distance
        for a in range(3):
            slopes[i, a] *= weight


@part
def find_normals(grid: Grid, run: Run, cells: Cells) -> None:
    """Computes the weighted normals at the places."""
    values, origin, inverse_spacing = grid
    flat = values.reshape(-1)
    nx, ny, nz = values.shape[0], values.shape[1], values.shape[2]
    sy, sx = np.uintp(4 * nz), np.uintp(4 * nz * ny)
    places, normals = cells.places, cells.normals
    for i in range(run[0], run[1]):
        if cells.weights[i] == 0.0:
            normals[i, 0] = normals[i, 1] = normals[i, 2] = 0.0
            continue
        ix, fx, _ = cell(places[i, 0], origin[0], inverse_spacing, nx - 1.0)
        iy, fy, _ = cell(places[i, 1], origin[1], inverse_spacing, ny - 1.0)
        iz, fz, _ = cell(places[i, 2], origin[2], inverse_spacing, nz - 1.0)
        at = np.uintp(4 * ((ix * ny + iy) * nz + iz))
        square = SOFT_LENGTH**2
        for a in range(3):
            normals[i, a] = interpolate(flat, at + np.uintp(1 + a), sx, sy, fx, fy, fz)[0]
            square += normals[i, a] ** 2
        for a in range(3):
            normals[i, a] *= cells.weights[i] / np.sqrt(square)


@inlined
def _slack(dot, square, stretched, depth, width):
    """How far a pressed cell's point may be from a surface that only a part of the cell feels, see `PatchCells`.

    Given are the component of the gradient along the pad's inward normal, the gradient's squared length, and its
    component in the pad along the stretch.
    """
    along = max(square - dot * dot, 0.0) + stretched * stretched
    dot = max(dot, 0.0)
    if width * width * along <= depth * depth * dot * dot:
        return 0.0
    return (np.sqrt(width * np.sqrt(along)) - np.sqrt(depth * dot)) ** 2
