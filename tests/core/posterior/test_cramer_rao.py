import math

import numpy as np
import pytest
import trimesh

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.objectives.objective import SumObjective
from tactopose_drake.core.objectives.pose_prior import PriorObjective
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.poses import compose, exp_so3, increments_between, make_poses, random_rotations, retract
from tactopose_drake.core.posterior.cramer_rao import cramer_rao_bound
from tactopose_drake.core.posterior.modes import determined_part
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface
from tactopose_drake.errors import InvalidInputError, TooFewContactsError

SIGMA_POSITION, SIGMA_NORMAL = 0.0005, math.radians(3.0)


@pytest.fixture(scope="module")
def cylinder() -> ObjectModel:
    return ObjectModel.from_mesh(trimesh.creation.cylinder(radius=0.03, height=0.14, sections=64))


def grasp(model: ObjectModel, count: int, seed: int) -> tuple[Contacts, np.ndarray]:
    """Exact contacts, with the noise that they would have, and the true pose."""
    generator = np.random.default_rng(seed)
    X_PO = make_poses(random_rotations(generator, 1), 0.05 * generator.normal(size=(1, 3)))[0]
    exact = touch_surface(model, X_PO, count, generator, sigma_position=0.0, sigma_normal=0.0)
    return Contacts(exact.p_PC, exact.n_PC, sigma_position=SIGMA_POSITION, sigma_normal=SIGMA_NORMAL), X_PO


def measure(exact: Contacts, generator: np.random.Generator) -> Contacts:
    assert exact.n_PC is not None
    turn = exp_so3(generator.normal(size=(len(exact), 3)) * SIGMA_NORMAL)
    return Contacts(
        exact.p_PC + generator.normal(size=(len(exact), 3)) * SIGMA_POSITION,
        np.einsum("kij,kj->ki", turn, exact.n_PC),
        sigma_position=SIGMA_POSITION,
        sigma_normal=SIGMA_NORMAL,
    )


@pytest.mark.parametrize("has_prior", [False, True])
def test_the_scatter_of_the_best_fit_is_the_bound(blob: ObjectModel, has_prior: bool) -> None:
    exact, X_PO = grasp(blob, 8, 1)
    sigmas = np.array([0.02, 0.0005])  # Of the order of what the touch says.
    prior = GaussianPrior(X_PO, sigma_rotation=sigmas[0], sigma_translation=sigmas[1]) if has_prior else None
    bound = cramer_rao_bound(blob, exact, X_PO, prior)
    generator = np.random.default_rng(0)
    errors = []
    for _ in range(1500):
        touch = SurfaceContact(blob.grid, measure(exact, generator))
        objective = SumObjective([touch])
        if has_prior:
            X_prior = retract(X_PO, generator.normal(size=6) * np.repeat(sigmas, 3))
            objective = SumObjective(
                [touch, PriorObjective(GaussianPrior(X_prior, sigma_rotation=sigmas[0], sigma_translation=sigmas[1]))]
            )
        errors.append(increments_between(LevenbergMarquardt().refine(objective, X_PO[None]).X_PO[0], X_PO))
    # In the bound's own units the scatter is the unit matrix: 1500 draws know its parts to about 0.04.
    whiten = np.linalg.cholesky(np.linalg.inv(bound.covariance)).T
    scatter = np.cov((np.array(errors) @ whiten.T).T)
    np.testing.assert_allclose(scatter, np.eye(6), atol=0.2)
    assert np.trace(scatter) == pytest.approx(6.0, rel=0.08)


def test_the_spin_and_slide_of_a_cylinder_are_infinitely_uncertain(cylinder: ObjectModel) -> None:
    p = 0.03
    sides = np.array([[p, 0, 0.0], [-p, 0, 0.0], [0, p, -0.03], [0, -p, -0.01]])
    contacts = Contacts(sides, sides * [1, 1, 0] / p)
    bound = cramer_rao_bound(cylinder, contacts, np.eye(4))
    assert bound.free_directions.shape == (2, 6)
    for direction in (np.eye(6)[2], np.eye(6)[5]):
        assert np.linalg.norm(determined_part(direction, bound.free_directions, cylinder.size)) < 0.05
        assert bound.variance(direction) == math.inf
        assert np.linalg.norm(bound.covariance @ direction) < 0.05 * np.linalg.norm(bound.covariance)
    assert bound.rms_rotation == bound.rms_translation == math.inf
    # A prior makes them as uncertain as it is itself.
    prior = GaussianPrior(np.eye(4), sigma_translation=0.033, sigma_rotation=0.3)
    with_prior = cramer_rao_bound(cylinder, contacts, np.eye(4), prior)
    np.testing.assert_allclose(with_prior.sigmas[[2, 5]], [0.3, 0.033], rtol=0.02)
    assert with_prior.free_directions.shape == (2, 6)
    roots = np.sqrt(np.trace(with_prior.covariance[:3, :3])), np.sqrt(np.trace(with_prior.covariance[3:, 3:]))
    assert (with_prior.rms_rotation, with_prior.rms_translation) == pytest.approx(roots)
    # Two contacts at the height of O's origin, one on each side, say where it is across; and a little the normals of
    # the other two, which turn by one radian in 30 mm.
    across = np.eye(6)[3] - cylinder_free_part(bound.free_directions, np.eye(6)[3])
    least = 1.0 / (2.0 / 0.0009**2 + 2.0 / (0.03 * math.radians(5.0)) ** 2)
    assert 0.97 * least < bound.variance(across) < 0.0009**2 / 2


