"""What the compiled loops over poses share: points and normals in O, derivatives and increments of poses.

Poses are (3, 4), or (B, 3, 4) for a batch; increments (w, v) as in `poses.py`.
"""

import numpy as np

from tactopose_drake.core.compilation import inlined, kernel, part
from tactopose_drake.core.kernel_types import Floats1, Floats2, Floats3, OutFloats1, OutFloats3


@part
def to_object(X: Floats2, p: Floats1, q: OutFloats1) -> None:
    """q = R^T (p - t) for one pose X (3, 4)."""
    dx, dy, dz = p[0] - X[0, 3], p[1] - X[1, 3], p[2] - X[2, 3]
    for a in range(3):
        q[a] = X[0, a] * dx + X[1, a] * dy + X[2, a] * dz


@part
def rotate_to_object(X: Floats2, n: Floats1, m: OutFloats1) -> None:
    """m = R^T n for one pose X (3, 4)."""
    for a in range(3):
        m[a] = X[0, a] * n[0] + X[1, a] * n[1] + X[2, a] * n[2]


@inlined
def chain(row, q, X, weight, J):
    """Converts a derivative with respect to the point in O to one by the increment: dq = [q]x w - R^T v."""
    J[0] = weight * (row[1] * q[2] - row[2] * q[1])
    J[1] = weight * (row[2] * q[0] - row[0] * q[2])
    J[2] = weight * (row[0] * q[1] - row[1] * q[0])
    for a in range(3):
        J[3 + a] = -weight * (X[a, 0] * row[0] + X[a, 1] * row[1] + X[a, 2] * row[2])


@inlined
def turn_normal(m, weight, J):
    """Adds to rows 1 to 3 the rotation of the measured normal by the increment: d(R^T n) = [m]x w."""
    J[1, 1] += m[2] * weight
    J[1, 2] -= m[1] * weight
    J[2, 0] -= m[2] * weight
    J[2, 2] += m[0] * weight
    J[3, 0] += m[1] * weight
    J[3, 1] -= m[0] * weight


@inlined
def turn_translations(X, g, H, gradient, hessian):
    """Gradient and Hessian by (w, v) from those by (w, R^T v), of which H is the lower triangle."""
    for a in range(3):
        gradient[a] = g[a]
        gradient[3 + a] = X[a, 0] * g[3] + X[a, 1] * g[4] + X[a, 2] * g[5]
        for c in range(a + 1):
            hessian[a, c] = hessian[c, a] = H[a, c]
            H[3 + c, 3 + a] = H[3 + a, 3 + c]
        for c in range(3):
            mixed = X[a, 0] * H[3, c] + X[a, 1] * H[4, c] + X[a, 2] * H[5, c]
            hessian[3 + a, c] = hessian[c, 3 + a] = mixed
    for a in range(3):
        x = X[a, 0] * H[3, 3] + X[a, 1] * H[4, 3] + X[a, 2] * H[5, 3]
        y = X[a, 0] * H[3, 4] + X[a, 1] * H[4, 4] + X[a, 2] * H[5, 4]
        z = X[a, 0] * H[3, 5] + X[a, 1] * H[4, 5] + X[a, 2] * H[5, 5]
        for c in range(a + 1):
            both = x * X[c, 0] + y * X[c, 1] + z * X[c, 2]
            hessian[3 + a, 3 + c] = hessian[3 + c, 3 + a] = both


@inlined
def retract_one(X, increment, out):
    """R exp(w), p + v for one pose (3, 4) and increment (6,)."""
    x, y, z = increment[0], increment[1], increment[2]
    angle2 = x * x + y * y + z * z
    if angle2 < 1e-8:
        s, c = 1.0 - angle2 / 6.0, 0.5 - angle2 / 24.0
    else:
        angle = np.sqrt(angle2)
        s, c = np.sin(angle) / angle, (1.0 - np.cos(angle)) / angle2
    e00, e01, e02 = 1.0 - c * (y * y + z * z), c * x * y - s * z, c * x * z + s * y
    e10, e11, e12 = c * x * y + s * z, 1.0 - c * (x * x + z * z), c * y * z - s * x
    e20, e21, e22 = c * x * z - s * y, c * y * z + s * x, 1.0 - c * (x * x + y * y)
    for i in range(3):
        a, b, c = X[i, 0], X[i, 1], X[i, 2]
        out[i, 0] = a * e00 + b * e10 + c * e20
        out[i, 1] = a * e01 + b * e11 + c * e21
        out[i, 2] = a * e02 + b * e12 + c * e22
        out[i, 3] = X[i, 3] + increment[3 + i]


