"""How well poses of an object explain one grasp, given what all other grasps tell about the hand.

The shared errors move the contacts of a grasp together, so the residuals are jointly Gaussian with all correlations.
Knowledge of these errors must come from the other grasps: a wrong pose that has biased the hand's parameters would
confirm itself. A grasp that several poses explain is a mixture of them, and so is its information about the hand.

Source: [RW06] C. Rasmussen, C. Williams, Gaussian processes for machine learning, 2006, section 5.4.2: leave-one-out
prediction of each datum by all others.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.calibration.mixture_loss import grasp_limit
from tactopose_drake.core.calibration.shared_least_squares import POSE_INFORMATION, Knowledge
from tactopose_drake.core.calibration.surface_residuals import ContactSigmas, GraspContacts, surface_rows
from tactopose_drake.core.poses import increments_between, retract
from tactopose_drake.core.shape.signed_distance import DistanceGrid
from tactopose_drake.core.validation import FloatArray

_ITERATIONS = 25
_ENOUGH = 1e-3  # nats: least decrease of the cost for which a descent goes on
_MOST_DAMPING = 1e6
_SAME = 2.0  # standard deviations within which two poses are the same,
_CLOSE = np.repeat([0.02, 0.001], 3)  # or rad and m


class Candidates(NamedTuple):
    """Candidate poses of the object in one grasp, each with what it implies about the hand.

    Attributes:
        X_PO: shape (k, 3, 4), the most probable first.
        probability: of each, shape (k,); the rest to one is the probability that none is right.
        shared: posterior mean of the shared unknowns under each pose, shape (k, d).
        taken: index of the candidate that the first start pose has led to.
    """

    X_PO: FloatArray
    probability: FloatArray
    shared: FloatArray
    taken: int


class GraspTouches(NamedTuple):
    """The contacts of one grasp.

    Attributes:
        touches: the contacts, at the mean of what is known of the hand.
        noise: their standard deviations.
        grid: of the object.
    """

    touches: GraspContacts
    noise: ContactSigmas
    grid: DistanceGrid

    @classmethod
    def of(
        cls, touches: GraspContacts, noise: ContactSigmas, grids: Sequence[DistanceGrid], grasp: int
    ) -> "GraspTouches":
        """Selects one grasp from all."""
        rows = np.flatnonzero(touches.grasp == grasp)
        return cls(touches.chosen(rows), noise.chosen(rows), grids[grasp])


class _Point(NamedTuple):
    """Poses in a descent: residuals (k, r), their derivatives and inverse covariance, and the negative log density."""

    X_PO: FloatArray
    residual: FloatArray
    by_pose: FloatArray
    by_shared: FloatArray
    inverse: FloatArray
    cost: FloatArray

    @property
    def information(self) -> FloatArray:
        """Information about the poses, shape (k, 6, 6)."""
        of_pose: FloatArray = np.swapaxes(self.by_pose, 1, 2) @ self.inverse @ self.by_pose + POSE_INFORMATION
        return of_pose


def explain(felt: GraspTouches, X_PO: FloatArray, known: Knowledge) -> Candidates:
    """Descends from each pose to a local optimum, and compares the distinct ones.

    Args:
        felt: the grasp.
        X_PO: start poses, shape (k, 3, 4).
        known: the shared unknowns, from all other grasps.
    """
    at = _descend(felt, X_PO, known.covariance)
    information = at.information
    evidence = -at.cost - 0.5 * np.linalg.slogdet(information)[1]
    chosen, taken = _distinct(at.X_PO, evidence, information)
    at, information, evidence = _Point(*(values[chosen] for values in at)), information[chosen], evidence[chosen]
    # With the pose marginalised, only the information that no pose explains away remains.
    turned = np.swapaxes(at.by_pose, 1, 2) @ at.inverse
    left = at.inverse - np.swapaxes(turned, 1, 2) @ np.linalg.solve(information, turned)
    pull = np.swapaxes(at.by_shared, 1, 2) @ left @ at.residual[..., None]
    shared = known.mean - (known.covariance @ pull)[..., 0]
    square = np.einsum("ki,kij,kj->k", at.residual, at.inverse, at.residual)
    limit = float(grasp_limit(np.array([len(felt.touches.grasp)]))[0])
    none = float(np.max(evidence + 0.5 * square)) - 0.5 * limit
    probability = np.exp(evidence - np.logaddexp.reduce([*evidence, none]))
    return Candidates(at.X_PO, probability, shared, taken)


def mixture(candidates: Sequence[Candidates], without: Sequence[Knowledge], known: Knowledge) -> Knowledge:
    """Joins the grasps' information when the pose of each is uncertain, to first order.

    Args:
        candidates: of each grasp, including the one assumed in `known`.
        without: what all other grasps tell, for each grasp.
        known: what all tell if the assumed poses are right.
    """
    mean, covariance = known.mean.copy(), known.covariance.copy()
    for found, left in zip(candidates, without, strict=True):
        none = max(0.0, 1.0 - float(found.probability.sum()))
        weights = np.append(found.probability, none)
        away = np.concatenate([found.shared - found.shared[found.taken], [left.mean - known.mean]])
        moved = weights @ away
        mean += moved
        covariance += (away * weights[:, None]).T @ away - np.outer(moved, moved)
        covariance += none * (left.covariance - known.covariance)
    return Knowledge(mean, covariance)


def _distinct(X_PO: FloatArray, evidence: FloatArray, information: FloatArray) -> tuple[NDArray[np.intp], int]:
    """Indices of distinct poses, best first, and the position among them of the one that pose 0 equals."""
    kept: list[int] = []
    taken = 0
    for k in np.argsort(-evidence, kind="stable"):
        away = increments_between(X_PO[kept], np.repeat(X_PO[k : k + 1], len(kept), axis=0))
        same = np.einsum("ki,kij,kj->k", away, information[kept], away) < _SAME**2
        same |= np.all(np.abs(away) < _CLOSE, axis=1)
        if k == 0:
            taken = int(np.argmax(same)) if same.any() else len(kept)
        if not same.any():
            kept.append(int(k))
    return np.array(kept, dtype=np.intp), taken


def _descend(felt: GraspTouches, X_PO: FloatArray, covariance: FloatArray) -> _Point:
    """Levenberg-Marquardt from all poses in parallel."""
    at, damping = _point(felt, X_PO, covariance), np.full(len(X_PO), 1e-3)
    moving = np.ones(len(X_PO), dtype=np.bool_)
    for _ in range(_ITERATIONS):
        information = at.information
        damped = information + damping[:, None, None] * information * np.eye(6)
        step = -np.linalg.solve(damped, np.swapaxes(at.by_pose, 1, 2) @ at.inverse @ at.residual[..., None])[..., 0]
        there = _point(felt, retract(at.X_PO, np.where(moving[:, None], step, 0.0)), covariance)
        better = moving & (there.cost < at.cost)
        moving &= np.where(better, at.cost - there.cost >= _ENOUGH, damping < _MOST_DAMPING)
        damping = np.where(better, np.maximum(damping / 5.0, 1e-6), damping * 8.0)
        at = _Point(*(_where(better, new, old) for new, old in zip(there, at, strict=True)))
        if not moving.any():
            break
    return at


def _where(mask: NDArray[np.bool_], new: FloatArray, old: FloatArray) -> FloatArray:
    return np.where(mask.reshape(-1, *[1] * (new.ndim - 1)), new, old)


def _point(felt: GraspTouches, X_PO: FloatArray, covariance: FloatArray) -> _Point:
    """The residuals at poses, under their joint Gaussian."""
    count, contacts = len(X_PO), len(felt.touches.grasp)
    again = np.tile(np.arange(contacts), count)
    repeated = felt.touches.chosen(again)._replace(grasp=np.repeat(np.arange(count, dtype=np.int64), contacts))
    rows = surface_rows([felt.grid] * count, X_PO, repeated, felt.noise.chosen(again))
    residual, by_pose, by_shared = (
        values.reshape(count, -1, *values.shape[2:]) for values in (rows.residual, rows.by_pose, rows.by_shared)
    )
    spread = np.eye(residual.shape[1]) + by_shared @ covariance @ np.swapaxes(by_shared, 1, 2)
    inverse: FloatArray = np.asarray(np.linalg.inv(spread), dtype=np.float64)
    square = np.einsum("ki,kij,kj->k", residual, inverse, residual)
    cost = 0.5 * (square + np.linalg.slogdet(spread)[1]) + rows.log_scale.reshape(count, -1).sum(axis=1)
    return _Point(X_PO, residual, by_pose, by_shared, inverse, cost)
