import numpy as np
import pytest

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.pairs.pair_poses import ContactPair, coarse_cost, distinct_poses, judge_pairs, pair_poses
from tactopose_drake.core.poses import compose, make_poses, random_rotations, rotation_angles, transform_points
from tactopose_drake.core.shape.coarse_field import contact_table
from tactopose_drake.core.shape.objects import ObjectModel
from tactopose_drake.core.shape.symmetry import RotationalSymmetry
from tests.core.searches.problems import make_blob

EVERY = 10**6
EVERYWHERE = (np.eye(3, 4), (np.pi, np.inf), np.eye(3, 4)[None])


@pytest.fixture(scope="module")
def blob() -> ObjectModel:
    return make_blob()


def pose(seed: int) -> np.ndarray:
    generator = np.random.default_rng(seed)
    return make_poses(random_rotations(generator, 1), 0.1 * generator.normal(size=(1, 3)))[0]


def touch_samples(model: ObjectModel, X_PO: np.ndarray, rows: list[int]) -> Contacts:
    """Exact contacts at two of the samples that are paired, and at others."""
    features = model.pair_features
    return Contacts(transform_points(X_PO, features.points[rows]), features.normals[rows] @ X_PO[:, :3].T)


def match_of(model: ObjectModel, i: int, j: int) -> np.ndarray:
    return np.flatnonzero((model.pair_features.pairs == (i, j)).all(axis=1)).astype(np.int32)


@pytest.mark.parametrize("seed", range(5))
def test_the_right_match_gives_the_pose(blob: ObjectModel, seed: int) -> None:
    X_PO = pose(seed)
    i, j, *others = np.random.default_rng(seed).choice(1000, 5, replace=False).tolist()
    contacts = touch_samples(blob, X_PO, [i, j, *others])
    table = contact_table(blob.coarse_field, contacts, 0.0, 0.1)
    pair = ContactPair(0, 1, match_of(blob, i, j), 1)
    found = pair_poses([pair], blob.pair_features, table, np.array([0]))[0]
    np.testing.assert_allclose(found, X_PO, atol=1e-9)
    cost = judge_pairs([pair], blob.pair_features, blob.coarse_field, table, EVERY, *EVERYWHERE)
    assert cost[0] < 15.0


def test_both_points_stay_on_the_surface_whatever_the_spin(blob: ObjectModel) -> None:
    X_PO = pose(1)
    contacts = touch_samples(blob, X_PO, [10, 500, 700])
    table = contact_table(blob.coarse_field, contacts, 0.001, 0.1)
    pair = ContactPair(0, 1, match_of(blob, 10, 500), 12)
    found = pair_poses([pair], blob.pair_features, table, np.arange(12))
    np.testing.assert_allclose(
        found[:, :, :3] @ np.swapaxes(found[:, :, :3], 1, 2), np.tile(np.eye(3), (12, 1, 1)), atol=1e-12
    )
    for row, index in enumerate((10, 500)):
        touched = transform_points(found, blob.pair_features.points[index][None])[:, 0]
        np.testing.assert_allclose(touched, np.tile(contacts.p_PC[row], (12, 1)), atol=1e-12)
    np.testing.assert_allclose(rotation_angles(found[:-1, :, :3], found[1:, :, :3]), np.pi / 6)
    # The best of the twelve turns is the one next to the truth.
    cost = judge_pairs([pair], blob.pair_features, blob.coarse_field, table, EVERY, *EVERYWHERE)
    angles = rotation_angles(found[:, :, :3], X_PO[:, :3])
    assert angles[cost.argmin()] < np.pi / 6


