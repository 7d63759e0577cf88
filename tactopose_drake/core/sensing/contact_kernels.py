"""The compiled loop of the intrinsic contact solver: the contact of each wrench, or the reason why there is none.

The solution is in the surface's frame F, for a wrench divided by its force: f is a unit vector and the moment m a
length. `surface_kernels.py` says what a surface is, `intrinsic_contact.py` explains the equations.
"""

import math
from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import kernel, part
from tactopose_drake.core.kernel_types import Floats1, Floats2, OutFloats1, OutFloats2, OutLongs1, Triple
from tactopose_drake.core.kernels.sorting_kernels import copy_vector
from tactopose_drake.core.sensing.closed_form_kernels import EDGE, closed_form, facing_point, rod_contact
from tactopose_drake.core.sensing.contact_newton_kernels import MAX_ITERATIONS, Line, NewtonScratch, linearize, newton
from tactopose_drake.core.surfaces.surface_kernels import ROD, SMOOTH, project

VALID, NOT_FINITE, TOO_WEAK, MISSES, TENSION, OUTSIDE, FRICTION, TORQUE, LAYER, TOO_STRONG = range(10)
RESULT_SIZE = 18  # p, n, normal force, friction force, local torque (three each), residual, deformation, iterations

# Parameters of the continuation, which do not affect its result: how it proceeds, and when it is given up.
_MIN_STRIDE = 4e-3  # least step, as a share of the path from the closed form to the surface
_EXTRA = 0.2  # lever arm of the moment that keeps f.m off zero on that path, relative to the extent
# Ratio of friction to normal force (84 degrees) at which a wrench counts as missing the surface: the equations also
# have a contact for a distant line, held by almost nothing but friction and local torque. `solve_contact` documents
# this as its bound on the coefficient if none is given; users who want a lower bound give one.
_GRAZING = 10.0


class Points(NamedTuple):
    """Scratch: the contact q (3,), the start of a search for it (3,), and a shape between ellipsoid and surface."""

    q: OutFloats1
    start: OutFloats1
    between: OutFloats1


class Scratch(NamedTuple):
    """All scratch of one solution."""

    work: NewtonScratch
    points: Points


class Conditions(NamedTuple):
    """The conditions common to all wrenches.

    Attributes:
        limits: least force, N; friction coefficient (infinite if unknown); the layer's compliance, m/N, and thickness,
            m; largest force, N; shape (5,), read-only.
        iterate: whether Newton's method is used even if there is a closed form.
    """

    limits: Floats1
    iterate: bool


@kernel
def solve(
    kind: int, shape: Floats1, X_SF: Floats2, F_S: Floats2, conditions: Conditions, out: OutFloats2, codes: OutLongs1
) -> None:
    """Solves wrenches F_S (B, 6); fills out (B, RESULT_SIZE) and codes (B,)."""
    work = NewtonScratch(np.empty(3), np.empty((3, 3)), np.empty(18), np.empty(18), np.empty(3))
    points = Points(np.empty(3), np.empty(3), np.empty(len(shape)))
    for i in range(len(F_S)):
        codes[i] = _solve(kind, shape, X_SF, F_S[i], conditions, out[i], Scratch(work, points))


@kernel
def _solve(
    kind: int, shape: Floats1, X: Floats2, F: Floats1, conditions: Conditions, out: OutFloats1, scratch: Scratch
) -> int:
    """Solves one wrench F (6,) in S; X (3, 4) is X_SF; fills out (RESULT_SIZE,) and returns the code."""
    limits, (work, points) = conditions.limits, scratch
    out[:] = np.nan
    for i in range(6):
        if not math.isfinite(F[i]):
            return NOT_FINITE
    force = math.sqrt(F[3] * F[3] + F[4] * F[4] + F[5] * F[5])
    if force < limits[0] or force == 0.0:
        return TOO_WEAK
    if force > limits[4]:
        return TOO_STRONG
    a0, a1, a2 = F[3] / force, F[4] / force, F[5] / force
    b0 = F[0] / force - (X[1, 3] * a2 - X[2, 3] * a1)
    b1 = F[1] / force - (X[2, 3] * a0 - X[0, 3] * a2)
    b2 = F[2] / force - (X[0, 3] * a1 - X[1, 3] * a0)
    f = (
        X[0, 0] * a0 + X[1, 0] * a1 + X[2, 0] * a2,
        X[0, 1] * a0 + X[1, 1] * a1 + X[2, 1] * a2,
        X[0, 2] * a0 + X[1, 2] * a1 + X[2, 2] * a2,
    )
    m = (
        X[0, 0] * b0 + X[1, 0] * b1 + X[2, 0] * b2,
        X[0, 1] * b0 + X[1, 1] * b1 + X[2, 1] * b2,
        X[0, 2] * b0 + X[1, 2] * b1 + X[2, 2] * b2,
    )
    compliance, q = limits[2] * force, points.q
    line = Line(m, f, compliance)
    count = _locate(kind, shape, line, conditions.iterate, points, work)
    if count < 0 or not _admissible(shape, q):
        return _why_none(kind, shape, line, count, q, work)
    linearize(kind, shape, line, q, work.g, work.H, work.here)
    state = work.here
    fn, torque = state[6], state[7]
    friction = math.sqrt(max(0.0, 1.0 - fn * fn))
    if friction > -_GRAZING * fn:
        return MISSES
    if friction > -limits[1] * fn * (1.0 + 1e-9):
        return FRICTION
    if abs(torque) > -min(limits[1], _GRAZING) * fn * shape[7]:
        return TORQUE
    depth = -compliance * fn
    if limits[2] > 0.0 and (depth >= limits[3] or depth * state[17] >= 1.0):
        return LAYER
    for i in range(3):
        n = X[i, 0] * state[8] + X[i, 1] * state[9] + X[i, 2] * state[10]
        out[3 + i] = n
        out[i] = X[i, 0] * q[0] + X[i, 1] * q[1] + X[i, 2] * q[2] + X[i, 3] - depth * n
        out[6 + i] = force * fn * n
        out[9 + i] = F[3 + i] - out[6 + i]
        out[12 + i] = force * torque * n
    r0 = F[0] - (out[1] * F[5] - out[2] * F[4]) - out[12]
    r1 = F[1] - (out[2] * F[3] - out[0] * F[5]) - out[13]
    r2 = F[2] - (out[0] * F[4] - out[1] * F[3]) - out[14]
    out[15] = math.sqrt(r0 * r0 + r1 * r1 + r2 * r2)
    out[16] = depth
    out[17] = count
    return VALID


