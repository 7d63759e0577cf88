"""The score of a choice of contacts: the information about the object's pose, and how well they carry the object."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from tactopose_drake.core import poses
from tactopose_drake.core.grasping.wrench_space import cone_wrenches
from tactopose_drake.core.validation import FloatArray


@dataclass(frozen=True, kw_only=True)
class ScoreParams:
    """What the fingers are to carry, and the weights of the score."""

    friction: float
    normal_force: float  # wanted of each finger, N
    least_force: float  # N
    most_force: float  # N
    least_contacts: int = 3  # of a balanced grasp
    cone_edges: int = 6  # of the pyramid that approximates a friction cone
    arm: float = 0.04  # lever arm that converts torques to forces, m: about an object's half width
    balance_weight: float = 10.0  # of the balance of forces, against their deviation from the wanted one
    most_imbalance: float = 0.4  # of a balanced grasp, N
    least_share: float = 0.5  # of the least force that all forces of a balanced grasp exceed, before they are clipped
    imbalance_cost: float = 4.0  # of the score, per newton of imbalance
    clipping_cost: float = 3.0  # of the score, per newton by which forces are out of their range
    touch_position: float = 0.0009  # simulated standard deviation of a touch along each axis, m
    touch_normal: float = math.radians(5.0)  # of a small rotation of its normal about each axis, rad
    prior_translation: float = 0.033  # standard deviation of the pose from vision, m
    prior_rotation: float = math.radians(16.0)  # the same for its rotation, rad


@dataclass(frozen=True, eq=False)
class GraspScore:
    """A grasp's score.

    Attributes:
        value: larger is better.
        force: normal force of each finger that balances the load, shape (k,), N.
        balanced: whether these forces balance it, each within its range.
    """

    value: float
    force: FloatArray
    balanced: bool


class ContactTerms(NamedTuple):
    """The contribution of each of k contacts to a grasp, independent of the others.

    Attributes:
        wrench: edges of its friction cone with a normal force of 1 N, torques over the arm and then forces, shape
            (k, e, 6), N.
        distance: whitened derivative of its distance by a pose increment, shape (k, 6).
        normal: whitened derivative of its normal, shape (k, 3, 6).
    """

    wrench: FloatArray
    distance: FloatArray
    normal: FloatArray

    @classmethod
    def of(cls, p_GC: FloatArray, n: FloatArray, params: ScoreParams) -> ContactTerms:
        """Computes the terms of contacts.

        Args:
            p_GC: contact points relative to the object's centre of mass, in the palm's axes, shape (k, 3), m.
            n: the object's outward normals, shape (k, 3).
            params: friction, and the accuracy of a touch.
        """
        wrench = cone_wrenches(p_GC, n, params.friction, params.cone_edges, params.arm)
        distance = np.concatenate([np.cross(p_GC, n), n], axis=1) / params.touch_position
        normal = np.concatenate([poses.skew(n), np.zeros((len(n), 3, 3))], axis=2) / params.touch_normal
        return cls(wrench, distance, normal)

    @classmethod
    def one_of_each(cls, terms: Sequence[ContactTerms], rows: Sequence[int]) -> ContactTerms:
        """Selects one row of each contact's terms."""
        chosen = [(each.wrench[i], each.distance[i], each.normal[i]) for each, i in zip(terms, rows, strict=True)]
        return cls(*(np.array(column) for column in zip(*chosen, strict=True)))


def score_grasp(contacts: ContactTerms, cost: float, load: FloatArray, params: ScoreParams) -> GraspScore:
    """Scores k contacts.

    Args:
        contacts: their terms.
        cost: sum of the touches' own costs.
        load: the object's weight, shape (3,), N.
        params: forces and weights.
    """
    count = len(contacts.distance)
    value = 0.5 * _information(contacts, params) + count - cost
    if count < params.least_contacts:
        return GraspScore(value, np.zeros(count), False)
    force, imbalance = balance(contacts, load, params)
    clipped = np.clip(force, params.least_force, params.most_force)
    value -= params.imbalance_cost * imbalance + params.clipping_cost * float(np.abs(force - clipped).sum())
    balanced = imbalance < params.most_imbalance and bool(force.min() > params.least_share * params.least_force)
    return GraspScore(value, clipped, balanced)


def balance(contacts: ContactTerms, load: FloatArray, params: ScoreParams) -> tuple[FloatArray, float]:
    """Normal forces that, with friction, balance a load and are close to a wanted force.

    Args:
        contacts: about the point at which the load acts.
        load: shape (3,), N.
        params: wanted force, and weights.

    Returns:
        Normal forces, shape (k,), N, and the remaining imbalance, N (torques over the arm).
    """
    count = len(contacts.wrench)
    wrench = contacts.wrench.reshape(-1, 6).T
    target = np.concatenate([np.zeros(3), -load])
    sums = np.repeat(np.eye(count), contacts.wrench.shape[1], axis=1)
    A = np.vstack([params.balance_weight * wrench, sums])
    b = np.concatenate([params.balance_weight * target, np.full(count, params.normal_force)])
    x, _ = nnls(A, b)
    return sums @ x, float(np.linalg.norm(wrench @ x - target))


def _information(contacts: ContactTerms, params: ScoreParams) -> float:
    """Half the log determinant of the joint information of touch and vision on a pose increment."""
    rows = np.concatenate([contacts.distance, contacts.normal.reshape(-1, 6)])
    prior = np.diag([params.prior_rotation**-2] * 3 + [params.prior_translation**-2] * 3)
    return float(0.5 * np.linalg.slogdet(rows.T @ rows + prior)[1])
