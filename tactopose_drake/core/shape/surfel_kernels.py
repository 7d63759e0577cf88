"""The density of contacts over a surface of many small discs, compiled."""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import inlined, kernel
from tactopose_drake.core.kernel_types import Floats1, Floats2, Floats3, Ints1, OutFloats2, Shape3, Singles2, Singles3

# Number of discs that are evaluated at once: the layout of `Surfels.blocks`.
BLOCK = 8
# The exponent of a disc's density is capped at this value, the limit of `_exp_minus`.
_MOST = 24.0
# Offsets of a block's rows: see `Surfels.blocks`.
_Y, _Z, _NX, _NY, _NZ, _AREA, _SPREAD, _ROUGHNESS, _WHOLE = (np.uintp(BLOCK * row) for row in range(1, 10))


class Discs(NamedTuple):
    """The discs of `Surfels`, sorted into cells; read-only.

    Attributes:
        blocks: of BLOCK discs each, shape (b, 9, BLOCK).
        balls: bounding ball of each block: centre, m, and radius, m, shape (b, 4).
        first: see `Surfels.first`.
        origin: the first cell's lower corner, shape (3,), m.
        per_cell: inverse of a cell's width, 1/m.
        shape: number of cells along x, y and z.
        spacing: approximate distance between neighbours, m.
        reach: standard deviations within which discs count.
    """

    blocks: Singles3
    balls: Singles2
    first: Ints1
    origin: Floats1
    per_cell: float
    shape: Shape3
    spacing: float
    reach: float


class Measurements(NamedTuple):
    """Contacts, read-only.

    Points (k, 3), m, and unit normals (k, 3) in P; sigma of coordinates (k,), m, and inverse sigma of each normal (k,),
    1/rad, zero without one.
    """

    p: Floats2
    n: Floats2
    sigma_position: Floats1
    weight_normal: Floats1


@inlined
def _exp_minus(x):
    """exp(-x) of a float32, to 1e-4 for 0 <= x < 12 and 2 % up to 24, in half the time of the library's.

    The 32nd power of a truncated series for exp(-x / 32).
    """
    y, one = x * np.float32(-1.0 / 32.0), np.float32(1.0)
    third = np.float32(1.0 / 6.0) + y * (np.float32(1.0 / 24.0) + y * np.float32(1.0 / 120.0))
    power = one + y * (one + y * (np.float32(0.5) + y * third))
    power = power * power
    power = power * power
    power = power * power
    power = power * power
    return power * power


@inlined
def _blocks_near(discs, q, low, high, reach, near):
    """Writes the blocks within reach of a point q (3,) in O, m, to `near`; returns their number.

    It scans the cells from `low` to `high` (3,) by columns, and in each the blocks of their discs, without
    unpredictable branches. Discs of neighbouring cells in the first and last block count too, as they are in no other
    column.
    """
    x, y, z, count = np.float32(q[0]), np.float32(q[1]), np.float32(q[2]), np.uintp(0)
    balls, first, shape = discs.balls, discs.first, discs.shape
    for a in range(low[0], high[0] + 1):
        for c in range(low[1], high[1] + 1):
            column = (a * shape[1] + c) * (shape[2] + 1)
            begin = np.uintp(first[column + low[2]]) // np.uintp(BLOCK)
            end = np.uintp(first[column + high[2] + 1] + BLOCK - 1) // np.uintp(BLOCK)
            for block in range(begin, end):
                dx, dy, dz = x - balls[block, 0], y - balls[block, 1], z - balls[block, 2]
                far = reach + balls[block, 3]
                near[count] = block
                count += np.uintp(dx * dx + dy * dy + dz * dz <= far * far)
    return count


@kernel
def densities(discs: Discs, measured: Measurements, X: Floats3, density: OutFloats2) -> None:
    """Fills density (B, k) of each contact at each pose, relative to a flat surface with the right normal.

    It is the sum over the discs in blocks within reach.
    """
    blocks, _, _, origin, per_cell, shape, spacing, sigmas = discs
    p, n, sigma, weight_n = measured
    numbers, width = blocks.reshape(-1), np.uintp(blocks.shape[2])
    q, m, shares = np.empty(3), np.empty(3), np.empty(BLOCK, dtype=np.float32)
    low, high = np.empty(3, dtype=np.int64), np.empty(3, dtype=np.int64)
    near = np.empty(blocks.shape[0], dtype=np.uint32)
    one, half, most = np.float32(1.0), np.float32(0.5), np.float32(_MOST)
    for b in range(X.shape[0]):
        for i in range(p.shape[0]):
            reach = sigmas * sigma[i] + 0.5 * spacing
            x, y, z = p[i, 0] - X[b, 0, 3], p[i, 1] - X[b, 1, 3], p[i, 2] - X[b, 2, 3]
            empty = False
            for a in range(3):
                q[a] = X[b, 0, a] * x + X[b, 1, a] * y + X[b, 2, a] * z
                m[a] = X[b, 0, a] * n[i, 0] + X[b, 1, a] * n[i, 1] + X[b, 2, a] * n[i, 2]
                low[a] = max(0, int(np.floor((q[a] - reach - origin[a]) * per_cell)))
                high[a] = min(shape[a] - 1, int(np.floor((q[a] + reach - origin[a]) * per_cell)))
                if high[a] < low[a]:
                    empty = True
                    break
            if empty:
                density[b, i] = 0.0
                continue
            for j in range(BLOCK):
                shares[j] = 0.0
            q0, q1, q2 = np.float32(q[0]), np.float32(q[1]), np.float32(q[2])
            m0, m1, m2 = np.float32(m[0]), np.float32(m[1]), np.float32(m[2])
            variance, per_across = np.float32(sigma[i] ** 2), np.float32(0.5 / sigma[i] ** 2)
            per_normal = np.float32(weight_n[i] ** 2)
            count = _blocks_near(discs, q, low, high, np.float32(sigmas * sigma[i]), near)
            for place in range(count):
                start = np.uintp(near[place]) * _WHOLE
                # With a length known at compile time, the loop would be unrolled instead of vectorised.
                for j in range(width):
                    k = start + j
                    nx, ny, nz = numbers[k + _NX], numbers[k + _NY], numbers[k + _NZ]
                    dx, dy, dz = q0 - numbers[k], q1 - numbers[k + _Y], q2 - numbers[k + _Z]
                    d = dx * nx + dy * ny + dz * nz
                    square = dx * dx + dy * dy + dz * dz - d * d
                    # A single division for both factors.
                    wider = variance + numbers[k + _SPREAD]
                    rougher = one + per_normal * numbers[k + _ROUGHNESS]
                    both = one / (wider * rougher)
                    exponent = per_across * d * d + half * rougher * both * square
                    # Half the squared difference of unit vectors is one minus their product.
                    turned = one - (m0 * nx + m1 * ny + m2 * nz)
                    exponent += per_normal * wider * both * turned
                    shares[j] += numbers[k + _AREA] * both * _exp_minus(min(exponent, most))
            total = np.float32(0.0)
            for j in range(BLOCK):
                total += shares[j]
            density[b, i] = total / (2.0 * np.pi)
