import numpy as np

from tactopose_drake.core.objectives.finite_differences import DifferencedObjective
from tactopose_drake.core.poses import make_poses, random_rotations
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.validation import FloatArray

POINT, TARGET = np.array([0.3, -0.1, 0.2]), np.array([0.5, 0.4, -0.2])


class Offset(DifferencedObjective):
    """How far the object's point R s + p is from a target, and its height above the floor, if any."""

    def residuals(self, X_PO: FloatArray) -> FloatArray:
        p_PS = X_PO[..., :3] @ POINT + X_PO[..., 3]
        return np.column_stack([p_PS - TARGET, np.maximum(0.0, p_PS[:, 2])])


def poses(count: int) -> FloatArray:
    generator = np.random.default_rng(0)
    return make_poses(random_rotations(generator, count), generator.normal(size=(count, 3)))


def test_the_jacobian_is_the_derivative() -> None:
    residuals, jacobian = Offset().residuals_and_jacobian(poses(20))
    np.testing.assert_array_equal(residuals, Offset().residuals(poses(20)))
    for X_PO, r, J in zip(poses(20), residuals, jacobian, strict=True):
        # d (R s + p) = R (w x s) + v
        by_turn = X_PO[:, :3] @ np.cross(np.eye(3), POINT).T
        expected = np.hstack([by_turn, np.eye(3)])
        np.testing.assert_allclose(J[:3], expected, atol=1e-5)
        np.testing.assert_allclose(J[3], expected[2] * (r[3] > 0), atol=1e-5)


def test_cost_and_normal_equations_follow_from_the_residuals() -> None:
    residuals, jacobian = Offset().residuals_and_jacobian(poses(5))
    equations = Offset().normal_equations(poses(5))
    np.testing.assert_allclose(Offset().cost(poses(5)), 0.5 * np.sum(residuals**2, axis=1))
    np.testing.assert_allclose(equations.cost, Offset().cost(poses(5)))
    np.testing.assert_allclose(equations.gradient, np.einsum("bmi,bm->bi", jacobian, residuals))
    np.testing.assert_allclose(equations.hessian, np.einsum("bmi,bmj->bij", jacobian, jacobian))


def test_a_search_takes_it() -> None:
    assert LevenbergMarquardt().refine(Offset(), poses(5)).cost.max() < 1e-9
