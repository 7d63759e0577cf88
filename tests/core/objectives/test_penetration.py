import numpy as np
import pytest
import trimesh

from tactopose_drake.core.evidence.hand_geometry import HandGeometry
from tactopose_drake.core.objectives.penetration import Penetration, overlap_slope
from tactopose_drake.core.poses import (
    compose,
    exp_so3,
    inverse,
    make_poses,
    random_rotations,
    retract,
    transform_points,
)
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.resources import model_path
from tests.core.objectives.laws import check_derivatives

RADIUS = 0.04
IDENTITY = np.eye(3, 4)[None]


@pytest.fixture(scope="module")
def ball() -> ObjectModel:
    return ObjectModel.from_mesh(trimesh.creation.icosphere(subdivisions=4, radius=RADIUS))


@pytest.fixture(scope="module")
def mug() -> ObjectModel:
    return ObjectModel.from_mesh(model_path("objects", "mug.obj"))


def fist(seed: int, count: int = 150, spread: float = 0.08) -> HandGeometry:
    """Spheres of all sizes, close together."""
    generator = np.random.default_rng(seed)
    return HandGeometry(generator.uniform(-spread, spread, (count, 3)), generator.uniform(0.002, 0.012, count))


def poses_near(seed: int, count: int, spread: float) -> np.ndarray:
    generator = np.random.default_rng(seed)
    return make_poses(random_rotations(generator, count), generator.normal(size=(count, 3)) * spread)


def test_the_residual_of_a_ball_is_its_depth_in_sigmas(ball: ObjectModel) -> None:
    # 10 mm spheres whose surfaces are 3 mm inside, 1 mm inside, and 1 mm outside of the ball.
    hand = HandGeometry([[0.047, 0, 0], [0, 0.049, 0], [0, 0, -0.051]], np.full(3, 0.01), sigma=0.0005)
    exact = np.sort(Penetration(ball.grid, hand).residuals(IDENTITY)[0])
    np.testing.assert_allclose(exact, [0.0, 2.0, 6.0], atol=0.3)
    lenient = np.sort(Penetration(ball.grid, hand, allowed=0.002).residuals(IDENTITY)[0])
    np.testing.assert_allclose(lenient, [0.0, 0.0, 2.0], atol=0.3)


