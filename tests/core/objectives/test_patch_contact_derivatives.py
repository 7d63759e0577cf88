import numpy as np
import pytest

from tactopose_drake.core.objectives.patch_contact import PatchCells, PatchContact
from tactopose_drake.core.poses import exp_so3, make_poses, retract, transform_points
from tactopose_drake.core.sensing.patches import describe_patch
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.synthetic.synthetic_patch import flat_pad
from tests.core.meshes import smooth_shape
from tests.core.objectives.pads import ALPHA, NOISE, OUT, pads_on


@pytest.mark.parametrize("angle", [0.0, 1e-8, 1.0, np.pi])
def test_where_the_residuals_vanish_the_jacobian_is_the_central_difference(slab: ObjectModel, angle: float) -> None:
    R_PO = exp_so3(np.array([0.36, -0.48, 0.8]) * angle)
    X_PO = make_poses(R_PO, np.array([0.01, -0.02, 0.03]))
    patches = []
    for x, y in [(0.0, 0.0), (0.04, 0.01), (-0.02, 0.05)]:
        # The pads lean, and the cells at their ends do not touch.
        cells = flat_pad() @ exp_so3(np.array([0.02, 0.1, 0.0])).T + np.array([x, y, -0.0003])
        n_PT = np.tile(exp_so3(np.array([0.02, 0.1, 0.0]))[:, 2] * -1.0, (24, 1))
        depth = np.maximum(0.0, cells[:, 2] / n_PT[0, 2])
        assert 5 < np.count_nonzero(depth) < 20
        patches.append(describe_patch(transform_points(X_PO, cells), depth / ALPHA, alpha=ALPHA, n_PT=n_PT @ R_PO.T))
    objective = PatchCells(slab.grid, patches, **NOISE)
    step = 1e-4 * np.eye(6)
    there, back = objective.residuals(retract(X_PO[None], step)), objective.residuals(retract(X_PO[None], -step))
    residuals, jacobian = objective.residuals_and_jacobian(X_PO[None])
    np.testing.assert_allclose(residuals, 0.0, atol=1e-3)
    assert np.abs(jacobian).max() > 100.0
    np.testing.assert_allclose(jacobian[0], (there - back).T / 2e-4, rtol=1e-3, atol=0.1)


def test_the_gradient_is_the_central_difference_of_the_cost() -> None:
    # Where a body curves more, the misplacements are found less exactly.
    rounder = ObjectModel.from_mesh(smooth_shape().apply_scale([1 / 0.7, 1.0, 1 / 1.3]))
    X_PO, patches = pads_on(rounder, 4)
    objective = PatchContact(rounder.grid, patches)
    poses = retract(X_PO[None], np.random.default_rng(4).normal(size=(20, 6)) * ([0.05] * 3 + [0.002] * 3))
    equations = objective.normal_equations(poses)
    off = []
    for pose, gradient, hessian in zip(poses, equations.gradient, equations.hessian, strict=True):
        units = np.linalg.cholesky(np.linalg.inv(hessian))  # columns of one standard deviation
        step = 1e-4 * units.T
        slope = (objective.cost(retract(pose[None], step)) - objective.cost(retract(pose[None], -step))) / 2e-4
        off.append(np.abs(units.T @ gradient - slope))
    assert np.median(off) < 1e-3
    # Where another number of steps finds the misplacements, the cost jumps by some 1e-5.
    assert np.quantile(off, 0.9) < 0.1


def test_the_gradient_is_the_jacobian_times_the_residuals(angular: ObjectModel) -> None:
    X_PO, patches = pads_on(angular, 5)
    objective = PatchContact(angular.grid, patches)
    poses = retract(X_PO[None], np.random.default_rng(5).normal(size=(20, 6)) * 0.02)
    residuals, jacobian = objective.residuals_and_jacobian(poses)
    expected = np.einsum("bmi,bm->bi", jacobian, residuals)
    np.testing.assert_allclose(objective.normal_equations(poses).gradient, expected, rtol=1e-8, atol=1e-6)


def test_the_hessian_is_gauss_newton(slab: ObjectModel, blob: ObjectModel) -> None:
    # On a flat face the smooth normals are the exact ones.
    pressure = np.where(np.arange(24) < 15, 8e3, 0.0)
    flat = [
        describe_patch(flat_pad() + np.array([x, y, -0.0006]), pressure, alpha=ALPHA, n_PT=-OUT)
        for x, y in [(0.0, 0.0), (0.04, 0.01), (-0.02, 0.05)]
    ]
    X_PO, patches = pads_on(blob, 6)
    tilted = make_poses(exp_so3(np.array([[0.02, -0.03, 0.3]])), np.zeros((1, 3)))
    for model, pads, pose, tolerance in [(slab, flat, tilted, 0.004), (blob, patches, X_PO[None], 0.2)]:
        objective = PatchCells(model.grid, pads, **NOISE)
        _, jacobian = objective.residuals_and_jacobian(pose)
        expected = jacobian[0].T @ jacobian[0]
        scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected))) + 1e-6
        assert np.abs((objective.normal_equations(pose).hessian[0] - expected) / scale).max() < tolerance
