import numpy as np
import pytest
import trimesh

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.identification import index_kernels
from tactopose_drake.core.identification.library_index import (
    LEAST_DENSITY,
    SAMPLES,
    LibraryIndex,
    PairCounts,
    _weights,
    count_pairs,
)
from tactopose_drake.core.poses import random_rotations
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.shape.pair_features import pair_feature
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface

SHAPES = {
    "cube": trimesh.creation.box((0.06, 0.06, 0.06)),
    "rod": trimesh.creation.cylinder(0.008, 0.15, sections=32),
    "ball": trimesh.creation.icosphere(3, 0.035),
    "plate": trimesh.creation.box((0.12, 0.12, 0.012)),
}


@pytest.fixture(scope="module")
def models() -> list[ObjectModel]:
    return [ObjectModel.from_mesh(mesh, samples=SAMPLES, spacing=0.003, cache=False) for mesh in SHAPES.values()]


@pytest.fixture(scope="module")
def index(models: list[ObjectModel]) -> LibraryIndex:
    return LibraryIndex.join([count_pairs(model.samples) for model in models])


def touch(model: ObjectModel, seed: int) -> Contacts:
    generator = np.random.default_rng(seed)
    X_PO = np.column_stack([random_rotations(generator, 1)[0], generator.normal(size=3)])
    return touch_surface(model, X_PO, 5, generator, spread=False)


def test_every_pair_is_counted(models: list[ObjectModel], index: LibraryIndex) -> None:
    for i, model in enumerate(models):
        pairs = count_pairs(model.samples)
        assert np.all(np.diff(pairs.bins) > 0)
        assert pairs.counts.sum() == SAMPLES * (SAMPLES - 1)
        assert index.counts[index.objects == i].sum() == SAMPLES * (SAMPLES - 1)


def test_objects_of_distinct_shape_are_told_apart(models: list[ObjectModel], index: LibraryIndex) -> None:
    first = [
        int(index.scores(touch(model, seed)).argmax() == i) for i, model in enumerate(models) for seed in range(10)
    ]
    assert np.mean(first) >= 0.9


@pytest.mark.parametrize("sigma_position", [0.0009, 0.006])  # m; the second tilts the line between two contacts
@pytest.mark.parametrize("has_normals", [True, False])
def test_densities_are_those_of_the_samples_pairs(
    models: list[ObjectModel], index: LibraryIndex, has_normals: bool, sigma_position: float
) -> None:
    """A kernel about the contacts' feature, summed over all pairs one by one."""
    measured = touch(models[0], 1)
    assert measured.n_PC is not None
    n_PC = measured.n_PC[:2] if has_normals else None
    contacts = Contacts(measured.p_PC[:2], n_PC, sigma_position=sigma_position)
    points, normals = models[0].samples.points, models[0].samples.normals
    apart = points[None] - points[:, None]
    length = np.linalg.norm(apart, axis=-1) + np.eye(SAMPLES)
    unit = apart / length[..., None]
    features = [
        length,
        np.arccos(np.clip(np.einsum("ia,ija->ij", normals, unit), -1, 1)),
        np.arccos(np.clip(np.einsum("ja,ija->ij", normals, unit), -1, 1)),
        np.arccos(np.clip(normals @ normals.T, -1, 1)),
    ]
    width = np.array([index_kernels.DISTANCE, *np.full(3, index_kernels.ANGLE)])
    distance = float(np.linalg.norm(contacts.p_PC[1] - contacts.p_PC[0]))
    sigma = [np.sqrt(2.0) * sigma_position]
    feature = np.array([distance, 0.0, 0.0, 0.0])
    if contacts.n_PC is not None:
        feature = pair_feature(contacts.p_PC[0], contacts.n_PC[0], contacts.p_PC[1], contacts.n_PC[1])
        turn = np.radians(5.0)
        sigma += [np.hypot(turn, sigma[0] / distance)] * 2 + [np.sqrt(2.0) * turn]
    kernel = ~np.eye(SAMPLES, dtype=bool) * 1.0
    for a, spread in enumerate(np.sqrt((np.array(sigma) / width[: len(sigma)]) ** 2 + 1.0 / 6.0)):
        # Of a distance the bins begin at zero, of an angle the first bin's middle is there.
        bins = np.floor(features[a] / width[a]) + 0.5 if a == 0 else np.rint(features[a] / width[a])
        steps = bins - feature[a] / width[a]
        kernel *= np.exp(-0.5 * (steps / spread) ** 2) / (np.sqrt(2.0 * np.pi) * spread)
    expected = kernel.sum() / (SAMPLES * (SAMPLES - 1))
    found = np.exp(index.scores(contacts)[0]) - LEAST_DENSITY
    # Bins beyond 2.5 standard deviations, a hundredth of each direction, are left out.
    assert found == pytest.approx(expected, rel=0.06)


