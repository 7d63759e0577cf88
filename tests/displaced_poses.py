"""Poses at random, first guesses that are off by a known way, and how far an estimate is off."""

import math

import numpy as np

import tactopose_drake as tp
from tactopose_drake.core.poses import increments_between, make_poses, random_rotations, retract


def random_pose(seed: int) -> np.ndarray:
    generator = np.random.default_rng(seed)
    return make_poses(random_rotations(generator, 1), generator.normal(size=(1, 3)) * 0.05)[0]


def displaced(X_PO: np.ndarray, seed: int, translation: float = 0.033, degrees: float = 16.0) -> np.ndarray:
    w, v = (u / np.linalg.norm(u) for u in np.random.default_rng(seed).normal(size=(2, 3)))
    return retract(X_PO, np.concatenate([math.radians(degrees) * w, translation * v]))


def error(estimate: tp.PoseEstimate, X_PO: np.ndarray) -> np.ndarray:
    return increments_between(estimate.best.X_PO.GetAsMatrix34(), X_PO)
