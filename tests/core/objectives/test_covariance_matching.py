import dataclasses

import numpy as np
import pytest
import trimesh

from tactopose_drake.core.objectives.cell_distance import CellDistance
from tactopose_drake.core.objectives.covariance_matching import CovarianceMatching
from tactopose_drake.core.poses import inverse, make_poses, retract, transform_points
from tactopose_drake.core.sensing.patches import Patch, describe_patch
from tactopose_drake.core.sensing.sensing_range import sensing_box
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.shape.point_grid import PointGrid, build_point_grid
from tactopose_drake.core.synthetic.synthetic_patch import flat_pad, touch_with_pads
from tactopose_drake.errors import InvalidInputError
from tests.core.meshes import shape_poor_in_symmetry
from tests.displaced_poses import random_pose

WEIGHTS = {"gate": 0.03, "h1": 3.0, "h2": 0.2, "h3": 700.0}
BOX = {"thickness": 0.001, "height": 0.004}
IDENTITY = np.eye(3, 4)


@pytest.fixture(scope="module")
def model() -> ObjectModel:
    return ObjectModel.from_mesh(shape_poor_in_symmetry())


@pytest.fixture(scope="module")
def cloud(model: ObjectModel) -> PointGrid:
    return build_point_grid(model.samples.points)


def mismatch(covariance: np.ndarray, eigenvalues: np.ndarray) -> float:
    """q, of a covariance in the eigenbasis (3, 3) and the eigenvalues (3,). [B16] eq. 5.8."""
    return float(np.linalg.norm(covariance - np.diag(eigenvalues)))


def as_listed(points: np.ndarray, patches: list[Patch], X_PO: np.ndarray) -> float:
    """[B16] algorithm 5.2, step by step, for patches that are areas."""
    total = 0.0
    p_PS = transform_points(X_PO, points)
    for patch in patches:
        E, size = patch.eigenvectors, np.linalg.norm(patch.eigenvalues)
        d = np.linalg.norm(p_PS - patch.centroid, axis=1).min()
        box = sensing_box(patch, **BOX)
        p_BS = transform_points(inverse(box.X_PB), p_PS)
        inside = np.all((p_BS >= box.lower) & (p_BS <= box.upper), axis=1)
        if d <= WEIGHTS["gate"] and inside.sum() > 3:
            in_eigenbasis = (p_PS[inside] - patch.centroid) @ E
            r = np.sum(WEIGHTS["h2"] * np.maximum(0.0, -p_BS[inside, 2]))
            q = mismatch(np.cov(in_eigenbasis.T), patch.eigenvalues)
            total += q * WEIGHTS["h3"] + np.linalg.norm(in_eigenbasis.mean(axis=0)) + r
        else:
            total += WEIGHTS["h1"] * d + size * WEIGHTS["h3"]
    return float(total)


def test_the_worked_example() -> None:
    """[B16] eqs. 5.9 and 5.10."""
    eigenvalues = np.array([34.56, 7.86, 0.76]) * 1e-6
    covariance = np.array([[34.15, -0.01, 0.26], [-0.01, 7.55, -0.00], [0.26, -0.00, 0.15]]) * 1e-6
    # Six points with this covariance about the middle of a pad that feels those eigenvalues.
    arms = np.sqrt(5 / 2) * np.linalg.cholesky(covariance).T
    points = np.concatenate([arms, -arms])
    np.testing.assert_allclose(np.cov(points.T), covariance, atol=1e-18)
    cells = flat_pad(6, 4, 0.004)
    flat = describe_patch(cells, np.full(24, 1e4), alpha=0.0, n_PT=np.tile([0.0, 0.0, 1.0], (24, 1)))
    patch = dataclasses.replace(flat, covariance=np.diag(eigenvalues))
    objective = CovarianceMatching(build_point_grid(points), [patch], thickness=0.001, h2=0.0, h3=1.0)
    assert objective.cost(IDENTITY[None])[0] == pytest.approx(0.87846e-6, abs=0.5e-11)


