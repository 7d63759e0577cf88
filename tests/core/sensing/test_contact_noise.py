import numpy as np
import pytest
from hypothesis import given, settings

from tactopose_drake.core.poses import make_poses, random_rotations, skew
from tactopose_drake.core.sensing.contact_noise import contact_covariance
from tactopose_drake.core.sensing.contact_noise_kernels import HandVariances, SensedContact, fill_hand_covariance
from tactopose_drake.core.sensing.intrinsic_contact import solve_contact, solve_contacts
from tactopose_drake.core.sensing.soft_layer import SoftLayer
from tactopose_drake.core.surfaces import Sphere, Surface
from tactopose_drake.errors import InvalidInputError
from tests.core.touches import SURFACES, placed, seeds, touch

# On a crease the answer is no linear function of the noise.
SMOOTH = {name: surface for name, surface in SURFACES.items() if "pinched" not in name}
every_surface = pytest.mark.parametrize("surface", SMOOTH.values(), ids=SMOOTH)
LAYER = SoftLayer(thickness=0.002, stiffness=20e3)


@every_surface
@pytest.mark.parametrize("layer", [None, LAYER], ids=["rigid", "soft"])
@given(seed=seeds)
@settings(max_examples=20)
def test_covariances_follow_the_solver_s_own_slopes(surface: Surface, layer: SoftLayer | None, seed: int) -> None:
    generator = np.random.default_rng(seed)
    surface = placed(surface, generator)
    F_S = touch(surface, generator, 1, force=1.0, layer=layer).F_S[0]
    solution = solve_contact(F_S, surface, layer=layer)
    steps = np.diag([1e-9] * 3 + [1e-7] * 3)
    up, down = (solve_contacts(F_S + sign * steps, surface, layer=layer) for sign in (1, -1))
    if not (solution.valid and up.valid.all() and down.valid.all()):
        return  # on the edge of an open surface
    sigma = np.array([1e-5] * 3 + [2e-3] * 3)
    scale = (sigma / np.diag(2 * steps))[:, None]
    slope_p, slope_n = (up.p_SC - down.p_SC) * scale, (up.n_S - down.n_S) * scale
    covariance = contact_covariance(solution, surface, layer=layer, sigma_moment=1e-5, sigma_force=2e-3)
    of_p, of_n = slope_p.T @ slope_p, slope_n.T @ slope_n
    np.testing.assert_allclose(covariance.p, of_p, atol=1e-3 * np.trace(of_p) + 1e-18)
    np.testing.assert_allclose(covariance.n, of_n, atol=1e-3 * np.trace(of_n) + 1e-18)
    # 1e-9 of the normal, as above, is what rounding leaves of it where the surface is flat.
    scale = np.sqrt(np.trace(of_p)) * (1e-3 * np.sqrt(np.trace(of_n)) + 1e-9)
    np.testing.assert_allclose(covariance.pn, slope_p.T @ slope_n, atol=scale)


def test_covariances_are_those_of_noisy_wrenches() -> None:
    surface = SURFACES["capsule"]
    generator = np.random.default_rng(4)
    F_S = touch(surface, generator, 1, force=1.0).F_S[0]
    noisy = F_S + generator.normal(size=(20_000, 6)) * ([1 / 64e3] * 3 + [1 / 320] * 3)
    found = solve_contacts(noisy, surface)
    covariance = contact_covariance(solve_contact(F_S, surface), surface)  # a Nano17's noise by default
    np.testing.assert_allclose(covariance.p, np.cov(found.p_SC.T), atol=0.05 * np.trace(covariance.p))
    np.testing.assert_allclose(covariance.n, np.cov(found.n_S.T), atol=0.05 * np.trace(covariance.n))


def test_a_straight_push_on_a_sphere_by_hand() -> None:
    # Across the force both sigma_m / f and the lever arm's R sigma_f / f count; along the normal the point is certain.
    solution = solve_contact([0, 0, 0, 0, 0, -2.0], Sphere(radius=0.009))
    covariance = contact_covariance(solution, Sphere(radius=0.009), sigma_moment=1e-5, sigma_force=4e-3)
    variance = (1e-5 / 2.0) ** 2 + (0.009 * 4e-3 / 2.0) ** 2
    np.testing.assert_allclose(covariance.p, np.diag([variance, variance, 0.0]), atol=1e-18)
    np.testing.assert_allclose(covariance.n, covariance.p / 0.009**2, atol=1e-12)
    np.testing.assert_allclose(covariance.pn, covariance.p / 0.009, atol=1e-15)


def test_a_batch_is_as_its_items_and_invalid_ones_have_none() -> None:
    surface = SURFACES["ellipsoid"]
    F_S = touch(surface, np.random.default_rng(0), 4).F_S
    F_S[2] = np.nan
    found = solve_contacts(F_S, surface)
    covariance = contact_covariance(found, surface)
    assert covariance.p.shape == covariance.n.shape == covariance.pn.shape == (4, 3, 3)
    assert np.isnan(covariance.p[2]).all()
    for i in (0, 1, 3):
        single = contact_covariance(found[i], surface)
        np.testing.assert_allclose(single.p, covariance.p[i], rtol=1e-12)
        np.testing.assert_allclose(single.n, covariance.n[i], rtol=1e-12)


@pytest.mark.parametrize("name", ["sigma_moment", "sigma_force", "sigma_radius"])
def test_a_negative_sigma_is_refused(name: str) -> None:
    solution = solve_contact([0, 0, 0, 0, 0, -2.0], Sphere(radius=0.009))
    with pytest.raises(InvalidInputError, match=f"{name} must be .*, not -1"):
        contact_covariance(solution, Sphere(radius=0.009), **{name: -1.0})  # type: ignore[arg-type]


def test_a_hands_errors_turn_and_move_a_contact_together() -> None:
    """Each error is linear: the point moves by dp and w x p, and the normal by dn turns by n x dn."""
    generator = np.random.default_rng(3)
    R, p_PS, p_SC, n_S = (*random_rotations(generator, 1), *generator.normal(size=(3, 3)))
    n_S /= np.linalg.norm(n_S)
    root, by_joints = generator.normal(size=(6, 6)), generator.normal(size=(6, 4))
    noise = root @ root.T  # of point and normal, by the sensor
    arm, normal = R @ p_SC, R @ n_S
    by_noise = np.block([[R, np.zeros((3, 3))], [np.zeros((3, 3)), skew(normal) @ R]])
    by_turn = np.vstack([-skew(arm), np.eye(3)])
    expected = by_noise @ noise @ by_noise.T + np.roll(by_joints, 3, axis=0) @ np.roll(by_joints, 3, axis=0).T
    expected += 0.3 * by_turn @ by_turn.T + 0.2 * np.diag([1.0, 1, 1, 0, 0, 0])
    found = np.empty((6, 6))
    blocks = (np.ascontiguousarray(block) for block in (noise[:3, :3], noise[3:, 3:], noise[:3, 3:]))
    contact = SensedContact(p_SC, n_S, *blocks)
    fill_hand_covariance(make_poses(R, p_PS), contact, by_joints, HandVariances(0.2, 0.3), found)
    np.testing.assert_allclose(found, expected, atol=1e-9)