def test_poses_beyond_the_limit_or_out_of_reach_are_left_out(blob: ObjectModel) -> None:
    X_PO = pose(2)
    contacts = touch_samples(blob, X_PO, [10, 500, 700, 900])
    table = contact_table(blob.coarse_field, contacts, 0.004, 0.2)
    features, field = blob.pair_features, blob.coarse_field
    pair = ContactPair(0, 1, np.arange(0, len(features.pairs), 997, dtype=np.int32), 1)
    every = judge_pairs([pair], features, field, table, EVERY, *EVERYWHERE)
    # Of several pairs the best are found, and most others are not judged to the end.
    parts = [ContactPair(0, 1, pair.matches[k::3], 1) for k in range(3)]
    limited = judge_pairs(parts, features, field, table, 50, *EVERYWHERE)
    joined = np.concatenate([every[k::3] for k in range(3)])
    judged = np.isfinite(limited)
    np.testing.assert_array_equal(limited[judged], joined[judged])
    np.testing.assert_array_equal(np.sort(limited)[:50], np.sort(joined)[:50])
    assert judged.sum() < 0.7 * len(joined)
    near = judge_pairs([pair], features, field, table, EVERY, X_PO, (1.0, 0.05), np.eye(3, 4)[None])
    X_all = pair_poses([pair], features, table, np.arange(len(every)))
    within = (rotation_angles(X_all[:, :, :3], X_PO[:, :3]) <= 1.0) & (
        np.linalg.norm(X_all[:, :, 3] - X_PO[:, 3], axis=1) <= 0.05
    )
    assert 0 < within.sum() < len(within)
    np.testing.assert_array_equal(np.isfinite(near), within)


def test_a_pose_is_in_reach_when_a_symmetry_brings_it_there(blob: ObjectModel) -> None:
    X_PO = pose(3)
    contacts = touch_samples(blob, X_PO, [10, 500, 700])
    table = contact_table(blob.coarse_field, contacts, 0.004, 0.2)
    features, field = blob.pair_features, blob.coarse_field
    pair = ContactPair(0, 1, np.arange(0, len(features.pairs), 997, dtype=np.int32), 1)
    # A turn of a third about an axis that does not meet O's origin.
    turns = RotationalSymmetry(np.array([0.6, 0.0, 0.8]), np.array([0.03, 0.05, 0.0]), 3).poses()
    near = judge_pairs([pair], features, field, table, EVERY, X_PO, (0.8, 0.1), turns)
    images = compose(pair_poses([pair], features, table, np.arange(pair.count))[:, None], turns)
    within = (rotation_angles(images[..., :3], X_PO[:, :3]) <= 0.8) & (
        np.linalg.norm(images[..., 3] - X_PO[:, 3], axis=-1) <= 0.1
    )
    assert within[:, 1:].any(axis=1).sum() > within[:, 0].sum() / 2
    np.testing.assert_array_equal(np.isfinite(near), within.any(axis=1))


def test_of_poses_close_together_the_first_is_kept() -> None:
    generator = np.random.default_rng(0)
    far = make_poses(random_rotations(generator, 50), generator.normal(size=(50, 3)))
    assert distinct_poses(far, 0.004, 0.1).all()
    twice = np.concatenate([far, far + 1e-12])
    kept = distinct_poses(twice, 0.004, 0.1)
    assert kept[:50].all()
    assert kept[50:].sum() <= 2
    assert len(distinct_poses(far[:0], 0.004, 0.1)) == 0


def test_the_cost_is_that_of_each_contact_once(blob: ObjectModel) -> None:
    contacts = touch_samples(blob, pose(4), [10, 500, 700, 900, 300])
    contacts = Contacts(contacts.p_PC + 0.003 * np.random.default_rng(0).normal(size=(5, 3)), contacts.n_PC)
    features, field = blob.pair_features, blob.coarse_field
    table = contact_table(field, contacts, 0.004, 0.2)
    matches = np.arange(0, len(features.pairs), 9973, dtype=np.int32)
    pairs = [ContactPair(a, b, matches, 1) for a, b in ((0, 1), (2, 3), (4, 2))]
    found = judge_pairs(pairs, features, field, table, EVERY, *EVERYWHERE)
    X_PO = pair_poses(pairs, features, table, np.arange(len(found)))
    arguments = (field.values, field.shape, field.origin, 1 / field.spacing, field.spacing / field.step, table)
    expected = [coarse_cost(*arguments, np.arange(5), X, np.inf) for X in X_PO]
    np.testing.assert_allclose(found, expected, rtol=1e-3)
