import numpy as np
import pytest
import trimesh

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.kernels.least_squares_kernels import DescentRule
from tactopose_drake.core.objectives.pose_prior import PriorObjective
from tactopose_drake.core.objectives.surface_contact import (
    ContactsButOne,
    ContactSum,
    SurfaceContact,
    along_normals,
)
from tactopose_drake.core.poses import exp_so3, make_poses, random_rotations, retract, transform_points
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface

RADIUS = 0.04


@pytest.fixture(scope="module")
def ball() -> ObjectModel:
    return ObjectModel.from_mesh(trimesh.creation.icosphere(subdivisions=4, radius=RADIUS))


def random_poses(seed: int, count: int, spread: float = 0.01) -> np.ndarray:
    generator = np.random.default_rng(seed)
    return make_poses(random_rotations(generator, count), generator.normal(size=(count, 3)) * spread)


def test_the_residuals_of_a_ball_are_the_formula(ball: ObjectModel) -> None:
    p_PC = np.array([[0.05, 0.0, 0.0], [0.0, -0.03, 0.0]])
    n_PC = np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
    contacts = Contacts(p_PC, n_PC, sigma_position=0.001, sigma_normal=0.1)
    residuals = SurfaceContact(ball.grid, contacts).residuals(np.eye(3, 4)[None])[0].reshape(2, 5)
    np.testing.assert_allclose(residuals[0, :4], [10.0, 10.0, -10.0, 0.0], atol=0.5)
    np.testing.assert_allclose(residuals[1, :4], [-10.0, 0.0, 0.0, 0.0], atol=0.5)
    # The last one is for the spread of the normals about a contact known to a millimetre: there is little on a ball.
    assert np.all(np.abs(residuals[:, 4]) < 0.6)


def test_the_cost_is_half_the_sum_of_squares(blob: ObjectModel) -> None:
    X_PO = random_poses(1, 20)
    contacts = touch_surface(blob, X_PO[0], 5, np.random.default_rng(1))
    objective = SurfaceContact(blob.grid, contacts)
    half_squares = 0.5 * np.sum(objective.residuals(X_PO) ** 2, axis=1)
    np.testing.assert_allclose(objective.cost(X_PO), half_squares, rtol=1e-7)
    np.testing.assert_allclose(objective.normal_equations(X_PO).cost, half_squares, rtol=1e-7)


@pytest.mark.parametrize("with_normals", [True, False])
@pytest.mark.parametrize("angle", [0.0, 1e-8, 1.0, np.pi])
def test_the_jacobian_is_the_central_difference(blob: ObjectModel, with_normals: bool, angle: float) -> None:
    generator = np.random.default_rng(3)
    axis = np.array([0.36, -0.48, 0.8])
    X_true = make_poses(exp_so3(axis * angle)[None], generator.normal(size=(1, 3)) * 0.01)
    contacts = touch_surface(blob, X_true[0], 6, generator)
    if not with_normals:
        contacts = Contacts(contacts.p_PC)
    objective = SurfaceContact(blob.grid, contacts)
    X_PO = retract(X_true, generator.normal(size=(1, 6)) * 0.02)
    step = 1e-9 * np.eye(6)
    there, back = objective.residuals(retract(X_PO, step)), objective.residuals(retract(X_PO, -step))
    _, jacobian = objective.residuals_and_jacobian(X_PO)
    np.testing.assert_allclose(jacobian[0], (there - back).T / 2e-9, rtol=1e-3, atol=1e-2)


def test_the_gradient_is_the_jacobian_times_the_residuals(blob: ObjectModel) -> None:
    X_PO = random_poses(4, 10)
    objective = SurfaceContact(blob.grid, touch_surface(blob, X_PO[0], 5, np.random.default_rng(4)))
    residuals, jacobian = objective.residuals_and_jacobian(X_PO)
    equations = objective.normal_equations(X_PO)
    np.testing.assert_allclose(equations.gradient, np.einsum("bmi,bm->bi", jacobian, residuals), rtol=1e-9, atol=1e-6)


def test_the_hessian_of_a_smooth_body_is_gauss_newton(blob: ObjectModel) -> None:
    X_PO = random_poses(5, 10, spread=0.001)
    objective = SurfaceContact(blob.grid, touch_surface(blob, X_PO[0], 5, np.random.default_rng(5)))
    _, jacobian = objective.residuals_and_jacobian(X_PO[:1])
    # The last residual of each contact, the spread of the normals, is left out of the Hessian.
    rows = jacobian[0].reshape(5, 5, 6)[:, :4].reshape(20, 6)
    expected = rows.T @ rows
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.abs((objective.normal_equations(X_PO[:1]).hessian[0] - expected) / scale).max() < 0.05


def test_on_an_edge_no_normal_is_expected_strongly() -> None:
    box = ObjectModel.from_mesh(trimesh.creation.box((0.04, 0.05, 0.06)))
    edge, middle = [0.02, 0.025, 0.0], [0.02, 0.0, 0.0]
    normals = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.6, 0.8, 0.0]])
    identity = np.eye(3, 4)[None]
    on_edge = [SurfaceContact(box.grid, Contacts([edge], [n])).cost(identity)[0] for n in normals]
    assert max(on_edge) < 6.0
    # Each costs more there than the face's own normal on the face.
    assert min(on_edge) > SurfaceContact(box.grid, Contacts([middle], normals[:1])).cost(identity)[0] + 2.0
    assert SurfaceContact(box.grid, Contacts([middle], normals[1:2])).cost(identity)[0] > 50.0


