"""The equations of the intrinsic contact linearised on the surface, and Newton's method for them, compiled.

Everything is in the surface's frame F, for a wrench divided by its force: f is a unit vector and the moment m a length.
`surface_kernels.py` says what a surface is, `intrinsic_contact.py` explains the equations.
"""

import math
from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import part
from tactopose_drake.core.kernel_types import Floats1, OutFloats1, OutFloats2, Triple
from tactopose_drake.core.kernels.sorting_kernels import copy_vector
from tactopose_drake.core.surfaces.surface_kernels import evaluate_one, project

# Limits at which a search that does not converge is given up. They do not affect the result of one that does, which
# ends at rounding error, and are therefore no parameters.
MAX_ITERATIONS = 60
_MIN_FRACTION = 1e-4  # of a Newton step, below which the line search is given up


class Line(NamedTuple):
    """A wrench over its force: moment m and direction f in F, and the layer's compliance times the force, m."""

    m: Triple
    f: Triple
    compliance: float


class NewtonScratch(NamedTuple):
    """Scratch of Newton's method: gradient (3,), Hessian (3, 3), two states (18,) and a trial point (3,)."""

    g: OutFloats1
    H: OutFloats2
    here: OutFloats1
    there: OutFloats1
    trial: OutFloats1


@part
def linearize(
    kind: int,
    shape: Floats1,
    line: Line,
    q: Floats1,
    g: OutFloats1,
    H: OutFloats2,
    out: OutFloats1,
) -> None:
    """The equations at q, out (18,): residual (2), its Jacobian (2x2), f.n, torque; n, t1, t2; largest curvature.

    The residual is the part of e = m - p x f in the tangent plane (t1, t2); the rest, e.n, is the local torque. Its
    Jacobian is to a step along t1, t2: with the surface's curvature W (dn = W t), f_t the friction and the deformation
    d = -compliance f.n, p = q - d n,
        J = (f.n) [n]x (1 - d W) - compliance (n x f_t) (W f_t)^T - (e.n) W.
    """
    m, f, compliance = line
    evaluate_one(kind, shape, q[0], q[1], q[2], g, H)
    length = math.sqrt(g[0] * g[0] + g[1] * g[1] + g[2] * g[2])
    n0, n1, n2 = g[0] / length, g[1] / length, g[2] / length
    fn = f[0] * n0 + f[1] * n1 + f[2] * n2
    depth = -compliance * fn
    p0, p1, p2 = q[0] - depth * n0, q[1] - depth * n1, q[2] - depth * n2
    e0 = m[0] - (p1 * f[2] - p2 * f[1])
    e1 = m[1] - (p2 * f[0] - p0 * f[2])
    e2 = m[2] - (p0 * f[1] - p1 * f[0])
    torque = e0 * n0 + e1 * n1 + e2 * n2

    sign = math.copysign(1.0, n2)
    a = -1.0 / (sign + n2)
    t0, t1, t2 = 1.0 + sign * n0 * n0 * a, sign * n0 * n1 * a, -sign * n0
    s0, s1, s2 = n0 * n1 * a, sign + n1 * n1 * a, -n1
    u0 = (H[0, 0] * t0 + H[0, 1] * t1 + H[0, 2] * t2) / length
    u1 = (H[1, 0] * t0 + H[1, 1] * t1 + H[1, 2] * t2) / length
    u2 = (H[2, 0] * t0 + H[2, 1] * t1 + H[2, 2] * t2) / length
    W11, W12 = t0 * u0 + t1 * u1 + t2 * u2, s0 * u0 + s1 * u1 + s2 * u2
    W22 = (
        s0 * (H[0, 0] * s0 + H[0, 1] * s1 + H[0, 2] * s2)
        + s1 * (H[1, 0] * s0 + H[1, 1] * s1 + H[1, 2] * s2)
        + s2 * (H[2, 0] * s0 + H[2, 1] * s1 + H[2, 2] * s2)
    ) / length
    f1, f2 = f[0] * t0 + f[1] * t1 + f[2] * t2, f[0] * s0 + f[1] * s1 + f[2] * s2
    Wf1, Wf2 = compliance * (W11 * f1 + W12 * f2), compliance * (W12 * f1 + W22 * f2)

    out[0], out[1] = e0 * t0 + e1 * t1 + e2 * t2, e0 * s0 + e1 * s1 + e2 * s2
    out[2] = fn * depth * W12 + f2 * Wf1 - torque * W11
    out[3] = fn * (depth * W22 - 1.0) + f2 * Wf2 - torque * W12
    out[4] = fn * (1.0 - depth * W11) - f1 * Wf1 - torque * W12
    out[5] = -fn * depth * W12 - f1 * Wf2 - torque * W22
    out[6], out[7] = fn, torque
    out[8], out[9], out[10] = n0, n1, n2
    out[11], out[12], out[13] = t0, t1, t2
    out[14], out[15], out[16] = s0, s1, s2
    out[17] = 0.5 * (W11 + W22) + math.sqrt(0.25 * (W11 - W22) ** 2 + W12 * W12)


@part
def newton(kind: int, shape: Floats1, line: Line, q: OutFloats1, work: NewtonScratch) -> int:
    """Newton's method on the surface with a line search, from q, which it moves; iterations, negative if it stalls.

    det J = (f.n)^2 + torque^2 det W > 0 on a rigid convex surface, so the squared residual has no local minimum other
    than the contact: a Newton step is always a descent direction. Steps are limited to where the force pushes.
    """
    m = line.m
    g, H, here, there, trial = work
    tolerance = 1e-13 * (shape[7] + abs(m[0]) + abs(m[1]) + abs(m[2]))
    square, bound, step1, step2, length, fraction, iterations = np.inf, np.inf, 0.0, 0.0, np.inf, 1.0, -1
    copy_vector(q, trial)
    while iterations < MAX_ITERATIONS:
        linearize(kind, shape, line, trial, g, H, there)
        if there[6] < 0.0 and there[0] ** 2 + there[1] ** 2 < bound:
            copy_vector(trial, q)
            copy_vector(there, here)
            iterations += 1
            square = here[0] ** 2 + here[1] ** 2
            if square <= tolerance * tolerance:
                return iterations
            det = here[2] * here[5] - here[3] * here[4]
            step1 = (here[3] * here[1] - here[5] * here[0]) / det
            step2 = (here[4] * here[0] - here[2] * here[1]) / det
            length = math.sqrt(step1 * step1 + step2 * step2)
            fraction = min(1.0, shape[7] / length)
        elif iterations >= 0 and fraction > _MIN_FRACTION:
            fraction *= 0.5
        else:
            break
        bound = square * (1.0 - 1e-4 * fraction)
        for i in range(3):
            trial[i] = q[i] + fraction * (step1 * here[11 + i] + step2 * here[14 + i])
        project(kind, shape, trial)
    # At the limit of rounding, or on a crease where the normal turns within it, no step descends: the iteration has
    # converged if the next step is negligibly short.
    return iterations if length < 1e-9 * shape[7] else -1
