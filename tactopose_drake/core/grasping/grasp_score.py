"""How good a choice of contacts is: how much it tells of the object's pose, and how well it carries the object."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from tactopose_drake.core import poses
from tactopose_drake.core.validation import FloatArray

_CONE_EDGES = 6
# A touch as exact as it is simulated, beside what vision knows: m and rad.
_TOUCH_SIGMAS = (0.0009, math.radians(5.0))
_PRIOR_SIGMAS = (0.033, math.radians(16.0))
# Lever arm that turns torques into forces, m: about an object's half width.
_ARM = 0.04
# Weight of the balance of forces against their being near the wanted one.
_BALANCE_WEIGHT = 10.0
# Forces of a balanced grasp may fall short of the least force by this share: they are clipped.
_LEAST_SHARE = 0.5
_MOST_IMBALANCE = 0.4  # N


@dataclass(frozen=True, kw_only=True)
class ScoreParams:
    """What the fingers are to carry."""

    friction: float
    normal_force: float  # wanted of each finger, N
    least_force: float  # N
    most_force: float  # N


@dataclass(frozen=True, eq=False)
class GraspScore:
    """A grasp's score.

    Attributes:
        value: larger is better.
        force: normal force of each finger that balances the load, shape (k,), N.
        balanced: whether those forces do balance it, each within its range.
    """

    value: float
    force: FloatArray
    balanced: bool


def score_grasp(p_GC: FloatArray, n: FloatArray, cost: float, load: FloatArray, params: ScoreParams) -> GraspScore:
    """Judges k contacts.

    Args:
        p_GC: contact points relative to the object's centre of mass, in the palm's axes, shape (k, 3), m.
        n: the object's outward normals, shape (k, 3).
        cost: of the touches by themselves.
        load: the object's weight, shape (3,), N.
        params: see there.
    """
    value = 0.5 * _information(p_GC, n) + len(n) - cost
    if len(n) < 3:
        return GraspScore(value, np.zeros(len(n)), False)
    force, imbalance = balance(p_GC, n, load, params.friction, params.normal_force)
    clipped = np.clip(force, params.least_force, params.most_force)
    value -= 4.0 * imbalance + 3.0 * float(np.abs(force - clipped).sum())
    balanced = imbalance < _MOST_IMBALANCE and bool(force.min() > _LEAST_SHARE * params.least_force)
    return GraspScore(value, clipped, balanced)


def balance(
    p: FloatArray, n: FloatArray, load: FloatArray, friction: float, normal_force: float
) -> tuple[FloatArray, float]:
    """Normal forces that, with friction, balance a load and are near a wanted force.

    Args:
        p: contact points about the load's point of attack, shape (k, 3), m.
        n: the object's outward normals, shape (k, 3).
        load: shape (3,), N.
        friction: coefficient.
        normal_force: wanted of each, N.

    Returns:
        Normal forces, shape (k,), N, and the imbalance that is left, N (torques at an arm of 40 mm).
    """
    helper = np.eye(3)[np.argmin(np.abs(n), axis=1)]
    t1 = np.cross(n, helper)
    t1 /= np.linalg.norm(t1, axis=1, keepdims=True)
    t2 = np.cross(n, t1)
    angle = np.arange(_CONE_EDGES) * (2 * math.pi / _CONE_EDGES)
    around = np.cos(angle)[None, :, None] * t1[:, None] + np.sin(angle)[None, :, None] * t2[:, None]
    edges = friction * around - n[:, None]  # (k, e, 3), each with a normal part of one
    wrench = np.concatenate([np.cross(p[:, None], edges) / _ARM, edges], axis=2).reshape(-1, 6).T
    target = np.concatenate([np.zeros(3), -load])
    sums = np.kron(np.eye(len(n)), np.ones((1, _CONE_EDGES)))
    A = np.vstack([_BALANCE_WEIGHT * wrench, sums])
    b = np.concatenate([_BALANCE_WEIGHT * target, np.full(len(n), normal_force)])
    x, _ = nnls(A, b)
    return sums @ x, float(np.linalg.norm(wrench @ x - target))


def _information(p: FloatArray, n: FloatArray) -> float:
    """Half the log determinant of the information on a pose increment that touch and vision give together."""
    by_distance = np.concatenate([np.cross(p, n), n], axis=1) / _TOUCH_SIGMAS[0]
    by_normal = np.concatenate([poses.skew(n), np.zeros((len(n), 3, 3))], axis=2).reshape(-1, 6) / _TOUCH_SIGMAS[1]
    rows = np.concatenate([by_distance, by_normal])
    prior = np.diag([_PRIOR_SIGMAS[1] ** -2] * 3 + [_PRIOR_SIGMAS[0] ** -2] * 3)
    return float(0.5 * np.linalg.slogdet(rows.T @ rows + prior)[1])
