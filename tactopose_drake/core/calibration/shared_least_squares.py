"""Levenberg-Marquardt over an object pose for each grasp and unknowns that all grasps share, by blocks.

Each grasp's rows depend on its own pose and on the shared unknowns, so the poses are eliminated one by one (the Schur
complement), which leaves a dense system of the size of the shared unknowns. These are in units of their prior's
standard deviations: the prior of each is standard normal.

Source: [TMHF00] B. Triggs et al., Bundle adjustment - a modern synthesis, 2000, section 6.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.calibration.mixture_loss import CONTACT_LIMIT, grasp_limit, loss, weight
from tactopose_drake.core.calibration.surface_residuals import ContactSigmas, GraspContacts, SurfaceRows, surface_rows
from tactopose_drake.core.poses import retract
from tactopose_drake.core.shape.signed_distance import DistanceGrid
from tactopose_drake.core.validation import FloatArray

POSE_INFORMATION = np.diag(np.repeat([1.0 / np.pi**2, 1.0 / 0.1**2], 3))
"""Prior information on an object's pose: it is in the hand. Rotations rad, translations m."""
_ITERATIONS = 60
ENOUGH = 1e-6
"""Relative change of the cost at which a final fit ends."""
_MOST_DAMPING = 1e8


class Knowledge(NamedTuple):
    """A Gaussian over the shared unknowns.

    Attributes:
        mean: shape (d,).
        covariance: shape (d, d).
    """

    mean: FloatArray
    covariance: FloatArray


class SharedProblem(NamedTuple):
    """The data to fit.

    Attributes:
        touch: gives the contacts of all grasps for values of the shared unknowns, shape (d,).
        grids: of the object of each grasp.
        readings: whitened rows A of direct measurements of the shared unknowns, shape (m, d).
        measured: the measured values, shape (m,).
    """

    touch: Callable[[FloatArray], GraspContacts]
    grids: Sequence[DistanceGrid]
    readings: FloatArray
    measured: FloatArray


class Linearization(NamedTuple):
    """The problem linearised at a point.

    Attributes:
        touches: the contacts there.
        rows: their residuals.
        weights: robust weights of the contacts, shape (n,), from 0 for outliers to 1 for inliers.
        grasp_weights: robust weights of whole grasps, shape (g,).
        cost: half the sum of all losses, of the prior and of the direct measurements.
    """

    touches: GraspContacts
    rows: SurfaceRows
    weights: FloatArray
    grasp_weights: FloatArray
    cost: float


class Solution(NamedTuple):
    """The end of the iteration.

    Attributes:
        shared: the shared unknowns, shape (d,).
        X_PO: pose of the object in each grasp, shape (g, 3, 4).
        covariance: of the shared unknowns, shape (d, d).
        leverage: diagonal of the hat matrix, by contact and residual, shape (n, 4), 0 to 1.
        at: the problem linearised at the solution.
        converged: whether the cost had stopped decreasing.
    """

    shared: FloatArray
    X_PO: FloatArray
    covariance: FloatArray
    leverage: FloatArray
    at: Linearization
    converged: bool


def solve_shared(
    problem: SharedProblem, shared: FloatArray, X_PO: FloatArray, noise: ContactSigmas, enough: float = ENOUGH
) -> Solution:
    """Descends to a local minimum.

    Args:
        problem: the data to fit.
        shared: start values of the shared unknowns, shape (d,).
        X_PO: start poses, shape (g, 3, 4).
        noise: of the contacts.
        enough: relative change of the cost at which it ends.
    """
    at, damping, converged = linearize(problem, shared, X_PO, noise), 1e-4, False
    for _ in range(_ITERATIONS):
        blocks = _Blocks(problem, shared, at)
        while damping <= _MOST_DAMPING:
            step, increments = blocks.step(damping)
            there = linearize(problem, shared + step, retract(X_PO, increments), noise)
            if there.cost <= at.cost:
                break
            damping *= 8.0
        if damping > _MOST_DAMPING:
            converged = True
            break
        converged = at.cost - there.cost <= enough * (1.0 + at.cost)
        shared, X_PO, at, damping = shared + step, retract(X_PO, increments), there, max(damping / 4.0, 1e-9)
        if converged:
            break
    blocks = _Blocks(problem, shared, at)
    covariance: FloatArray = np.asarray(np.linalg.inv(blocks.reduced), dtype=np.float64)
    return Solution(shared, X_PO, covariance, blocks.leverage(covariance), at, converged)


def linearize(problem: SharedProblem, shared: FloatArray, X_PO: FloatArray, noise: ContactSigmas) -> Linearization:
    """The residuals, their weights and the cost."""
    touches = problem.touch(shared)
    rows = surface_rows(problem.grids, X_PO, touches, noise)
    # A wrench that no contact explains costs as much as an outlier.
    square = np.where(touches.valid, np.sum(rows.residual**2, axis=1), 4.0 * CONTACT_LIMIT)
    count = len(problem.grids)
    of_grasp: FloatArray = np.asarray(
        np.bincount(touches.grasp, weights=loss(square, CONTACT_LIMIT), minlength=count), dtype=np.float64
    )
    limit = grasp_limit(np.bincount(touches.grasp, minlength=count))
    of_grasps = weight(of_grasp, limit)
    cost = 0.5 * float(loss(of_grasp, limit).sum() + shared @ shared)
    cost += 0.5 * float(np.sum((problem.readings @ shared - problem.measured) ** 2))
    return Linearization(touches, rows, weight(square, CONTACT_LIMIT) * of_grasps[touches.grasp], of_grasps, cost)


