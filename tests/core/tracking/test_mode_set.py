import numpy as np
import pytest

from tactopose_drake.core.poses import random_rotations
from tactopose_drake.core.tracking.mode_set import ModeSet

HAND = np.array([0.0005**2, 0.04**2])
SOURCES = 3


def make_modes(roughness: float) -> ModeSet:
    """Two modes that know of the biases what an update would tell them, on a surface of a roughness in HAND's unit."""
    generator = np.random.default_rng(0)
    own = np.tile(np.repeat(HAND * (1.0 + roughness), 3), SOURCES)
    root = generator.normal(size=(2, 6 + len(own), 6 + len(own))) * np.sqrt(np.concatenate([np.full(6, 1e-4), own]))
    joint = np.swapaxes(root, 1, 2) @ root / (6 + len(own))
    joint[:, 6:, 6:] = np.diag(own)
    X_PO = np.concatenate([random_rotations(generator, 2), np.zeros((2, 3, 1))], axis=2)
    rough = np.tile(roughness * HAND, (2, SOURCES, 1))
    return ModeSet.make(X_PO, joint[:, :6, :6], 0.3 * joint[:, :6, 6:], rough, np.zeros(2), np.zeros(2))


def joint_covariance(modes: ModeSet) -> np.ndarray:
    own = np.repeat(HAND + modes.roughness, 3, axis=2).reshape(len(modes), -1)
    joint = np.zeros((len(modes), 6 + own.shape[1], 6 + own.shape[1]))
    joint[:, :6, :6], joint[:, :6, 6:] = modes.covariance, modes.cross
    joint[:, 6:, :6] = np.swapaxes(modes.cross, 1, 2)
    joint[:, 6:, 6:] += own[:, :, None] * np.eye(own.shape[1])
    return joint


@pytest.mark.parametrize(("before", "felt"), [(0.0, 30.0), (30.0, 0.0), (1.0, 1.0)])
def test_biases_follow_the_roughness_and_the_covariance_stays_one(before: float, felt: float) -> None:
    modes = make_modes(before)
    touched = np.array([0, 2])
    after = modes.touched(touched, np.tile(felt * HAND, (2, 2, 1)), HAND)
    assert np.linalg.eigvalsh(joint_covariance(modes)).min() > 0.0
    assert np.linalg.eigvalsh(joint_covariance(after)).min() > 0.0
    share = after.roughness[:, touched] / HAND
    assert np.all(np.abs(share - felt) <= np.abs(before - felt))
    expected = min(1.0, (1.0 + share[0, 0, 0]) / (1.0 + before))
    np.testing.assert_allclose(after.cross[:, :, :6], expected * modes.cross[:, :, :6])
    # Of a source that touches nothing nothing is new.
    np.testing.assert_array_equal(after.cross[:, :, 6:12], modes.cross[:, :, 6:12])


def test_equal_modes_found_twice_count_once_and_those_that_met_count_both() -> None:
    modes = make_modes(0.0).chosen([0, 0, 1])
    symmetry = np.eye(3, 4)[None]
    np.testing.assert_allclose(modes.distinct(symmetry).log_weight, [0.0, 0.0])
    np.testing.assert_allclose(modes.merged(symmetry).log_weight, [np.log(2.0), 0.0])
