"""The density of contacts over a surface of many small discs."""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import (
    Floats1,
    Floats2,
    Floats3,
    Ints1,
    OutFloats2,
    Shape3,
    Singles2,
    inlined,
    kernel,
)

# So many discs are reckoned at once: the layout of `Surfels.discs`, and loops whose length the compiler knows.
BLOCK = 16
# No disc counts for less than the exponential of minus this, which is as far as `_exp_minus` holds.
_MOST = 24.0


class Discs(NamedTuple):
    """The discs of `Surfels`, sorted into cells; read-only.

    Attributes:
        rows: one for each number of a disc, shape (9, n + BLOCK).
        first: the number of discs in the cells before each.
        origin: the first cell's lower corner, shape (3,), m.
        per_cell: one over a cell's width, 1/m.
        shape: number of cells along x, y and z.
        spacing: about the distance between neighbours, m.
        reach: discs count within so many standard deviations.
    """

    rows: Singles2
    first: Ints1
    origin: Floats1
    per_cell: float
    shape: Shape3
    spacing: float
    reach: float


class Measurements(NamedTuple):
    """Contacts, read-only: points (k, 3), m, and unit normals (k, 3) in P; sigma of coordinates (k,), m, and one over
    sigma of each normal (k,), 1/rad, zero where there is none.
    """

    p: Floats2
    n: Floats2
    sigma_position: Floats1
    weight_normal: Floats1


@inlined
def _exp_minus(x):
    """exp(-x) of a float32, to a ten-thousandth where 0 <= x < 12 and 2 % up to 24: the library's takes twice as long.

    The 32nd power of a short series for exp(-x / 32).
    """
    y, one = x * np.float32(-1.0 / 32.0), np.float32(1.0)
    third = np.float32(1.0 / 6.0) + y * (np.float32(1.0 / 24.0) + y * np.float32(1.0 / 120.0))
    power = one + y * (one + y * (np.float32(0.5) + y * third))
    power = power * power
    power = power * power
    power = power * power
    power = power * power
    return power * power


@kernel
def densities(discs: Discs, measured: Measurements, X: Floats3, density: OutFloats2) -> None:
    """The density of each contact at each pose, into density (B, k); on a flat surface with the right normal it is 1.

    Each number of the discs is an array by itself, read by unsigned offsets, which need no check of their sign, and
    in whole blocks: what of a run's last block lies behind its end counts for nothing.
    """
    rows, first, origin, per_cell, shape, spacing, sigmas = discs
    p, n, sigma, weight_n = measured
    x_disc, y_disc, z_disc, x_normal, y_normal, z_normal = rows[0], rows[1], rows[2], rows[3], rows[4], rows[5]
    area, spread, roughness = rows[6], rows[7], rows[8]
    q, m, shares = np.empty(3), np.empty(3), np.empty(BLOCK, dtype=np.float32)
    low, high = np.empty(3, dtype=np.int64), np.empty(3, dtype=np.int64)
    one, half = np.float32(1.0), np.float32(0.5)
    most = np.float32(_MOST)
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
                empty = empty or high[a] < low[a]
            for j in range(BLOCK):
                shares[j] = 0.0
            if not empty:
                q0, q1, q2 = np.float32(q[0]), np.float32(q[1]), np.float32(q[2])
                m0, m1, m2 = np.float32(m[0]), np.float32(m[1]), np.float32(m[2])
                variance, per_across = np.float32(sigma[i] ** 2), np.float32(0.5 / sigma[i] ** 2)
                per_normal = np.float32(weight_n[i] ** 2)
                for a in range(low[0], high[0] + 1):
                    for c in range(low[1], high[1] + 1):
                        row = (a * shape[1] + c) * shape[2]
                        begin = np.uintp(first[row + low[2]])
                        count = np.uintp(first[row + high[2] + 1]) - begin
                        for block in range(np.uintp(0), count, np.uintp(BLOCK)):
                            for j in range(np.uintp(BLOCK)):
                                k = begin + block + np.uintp(j)
                                dx, dy, dz = q0 - x_disc[k], q1 - y_disc[k], q2 - z_disc[k]
                                d = dx * x_normal[k] + dy * y_normal[k] + dz * z_normal[k]
                                square = dx * dx + dy * dy + dz * dz - d * d
                                # One division for both factors.
                                wider, rougher = variance + spread[k], one + per_normal * roughness[k]
                                both = one / (wider * rougher)
                                exponent = per_across * d * d + half * rougher * both * square
                                # Half the squared difference of unit vectors is one minus their product.
                                turned = one - (m0 * x_normal[k] + m1 * y_normal[k] + m2 * z_normal[k])
                                exponent += per_normal * wider * both * turned
                                # Without a branch, which would part the block.
                                share = area[k] * both * _exp_minus(min(exponent, most))
                                shares[j] += share if block + np.uintp(j) < count else np.float32(0.0)
            total = np.float32(0.0)
            for j in range(BLOCK):
                total += shares[j]
            density[b, i] = total / (2.0 * np.pi)
