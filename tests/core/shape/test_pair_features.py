import numpy as np
import pytest
import trimesh

from tactopose_drake.core.poses import compose, make_poses, random_rotations, transform_points
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.shape.pair_feature_kernels import find_matches
from tactopose_drake.core.shape.pair_features import PairFeatures, build_pair_features, fundamental_points, pair_feature

NO_SYMMETRY = np.eye(3, 4)[None]


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    return ObjectModel.from_mesh(trimesh.creation.box((0.06, 0.09, 0.14)).subdivide().subdivide())


def matches(
    features: PairFeatures, wanted: np.ndarray, sigma: np.ndarray, step: int = 1, room: int = 10**6
) -> np.ndarray:
    found = np.empty(room, dtype=np.int32)
    arguments = (wanted / features.unit, features.unit / sigma, 2.0, step, found)
    count = find_matches(features.features, features.first, *arguments)
    assert count == find_matches(features.features, features.first, *arguments[:-1], found[:1].copy())
    return found[:count]


def test_samples_are_as_far_apart_as_the_area_of_each_says(box: ObjectModel) -> None:
    features = build_pair_features(box.samples, box.area, NO_SYMMETRY)
    assert features.spacing**2 * len(features.points) == pytest.approx(box.area)


def test_no_motion_changes_a_feature() -> None:
    generator = np.random.default_rng(0)
    X = make_poses(random_rotations(generator, 1), generator.normal(size=(1, 3)))[0]
    for _ in range(20):
        p, n = generator.normal(size=(2, 3)), generator.normal(size=(2, 3))
        n /= np.linalg.norm(n, axis=1, keepdims=True)
        q, m = transform_points(X, p), n @ X[:, :3].T
        here, there = pair_feature(p[0], n[0], p[1], n[1]), pair_feature(q[0], m[0], q[1], m[1])
        np.testing.assert_allclose(here, there, atol=1e-7)


def test_a_feature_is_a_distance_and_three_angles() -> None:
    x, y, z = np.eye(3)
    np.testing.assert_allclose(pair_feature(0 * x, -x, 0.2 * x, y), [0.2, np.pi, np.pi / 2, np.pi / 2])
    np.testing.assert_allclose(pair_feature(x, x, x + 3 * z, z), [3.0, np.pi / 2, 0.0, np.pi / 2])


@pytest.mark.parametrize(
    "sigma", [np.array([0.004, 0.2, 0.15, 0.3]), np.array([0.001, np.inf, np.inf, np.inf]), np.full(4, np.inf)]
)
def test_matches_are_those_that_a_search_of_all_pairs_finds(blob: ObjectModel, sigma: np.ndarray) -> None:
    features = build_pair_features(blob.samples, blob.area, NO_SYMMETRY, max_points=100)
    n = len(features.points)
    wanted = pair_feature(features.points[3], features.normals[3], features.points[70], features.normals[70])
    found = {tuple(pair) for pair in features.pairs[matches(features, wanted, sigma)].tolist()}
    rounding = np.array([features.length, np.pi, np.pi, np.pi]) / 255 / sigma
    for i in range(n):
        for j in range(n):
            if i == j:
                assert (i, j) not in found
                continue
            other = pair_feature(features.points[i], features.normals[i], features.points[j], features.normals[j])
            off = np.linalg.norm((other - wanted) / sigma)
            if abs(off - 2.0) > np.linalg.norm(rounding):
                assert ((i, j) in found) == (off < 2.0)


def test_every_so_many_pairs_are_looked_at_with_a_step(blob: ObjectModel) -> None:
    features = blob.pair_features
    for sigma in (np.array([0.004, 0.2, 0.15, 0.3]), np.array([0.003, np.inf, np.inf, np.inf])):
        wanted = pair_feature(features.points[3], features.normals[3], features.points[700], features.normals[700])
        every = matches(features, wanted, sigma)
        np.testing.assert_array_equal(matches(features, wanted, sigma, step=16), every[every % 16 == 0])
        assert 16 * len(matches(features, wanted, sigma, step=16)) == pytest.approx(len(every), rel=0.3)


def test_of_pairs_that_a_symmetry_turns_into_each_other_one_is_kept(box: ObjectModel) -> None:
    assert len(box.symmetry_poses) == 4
    points = box.samples.points
    kept = points[fundamental_points(points, box.symmetry_poses)]
    assert len(kept) == pytest.approx(len(points) / 4, rel=0.1)
    # Every point comes back by a symmetry.
    images = transform_points(box.symmetry_poses, kept).reshape(-1, 3)
    assert max(np.linalg.norm(images - p, axis=1).min() for p in points[::50]) < 0.01
    assert len(box.pair_features.pairs) == pytest.approx(1000 * 999 / 4, rel=0.1)


def test_a_cylinders_pairs_start_in_one_sector() -> None:
    can = ObjectModel.from_mesh(trimesh.creation.cylinder(radius=0.033, height=0.115, sections=64))
    # Twelve turns and a flip.
    assert len(can.pair_features.pairs) < 1000 * 999 / 20


def test_pairs_are_made_once_for_a_model(blob: ObjectModel) -> None:
    assert blob.pair_features is blob.pair_features
    assert blob.pair_features.spacing == pytest.approx(np.sqrt(blob.area / 1000))


def test_the_group_of_symmetries_is_applied_to_points_not_to_poses(box: ObjectModel) -> None:
    # A symmetry about an axis beside the origin keeps as many points.
    shift = make_poses(np.eye(3)[None], np.array([[0.2, -0.1, 0.3]]))
    back = make_poses(np.eye(3)[None], -shift[:, :, 3])
    moved = compose(compose(shift, box.symmetry_poses), back)
    here = fundamental_points(box.samples.points, box.symmetry_poses)
    np.testing.assert_array_equal(fundamental_points(box.samples.points + shift[0, :, 3], moved), here)
