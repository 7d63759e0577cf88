import numpy as np
import pytest

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.poses import compose, make_poses, random_rotations, rotation_angles, transform_points
from tactopose_drake.core.searches.pairs.pair_poses import _ALIKE, MatchedPairs, best_poses, contact_table
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.shape.symmetry import RotationalSymmetry
from tests.coarse_costs import cost_at
from tests.core.models import brick

# So many by all contacts, and so many by all but one.
ALL, BUT_FOR_ONE = (10**6, 0), (0, 10**6)
EVERYWHERE = (np.eye(3, 4), (np.pi, np.inf), np.eye(3, 4)[None])


def pose(seed: int) -> np.ndarray:
    generator = np.random.default_rng(seed)
    return make_poses(random_rotations(generator, 1), 0.1 * generator.normal(size=(1, 3)))[0]


def touch_samples(model: ObjectModel, X_PO: np.ndarray, rows: list[int]) -> Contacts:
    """Exact contacts at two of the samples that are paired, and at others."""
    features = model.pair_features
    return Contacts(transform_points(X_PO, features.points[rows]), features.normals[rows] @ X_PO[:, :3].T)


def match_of(model: ObjectModel, i: int, j: int) -> np.ndarray:
    return np.flatnonzero((model.pair_features.pairs == (i, j)).all(axis=1)).astype(np.int32)


def every_so_many(model: ObjectModel, step: int) -> np.ndarray:
    return np.arange(0, len(model.pair_features.pairs), step, dtype=np.int32)


def matched(*pairs: tuple[int, int, np.ndarray], spins: int = 1) -> MatchedPairs:
    """Of two contacts each, and their matches."""
    begins = np.cumsum([0] + [len(matches) for *_, matches in pairs])
    ends = np.array([(first, second) for first, second, _ in pairs])
    return MatchedPairs(ends, np.full(len(pairs), spins), begins, np.concatenate([matches for *_, matches in pairs]))


@pytest.mark.parametrize("seed", range(5))
def test_the_right_match_gives_the_pose(blob: ObjectModel, seed: int) -> None:
    X_PO = pose(seed)
    i, j, *others = np.random.default_rng(seed).choice(1000, 5, replace=False).tolist()
    contacts = touch_samples(blob, X_PO, [i, j, *others])
    table = contact_table(blob.coarse_field, contacts, 0.0, 0.1)
    pairs = matched((0, 1, match_of(blob, i, j)))
    (found, cost), _ = best_poses(pairs, blob.pair_features, blob.coarse_field, table, ALL, *EVERYWHERE)
    assert len(found) == len(cost) == 1
    np.testing.assert_allclose(found[0], X_PO, atol=1e-6)  # Poses are laid out in singles.
    assert cost[0] < 15.0


def test_both_points_stay_on_the_surface_whatever_the_spin(blob: ObjectModel) -> None:
    X_PO = pose(1)
    contacts = touch_samples(blob, X_PO, [10, 500, 700])
    table = contact_table(blob.coarse_field, contacts, 0.001, 0.1)
    pairs = matched((0, 1, match_of(blob, 10, 500)), spins=12)
    (found, cost), _ = best_poses(pairs, blob.pair_features, blob.coarse_field, table, ALL, *EVERYWHERE)
    assert len(found) == 12
    np.testing.assert_allclose(
        found[:, :, :3] @ np.swapaxes(found[:, :, :3], 1, 2), np.tile(np.eye(3), (12, 1, 1)), atol=1e-12
    )
    for row, index in enumerate((10, 500)):
        touched = transform_points(found, blob.pair_features.points[index][None])[:, 0]
        np.testing.assert_allclose(touched, np.tile(contacts.p_PC[row], (12, 1)), atol=1e-12)
    turns = np.sort(rotation_angles(found[:, :, :3], found[0, :, :3]))
    np.testing.assert_allclose(turns, np.pi / 6 * np.array([0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5, 6]), atol=1e-6)
    # The best of the twelve turns is the one next to the truth.
    assert (np.diff(cost) >= 0.0).all()
    assert rotation_angles(found[0, :, :3], X_PO[:, :3]) < np.pi / 6


def test_of_several_pairs_the_best_poses_are_found(blob: ObjectModel) -> None:
    contacts = touch_samples(blob, pose(2), [10, 500, 700, 900])
    table = contact_table(blob.coarse_field, contacts, 0.004, 0.2)
    features, field, matches = blob.pair_features, blob.coarse_field, every_so_many(blob, 997)
    (X_every, every), _ = best_poses(matched((0, 1, matches)), features, field, table, ALL, *EVERYWHERE)
    assert len(every) == len(matches)
    parts = matched(*((0, 1, matches[k::3]) for k in range(3)))
    (X_best, best), _ = best_poses(parts, features, field, table, (50, 0), *EVERYWHERE)
    # Of those that are alike any counts as the better one.
    told, first = best >= _ALIKE * len(contacts), every[:50] >= _ALIKE * len(contacts)
    assert np.count_nonzero(told) == np.count_nonzero(first) > 40
    np.testing.assert_array_equal(best[told], every[:50][first])
    np.testing.assert_allclose(X_best[told], X_every[:50][first], atol=1e-12)