@kernel
def retract(X: Floats3, increment: Floats2, out: OutFloats3) -> None:
    """The compiled `poses.retract`: R exp(w), p + v for poses (B, 3, 4), or one (1, 3, 4), and increments (B, 6)."""
    for b in range(increment.shape[0]):
        retract_one(X[min(b, X.shape[0] - 1)], increment[b], out[b])


@inlined
def compose_one(X, Y, out):
    """The pose X Y; all (3, 4)."""
    for i in range(3):
        for j in range(4):
            out[i, j] = X[i, 0] * Y[0, j] + X[i, 1] * Y[1, j] + X[i, 2] * Y[2, j]
        out[i, 3] += X[i, 3]


@inlined
def increment_between(X, Y, out):
    """The increment (w, v) from the pose X to Y, both (3, 4), into out (6,)."""
    for i in range(3):
        out[3 + i] = Y[i, 3] - X[i, 3]
    r00 = X[0, 0] * Y[0, 0] + X[1, 0] * Y[1, 0] + X[2, 0] * Y[2, 0]
    r01 = X[0, 0] * Y[0, 1] + X[1, 0] * Y[1, 1] + X[2, 0] * Y[2, 1]
    r02 = X[0, 0] * Y[0, 2] + X[1, 0] * Y[1, 2] + X[2, 0] * Y[2, 2]
    r10 = X[0, 1] * Y[0, 0] + X[1, 1] * Y[1, 0] + X[2, 1] * Y[2, 0]
    r11 = X[0, 1] * Y[0, 1] + X[1, 1] * Y[1, 1] + X[2, 1] * Y[2, 1]
    r12 = X[0, 1] * Y[0, 2] + X[1, 1] * Y[1, 2] + X[2, 1] * Y[2, 2]
    r20 = X[0, 2] * Y[0, 0] + X[1, 2] * Y[1, 0] + X[2, 2] * Y[2, 0]
    r21 = X[0, 2] * Y[0, 1] + X[1, 2] * Y[1, 1] + X[2, 2] * Y[2, 1]
    r22 = X[0, 2] * Y[0, 2] + X[1, 2] * Y[1, 2] + X[2, 2] * Y[2, 2]
    x, y, z = 0.5 * (r21 - r12), 0.5 * (r02 - r20), 0.5 * (r10 - r01)
    sine, cosine = np.sqrt(x * x + y * y + z * z), 0.5 * (r00 + r11 + r22 - 1.0)
    angle = np.arctan2(sine, cosine)
    if cosine > -0.99:
        scale = angle / sine if sine > 1e-12 else 1.0
        out[0], out[1], out[2] = scale * x, scale * y, scale * z
    else:  # Near a half turn the axis n comes from the largest column of (R + R^T) / 2 - cos = (1 - cos) n n^T.
        if r00 >= r11 and r00 >= r22:
            a, b, c = r00 - cosine, 0.5 * (r01 + r10), 0.5 * (r02 + r20)
        elif r11 >= r22:
            a, b, c = 0.5 * (r01 + r10), r11 - cosine, 0.5 * (r12 + r21)
        else:
            a, b, c = 0.5 * (r02 + r20), 0.5 * (r12 + r21), r22 - cosine
        scale = angle / np.sqrt(a * a + b * b + c * c)
        if a * x + b * y + c * z < 0.0:
            scale = -scale
        out[0], out[1], out[2] = scale * a, scale * b, scale * c
