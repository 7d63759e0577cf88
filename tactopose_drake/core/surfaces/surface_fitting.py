"""Fits fingertip surfaces to points of a fingertip's shape.

Source: [SB90] F. Solina and R. Bajcsy, Recovery of parametric models from range images: the case for superquadrics with
global deformations, 1990; the distance is G. Taubin's, of first order in the implicit function, 1991.
"""

import math
from collections.abc import Callable, Iterator

import numpy as np
from scipy.optimize import least_squares

from tactopose_drake.core import poses
from tactopose_drake.core.surfaces.capsule import Capsule
from tactopose_drake.core.surfaces.sphere import Sphere
from tactopose_drake.core.surfaces.superquadric import Superquadric
from tactopose_drake.core.surfaces.surface import MOST_LENGTH, Surface
from tactopose_drake.core.validation import FloatArray

_LEAST_EXPONENT, _MOST_EXPONENT = 0.1, 1.2
_START_EXPONENT = 0.6
_SHORTEST, _LONGEST = 0.05, 2.0  # bounds of semi-axes and radius, in half extents of the points
_STEPS = 60  # most evaluations of the residuals' Jacobian
_AS_GOOD = 1.5  # ratio to the least residual up to which a simpler surface is as good
_EXACT = 2e-4  # residual that counts as none, m


def surface_distances(surface: Surface, p_SQ: FloatArray) -> FloatArray:
    """Signed distances of points p_SQ (n, 3) from a surface, negative inside, m, shape (n,); exact to first order."""
    gauge = np.sqrt(np.maximum(1.0 + surface.value(p_SQ), 1e-12))
    slope = np.linalg.norm(surface.gradient(p_SQ), axis=1) / (2.0 * gauge)
    distances: FloatArray = (gauge - 1.0) / np.maximum(slope, 1e-9)
    return distances


def residual(surface: Surface, p_SQ: FloatArray) -> float:
    """The root mean square of the points' distances from a surface, m."""
    return float(np.sqrt(np.mean(surface_distances(surface, p_SQ) ** 2)))


def fit_surface(p_SQ: FloatArray, outwards: FloatArray) -> Surface:
    """Fits a sphere, a capsule and a superquadric to points; returns the simplest that is about as good as the best.

    Args:
        p_SQ: points, shape (n, 3), up to 0.3 m from S.
        outwards: direction of the finger's end, shape (3,), where a capsule has its round end.
    """
    fitted = [*_spheres(p_SQ), *(min(_fits(p_SQ, outwards, kind), key=lambda s: residual(s, p_SQ)) for kind in _KINDS)]
    residuals = [residual(surface, p_SQ) for surface in fitted]
    good_enough = max(_AS_GOOD * min(residuals), _EXACT)
    return next(surface for surface, left in zip(fitted, residuals, strict=True) if left <= good_enough)


def _spheres(p_SQ: FloatArray) -> Iterator[Sphere]:
    """The algebraic fit, |p|^2 = 2 c p + (r^2 - c^2); none if nearly flat points make it larger than a finger."""
    A = np.column_stack([2.0 * p_SQ, np.ones(len(p_SQ))])
    solution = np.linalg.lstsq(A, np.sum(p_SQ**2, axis=1))[0]
    center, rest = solution[:3], solution[3]
    radius = math.sqrt(rest + center @ center)
    if max(radius, np.abs(center).max()) <= MOST_LENGTH:
        yield Sphere(radius, X_SF=poses.make_poses(np.eye(3), center))


def _capsule(x: FloatArray, X_SF: FloatArray, half: FloatArray) -> Capsule:
    return Capsule(float(x[6] * half[:2].mean()), float(2.0 * x[7] * half[2]), X_SF=X_SF)


def _superquadric(x: FloatArray, X_SF: FloatArray, half: FloatArray) -> Superquadric:
    a, b, c = (x[6:9] * half).tolist()
    return Superquadric((a, b, c), (float(x[9]), float(x[10])), X_SF=X_SF)


_Make = Callable[[FloatArray, FloatArray, FloatArray], Surface]
# For each kind: its constructor from parameters, and their start values and bounds, in half extents of the points.
_KINDS: tuple[tuple[_Make, tuple[float, ...], tuple[float, ...], tuple[float, ...]], ...] = (
    (_capsule, (1.0, 0.5), (_SHORTEST, 0.01), (_LONGEST, _LONGEST)),
    (
        _superquadric,
        (1.0, 1.0, 1.0, _START_EXPONENT, _START_EXPONENT),
        (_SHORTEST,) * 3 + (_LEAST_EXPONENT,) * 2,
        (_LONGEST,) * 3 + (_MOST_EXPONENT,) * 2,
    ),
)


def _fits(
    p_SQ: FloatArray, outwards: FloatArray, kind: tuple[_Make, tuple[float, ...], tuple[float, ...], tuple[float, ...]]
) -> Iterator[Surface]:
    """Fits of one kind, with its z axis started along each of the points' principal axes."""
    make, start, least, most = kind
    _, _, axes = np.linalg.svd(p_SQ - p_SQ.mean(axis=0), full_matrices=False)
    for turn in range(3):
        R = np.roll(axes, turn, axis=0).T
        R[:, 2] *= math.copysign(1.0, R[:, 2] @ outwards)
        R[:, 1] *= math.copysign(1.0, np.linalg.det(R))
        along = p_SQ @ R
        low, high = along.min(axis=0), along.max(axis=0)
        half, center = 0.5 * (high - low), R @ (0.5 * (low + high))

        def surface(x: FloatArray, R: FloatArray = R, center: FloatArray = center, half: FloatArray = half) -> Surface:
            X_SF = poses.make_poses(R @ poses.exp_so3(x[:3]), center + half.max() * x[3:6])
            return make(x, X_SF, half)

        def distances(x: FloatArray, surface: Callable[[FloatArray], Surface] = surface) -> FloatArray:
            return surface_distances(surface(x), p_SQ) / 1e-3

        longest = np.minimum(most, 0.5 * MOST_LENGTH / half.max())
        bounds = (np.array([-1.0] * 6 + list(least)), np.array([1.0] * 6 + list(longest)))
        x = np.clip(np.array([0.0] * 6 + list(start)), bounds[0], bounds[1])
        yield surface(least_squares(distances, x, bounds=bounds, max_nfev=_STEPS, loss="soft_l1").x)
