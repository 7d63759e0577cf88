import numpy as np
from scipy.spatial.distance import cdist

from tactopose_drake.core.objectives.cell_distance import CellDistance
from tactopose_drake.core.poses import make_poses, random_rotations, transform_points
from tactopose_drake.core.sensing.patches import Patch, describe_patch
from tactopose_drake.core.shape.point_grid import build_point_grid
from tactopose_drake.core.synthetic.synthetic_patch import flat_pad

GENERATOR = np.random.default_rng(0)
CLOUD = GENERATOR.normal(size=(500, 3)) * 0.04
POSES = make_poses(random_rotations(GENERATOR, 30), GENERATOR.normal(size=(30, 3)) * 0.03)


def pad(seed: int) -> Patch:
    generator = np.random.default_rng(seed)
    pressure = generator.uniform(0.0, 1e4, 24) * (generator.random(24) < 0.6)
    return describe_patch(flat_pad() + generator.normal(size=3) * 0.03, pressure, alpha=1e-7)


def test_it_is_the_mean_squared_distance_of_the_active_cells() -> None:
    patches = [pad(seed) for seed in range(3)]
    expected = np.zeros(30)
    for b, X_PO in enumerate(POSES):
        for patch in patches:
            gaps = cdist(patch.points[patch.active], transform_points(X_PO, CLOUD)).min(axis=1)
            expected[b] += np.mean(gaps**2)
    objective = CellDistance(build_point_grid(CLOUD), patches)
    np.testing.assert_allclose(objective.cost(POSES), expected, rtol=1e-9)


def test_a_pad_that_feels_nothing_costs_nothing() -> None:
    nothing = describe_patch(flat_pad(), np.zeros(24), alpha=1e-7)
    grid = build_point_grid(CLOUD)
    np.testing.assert_array_equal(CellDistance(grid, [nothing]).cost(POSES), 0.0)
    alone, beside = CellDistance(grid, [pad(1)]), CellDistance(grid, [nothing, pad(1), nothing])
    np.testing.assert_array_equal(alone.cost(POSES), beside.cost(POSES))


def test_the_gradient_is_the_derivative() -> None:
    # One cell, over a plate's point.
    plate = np.array([[0.01 * i, 0.01 * j, 0.0] for i in range(-3, 4) for j in range(-3, 4)])
    patch = describe_patch([[0.001, 0.002, 0.003]], [1e4], alpha=0.0)
    equations = CellDistance(build_point_grid(plate), [patch]).normal_equations(np.eye(3, 4)[None])
    # d |q - s|^2 / dv = -2 (q - s); d / dw = 2 (q - s) x s for the point s = 0.
    np.testing.assert_allclose(equations.gradient[0], [0.0, 0.0, 0.0, -0.002, -0.004, -0.006], atol=1e-5)