def test_bins_of_distances_begin_at_zero_and_those_of_angles_have_their_middle_there() -> None:
    generator, table = np.random.default_rng(0), index_kernels.DISTANCE_BINS * index_kernels.ANGLE_BINS**3
    width = np.array([index_kernels.DISTANCE, *np.full(3, index_kernels.ANGLE)])
    for _ in range(20):
        points, normals = (
            0.01 * generator.normal(size=(2, 3)),
            np.ascontiguousarray(random_rotations(generator, 2)[:, 0]),
        )
        counts = np.zeros(table, dtype=np.int64)
        index_kernels.count_features(points, normals, counts)
        for a, b in ((0, 1), (1, 0)):
            feature = pair_feature(points[a], normals[a], points[b], normals[b]) / width
            d, *angles = int(np.floor(feature[0])), *np.rint(feature[1:]).astype(int).tolist()
            assert counts[np.ravel_multi_index((d, *angles), (table // 13**3, 13, 13, 13))] >= 1
        assert counts.sum() == 2


def test_weights_are_highest_where_a_feature_is_and_fall_alike_to_both_sides() -> None:
    width = np.array([index_kernels.DISTANCE, *np.full(3, index_kernels.ANGLE)])
    low, weights = _weights(np.array([20.5, 4.0, 6.0, 8.0]) * width, 0.6 * width)
    np.testing.assert_array_equal(low + weights.argmax(axis=1), [20, 4, 6, 8])
    for row in weights:
        row = row[row > 0.0]
        np.testing.assert_allclose(row, row[::-1], rtol=1e-9)
        assert row.max() > 1.1 * np.sort(row)[-2]
        assert row.sum() == pytest.approx(1.0, abs=0.02)


def test_normals_that_are_any_count_as_none(models: list[ObjectModel], index: LibraryIndex) -> None:
    contacts = touch(models[1], 4)
    bare = Contacts(contacts.p_PC)
    anyhow = Contacts(contacts.p_PC, np.tile([0.0, 0.0, 1.0], (len(contacts), 1)), sigma_normal=1e3)
    assert np.ptp(index.scores(bare)) > 1.0
    np.testing.assert_allclose(index.scores(anyhow), index.scores(bare), rtol=1e-12)


def test_moving_the_hand_changes_nothing(models: list[ObjectModel], index: LibraryIndex) -> None:
    contacts = touch(models[3], 2)
    R = random_rotations(np.random.default_rng(5), 1)[0]
    assert contacts.n_PC is not None
    moved = Contacts(contacts.p_PC @ R.T + 1.0, contacts.n_PC @ R.T)
    np.testing.assert_allclose(index.scores(moved), index.scores(contacts), rtol=1e-6)


def test_an_objects_score_is_its_own(models: list[ObjectModel], index: LibraryIndex) -> None:
    contacts, order = touch(models[1], 3), [2, 0, 3]
    fewer = LibraryIndex.join([count_pairs(models[i].samples) for i in order])
    np.testing.assert_array_equal(fewer.scores(contacts), index.scores(contacts)[order])


def test_contacts_that_say_nothing_leave_all_objects_equal(index: LibraryIndex) -> None:
    assert np.ptp(index.scores(Contacts([[0.0, 0.0, 0.1]], [[0.0, 0.0, 1.0]]))) == 0.0
    together = Contacts([[0.0, 0.0, 0.1], [0.0, 0.0005, 0.1]], [[0.0, 0.0, 1.0]] * 2)
    assert np.ptp(index.scores(together)) == 0.0


def test_distances_beyond_the_last_bin_are_counted_there() -> None:
    long = ObjectModel.from_mesh(trimesh.creation.box((1.6, 0.05, 0.05)), samples=SAMPLES, spacing=0.02, cache=False)
    index = LibraryIndex.join([count_pairs(long.samples)])
    ends = Contacts([[-0.8, 0.0, 0.0], [0.8, 0.0, 0.0]], [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    apart = Contacts([[-3.0, 0.0, 0.0], [3.0, 0.0, 0.0]], [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    assert np.isfinite(index.scores(apart)).all()
    assert index.scores(ends)[0] > np.log(LEAST_DENSITY) + 1.0


def test_counts_from_a_file_are_checked(models: list[ObjectModel]) -> None:
    pairs = count_pairs(models[0].samples)
    found = PairCounts.from_arrays({"bins": pairs.bins, "counts": pairs.counts})
    assert found is not None
    np.testing.assert_array_equal(found.bins, pairs.bins)
    beyond, before = pairs.bins.copy(), pairs.bins.copy()
    beyond[-1], before[0] = 2**31 - 1, -1
    for bins in (beyond, before, pairs.bins[::-1], pairs.bins[:-1], pairs.bins.astype(np.int64)):
        assert PairCounts.from_arrays({"bins": bins, "counts": pairs.counts}) is None
    assert PairCounts.from_arrays({"bins": pairs.bins[:0], "counts": pairs.counts[:0]}) is None
    assert PairCounts.from_arrays({"bins": pairs.bins}) is None
