"""Compiled loops of the densities of a mixture of Student-t densities over poses; see `student_t_mixture.py`."""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import kernel, part
from tactopose_drake.core.kernel_types import Floats1, Floats2, Floats3, Longs1, OutFloats2
from tactopose_drake.core.kernels import pose_kernels

# Number of poses compared with a component at a time, so that they fit into the first-level cache.
_LANES = 256


class Components(NamedTuple):
    """The components of a mixture, sorted by group.

    Attributes:
        first: index of the first component of each group, and the number of components at the end, shape (g + 1,).
        center: increments from the group's pose, shape (n, 6).
        information: with the turns projected out, shape (n, 6, 6).
        reach: squared translation within which a pose may belong to each group, shape (g,), m^2.
        scale: the densities' normalising constants, times the number of samples of each, shape (n,).
    """

    first: Longs1
    center: Floats2
    information: Floats3
    reach: Floats1
    scale: Floats1


@kernel
def add_densities(
    components: Components, freedom: int, power: int, X_group: Floats3, X: Floats3, density: OutFloats2
) -> None:
    """Adds each group's density at poses X (B, 3, 4) to density (B, g).

    It is the sum over components of scale (f / (f + d^T H d))^(power / 2), with d from the component's centre, over the
    determinant of the right Jacobian of the rotation, which is the volume of increments over that of poses. The poses
    within a group's reach are gathered block by block, as a structure of arrays, so that the density of a component is
    vectorised over poses.
    """
    first, center, information, reach, scale = components
    near, lanes = np.empty(_LANES, dtype=np.int64), np.empty((19, _LANES))
    for begin in range(0, X.shape[0], _LANES):
        for g in range(reach.shape[0]):
            count = 0
            for b in range(begin, min(begin + _LANES, X.shape[0])):
                square = 0.0
                for i in range(3):
                    square += (X[b, i, 3] - X_group[g, i, 3]) ** 2
                if square > reach[g]:
                    continue
                near[count], lanes[8, count] = b, 0.0
                for i in range(3):
                    lanes[3 + i, count] = X[b, i, 3] - X_group[g, i, 3]
                    for c in range(3):
                        lanes[10 + 3 * i + c, count] = X[b, i, c]
                count += 1
            _fill_rotations(X_group[g], lanes, count)
            for j in range(first[g], first[g + 1]):
                _add_density(center[j], information[j], scale[j], freedom, power, lanes, count)
            for k in range(count):
                density[near[k], g] += lanes[8, k] / lanes[9, k]


