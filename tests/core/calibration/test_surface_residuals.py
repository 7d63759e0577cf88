"""The residuals of contacts, and their derivatives, against central differences."""

import numpy as np
import pytest
import trimesh

from tactopose_drake.core.calibration.surface_residuals import ContactSigmas, GraspContacts, surface_rows
from tactopose_drake.core.poses import exp_so3, make_poses, random_rotations, transform_points
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.synthetic.synthetic_touch import random_surface_points


@pytest.fixture
def touched(blob: ObjectModel) -> tuple[np.ndarray, GraspContacts]:
    """Two poses, and six contacts near the surface."""
    generator = np.random.default_rng(4)
    X_PO = make_poses(random_rotations(generator, 2), 0.05 * generator.normal(size=(2, 3)))
    p_O, n_O = random_surface_points(blob, 6, generator)
    p_O = p_O + 0.002 * generator.normal(size=(6, 3))
    grasp = np.array([0, 0, 0, 1, 1, 1])
    p = np.array([transform_points(X_PO[g], q[None])[0] for g, q in zip(grasp, p_O, strict=True)])
    n = np.einsum("nij,nj->ni", X_PO[grasp][:, :, :3] @ exp_so3(0.1 * generator.normal(size=(6, 3))), n_O)
    return X_PO, GraspContacts(grasp, p, n, np.tile(np.eye(6), (6, 1, 1)), np.ones(6, dtype=np.bool_))


NOISE = ContactSigmas(np.full(6, 1e-6), np.full(6, 0.1))


def test_a_contact_on_the_surface_has_no_residual(blob: ObjectModel) -> None:
    p_O, _n_O = random_surface_points(blob, 20, np.random.default_rng(0))
    phi, normal = blob.grid.distance_and_normal(p_O)
    on = p_O - phi[:, None] * normal
    _, normal = blob.grid.distance_and_normal(on)
    X_PO = np.eye(3, 4)[None]
    touches = GraspContacts(np.zeros(20, dtype=np.int64), on, normal, np.zeros((20, 6, 0)), np.ones(20, dtype=np.bool_))
    residual = surface_rows([blob.grid], X_PO, touches, ContactSigmas(np.full(20, 1.0), np.full(20, 1.0))).residual
    np.testing.assert_allclose(residual[:, 0], 0.0, atol=2e-5)
    np.testing.assert_allclose(residual[:, 1:], 0.0, atol=1e-12)


def test_the_derivatives_by_contact_are_those_of_differences(
    blob: ObjectModel, touched: tuple[np.ndarray, GraspContacts]
) -> None:
    X_PO, touches = touched
    exact = surface_rows([blob.grid] * 2, X_PO, touches, NOISE).by_shared
    step = 0.5 * blob.grid.spacing
    for k in range(6):
        e = np.zeros(6)
        e[k] = step if k < 3 else 1e-5
        sides = []
        for sign in (1.0, -1.0):
            n = touches.n_PC @ exp_so3(sign * e[3:]).T
            moved = touches._replace(p_PC=touches.p_PC + sign * e[:3], n_PC=n)
            sides.append(surface_rows([blob.grid] * 2, X_PO, moved, NOISE).residual)
        difference = (sides[0] - sides[1]) / (2.0 * e[k])
        scale = np.abs(exact).max(axis=(0, 2))
        np.testing.assert_allclose(difference / scale, exact[:, :, k] / scale, atol=0.05)


def test_moving_the_object_is_moving_the_contact_the_other_way(
    blob: ObjectModel, touched: tuple[np.ndarray, GraspContacts]
) -> None:
    X_PO, touches = touched
    rows = surface_rows([blob.grid] * 2, X_PO, touches, NOISE)
    np.testing.assert_allclose(rows.by_pose[:, :, 3:], -rows.by_shared[:, :, :3], atol=1e-6)
    # An object that turns about P's origin by w in P, is contacts that turn by -w about it.
    w = np.array([0.2, -0.5, 0.3])
    for i, g in enumerate(touches.grasp):
        R, p = X_PO[g, :, :3], touches.p_PC[i]
        by_object = rows.by_pose[i] @ np.concatenate([R.T @ w, np.cross(w, X_PO[g, :, 3])])
        by_contact = rows.by_shared[i] @ np.concatenate([np.cross(w, p), w])
        np.testing.assert_allclose(by_object, -by_contact, atol=1e-6 * np.abs(by_contact).max())


def test_the_frame_does_not_matter(blob: ObjectModel, touched: tuple[np.ndarray, GraspContacts]) -> None:
    X_PO, touches = touched
    X_QP = make_poses(random_rotations(np.random.default_rng(1), 1), np.array([[0.3, -0.1, 0.2]]))
    moved = touches._replace(p_PC=transform_points(X_QP[0], touches.p_PC), n_PC=touches.n_PC @ X_QP[0, :, :3].T)
    X_QO = make_poses(X_QP[:, :, :3] @ X_PO[:, :, :3], transform_points(X_QP[0], X_PO[:, :, 3]))
    one = surface_rows([blob.grid] * 2, X_PO, touches, NOISE).residual
    other = surface_rows([blob.grid] * 2, X_QO, moved, NOISE).residual
    np.testing.assert_allclose(one, other, atol=1e-6 * np.abs(one).max())


def test_what_is_no_contact_says_nothing(blob: ObjectModel, touched: tuple[np.ndarray, GraspContacts]) -> None:
    X_PO, touches = touched
    valid = np.array([True, False, True, True, True, True])
    rows = surface_rows([blob.grid] * 2, X_PO, touches._replace(valid=valid), NOISE)
    for values in rows:
        assert np.all(values[1] == 0.0)
        assert np.any(values[0] != 0.0)


def test_residuals_of_noise_have_unit_variance_where_the_surface_bends_too() -> None:
    """On a ball a point that is off across the normal is where the normal is another."""
    ball = ObjectModel.from_mesh(
        trimesh.creation.icosphere(4, 0.03), spacing=0.001, samples=200, symmetry="none", cache=False
    )
    generator, count, sigma_position, sigma_normal = np.random.default_rng(5), 4000, 0.003, 0.05
    n = random_rotations(generator, count)[:, 0]
    p = 0.03 * n + sigma_position * generator.normal(size=(count, 3))
    turned = (exp_so3(sigma_normal * generator.normal(size=(count, 3))) @ n[..., None])[..., 0]
    noise = ContactSigmas(np.full(count, sigma_position), np.full(count, sigma_normal))
    every = np.ones(count, dtype=np.bool_)
    touches = GraspContacts(np.zeros(count, dtype=np.int64), p, turned, np.zeros((count, 6, 0)), every)
    rows = surface_rows([ball.grid], np.eye(3, 4)[None], touches, noise)
    assert np.mean(rows.residual[:, 0] ** 2) == pytest.approx(1.0, abs=0.1)
    assert np.mean(np.sum(rows.residual[:, 1:] ** 2, axis=1)) == pytest.approx(2.0, abs=0.15)
    # What they were whitened by: of a normal the whole of it, the bend's part among it.
    _, n_O = ball.grid.distance_and_normal(p)
    by_normal = np.linalg.norm(n_O - turned, axis=1) / np.linalg.norm(rows.residual[:, 1:], axis=1)
    np.testing.assert_allclose(rows.log_scale, np.log(sigma_position * by_normal**2), atol=1e-9)
