"""Poses that put two contacts on two surface samples, and their cost on the coarse field, vectorised over lanes.

Rows of lanes, as in `kernels.lane_kernels`: whatever differs between lanes (which samples, which voxels) is gathered
into rows first, so that the loops over lanes have no branches. Single precision doubles the vector width and suffices:
the samples lie millimetres beside the contacts, and the voxels err by a third of that.
"""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import inlined, part
from tactopose_drake.core.kernel_types import Floats1, Floats2, Ints1, Longs2, OutSingles1, Shape3, Shorts2, Singles1

LANES = 64
# Offsets of rows: midpoint of the two samples; the frame's axes in O; the samples' normals; the spin.
MIDDLE, AXES, _NORMALS, COSINE, SINE = (np.uintp(LANES * row) for row in (0, 3, 12, 18, 19))
# Of a contact: index of its voxel; its distance outside of the field, in voxels; its normal in O.
_VOXEL, _OUTSIDE, _TURNED = (np.uintp(LANES * row) for row in (20, 21, 22))
# Cost of all contacts together, and of the most expensive one.
COST, DEAREST = (np.uintp(LANES * row) for row in (25, 26))
SIZE = LANES * 27
"""Length of all rows together."""

_1, _2, _3, _4, _5, _6, _7, _8 = (np.uintp(LANES * row) for row in range(1, 9))
# Constants in single precision: a double would promote the whole expression.
_ZERO, _HALF, _ONE, _NONE, _STEP = (np.float32(value) for value in (0.0, 0.5, 1.0, 1e-15, 1.0 / 127.0))


class Samples(NamedTuple):
    """An object's surface samples (n, 3), their normals (n, 3), and pairs of them (m, 2); read-only."""

    points: Floats2
    normals: Floats2
    pairs: Shorts2


class Field(NamedTuple):
    """A `CoarseField`, read-only.

    The four bytes of each voxel are packed into an integer, lowest byte first. The inverse spacing is in 1/m; `steps`
    is the number of distance steps in a voxel.
    """

    values: Ints1
    shape: Shape3
    origin: Floats1
    inverse_spacing: float
    steps: float


@inlined
def axes_along(x, y, z):
    """Three axes as rows: x along a vector, any y and z.

    Source: T. Duff et al., Building an orthonormal basis, revisited, J. Comput. Graph. Tech. 6, 2017.
    """
    length = np.sqrt(x * x + y * y + z * z)
    x, y, z = x / length, y / length, z / length
    sign = _ONE if z >= _ZERO else -_ONE
    a = -_ONE / (sign + z)
    b = x * y * a
    return (x, y, z), (_ONE + sign * x * x * a, sign * b, -sign * x), (b, sign + y * y * a, -y)


@part
def place(samples: Samples, ends: Longs2, lanes: int, w: OutSingles1) -> None:
    """Places the frame of two contacts on pairs of samples (LANES, 2), up to its rotation about the line."""
    points, normals = samples.points, samples.normals
    for lane in range(np.uintp(lanes)):
        i, j = np.uintp(ends[lane, 0]), np.uintp(ends[lane, 1])
        for c in range(np.uintp(3)):
            row = np.uintp(LANES) * c + lane
            w[MIDDLE + row] = 0.5 * (points[i, c] + points[j, c])
            w[AXES + row] = points[j, c] - points[i, c]
            w[_NORMALS + row], w[_NORMALS + _3 + row] = normals[i, c], normals[j, c]
    for lane in range(np.uintp(lanes)):
        row = AXES + lane
        x, y, z = axes_along(w[row], w[row + _1], w[row + _2])
        w[row], w[row + _1], w[row + _2] = x
        w[row + _3], w[row + _4], w[row + _5] = y
        w[row + _6], w[row + _7], w[row + _8] = z


@part
def fit_spins(first: Singles1, second: Singles1, lanes: int, w: OutSingles1) -> None:
    """The rotation about the line that best aligns the normals of the pair's contacts (8,) with the samples'."""
    first_y, first_z, second_y, second_z = first[4], first[5], second[4], second[5]
    for lane in range(np.uintp(lanes)):
        across, up = _across(w, _NORMALS + lane, AXES + lane)
        cosine, sine = across * first_y + up * first_z, across * first_z - up * first_y
        across, up = _across(w, _NORMALS + _3 + lane, AXES + lane)
        cosine += across * second_y + up * second_z
        cosine += _NONE  # With normals along the line, or that ask for opposite spins, the spin is zero.
        sine += across * second_z - up * second_y
        scale = _ONE / np.sqrt(cosine * cosine + sine * sine)
        w[COSINE + lane], w[SINE + lane] = cosine * scale, sine * scale