def test_where_one_contact_is_spared_a_pose_costs_what_the_others_do(blob: ObjectModel) -> None:
    contacts = touch_samples(blob, pose(2), [10, 500, 700, 900])
    table = contact_table(blob.coarse_field, contacts, 0.004, 0.2)
    features, field, pairs = blob.pair_features, blob.coarse_field, matched((0, 1, every_so_many(blob, 997)))
    _, (X_PO, cost) = best_poses(pairs, features, field, table, BUT_FOR_ONE, *EVERYWHERE)
    assert len(X_PO) == len(best_poses(pairs, features, field, table, ALL, *EVERYWHERE)[0].X_PO) > 50
    own = np.array([[cost_at(field, row[None], X) for row in table] for X in X_PO])
    expected = own.sum(axis=1) - own.max(axis=1)
    told = expected >= _ALIKE * 3
    assert np.count_nonzero(told) > 0
    # Poses come out in doubles, and are judged in singles: a contact may come to lie in the next voxel.
    close = np.isclose(cost[told], expected[told], rtol=1e-3)
    assert close.mean() > 0.95
    assert (np.diff(cost) >= 0.0).all()


def test_poses_of_both_kinds_are_those_of_each_alone(blob: ObjectModel) -> None:
    contacts = touch_samples(blob, pose(2), [10, 500, 700, 900])
    table = contact_table(blob.coarse_field, contacts, 0.004, 0.2)
    given = matched((0, 1, every_so_many(blob, 97))), blob.pair_features, blob.coarse_field, table
    together = best_poses(*given, (60, 20), *EVERYWHERE)
    alone = best_poses(*given, (60, 0), *EVERYWHERE)[0], best_poses(*given, (0, 20), *EVERYWHERE)[1]
    for both, one, count in zip(together, alone, (60, 20), strict=True):
        assert len(both.X_PO) == count
        np.testing.assert_array_equal(both.X_PO, one.X_PO)
        np.testing.assert_array_equal(both.cost, one.cost)
    assert together[1].cost[0] < together[0].cost[0]


def test_poses_out_of_reach_are_left_out(blob: ObjectModel) -> None:
    X_PO = pose(2)
    contacts = touch_samples(blob, X_PO, [10, 500, 700, 900])
    table = contact_table(blob.coarse_field, contacts, 0.004, 0.2)
    features, field, pairs = blob.pair_features, blob.coarse_field, matched((0, 1, every_so_many(blob, 997)))
    (X_all, every), _ = best_poses(pairs, features, field, table, ALL, *EVERYWHERE)
    (X_near, near), _ = best_poses(pairs, features, field, table, ALL, X_PO, (1.0, 0.05), np.eye(3, 4)[None])
    within = (rotation_angles(X_all[:, :, :3], X_PO[:, :3]) <= 1.0) & (
        np.linalg.norm(X_all[:, :, 3] - X_PO[:, 3], axis=1) <= 0.05
    )
    assert 0 < within.sum() < len(within)
    np.testing.assert_array_equal(near, every[within])
    np.testing.assert_allclose(X_near, X_all[within], atol=1e-12)


def test_a_pose_is_in_reach_when_a_symmetry_brings_it_there(blob: ObjectModel) -> None:
    X_PO = pose(3)
    contacts = touch_samples(blob, X_PO, [10, 500, 700])
    table = contact_table(blob.coarse_field, contacts, 0.004, 0.2)
    features, field, pairs = blob.pair_features, blob.coarse_field, matched((0, 1, every_so_many(blob, 997)))
    # A turn of a third about an axis that does not meet O's origin.
    turns = RotationalSymmetry(np.array([0.6, 0.0, 0.8]), np.array([0.03, 0.05, 0.0]), 3).poses()
    (X_all, every), _ = best_poses(pairs, features, field, table, ALL, *EVERYWHERE)
    (_, near), _ = best_poses(pairs, features, field, table, ALL, X_PO, (0.8, 0.1), turns)
    images = compose(X_all[:, None], turns)
    within = (rotation_angles(images[..., :3], X_PO[:, :3]) <= 0.8) & (
        np.linalg.norm(images[..., 3] - X_PO[:, 3], axis=-1) <= 0.1
    )
    assert within[:, 1:].any(axis=1).sum() > within[:, 0].sum() / 2
    np.testing.assert_array_equal(near, every[within.any(axis=1)])