def cylinder_free_part(free: np.ndarray, function: np.ndarray) -> np.ndarray:
    basis = np.linalg.qr(free.T)[0]
    part: np.ndarray = basis @ (basis.T @ function)
    return part


def test_a_function_that_the_free_directions_do_not_change_is_as_certain_as_by_elimination(blob: ObjectModel) -> None:
    # One contact: its distance to the surface is all that is known of the translation.
    exact, X_PO = grasp(blob, 1, 3)
    bound = cramer_rao_bound(blob, Contacts(exact.p_PC, sigma_position=0.001), X_PO)
    assert len(bound.free_directions) == 5
    whole = np.linalg.eigh(bound.information)
    function = whole.eigenvectors[:, -1]
    assert bound.variance(function) == pytest.approx(1.0 / whole.eigenvalues[-1], rel=1e-3)


def test_the_bound_falls_with_more_contacts_and_less_noise(blob: ObjectModel) -> None:
    exact, X_PO = grasp(blob, 10, 2)
    assert exact.n_PC is not None
    all_of_them = cramer_rao_bound(blob, exact, X_PO)
    fewer = cramer_rao_bound(blob, Contacts(exact.p_PC[:6], exact.n_PC[:6], sigma_position=SIGMA_POSITION), X_PO)
    assert np.all(np.linalg.eigvalsh(fewer.covariance - all_of_them.covariance) > -1e-12)
    noisier = Contacts(exact.p_PC, exact.n_PC, sigma_position=2 * SIGMA_POSITION, sigma_normal=2 * SIGMA_NORMAL)
    # Fourfold at the most: the surface's own spread of normals, which adds to the noise, stays as it is.
    ratio = np.linalg.eigvals(np.linalg.solve(all_of_them.covariance, cramer_rao_bound(blob, noisier, X_PO).covariance))
    assert np.all((ratio > 3.0) & (ratio < 4.0 + 1e-9))


def test_the_bound_moves_with_the_frame(blob: ObjectModel) -> None:
    exact, X_PO = grasp(blob, 7, 4)
    assert exact.n_PC is not None
    X_QP = make_poses(exp_so3(np.array([0.3, -1.0, 2.0])), np.array([0.1, 0.2, -0.3]))
    moved = Contacts(
        exact.p_PC @ X_QP[:, :3].T + X_QP[:, 3],
        exact.n_PC @ X_QP[:, :3].T,
        sigma_position=SIGMA_POSITION,
        sigma_normal=SIGMA_NORMAL,
    )
    here, there = cramer_rao_bound(blob, exact, X_PO), cramer_rao_bound(blob, moved, compose(X_QP, X_PO))
    turn = np.block([[np.eye(3), np.zeros((3, 3))], [np.zeros((3, 3)), X_QP[:, :3]]])
    np.testing.assert_allclose(turn @ here.covariance @ turn.T, there.covariance, rtol=1e-6, atol=1e-14)


def test_bad_arguments_are_named(blob: ObjectModel) -> None:
    exact, X_PO = grasp(blob, 3, 5)
    with pytest.raises(TooFewContactsError, match=r"contacts must be at least 1 .*, not 0"):
        cramer_rao_bound(blob, Contacts.empty(), X_PO)
    with pytest.raises(InvalidInputError, match="X_PO must have a rotation matrix as its left 3x3 block"):
        cramer_rao_bound(blob, exact, 2 * X_PO)
    with pytest.raises(InvalidInputError, match=r"function must have the shape .*"):
        cramer_rao_bound(blob, exact, X_PO).variance([1.0])