@part
def _why_none(kind: int, shape: Floats1, line: Line, count: int, q: OutFloats1, work: NewtonScratch) -> int:
    """The code for a line of action without a pushing contact (a count below 0), or with one beyond the surface's end.

    A pull is a push of the opposite wrench. Beyond the edge both may explain the wrench: the pull is named if it needs
    far less friction. On a closed surface there is always a push.
    """
    push = 0.0
    if count >= 0:
        linearize(kind, shape, line, q, work.g, work.H, work.here)
        push = -work.here[6]
    m, f = line.m, line.f
    pull_m, pull_f = (-m[0], -m[1], -m[2]), (-f[0], -f[1], -f[2])
    if kind == ROD and rod_contact(shape, pull_m, pull_f, q) and _admissible(shape, q):
        linearize(kind, shape, Line(pull_m, pull_f, 0.0), q, work.g, work.H, work.here)
        if -work.here[6] > 2.0 * push:
            return TENSION
    return OUTSIDE if count >= 0 else MISSES


@part
def _locate(kind: int, shape: Floats1, line: Line, iterate: bool, points: Points, work: NewtonScratch) -> int:
    """Finds the pushing contact q, in closed form if possible; returns iterations, negative if there is no contact.

    If Newton's method fails from the point that faces the force, a continuation follows the contact from the closed
    form, while exponents go from 1, and compliance from 0, to their values. The one pushing contact moves continuously
    with the shape as long as f.m != 0, so short enough steps never lose it; an additional moment along f that vanishes
    on the way keeps f.m off zero.
    """
    m, f, compliance = line
    q, start, between = points
    exact = kind == ROD or (shape[3] == 1.0 and shape[4] == 1.0)
    if exact and compliance == 0.0 and not iterate:
        return 0 if closed_form(kind, shape, m, f, q) else -1
    extra = math.copysign(_EXTRA * shape[7], m[0] * f[0] + m[1] * f[1] + m[2] * f[2])
    following = not facing_point(kind, shape, f, start)
    if following and not closed_form(kind, shape, _add(m, extra, f), f, start):
        return -1
    copy_vector(shape, between)
    done, stride, iterations = 0.0, 1.0, 0
    while stride > _MIN_STRIDE and iterations < 10 * MAX_ITERATIONS:
        goal = min(1.0, done + stride)
        if kind == SMOOTH:
            between[3], between[4] = 1.0 + goal * (shape[3] - 1.0), 1.0 + goal * (shape[4] - 1.0)
        moment = _add(m, (1.0 - goal) * extra, f)
        copy_vector(start, q)
        project(kind, between, q)
        count = newton(kind, between, Line(moment, f, goal * compliance), q, work)
        iterations += max(count, 1)
        if count >= 0 and goal == 1.0:
            return iterations
        if count >= 0:
            done, stride = goal, 2.0 * stride
            copy_vector(q, start)
        elif following:
            stride *= 0.5
        else:
            following = True
            if not closed_form(kind, shape, _add(m, extra, f), f, start):
                return -1
    return -1


@kernel
def _add(m: Triple, factor: float, f: Triple) -> Triple:
    return m[0] + factor * f[0], m[1] + factor * f[1], m[2] + factor * f[2]


@part
def _admissible(shape: Floats1, q: Floats1) -> bool:
    slack = EDGE * shape[7]
    return shape[5] - slack <= q[2] <= shape[6] + slack