@inlined
def _across(w, normal, row):
    """A normal's components along y and z of the axes that begin at a row."""
    a, b, c = w[normal], w[normal + _1], w[normal + _2]
    across = a * w[row + _3] + b * w[row + _4] + c * w[row + _5]
    return across, a * w[row + _6] + b * w[row + _7] + c * w[row + _8]


@part
def turn(lanes: int, w: OutSingles1) -> None:
    """Rotates y and z of the frame by the spin, which aligns its own normals with the samples'."""
    for lane in range(np.uintp(lanes)):
        cosine, sine, row = w[COSINE + lane], w[SINE + lane], AXES + lane
        y0, y1, y2 = w[row + _3], w[row + _4], w[row + _5]
        z0, z1, z2 = w[row + _6], w[row + _7], w[row + _8]
        w[row + _3], w[row + _4], w[row + _5] = (
            cosine * y0 - sine * z0,
            cosine * y1 - sine * z1,
            cosine * y2 - sine * z2,
        )
        w[row + _6], w[row + _7], w[row + _8] = (
            sine * y0 + cosine * z0,
            sine * y1 + cosine * z1,
            sine * y2 + cosine * z2,
        )


@part
def add_cost(field: Field, contact: Singles1, lanes: int, w: OutSingles1) -> None:
    """Adds the squared whitened residuals of a contact (8,), see `_lay_out`, to the costs; keeps the largest."""
    values, steps, per_voxel = field.values, np.float32(field.steps), np.float32(field.inverse_spacing)
    nx, ny, nz = field.shape
    most_x, most_y, most_z = np.float32(nx - 1), np.float32(ny - 1), np.float32(nz - 1)
    row_y, row_x = np.float32(nz), np.float32(ny * nz)
    x0, y0, z0 = np.float32(field.origin[0]), np.float32(field.origin[1]), np.float32(field.origin[2])
    px, py, pz, n0, n1, n2 = contact[0], contact[1], contact[2], contact[3], contact[4], contact[5]
    weight_d, weight_n, bits = contact[6], contact[7], w.view(np.int32)
    for lane in range(np.uintp(lanes)):
        row = AXES + lane
        # In voxels from the centre of the first one.
        u = (w[MIDDLE + lane] - x0) * per_voxel + px * w[row] + py * w[row + _3] + pz * w[row + _6]
        v = (w[MIDDLE + _1 + lane] - y0) * per_voxel + px * w[row + _1] + py * w[row + _4] + pz * w[row + _7]
        t = (w[MIDDLE + _2 + lane] - z0) * per_voxel + px * w[row + _2] + py * w[row + _5] + pz * w[row + _8]
        a, b, c = min(max(u, _ZERO), most_x), min(max(v, _ZERO), most_y), min(max(t, _ZERO), most_z)
        w[_OUTSIDE + lane] = np.sqrt((u - a) * (u - a) + (v - b) * (v - b) + (t - c) * (t - c))
        a, b, c = np.float32(np.int32(a + _HALF)), np.float32(np.int32(b + _HALF)), np.float32(np.int32(c + _HALF))
        w[_VOXEL + lane] = a * row_x + b * row_y + c
        w[_TURNED + lane] = n0 * w[row] + n1 * w[row + _3] + n2 * w[row + _6]
        w[_TURNED + _1 + lane] = n0 * w[row + _1] + n1 * w[row + _4] + n2 * w[row + _7]
        w[_TURNED + _2 + lane] = n0 * w[row + _2] + n1 * w[row + _5] + n2 * w[row + _8]
    for lane in range(np.uintp(lanes)):
        bits[_VOXEL + lane] = values[np.uintp(np.int32(w[_VOXEL + lane]))]
    for lane in range(np.uintp(lanes)):
        # A left shift moves a byte to the top; an arithmetic right shift then extends its sign.
        v = bits[_VOXEL + lane]
        d = np.float32(np.int32(v << 24) >> 24) + steps * w[_OUTSIDE + lane]
        e = np.float32(np.int32(v << 16) >> 24) * _STEP - w[_TURNED + lane]
        f = np.float32(np.int32(v << 8) >> 24) * _STEP - w[_TURNED + _1 + lane]
        g = np.float32(v >> 24) * _STEP - w[_TURNED + _2 + lane]
        own = d * d * weight_d + (e * e + f * f + g * g) * weight_n
        w[COST + lane] += own
        w[DEAREST + lane] = max(w[DEAREST + lane], own)
