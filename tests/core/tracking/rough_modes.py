"""Modes with what an update would tell them of the contacts' biases."""

import dataclasses

import numpy as np

from tactopose_drake.core.poses import random_rotations
from tactopose_drake.core.tracking.tracked_modes import TrackedModes

# Variances of biases of positions, m^2, and of normals, rad^2, of three sources.
HAND = np.array([0.0005**2, 0.04**2])
SOURCES = 3


def make_rough_modes(roughness: float) -> TrackedModes:
    """Two modes that know of the biases what an update would tell them, on a surface of a roughness in HAND's unit."""
    generator = np.random.default_rng(0)
    own = np.tile(np.repeat(HAND * (1.0 + roughness), 3), SOURCES)
    root = generator.normal(size=(2, 6 + len(own), 6 + len(own))) * np.sqrt(np.concatenate([np.full(6, 1e-4), own]))
    joint = np.swapaxes(root, 1, 2) @ root / (6 + len(own))
    joint[:, 6:, 6:] = np.diag(own)
    X_PO = np.concatenate([random_rotations(generator, 2), np.zeros((2, 3, 1))], axis=2)
    rough = np.tile(roughness * HAND, (2, SOURCES, 1))
    modes = TrackedModes.independent(X_PO, joint[:, :6, :6], SOURCES)
    return dataclasses.replace(modes, cross_covariance=0.3 * joint[:, :6, 6:], roughness=rough)