def test_it_is_the_listing(model: ObjectModel, cloud: PointGrid) -> None:
    X_PO = random_pose(1)
    generator = np.random.default_rng(1)
    patches = list(touch_with_pads(model, X_PO, 4, generator))
    assert {patch.status for patch in patches} == {"area"}
    # From almost right to far off: every branch is taken.
    spread = np.repeat([0.0, 0.003, 0.01, 0.03, 0.1], 40)[:, None] * [10.0, 10.0, 10.0, 1.0, 1.0, 1.0]
    poses = retract(X_PO[None], generator.normal(size=spread.shape) * spread)
    expected = [as_listed(model.samples.points, patches, X) for X in poses]
    objective = CovarianceMatching(cloud, patches, **WEIGHTS, **BOX)
    np.testing.assert_allclose(objective.cost(poses), expected, rtol=1e-9)


def test_each_branch_of_the_listing() -> None:
    # A plate of points with 1 mm between them, and a pad of 6 x 4 cells on it whose box holds 24 x 16 of the points.
    side = 0.001 * (np.arange(60) - 29.5)
    plate = np.array([[x, y, 0.0] for x in side for y in side])
    cells = flat_pad(6, 4, 0.004)
    patch = describe_patch(cells, np.full(24, 1e4), alpha=0.0, n_PT=np.tile([0.0, 0.0, 1.0], (24, 1)))
    objective = CovarianceMatching(build_point_grid(plate), [patch], thickness=0.0, height=0.005)

    def cost(z: float) -> float:
        return float(objective.cost(retract(IDENTITY, np.array([[0.0, 0.0, 0.0, 0.0, 0.0, z]])))[0])

    size = float(np.linalg.norm(patch.eigenvalues))
    in_box = plate[(np.abs(plate) < [0.012, 0.008, 1.0]).all(axis=1)]
    assert mismatch(np.cov(in_box.T), np.zeros(3)) > 0
    on_it = cost(0.0)
    np.testing.assert_allclose(cost(0.001), on_it + 0.001, rtol=1e-9)  # further off: the centroids differ
    np.testing.assert_allclose(cost(-0.001), on_it + 0.001 + 0.1 * 0.001 * 24 * 16, rtol=1e-9)  # in the finger
    # Out of the box: the distance, to the nearest of the points.
    for z in (0.007, 0.029, 0.031):
        np.testing.assert_allclose(cost(z), 2.0 * np.hypot(z, 0.001 * np.sqrt(0.5)) + 1000.0 * size, rtol=1e-9)


def test_points_beyond_the_gate_are_not_compared() -> None:
    # Points at the pad's far end only.
    side = 0.001 * np.arange(5)
    corner = np.array([[0.05 + x, y, 0.0] for x in side for y in side])
    cells = flat_pad(50, 4, 0.0025)
    pressure = np.where(cells[:, 0] < 0, 1e4, 0.0)
    patch = describe_patch(cells, pressure, alpha=0.0, n_PT=np.tile([0.0, 0.0, 1.0], (200, 1)))
    grid = build_point_grid(corner)
    distance = float(grid.distance(patch.centroid[None])[0])
    far = CovarianceMatching(grid, [patch], gate=0.99 * distance).cost(IDENTITY[None])[0]
    assert far == pytest.approx(2.0 * distance + 1000.0 * np.linalg.norm(patch.eigenvalues))
    assert CovarianceMatching(grid, [patch], gate=1.01 * distance).cost(IDENTITY[None])[0] < far


