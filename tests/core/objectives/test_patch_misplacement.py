"""Pads that say themselves by how much they may be misplaced."""

import dataclasses
import math

import numpy as np
import pytest

from tactopose_drake.core.evidence.patch_contacts import patch_contacts
from tactopose_drake.core.objectives.patch_contact import PatchCells, PatchContact
from tactopose_drake.core.poses import exp_so3, inverse, make_poses, retract, transform_points
from tactopose_drake.core.sensing.patches import Patch, describe_patch
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.synthetic.synthetic_patch import flat_pad, touch_with_pads
from tactopose_drake.errors import InvalidInputError
from tests.core.objectives.pads import ALPHA, NOISE, OUT, pads_on, random_pose


def by_sigmas(shift: float, turn: float) -> np.ndarray:
    return np.diag(np.repeat([shift**2, turn**2], 3))


def some_covariance(seed: int) -> np.ndarray:
    """Of some millimetres and degrees, each number with something of the others."""
    A = np.random.default_rng(seed).normal(size=(6, 6)) * np.repeat([0.001, 0.03], 3)[:, None]
    covariance: np.ndarray = A @ A.T
    return covariance


def told(patches: list[Patch], seed: int) -> list[Patch]:
    return [dataclasses.replace(p, misplacement=some_covariance(seed + i)) for i, p in enumerate(patches)]


def test_a_covariance_of_the_sigmas_is_the_sigmas(blob: ObjectModel) -> None:
    X_PO, patches = pads_on(blob, 21)
    poses = retract(X_PO[None], np.random.default_rng(21).normal(size=(10, 6)) * ([0.03] * 3 + [0.002] * 3))
    noise = NOISE | {"share": 0.0}  # An alpha that is off comes to what patches say themselves.
    expected = PatchCells(blob.grid, patches, **noise)
    same = by_sigmas(NOISE["sigma_position"], NOISE["sigma_rotation"])
    said = [dataclasses.replace(patch, misplacement=same) for patch in patches]
    # What the objective is told of other pads is nothing to these.
    for sigma_position, sigma_rotation in ((NOISE["sigma_position"], NOISE["sigma_rotation"]), (0.0, 0.0)):
        others = noise | {"sigma_position": sigma_position, "sigma_rotation": sigma_rotation}
        objective = PatchCells(blob.grid, said, **others)
        np.testing.assert_allclose(objective.cost(poses), expected.cost(poses), rtol=2e-3)
        hessians = (objective.normal_equations(poses).hessian, expected.normal_equations(poses).hessian)
        np.testing.assert_allclose(*hessians, rtol=1e-2, atol=1e-2 * np.abs(hessians[1]).max())


def test_a_pad_that_cannot_be_misplaced_in_some_directions_is_known_there_to_a_hundredth_of_a_millimetre(
    blob: ObjectModel,
) -> None:
    """And to a ten-thousandth of a radian."""
    X_PO, patches = pads_on(blob, 21)
    poses = retract(X_PO[None], np.random.default_rng(21).normal(size=(10, 6)) * ([0.01] * 3 + [0.001] * 3))
    along = np.zeros((6, 6))
    along[0, 0] = 0.001**2
    least = np.diag(np.repeat([1e-5, 1e-4], 3) ** 2)
    costs = [
        PatchCells(blob.grid, [dataclasses.replace(p, misplacement=each) for p in patches], **NOISE).cost(poses)
        for each in (along, along + 1e-3 * least, along + 8.0 * least)
    ]
    np.testing.assert_allclose(costs[1], costs[0], rtol=1e-3)
    assert np.all(costs[2] < costs[0])


@pytest.mark.parametrize("scale", [1.0, 0.1])
def test_on_a_flat_surface_a_correlated_misplacement_and_an_alpha_that_is_off_are_integrated_out(
    slab: ObjectModel, scale: float
) -> None:
    pressure = np.random.default_rng(2).uniform(5e3, 2e4, 24)
    X_PO = make_poses(exp_so3(np.array([[0.7, -0.4, 0.3]])), np.array([[0.02, -0.01, 0.001]]))[0]
    covariance = scale**2 * some_covariance(3)
    cells = transform_points(X_PO, flat_pad())
    patch = describe_patch(cells, pressure, alpha=ALPHA, n_PT=-OUT @ X_PO[:, :3].T, misplacement=covariance)
    tilted = retract(X_PO[None], np.array([[0.03, 0.02, 0.0, 0.0, 0.0, 0.001]]))
    middle, depth = cells.mean(axis=0), ALPHA * pressure
    points = cells - depth[:, None] * patch.n_PT

    def phi(shift: np.ndarray, turn: np.ndarray) -> np.ndarray:
        moved = points + shift + np.cross(turn, points - middle)
        return slab.grid.distance(transform_points(inverse(tilted[0]), moved))

    d = phi(np.zeros(3), np.zeros(3))
    by_u = np.stack([phi(1e-3 * u[:3], 1e-3 * u[3:]) - d for u in np.eye(6)], axis=1) / 1e-3
    noise = np.diag(NOISE["sigma_depth"] ** 2 + (NOISE["share"] * depth) ** 2)
    by_alpha = by_u[:, :3] @ patch.n_PT[0] * NOISE["share"] * depth.mean()
    spread = noise + by_u @ covariance @ by_u.T + np.outer(by_alpha, by_alpha)
    expected = 0.5 * d @ np.linalg.solve(spread, d)
    assert PatchCells(slab.grid, [patch], **NOISE).cost(tilted)[0] == pytest.approx(expected, rel=1e-3)