def others(problem: SharedProblem, solution: Solution) -> list[Knowledge]:
    """For each grasp, the estimate of the shared unknowns from all other grasps, as far as the problem is linear."""
    blocks, information = _Blocks(problem, solution.shared, solution.at), np.linalg.inv(solution.covariance)
    found = []
    for own, pull in zip(*blocks.by_grasp(), strict=True):
        covariance = np.linalg.inv(information - own)
        found.append(Knowledge(solution.shared + covariance @ pull, 0.5 * (covariance + covariance.T)))
    return found


class _Blocks:
    """The normal equations, with a block for each grasp."""

    def __init__(self, problem: SharedProblem, shared: FloatArray, at: Linearization) -> None:
        count = len(problem.grids)
        self._at, w = at, at.weights[:, None]
        residual, by_pose, by_shared, _ = at.rows
        own = np.einsum("nri,nrj,n->nij", by_pose, by_pose, at.weights)
        cross = np.swapaxes(by_pose, 1, 2) @ (by_shared * at.weights[:, None, None])
        pull = np.einsum("nri,nr->ni", by_pose, w * residual)
        self._own, self._cross, self._pull = (_summed(values, at.touches.grasp, count) for values in (own, cross, pull))
        self._own += POSE_INFORMATION
        flat = by_shared.reshape(residual.size, len(shared))
        self._shared = (flat * np.repeat(at.weights, residual.shape[1])[:, None]).T @ flat
        self._shared += np.eye(len(shared)) + problem.readings.T @ problem.readings
        self._gradient = flat.T @ (w * residual).ravel() + shared
        self._gradient += problem.readings.T @ (problem.readings @ shared - problem.measured)

    @property
    def reduced(self) -> FloatArray:
        """The information about the shared unknowns with the poses eliminated."""
        information: FloatArray = self._shared - np.einsum(
            "gid,gie->de", self._cross, np.linalg.solve(self._own, self._cross)
        )
        return 0.5 * (information + information.T)

    def by_grasp(self) -> tuple[FloatArray, FloatArray]:
        """Each grasp's information (g, d, d) and gradient (g, d) for the shared unknowns, with its pose eliminated."""
        residual, _, by_shared, _ = self._at.rows
        w, grasp, count = self._at.weights, self._at.touches.grasp, len(self._own)
        whole = np.array([_information(by_shared[grasp == g], w[grasp == g]) for g in range(count)])
        pull = _summed(np.einsum("nrd,nr->nd", by_shared, w[:, None] * residual), grasp, count)
        by_pose = np.linalg.solve(self._own, np.concatenate([self._cross, self._pull[..., None]], axis=2))
        left = np.swapaxes(self._cross, 1, 2) @ by_pose
        return whole - left[:, :, :-1], pull - left[:, :, -1]

    def step(self, damping: float) -> tuple[FloatArray, FloatArray]:
        """The step of the shared unknowns (d,) and of the poses (g, 6)."""
        own = self._own * (1.0 + damping * np.eye(6))
        reduced = self._shared + damping * np.diag(np.diag(self._shared))
        reduced = reduced - np.einsum("gid,gie->de", self._cross, np.linalg.solve(own, self._cross))
        inner = np.linalg.solve(own, self._pull[..., None])[..., 0]
        step = np.linalg.solve(reduced, -(self._gradient - np.einsum("gid,gi->d", self._cross, inner)))
        return step, -inner - np.linalg.solve(own, (self._cross @ step)[..., None])[..., 0]

    def leverage(self, covariance: FloatArray) -> FloatArray:
        """The hat matrix's diagonal, shape (n, 4)."""
        _, by_pose, by_shared, _ = self._at.rows
        inverse, grasp = np.linalg.inv(self._own), self._at.touches.grasp
        rest = by_shared - by_pose @ (inverse @ self._cross)[grasp]
        hat: FloatArray = np.einsum("nri,nij,nrj->nr", by_pose, inverse[grasp], by_pose)
        hat += np.einsum("nrd,nrd->nr", rest @ covariance, rest)
        return self._at.weights[:, None] * hat


def _information(rows: FloatArray, weights: FloatArray) -> FloatArray:
    flat: FloatArray = (rows * np.sqrt(weights)[:, None, None]).reshape(-1, rows.shape[2])
    return flat.T @ flat


def _summed(values: FloatArray, grasp: NDArray[np.int64], count: int) -> FloatArray:
    total = np.zeros((count, *values.shape[1:]))
    np.add.at(total, grasp, values)
    return total