def test_the_cost_is_that_of_each_contact_once(blob: ObjectModel) -> None:
    contacts = touch_samples(blob, pose(4), [10, 500, 700, 900, 300])
    contacts = Contacts(contacts.p_PC + 0.003 * np.random.default_rng(0).normal(size=(5, 3)), contacts.n_PC)
    features, field = blob.pair_features, blob.coarse_field
    table = contact_table(field, contacts, 0.004, 0.2)
    pairs = matched(*((a, b, every_so_many(blob, 9973)) for a, b in ((0, 1), (2, 3), (4, 2))))
    (X_PO, cost), _ = best_poses(pairs, features, field, table, ALL, *EVERYWHERE)
    assert len(cost) == pairs.begins[-1]
    expected = [cost_at(field, table, X) for X in X_PO]
    np.testing.assert_allclose(cost, expected, rtol=1e-3)


def test_without_pairs_there_are_no_poses(blob: ObjectModel) -> None:
    table = contact_table(blob.coarse_field, touch_samples(blob, pose(4), [10]), 0.004, 0.2)
    none = MatchedPairs(
        np.empty((0, 2), dtype=np.intp), np.empty(0, dtype=np.int64), np.zeros(1, dtype=np.intp), match_of(blob, 1, 2)
    )
    (X_PO, cost), _ = best_poses(none, blob.pair_features, blob.coarse_field, table, (10, 0), *EVERYWHERE)
    assert X_PO.shape == (0, 3, 4)
    assert cost.shape == (0,)


@pytest.mark.parametrize("has_normals", [True, False])
def test_a_contact_is_as_unsure_as_its_sensor_the_poses_and_the_voxel_that_stands_for_its_place(
    has_normals: bool,
) -> None:
    """A distance in steps, by the middle of the voxel in which the contact is; normals by themselves."""
    field, generator = brick(0.06, 0.09, 0.13).coarse_field, np.random.default_rng(0)
    p_PC, n_PC = generator.normal(size=(3, 3)), np.array([[1.0, 0.0, 0.0], [0.0, 0.6, 0.8], [0.48, 0.64, 0.6]])
    sigmas, turns = np.array([0.0009, 0.002, 0.004]), np.array([0.05, 0.1, 0.2])
    contacts = Contacts(p_PC, n_PC if has_normals else None, sigma_position=sigmas, sigma_normal=turns)
    table = contact_table(field, contacts, 0.003, 0.15)
    np.testing.assert_array_equal(table[:, :3], p_PC)
    by_voxel = np.mean((n_PC @ generator.uniform(-0.5, 0.5, (3, 200_000)) * field.spacing) ** 2, axis=1)
    variance = sigmas**2 + 0.003**2 + by_voxel
    np.testing.assert_allclose(table[:, 6] * (0.001 / field.step) ** 2, 0.001**2 / variance, rtol=0.01)
    np.testing.assert_allclose(table[:, 7], has_normals / (turns**2 + 0.15**2))
    np.testing.assert_array_equal(table[:, 3:6], n_PC if has_normals else np.zeros((3, 3)))


def test_of_poses_that_cost_the_same_none_displaces_a_cheaper_one(blob: ObjectModel) -> None:
    contacts = Contacts(touch_samples(blob, pose(5), [10, 500, 700, 900]).p_PC)
    features, field = blob.pair_features, blob.coarse_field
    table = contact_table(field, contacts, 0.0, 0.1)
    pairs = matched((0, 1, every_so_many(blob, 97)), (2, 3, every_so_many(blob, 89)), spins=12)
    every = best_poses(pairs, features, field, table, (10**6, 10**6), *EVERYWHERE)
    for most in (100, 300, 1000):
        best = best_poses(pairs, features, field, table, (most, most), *EVERYWHERE)
        for few, all_of_them in zip(best, every, strict=True):
            np.testing.assert_array_equal(few.cost, all_of_them.cost[:most])


def test_normals_that_ask_for_opposite_spins_leave_it_open() -> None:
    box = brick(0.06, 0.1, 0.18)
    features = box.pair_features
    i, j = features.pairs.T
    opposed = np.flatnonzero(features.normals[i, 0] * features.normals[j, 0] == -1.0)[:500].astype(np.int32)
    assert len(opposed) == 500
    contacts = Contacts(
        [[0.03, -0.02, 0.05], [0.03, 0.03, -0.03], [0.03, 0.02, 0.07]], np.tile([1.0, 0.0, 0.0], (3, 1))
    )
    table = contact_table(box.coarse_field, contacts, 0.002, 0.2)
    pairs = matched((0, 1, opposed))
    (X_PO, cost), _ = best_poses(pairs, features, box.coarse_field, table, ALL, *EVERYWHERE)
    assert len(X_PO) == 500
    assert np.isfinite(cost).all()
    np.testing.assert_allclose(np.linalg.det(X_PO[:, :, :3]), 1.0, atol=1e-9)
