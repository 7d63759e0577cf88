"""Poses that lay two contacts on two surface samples, and their cost on the coarse field, several at a time.

Rows of lanes, as in `kernels.lane_kernels`: what differs from lane to lane (which samples, which voxels) is copied into
rows first; a loop over lanes has no branches, and becomes four numbers to an instruction.
"""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import (
    Bytes2,
    Floats1,
    Floats2,
    Longs2,
    OutFloats1,
    Shape3,
    Shorts2,
    inlined,
    part,
)

LANES = 8
# Where rows begin: the point between two samples; the frame's axes in O; the samples' normals; the turn about the line.
MIDDLE, AXES, _NORMALS, COSINE, SINE = (np.uintp(LANES * row) for row in (0, 3, 12, 18, 19))
# Of a contact: its voxel, and what is read there; how far outside of the field it is, in voxels; its normal in O.
_VOXEL, _OUTSIDE, _TURNED = (np.uintp(LANES * row) for row in (20, 24, 25))
COST = np.uintp(LANES * 28)
SIZE = LANES * 29
"""Numbers that the rows take."""

_1, _2, _3, _4, _5, _6, _7, _8 = (np.uintp(LANES * row) for row in range(1, 9))


class Samples(NamedTuple):
    """An object's surface samples (n, 3), their normals (n, 3), and pairs of them (m, 2); read-only."""

    points: Floats2
    normals: Floats2
    pairs: Shorts2


class Field(NamedTuple):
    """A `CoarseField`, read-only, with one over its spacing, 1/m, and the steps of the distance in a voxel."""

    values: Bytes2
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
    sign = 1.0 if z >= 0.0 else -1.0
    a = -1.0 / (sign + z)
    b = x * y * a
    return (x, y, z), (1.0 + sign * x * x * a, sign * b, -sign * x), (b, sign + y * y * a, -y)


@part
def place(samples: Samples, ends: Longs2, lanes: int, w: OutFloats1) -> None:
    """Where so many pairs of samples (LANES, 2) lay a frame of two contacts, but for its turn about the line."""
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
def fit_spins(first: Floats1, second: Floats1, lanes: int, w: OutFloats1) -> None:
    """The turns that lay the normals of the pair's contacts (8,), see `_lay_out`, best on the samples'."""
    first_y, first_z, second_y, second_z = first[4], first[5], second[4], second[5]
    for lane in range(np.uintp(lanes)):
        across, up = _across(w, _NORMALS + lane, AXES + lane)
        cosine, sine = 1e-30 + (across * first_y + up * first_z), across * first_z - up * first_y
        across, up = _across(w, _NORMALS + _3 + lane, AXES + lane)
        cosine += across * second_y + up * second_z  # Normals along the line leave the spin at zero.
        sine += across * second_z - up * second_y
        scale = 1.0 / np.sqrt(cosine * cosine + sine * sine)
        w[COSINE + lane], w[SINE + lane] = cosine * scale, sine * scale


@inlined
def _across(w, normal, row):
    """A normal's components along y and z of the axes that begin at a row."""
    a, b, c = w[normal], w[normal + _1], w[normal + _2]
    across = a * w[row + _3] + b * w[row + _4] + c * w[row + _5]
    return across, a * w[row + _6] + b * w[row + _7] + c * w[row + _8]


@part
def turn(lanes: int, w: OutFloats1) -> None:
    """Turns y and z: the frame's are where its own normals are laid on the samples'."""
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
def add_cost(field: Field, contact: Floats1, lanes: int, w: OutFloats1) -> None:
    """Adds the squared whitened differences of a contact (8,), see `_lay_out`, to the costs."""
    values, steps, per_voxel = field.values, field.steps, field.inverse_spacing
    nx, ny, nz = field.shape
    most_x, most_y, most_z = nx - 1.0, ny - 1.0, nz - 1.0
    x0, y0, z0 = field.origin[0], field.origin[1], field.origin[2]
    px, py, pz, n0, n1, n2 = contact[0], contact[1], contact[2], contact[3], contact[4], contact[5]
    weight_d, weight_n = contact[6], contact[7]
    for lane in range(np.uintp(lanes)):
        row = AXES + lane
        # Voxels from the first one's centre.
        u = (w[MIDDLE + lane] - x0) * per_voxel + px * w[row] + py * w[row + _3] + pz * w[row + _6]
        v = (w[MIDDLE + _1 + lane] - y0) * per_voxel + px * w[row + _1] + py * w[row + _4] + pz * w[row + _7]
        t = (w[MIDDLE + _2 + lane] - z0) * per_voxel + px * w[row + _2] + py * w[row + _5] + pz * w[row + _8]
        a, b, c = min(max(u, 0.0), most_x), min(max(v, 0.0), most_y), min(max(t, 0.0), most_z)
        w[_OUTSIDE + lane] = np.sqrt((u - a) ** 2 + (v - b) ** 2 + (t - c) ** 2)
        w[_VOXEL + lane], w[_VOXEL + _1 + lane], w[_VOXEL + _2 + lane] = a + 0.5, b + 0.5, c + 0.5
        w[_TURNED + lane] = n0 * w[row] + n1 * w[row + _3] + n2 * w[row + _6]
        w[_TURNED + _1 + lane] = n0 * w[row + _1] + n1 * w[row + _4] + n2 * w[row + _7]
        w[_TURNED + _2 + lane] = n0 * w[row + _2] + n1 * w[row + _5] + n2 * w[row + _8]
    for lane in range(np.uintp(lanes)):
        row = _VOXEL + lane
        at = np.uintp((int(w[row]) * ny + int(w[row + _1])) * nz + int(w[row + _2]))
        for c in range(np.uintp(4)):
            w[row + np.uintp(LANES) * c] = values[at, c]
    for lane in range(np.uintp(lanes)):
        row = _VOXEL + lane
        d = w[row] + steps * w[_OUTSIDE + lane]
        e = w[row + _1] * (1.0 / 127.0) - w[_TURNED + lane]
        f = w[row + _2] * (1.0 / 127.0) - w[_TURNED + _1 + lane]
        g = w[row + _3] * (1.0 / 127.0) - w[_TURNED + _2 + lane]
        w[COST + lane] += d * d * weight_d + (e * e + f * f + g * g) * weight_n