def test_cost_gradient_and_residuals_agree(angular: ObjectModel) -> None:
    X_PO, patches = pads_on(angular, 23)
    objective = PatchContact(angular.grid, told(patches, 30))
    poses = retract(X_PO[None], np.random.default_rng(23).normal(size=(20, 6)) * 0.02)
    residuals, jacobian = objective.residuals_and_jacobian(poses)
    equations = objective.normal_equations(poses)
    np.testing.assert_allclose(objective.cost(poses), 0.5 * np.sum(residuals**2, axis=1), rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(equations.gradient, np.einsum("bmi,bm->bi", jacobian, residuals), rtol=1e-7, atol=1e-5)


def test_moving_the_palm_frame_moves_the_answer(blob: ObjectModel) -> None:
    X_PO, X_QP = random_pose(24), random_pose(25)
    patches = told(list(touch_with_pads(blob, X_PO, 3, np.random.default_rng(24))), 40)
    R = np.kron(np.eye(2), X_QP[:, :3])
    moved = [
        describe_patch(
            transform_points(X_QP, p.p_PT),
            p.pressure,
            alpha=p.alpha,
            n_PT=p.n_PT @ X_QP[:, :3].T,
            misplacement=R @ p.misplacement @ R.T,
        )
        for p in patches
    ]
    poses = retract(X_PO[None], np.random.default_rng(26).normal(size=(10, 6)) * 0.01)
    X_QO = make_poses(X_QP[:, :3] @ poses[..., :3], transform_points(X_QP, poses[..., 3]))
    costs = PatchContact(blob.grid, patches).cost(poses)
    np.testing.assert_allclose(PatchContact(blob.grid, moved).cost(X_QO), costs, rtol=1e-6)


def test_a_pad_may_be_off_in_the_direction_that_it_says(slab: ObjectModel) -> None:
    def cost(direction: int) -> float:
        """Of a pad 4 mm above the slab that may be 4 mm off along one axis."""
        covariance = by_sigmas(1e-4, 1e-3)
        covariance[direction, direction] = 0.004**2
        cells = flat_pad() + np.array([0.0, 0.0, 0.004])
        patch = describe_patch(cells, np.full(24, 2e3), alpha=ALPHA, n_PT=-OUT, misplacement=covariance)
        return float(PatchContact(slab.grid, [patch]).cost(np.eye(3, 4)[None])[0])

    assert cost(2) == pytest.approx(0.5, abs=0.1)
    assert min(cost(0), cost(1)) > 100.0


def test_an_alpha_that_is_off_costs_a_deep_pad_that_is_well_placed_next_to_nothing(slab: ObjectModel) -> None:
    def cost(off: float, push: float) -> float:
        """Of a pad pushed in by so much, whose alpha is off by a share of itself."""
        cells, covariance = flat_pad() - np.array([0.0, 0.0, push]), by_sigmas(1e-4, 1e-3)
        pressure = np.full(24, push * (1.0 + off) / ALPHA)
        patch = describe_patch(cells, pressure, alpha=ALPHA, n_PT=-OUT, misplacement=covariance)
        return float(PatchCells(slab.grid, [patch], **NOISE).cost(np.eye(3, 4)[None])[0])

    for push in (0.001, 0.003):
        assert cost(0.0, push) == pytest.approx(0.0, abs=1e-3)
        assert cost(NOISE["share"], push) < 0.6
    assert cost(3.0 * NOISE["share"], 0.003) > 1.5


def test_contacts_of_misplaced_patches_are_as_uncertain() -> None:
    patch = describe_patch(flat_pad(), np.full(24, 5e3), alpha=ALPHA, n_PT=-OUT, misplacement=by_sigmas(0.004, 0.01))
    turned = describe_patch(flat_pad(), np.full(24, 5e3), alpha=ALPHA, n_PT=-OUT, misplacement=by_sigmas(1e-4, 0.3))
    felt = patch_contacts([patch, turned])
    assert felt.sigma_position[0] == pytest.approx(0.004, rel=1e-3)
    assert felt.sigma_normal[0] < 0.1
    assert felt.sigma_normal[1] == pytest.approx(math.hypot(0.3, 0.0), rel=0.05)


@pytest.mark.parametrize(
    "misplacement", [np.eye(5), np.full((6, 6), np.nan), np.triu(np.ones((6, 6))), np.diag([-1e-6, 1, 1, 1, 1, 1])]
)
def test_a_misplacement_is_a_covariance(misplacement: np.ndarray) -> None:
    with pytest.raises(InvalidInputError, match="misplacement"):
        describe_patch(flat_pad(), np.ones(24), alpha=ALPHA, n_PT=-OUT, misplacement=misplacement)