@part
def _fill_rotations(X: Floats2, lanes: OutFloats2, count: int) -> None:
    """The rotation vectors from pose X to `count` rotations, and the determinants of their right Jacobians.

    lanes (19, n): three rows of rotation vectors to fill, six not used here, one of determinants to fill, and nine of
    rotations.

    With a rotation's cosine c and its axis times its sine, its vector is the latter times a scale, angle / sine. The
    angle is 16 atan(tan(angle / 16)), by three half-angle formulas from tan(angle / 2) = sine / (1 + c) and the Taylor
    series of atan, whose first term left out is below 1e-14; the tangents cancel the sine, so small angles lose no
    digits. The determinant is 2 (1 - c) / angle^2. These have no branches, and are vectorised. Near a half turn, where
    the axis must be found otherwise, the vector is that of `increment_between`.
    """
    X00, X10, X20, X01, X11, X21 = X[0, 0], X[1, 0], X[2, 0], X[0, 1], X[1, 1], X[2, 1]
    X02, X12, X22 = X[0, 2], X[1, 2], X[2, 2]
    for k in range(count):
        Y00, Y01, Y02 = lanes[10, k], lanes[11, k], lanes[12, k]
        Y10, Y11, Y12 = lanes[13, k], lanes[14, k], lanes[15, k]
        Y20, Y21, Y22 = lanes[16, k], lanes[17, k], lanes[18, k]
        x = 0.5 * ((X02 * Y01 + X12 * Y11 + X22 * Y21) - (X01 * Y02 + X11 * Y12 + X21 * Y22))
        y = 0.5 * ((X00 * Y02 + X10 * Y12 + X20 * Y22) - (X02 * Y00 + X12 * Y10 + X22 * Y20))
        z = 0.5 * ((X01 * Y00 + X11 * Y10 + X21 * Y20) - (X00 * Y01 + X10 * Y11 + X20 * Y21))
        trace = (X00 * Y00 + X10 * Y10 + X20 * Y20) + (X01 * Y01 + X11 * Y11 + X21 * Y21)
        trace += X02 * Y02 + X12 * Y12 + X22 * Y22
        half = 2.0 / (1.0 + trace)  # 1 / (1 + c)
        tangent2 = (x * x + y * y + z * z) * half * half
        fourth = 1.0 / (1.0 + np.sqrt(1.0 + tangent2))
        tangent2 *= fourth * fourth
        eighth = 1.0 / (1.0 + np.sqrt(1.0 + tangent2))
        tangent2 *= eighth * eighth
        sixteenth = 1.0 / (1.0 + np.sqrt(1.0 + tangent2))
        t = -tangent2 * sixteenth * sixteenth
        series = 1.0 / 13.0 + t * (1.0 / 15.0 + t * (1.0 / 17.0))
        series = 1.0 / 7.0 + t * (1.0 / 9.0 + t * (1.0 / 11.0 + t * series))
        series = 1.0 + t * (1.0 / 3.0 + t * (1.0 / 5.0 + t * series))
        scale = 16.0 * series * half * fourth * eighth * sixteenth
        lanes[0, k], lanes[1, k], lanes[2, k] = scale * x, scale * y, scale * z
        lanes[6, k], lanes[9, k] = trace, 2.0 * half / (scale * scale)
    Y, u = np.empty((3, 4)), np.empty(6)
    for k in range(count):
        if lanes[6, k] < -0.98:
            for i in range(3):
                Y[i, 3] = X[i, 3]
                for c in range(3):
                    Y[i, c] = lanes[10 + 3 * i + c, k]
            pose_kernels.increment_between(X, Y, u)
            for i in range(3):
                lanes[i, k] = u[i]
            lanes[9, k] = (3.0 - lanes[6, k]) / (u[0] ** 2 + u[1] ** 2 + u[2] ** 2)


@part
def _add_density(
    center: Floats1, information: Floats2, scale: float, freedom: int, power: int, lanes: OutFloats2, count: int
) -> None:
    """Adds one component's density, without the volume, at `count` increments.

    lanes (19, n): six rows of increments, two of scratch, the sums that the density is added to, and ten not used here.
    """
    c, H, f = center, information, float(freedom)
    c0, c1, c2, c3, c4, c5 = c[0], c[1], c[2], c[3], c[4], c[5]
    H00, H11, H22, H33, H44, H55 = H[0, 0], H[1, 1], H[2, 2], H[3, 3], H[4, 4], H[5, 5]
    # Twice what is below the diagonal.
    H10, H20, H21 = 2.0 * H[1, 0], 2.0 * H[2, 0], 2.0 * H[2, 1]
    H30, H31, H32 = 2.0 * H[3, 0], 2.0 * H[3, 1], 2.0 * H[3, 2]
    H40, H41, H42, H43 = 2.0 * H[4, 0], 2.0 * H[4, 1], 2.0 * H[4, 2], 2.0 * H[4, 3]
    H50, H51, H52, H53, H54 = 2.0 * H[5, 0], 2.0 * H[5, 1], 2.0 * H[5, 2], 2.0 * H[5, 3], 2.0 * H[5, 4]
    for k in range(count):
        x, y, z = lanes[0, k] - c0, lanes[1, k] - c1, lanes[2, k] - c2
        r, s, t = lanes[3, k] - c3, lanes[4, k] - c4, lanes[5, k] - c5
        square = x * (H00 * x) + y * (H10 * x + H11 * y)
        square += z * (H20 * x + H21 * y + H22 * z)
        square += r * (H30 * x + H31 * y + H32 * z + H33 * r)
        square += s * (H40 * x + H41 * y + H42 * z + H43 * r + H44 * s)
        square += t * (H50 * x + H51 * y + H52 * z + H53 * r + H54 * s + H55 * t)
        ratio = f / (f + square)
        lanes[6, k] = ratio
        lanes[7, k] = scale * (np.sqrt(ratio) if power % 2 else 1.0)
    for _ in range(power // 2):
        for k in range(count):
            lanes[7, k] *= lanes[6, k]
    for k in range(count):
        lanes[8, k] += lanes[7, k]
