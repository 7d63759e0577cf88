"""From refined poses to the modes of the posterior: distinct ones with probabilities, covariances and free directions.

The posterior is approximated by a Gaussian at each mode (Laplace): weight exp(-cost) / sqrt(det H), covariance H^-1.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from tactopose_drake.core.kernels.matrix_kernels import eigenpairs, inverses
from tactopose_drake.core.kernels.mode_kernels import Minima, best_of_each
from tactopose_drake.core.posterior.free_direction_kernels import find_free
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture
from tactopose_drake.core.posterior.posterior_params import DEFAULT_PARAMS, ModeParams
from tactopose_drake.core.validation import FloatArray, number_array

# Relative to a matrix's largest eigenvalue: smaller eigenvalues are rounding errors.
_ROUNDING = 1e-13


@dataclasses.dataclass(frozen=True, eq=False)
class Modes:
    """Distinct modes of the posterior, in descending order of probability.

    Attributes:
        mixture: the modes' poses, posterior weights and covariances; n of them.
        cost: negative log likelihoods up to a constant, shape (n,).
        free_directions: for each mode the increments that the touch does not determine, unit rows (f, 6).
        log_mass: logarithm of the integral of exp(-cost) over all modes, with respect to the volume of poses,
            rad^3 m^3. Each mode counts once, however many images the object's finite symmetries make of it.
        standard_error: the largest standard error that sampling leaves in a mode's weight; infinite if the weights are
            those of Laplace's approximation.
    """

    mixture: GaussianMixture
    cost: FloatArray
    free_directions: tuple[FloatArray, ...]
    log_mass: float
    standard_error: float = math.inf


def find_modes(
    X_PO: FloatArray,
    cost: FloatArray,
    touch_information: FloatArray,
    prior_information: FloatArray,
    symmetry_poses: FloatArray,
    size: float,
    max_modes: int,
) -> Modes:
    """Merges poses that are one mode up to the object's symmetries, and weights the modes by Laplace's approximation.

    Of the merged poses the cheapest stays: a wide mode does not absorb a pose of lower cost.

    Args:
        X_PO: refined poses, in any order, shape (B, 3, 4).
        cost: of these, shape (B,).
        touch_information: Gauss-Newton Hessians of the touch alone, shape (B, 6, 6).
        prior_information: what else is known (the prior, or the extent of the searched space), shape (6, 6).
        symmetry_poses: the object's finite symmetry group as poses X_OO', the identity first, shape (g, 3, 4).
        size: the object's size, m; rotations are compared by the displacement of a point at half of it.
        max_modes: how many modes are kept at the most.
    """
    minima = Minima(X_PO, cost, touch_information)
    same_sigmas = DEFAULT_PARAMS.modes.same_sigmas
    index, covariance, log_determinant = best_of_each(minima, prior_information, symmetry_poses, same_sigmas)
    if not np.isfinite(log_determinant).all():
        covariance, log_determinant = _inverses(touch_information[index] + prior_information, size)
    log_weight = -cost[index] - 0.5 * log_determinant
    order = (-log_weight).argsort(kind="stable")[:max_modes]
    index, log_weight = index[order], log_weight[order]
    weight = np.exp(log_weight - log_weight[0])
    return Modes(
        mixture=GaussianMixture(X_PO[index], weight / weight.sum(), covariance[order]),
        cost=cost[index],
        free_directions=tuple(free_directions(touch_information[index], size)),
        log_mass=float(log_weight[0] + np.log(weight.sum()) + 3.0 * np.log(2.0 * np.pi)),
    )


def _inverses(information: FloatArray, size: float) -> tuple[FloatArray, FloatArray]:
    """Returns the inverses of information matrices (n, 6, 6) and the logarithms (n,) of their determinants.

    A matrix whose condition number exceeds double precision may be numerically singular. Its eigenvalues are then
    clipped from below at the rounding error, in the metric of `free_directions`.
    """
    lost = (~np.isfinite(inverses(information)[1])).nonzero()[0]
    information, scales = information.copy(), np.outer(units := increments_of_one_metre(size), units)
    values, rows = eigenpairs(information[lost] * scales)
    values = np.maximum(values, _ROUNDING * values.max(axis=1, keepdims=True))
    information[lost] = np.einsum("ni,nia,nib->nab", values, rows, rows) / scales
    return inverses(information)


def increments_of_one_metre(size: float) -> FloatArray:
    """The increment of each coordinate (w, v) that moves a point at half an object's size by one metre, shape (6,)."""
    turn = 2.0 / size
    return np.array([turn, turn, turn, 1.0, 1.0, 1.0])


def free_directions(
    touch_information: FloatArray,
    size: float,
    known: Sequence[FloatArray] = (),
    params: ModeParams = DEFAULT_PARAMS.modes,
) -> list[FloatArray]:
    """Returns the directions that each information matrix (n, 6, 6) leaves free, as orthonormal rows (f, 6).

    Rotations and translations are compared as motions of a point at half the object's size (m) from its origin. A
    direction is free when its standard deviation from the touch alone exceeds a share of the size. If `known` gives
    free directions, rows (f, 6) for each matrix, further ones are searched across these.

    Raises:
        InvalidInputError: if the matrices are of another shape, or do not consist of numbers.
    """
    touch_information = number_array("touch_information", touch_information, (None, 6, 6))
    units = increments_of_one_metre(size)
    rows, count = np.zeros((len(touch_information), 6, 6)), np.zeros(len(touch_information), dtype=np.int64)
    for i, free in enumerate(known):
        if len(free):
            rows[i, : len(free)], count[i] = free, len(free)
    find_free(touch_information, units, 1.0 / (params.free_share * size) ** 2, rows, count)
    return [free[:f] for free, f in zip(rows, count.tolist(), strict=True)]


def determined_part(increments: FloatArray, free: FloatArray, size: float) -> FloatArray:
    """Projects increments (..., 6) off the free directions (f, 6), in the metric of `free_directions`."""
    if not len(free):
        return increments
    units = increments_of_one_metre(size)
    basis = _metric_basis(free, units)
    metres = increments / units
    determined: FloatArray = (metres - (metres @ basis) @ basis.T) * units
    return determined


def determined_rows(covariance: FloatArray, free: FloatArray, size: float) -> FloatArray:
    """Rows (6, 6) whose outer products add up to the covariance with the free directions (f, 6) projected out."""
    rows = np.asarray(np.linalg.cholesky(covariance).T, dtype=np.float64)
    return determined_part(rows, free, size)


def determined_variance(covariance: FloatArray, free: FloatArray, size: float) -> float:
    """Trace of a covariance (6, 6) across the free directions (f, 6), in the metric of `free_directions`, m^2."""
    units = increments_of_one_metre(size)
    variance = float((covariance.diagonal() / (units * units)).sum())
    if len(free):
        along = _metric_basis(free, units) / units[:, None]
        variance -= float(np.sum(along * (covariance @ along)))
    return variance


def _metric_basis(free: FloatArray, units: FloatArray) -> FloatArray:
    """Orthonormal columns (6, f) that span the free directions (f, 6), scaled to metres."""
    columns: FloatArray = (free / units).T
    return columns / math.sqrt(float(np.sum(columns * columns))) if len(free) == 1 else np.linalg.qr(columns)[0]