def test_moving_the_palm_frame_moves_the_answer(blob: ObjectModel) -> None:
    X_PO = random_poses(6, 5)
    X_QP = random_poses(7, 1)[0]
    contacts = touch_surface(blob, X_PO[0], 5, np.random.default_rng(6))
    assert contacts.n_PC is not None
    moved = Contacts(transform_points(X_QP, contacts.p_PC), contacts.n_PC @ X_QP[:, :3].T)
    X_QO = make_poses(X_QP[:, :3] @ X_PO[..., :3], transform_points(X_QP, X_PO[..., 3]))
    np.testing.assert_allclose(
        SurfaceContact(blob.grid, moved).cost(X_QO), SurfaceContact(blob.grid, contacts).cost(X_PO), rtol=1e-6
    )


def test_swapping_fingers_changes_nothing(blob: ObjectModel) -> None:
    X_PO = random_poses(8, 5)
    contacts = touch_surface(blob, X_PO[0], 5, np.random.default_rng(8))
    assert contacts.n_PC is not None
    order = [3, 1, 4, 0, 2]
    swapped = Contacts(contacts.p_PC[order], contacts.n_PC[order])
    np.testing.assert_allclose(
        SurfaceContact(blob.grid, swapped).cost(X_PO), SurfaceContact(blob.grid, contacts).cost(X_PO), rtol=1e-12
    )


def test_far_from_the_grid_the_cost_grows_with_the_distance(ball: ObjectModel) -> None:
    objective = SurfaceContact(ball.grid, Contacts([[1.0, 0.0, 0.0]], sigma_position=0.1))
    distance = 0.1 * objective.residuals(np.eye(3, 4)[None])[0, 0]
    assert distance == pytest.approx(1.0 - RADIUS, rel=0.05)
    _, jacobian = objective.residuals_and_jacobian(np.eye(3, 4)[None])
    assert 0.1 * jacobian[0, 0, 3] == pytest.approx(-1.0, abs=0.01)


def test_the_facets_of_a_cylinder_do_not_determine_its_spin() -> None:
    can = ObjectModel.from_mesh(trimesh.creation.cylinder(radius=0.033, height=0.1, sections=64))
    # At the middles of facets and anywhere between.
    angles = np.array([0.0, 2.0, 4.1]) + np.pi / 64 * np.array([0.0, 0.3, 0.5])
    n_PC = np.stack([np.cos(angles), np.sin(angles), np.zeros(3)], axis=1)
    contacts = Contacts(0.033 * n_PC, n_PC, sigma_position=0.0003, sigma_normal=np.radians(2.0))
    hessian = SurfaceContact(can.grid, contacts).normal_equations(np.eye(3, 4)[None]).hessian[0]
    assert 1.0 / np.sqrt(hessian[2, 2]) > np.radians(20.0)
    assert 1.0 / np.sqrt(hessian[0, 0]) < np.radians(3.0)


def test_along_normals_a_difference_of_normals_has_two_components_and_loses_nothing() -> None:
    generator = np.random.default_rng(5)
    n_O = generator.normal(size=(7, 3))
    n_O /= np.linalg.norm(n_O, axis=1, keepdims=True)
    across = np.cross(n_O, generator.normal(size=(7, 3)))
    residuals = np.concatenate([generator.normal(size=(7, 1)), across], axis=1)
    jacobian = np.einsum("ka,ki->kai", residuals, generator.normal(size=(7, 6)))
    rows, slopes = along_normals(n_O, residuals, jacobian)
    np.testing.assert_allclose(rows[:, 0], residuals[:, 0])
    np.testing.assert_allclose(np.linalg.norm(rows[:, 1:], axis=1), np.linalg.norm(across, axis=1))
    np.testing.assert_allclose(slopes * residuals[:, :1, None], rows[..., None] * jacobian[:, :1], atol=1e-12)
    along = np.concatenate([np.zeros((7, 1)), n_O], axis=1)
    np.testing.assert_allclose(along_normals(n_O, along, jacobian)[0], 0.0, atol=1e-12)


@pytest.mark.parametrize("with_normals", [True, False])
@pytest.mark.parametrize("with_prior", [True, False])
def test_contacts_but_one_are_those_without_the_one_that_a_pose_explains_least(
    blob: ObjectModel, with_normals: bool, with_prior: bool
) -> None:
    X_PO = random_poses(4, 40)
    contacts = touch_surface(blob, X_PO[0], 6, np.random.default_rng(4))
    if not with_normals:
        contacts = Contacts(contacts.p_PC)
    prior = PriorObjective(GaussianPrior(X_PO[0], sigma_translation=0.02, sigma_rotation=0.3)) if with_prior else None
    touch, rule = SurfaceContact(blob.grid, contacts), DescentRule(4, 1e-6, 1e-2, 1e6, 0.1)
    but_one = ContactsButOne(touch, prior)
    dearest = np.square(touch.residuals(X_PO).reshape(40, 6, -1)).sum(axis=2).argmax(axis=1)
    assert len(set(dearest)) > 3
    equations, ends = but_one.normal_equations(X_PO), but_one.descent(rule, X_PO)
    np.testing.assert_array_equal(but_one.cost(X_PO), equations.cost)
    for b, left_out in enumerate(dearest):
        kept = SurfaceContact(blob.grid, contacts[np.delete(np.arange(6), left_out)])
        alone = kept if prior is None else ContactSum(kept, prior)
        for mine, other in zip(equations, alone.normal_equations(X_PO[b : b + 1]), strict=True):
            np.testing.assert_allclose(mine[b], other[0], rtol=1e-9, atol=1e-6)
        for mine, other in zip(ends, alone.descent(rule, X_PO[b : b + 1]), strict=True):
            np.testing.assert_allclose(mine[b], other[0], rtol=1e-6, atol=1e-6)