def test_a_hand_that_merely_touches_costs_nothing(ball: ObjectModel) -> None:
    generator = np.random.default_rng(1)
    away = generator.normal(size=(40, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    # All around the ball, half a millimetre in it.
    hand = HandGeometry(away * (RADIUS + 0.008 - 0.0005), np.full(40, 0.008))
    equations = Penetration(ball.grid, hand, allowed=0.002).normal_equations(IDENTITY)
    assert equations.cost[0] == 0.0
    np.testing.assert_array_equal(equations.gradient, 0.0)
    np.testing.assert_array_equal(equations.hessian, 0.0)


def test_the_deepest_sphere_of_a_neighbourhood_counts(mug: ObjectModel) -> None:
    # All within reach of the largest, which starts the only neighbourhood.
    hand = fist(2, spread=0.005)
    penetration = Penetration(mug.grid, hand, allowed=0.001)
    X_PO = poses_near(3, 500, 0.05)
    p_OH = (hand.p_PH - X_PO[:, None, :, 3]) @ X_PO[:, :, :3]
    depth = np.max(hand.radius - mug.grid.distance(p_OH), axis=1)
    expected = np.maximum(depth - 0.001, 0.0) / hand.sigma
    assert 50 < np.count_nonzero(expected) < 450
    np.testing.assert_allclose(penetration.residuals(X_PO)[:, 0], expected, atol=1e-9)


def test_every_sphere_is_in_one_neighbourhood(mug: ObjectModel) -> None:
    # One at a time far from the others: each is found, so none is skipped for a neighbour's sake.
    hand = fist(4)
    X_PO = poses_near(5, 300, 0.05)
    p_OH = (hand.p_PH - X_PO[:, None, :, 3]) @ X_PO[:, :, :3]
    deepest = np.max(hand.radius - mug.grid.distance(p_OH), axis=1)
    residuals = Penetration(mug.grid, hand).residuals(X_PO)
    np.testing.assert_allclose(residuals.max(axis=1), np.maximum(deepest, 0.0) / hand.sigma, atol=1e-9)


def test_no_neighbourhood_that_is_in_the_object_is_passed_over(mug: ObjectModel) -> None:
    # Many are beside the grid or just about touch: what a coarse look leaves out is out, to the last one.
    generator = np.random.default_rng(14)
    hand = HandGeometry(generator.uniform(-0.2, 0.2, (400, 3)), generator.uniform(0.001, 0.03, 400))
    X_PO = poses_near(15, 200, 0.08)
    residuals = Penetration(mug.grid, hand, neighbourhood=1e-9).residuals(X_PO)
    p_OH = (hand.p_PH - X_PO[:, None, :, 3]) @ X_PO[:, :, :3]
    depth = np.maximum(hand.radius - mug.grid.distance(p_OH), 0.0) / hand.sigma
    assert np.count_nonzero(depth) > 1000
    # Spheres alone, each its own neighbourhood, come by falling radius.
    expected = depth[:, np.argsort(-hand.radius, kind="stable")]
    np.testing.assert_allclose(residuals, expected, atol=1e-9)


def test_hands_that_are_joined_count_as_their_sum(mug: ObjectModel) -> None:
    one, other = (
        Penetration(mug.grid, fist(16, 60), allowed=0.002),
        Penetration(mug.grid, HandGeometry(fist(17, 30).p_PH, np.full(30, 0.004), sigma=0.003)),
    )
    X_PO, both = poses_near(18, 50, 0.05), one.joined(other)
    assert min(np.count_nonzero(each.cost(X_PO)) for each in (one, other)) > 20
    np.testing.assert_array_equal(
        both.residuals(X_PO), np.concatenate([one.residuals(X_PO), other.residuals(X_PO)], axis=1)
    )
    for mine, first, second in zip(
        both.normal_equations(X_PO), one.normal_equations(X_PO), other.normal_equations(X_PO), strict=True
    ):
        np.testing.assert_allclose(mine, first + second, rtol=1e-9, atol=1e-9 * np.abs(mine).max())
    np.testing.assert_allclose(both.cost(X_PO), 0.5 * np.square(both.residuals(X_PO)).sum(axis=1), rtol=1e-12)


def test_denser_packing_costs_no_more(mug: ObjectModel) -> None:
    hand = fist(6)
    inside = HandGeometry(np.repeat(hand.p_PH, 3, axis=0), np.outer(hand.radius, [1.0, 0.9, 0.8]).ravel())
    X_PO = poses_near(7, 50, 0.05)
    np.testing.assert_allclose(Penetration(mug.grid, inside).cost(X_PO), Penetration(mug.grid, hand).cost(X_PO))


def test_distant_parts_of_the_hand_add_up(ball: ObjectModel) -> None:
    one = HandGeometry([[0.045, 0, 0]], [0.01])
    two = HandGeometry([[0.045, 0, 0], [-0.045, 0, 0]], [0.01, 0.01])
    costs = [Penetration(ball.grid, hand).cost(IDENTITY)[0] for hand in (one, two)]
    assert costs[1] == pytest.approx(2.0 * costs[0], rel=0.02)


def test_the_palm_frame_is_of_no_consequence(mug: ObjectModel) -> None:
    hand, X_PO = fist(8), poses_near(9, 20, 0.05)
    X_QP = poses_near(10, 1, 0.2)
    moved = HandGeometry(transform_points(X_QP[0], hand.p_PH), hand.radius)
    np.testing.assert_allclose(
        Penetration(mug.grid, moved).cost(compose(X_QP, X_PO)), Penetration(mug.grid, hand).cost(X_PO), rtol=1e-6
    )


def test_a_pose_that_is_none_is_no_crash(ball: ObjectModel) -> None:
    X_PO = np.full((1, 3, 4), np.nan)
    assert Penetration(ball.grid, fist(1)).residuals(X_PO).max() == 0.0


@pytest.mark.parametrize("angle", [0.0, 1e-8, 1.0, np.pi])
def test_the_derivatives_are_exact(blob: ObjectModel, angle: float) -> None:
    generator = np.random.default_rng(11)
    turned = make_poses(exp_so3(angle * np.array([[0.36, -0.48, 0.8]])), generator.normal(size=(1, 3)) * 0.01)
    X_PO = retract(turned, generator.normal(size=(20, 6)) * 0.02)
    penetration = Penetration(blob.grid, fist(12), allowed=0.001)
    assert np.all(penetration.cost(X_PO) > 1.0)
    check_derivatives(penetration, X_PO)


def test_the_slope_of_the_deepest_overlap_is_its_derivative(ball: ObjectModel) -> None:
    hand, step = HandGeometry([[0.047, 0, 0], [0, 0.049, 0], [0, 0, -0.051]], np.full(3, 0.01)), 1e-4

    def deepest(X_PO: np.ndarray) -> float:
        return float((hand.radius - ball.grid.distance(transform_points(inverse(X_PO), hand.p_PH))).max())

    X_PO = poses_near(4, 20, 0.003)
    for X, slope in zip(X_PO, overlap_slope(ball.grid, hand, X_PO), strict=True):
        changes = [deepest(retract(X, step * row)) - deepest(retract(X, -step * row)) for row in np.eye(6)]
        assert np.array(changes) / (2.0 * step) == pytest.approx(slope, abs=0.05)


def test_so_it_is_where_the_surface_is_no_ball_and_the_spheres_are_of_unlike_sizes(blob: ObjectModel) -> None:
    # The largest sphere reaches deepest, though its centre is farthest.
    directions = np.array([[1.0, 0.2, -0.1], [-0.3, 1.0, 0.4], [0.2, -0.5, -1.0]])
    rays = directions[:, None] * np.linspace(0.0, 0.2, 4001)[:, None]
    outside = np.array([ray[np.flatnonzero(blob.grid.distance(ray) > 0.004)[0]] for ray in rays])
    farther = rays[0][np.flatnonzero(blob.grid.distance(rays[0]) > 0.010)[0]]
    centers, radii, step = np.concatenate([farther[None], outside[1:]]), np.array([0.018, 0.006, 0.006]), 1e-5
    X_PO = retract(poses_near(4, 12, 0.0005), np.repeat([0.02, 0.0], 3) * np.random.default_rng(1).normal(size=(12, 6)))
    hand = HandGeometry(transform_points(X_PO.mean(axis=0), centers), radii)

    def deepest(X: np.ndarray) -> float:
        return float((radii - blob.grid.distance(transform_points(inverse(X), hand.p_PH))).max())

    slopes = overlap_slope(blob.grid, hand, X_PO)
    changes = np.array(
        [[deepest(retract(X, step * row)) - deepest(retract(X, -step * row)) for row in np.eye(6)] for X in X_PO]
    ) / (2.0 * step)
    # Normals are those of the cell, the derivative that of the distance in it. By turns it is in metres.
    for part in (slice(0, 3), slice(3, 6)):
        off = np.linalg.norm(changes[:, part] - slopes[:, part]) / np.linalg.norm(changes[:, part])
        assert off < 0.3
    assert np.median(np.linalg.norm(changes[:, :3], axis=1)) > 0.005
