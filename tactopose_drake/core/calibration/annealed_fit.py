"""The fit of a whole calibration, with noise annealed to its actual size.

Start poses come from contacts that the hand's own errors have displaced, far more than the noise that remains once
these are known. So the fit begins with large standard deviations, which each round reduces as far as the residuals
allow, but at most by half. At the end the standard deviations of distances and of normals are those of the residuals
(variance components), so that the covariance is that of the data and not of a guess.
"""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.calibration.shared_least_squares import SharedProblem, Solution, solve_shared
from tactopose_drake.core.calibration.surface_residuals import ContactSigmas, GraspContacts
from tactopose_drake.core.validation import FloatArray

# Medians of chi-square variables with one and with two degrees of freedom.
_MEDIAN_1, _MEDIAN_2 = 0.455, 1.386
_ROUNDS, _LAST_ROUNDS = 14, 6
_ROUGHLY = 1e-3  # relative change of the cost at which all fits but the last ones end
_STEADY = 0.03  # relative change of a standard deviation at which annealing ends
_LEAST = (2e-5, 2e-3)  # m, rad: errors of the distance field itself
_FEWEST = 0.05  # least redundancy of the residuals from which noise is estimated
_TOLD = 10.0  # residuals that the told noise counts as, so that a fit to few does not claim to have none


class ContactNoise(NamedTuple):
    """The parts of each contact's noise: that of its wrench, and that of object, fingertip and joints.

    Attributes:
        by_wrench: standard deviations of each contact due to its wrench's noise.
        position: standard deviation of the distance due to everything else, m.
        normal: standard deviation of the normal due to everything else, rad.
    """

    by_wrench: ContactSigmas
    position: float
    normal: float

    @property
    def total(self) -> ContactSigmas:
        """Standard deviations of both parts together."""
        return ContactSigmas(
            np.hypot(self.by_wrench.position, self.position), np.hypot(self.by_wrench.normal, self.normal)
        )


class AnnealedFit(NamedTuple):
    """A fit, and the noise at its end."""

    solution: Solution
    noise: ContactNoise


def anneal(
    problem: SharedProblem, shared: FloatArray, X_PO: FloatArray, noise: ContactNoise, start: tuple[float, float]
) -> AnnealedFit:
    """Fits with large noise first, and then with less and less.

    Args:
        problem: the data to fit.
        shared: start values of the shared unknowns, shape (d,).
        X_PO: start poses, shape (g, 3, 4).
        noise: the expected noise.
        start: initial standard deviations of a contact's distance and normal, m and rad.
    """
    told = noise
    noise = noise._replace(position=start[0], normal=start[1])
    solution = solve_shared(problem, shared, X_PO, noise.total, _ROUGHLY)
    for _ in range(_ROUNDS):
        found = _by_medians(solution, noise)
        changed = noise._replace(
            position=float(np.clip(found[0], 0.5 * noise.position, noise.position)),
            normal=float(np.clip(found[1], 0.5 * noise.normal, noise.normal)),
        )
        if _is_steady(noise, changed):
            break
        noise = changed
        solution = solve_shared(problem, solution.shared, solution.X_PO, noise.total, _ROUGHLY)
    for _ in range(_LAST_ROUNDS):
        position, normal = _by_components(solution, noise, told)
        changed = noise._replace(position=position, normal=normal)
        if _is_steady(noise, changed):
            break
        noise = changed
        solution = solve_shared(problem, solution.shared, solution.X_PO, noise.total)
    return AnnealedFit(solution, noise)


def start_noise(touches: GraspContacts, noise: ContactNoise) -> tuple[float, float]:
    """Initial noise of a fit: the expected effect of the shared errors on contacts, or ten times the noise if more.

    Args:
        touches: contacts without errors.
        noise: the expected noise.
    """
    along = np.einsum("nj,njd->nd", touches.n_PC, touches.J[:, :3])[touches.valid]
    turned = touches.J[touches.valid, 3:]
    count = max(1, len(along))
    moved = float(np.sqrt(np.sum(along**2) / count)), float(np.sqrt(np.sum(turned**2) / (3.0 * count)))
    return max(moved[0], 10.0 * noise.position), max(moved[1], 10.0 * noise.normal)


def _is_steady(noise: ContactNoise, other: ContactNoise) -> bool:
    changes = other.position / noise.position - 1.0, other.normal / noise.normal - 1.0
    return max(map(abs, changes)) < _STEADY


def _by_medians(solution: Solution, noise: ContactNoise) -> tuple[float, float]:
    """Standard deviations from the residuals' medians, which are robust to some false contacts."""
    residual, valid = solution.at.rows.residual[solution.at.touches.valid], solution.at.touches.valid
    if not len(residual):
        return noise.position, noise.normal
    left = 1.0 - np.average(solution.leverage[valid, 0]), 1.0 - np.average(solution.leverage[valid, 1:].sum(axis=1)) / 2
    squares = np.median(residual[:, 0] ** 2), np.median(np.sum(residual[:, 1:] ** 2, axis=1))
    return (
        max(_LEAST[0], noise.position * float(np.sqrt(squares[0] / _MEDIAN_1 / max(left[0], _FEWEST)))),
        max(_LEAST[1], noise.normal * float(np.sqrt(squares[1] / _MEDIAN_2 / max(left[1], _FEWEST)))),
    )


def _by_components(solution: Solution, noise: ContactNoise, told: ContactNoise) -> tuple[float, float]:
    """Standard deviations from the weighted sums of squares, over the residuals' redundancy."""
    w, residual = solution.at.weights, solution.at.rows.residual
    total, found = float(w.sum()), []
    for sigma, told_of, rows, freedom in (
        (noise.position, told.position, slice(0, 1), 1.0),
        (noise.normal, told.normal, slice(1, None), 2.0),
    ):
        redundancy = max(0.0, freedom * total - float(solution.leverage[:, rows].sum()))
        squares = float(w @ np.sum(residual[:, rows] ** 2, axis=1)) * sigma**2
        found.append(float(np.sqrt((squares + _TOLD * told_of**2) / (redundancy + _TOLD))))
    return found[0], found[1]