def test_what_a_patch_does_not_know_does_not_count(model: ObjectModel, cloud: PointGrid) -> None:
    X_PO = random_pose(2)
    (patch,) = touch_with_pads(model, X_PO, 1, np.random.default_rng(2))
    kept = np.argsort(-patch.pressure)

    def fewer(count: int) -> Patch:
        pressure = np.zeros(24)
        pressure[kept[:count]] = patch.pressure[kept[:count]]
        return describe_patch(patch.p_PT, pressure, alpha=patch.alpha, n_PT=patch.n_PT)

    poses = retract(X_PO[None], np.random.default_rng(3).normal(size=(20, 6)) * 0.01)
    point, pair, nothing = fewer(1), fewer(2), fewer(0)
    assert [point.status, pair.status, nothing.status] == ["point", "row", "no_contact"]
    # One cell: the covariance's weight does not matter. Two: it does.
    by_weight = [CovarianceMatching(cloud, [point], h3=h3).cost(poses) for h3 in (0.0, 1e4)]
    np.testing.assert_array_equal(*by_weight)
    assert np.isfinite(by_weight).all()
    pairs = [CovarianceMatching(cloud, [pair], h3=h3).cost(poses) for h3 in (0.0, 1e4)]
    assert np.all(pairs[1] > pairs[0])
    np.testing.assert_array_equal(CovarianceMatching(cloud, [nothing]).cost(poses), 0.0)
    both = CovarianceMatching(cloud, [patch, nothing]).cost(poses)
    np.testing.assert_array_equal(both, CovarianceMatching(cloud, [patch]).cost(poses))


def test_moving_the_palm_frame_moves_the_answer(model: ObjectModel, cloud: PointGrid) -> None:
    X_PO, X_QP = random_pose(4), random_pose(5)
    patches = touch_with_pads(model, X_PO, 3, np.random.default_rng(4))
    moved = [
        describe_patch(transform_points(X_QP, p.p_PT), p.pressure, alpha=p.alpha, n_PT=p.n_PT @ X_QP[:, :3].T)
        for p in patches
    ]
    poses = retract(X_PO[None], np.random.default_rng(6).normal(size=(50, 6)) * 0.01)
    X_QO = make_poses(X_QP[:, :3] @ poses[..., :3], transform_points(X_QP, poses[..., 3]))
    costs = CovarianceMatching(cloud, patches).cost(poses)
    np.testing.assert_allclose(CovarianceMatching(cloud, moved).cost(X_QO), costs, rtol=1e-6)


def test_a_line_does_not_pass_for_a_plane() -> None:
    """The case of [B16] figure 5.14: an edge's cells lie on the side of the box, but do not look like it."""
    box = ObjectModel.from_mesh(trimesh.creation.box((0.06, 0.06, 0.06)))
    cells = flat_pad(8, 4, 0.0025)
    line = np.where(np.abs(cells[:, 1]) < 0.002, 1e4, 0.0)
    patch = describe_patch(cells, line, alpha=1e-7, n_PT=np.tile([0.0, 0.0, 1.0], (32, 1)))
    on_the_side = np.column_stack([np.eye(3), [0.0, 0.0, 0.03 - 0.001]])
    turn = np.sqrt(0.5)
    on_the_edge = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, turn, -turn, 0.0], [0.0, turn, turn, 0.03 / turn - 0.001]])
    poses, cloud = np.stack([on_the_side, on_the_edge]), build_point_grid(box.samples.points)
    by_distance = CellDistance(cloud, [patch]).cost(poses)
    assert by_distance[1] > 0.5 * by_distance[0]
    by_covariance = CovarianceMatching(cloud, [patch], height=0.001).cost(poses)
    assert by_covariance[1] < 0.5 * by_covariance[0]


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ({"gate": 0.0}, "gate must be a number > 0, not 0"),
        ({"h1": -1.0}, "h1 must be .*, not -1"),
        ({"h2": -1.0}, "h2 must be a number >= 0, not -1"),
        ({"h3": np.nan}, "h3 must be .*, not nan"),
        ({"height": 0.0}, "height must be .*, not 0"),
    ],
)
def test_bad_options_are_named(cloud: PointGrid, option: dict[str, float], message: str) -> None:
    patch = describe_patch(flat_pad(), np.ones(24), alpha=1e-7)
    with pytest.raises(InvalidInputError, match=message):
        CovarianceMatching(cloud, [patch], **option)  # type: ignore[arg-type]
