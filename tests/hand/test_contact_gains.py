"""How contacts move with wrench and radius, against what is known of a sphere."""

import numpy as np
import pytest

from tactopose_drake.core.sensing.contact_noise import contact_covariance
from tactopose_drake.core.sensing.intrinsic_contact import solve_contact
from tactopose_drake.core.sensing.soft_layer import SoftLayer
from tactopose_drake.core.surfaces import Capsule, Ellipsoid, Sphere, Surface
from tactopose_drake.hand.contact_gains import contact_gains, thicker, wrench_of


def pushes(surface: Surface, count: int) -> np.ndarray:
    generator = np.random.default_rng(0)
    p = surface.sample(generator, count)
    f = -2.0 * surface.normal(p) + 0.3 * generator.normal(size=(count, 3))
    return np.column_stack([np.cross(p, f), f])


LAYER = SoftLayer(thickness=0.002, stiffness=4000.0)
SURFACES = [Sphere(0.009), Capsule(0.009, 0.014), Ellipsoid((0.009, 0.008, 0.011))]


@pytest.mark.parametrize("layer", [None, LAYER], ids=["rigid", "soft"])
@pytest.mark.parametrize("surface", SURFACES, ids=lambda surface: type(surface).__name__)
def test_the_gains_are_those_of_the_noise(surface: Surface, layer: SoftLayer | None) -> None:
    gains = contact_gains(pushes(surface, 5), surface, layer)
    assert gains.solutions.valid.all()
    noise = np.repeat([1e-4, 1e-2], 3)
    expected = contact_covariance(gains.solutions, surface, layer=layer, sigma_moment=1e-4, sigma_force=1e-2)
    by_wrench = gains.point[:, :, :6] * noise
    found = by_wrench @ np.swapaxes(by_wrench, 1, 2)
    np.testing.assert_allclose(found, expected.p, atol=1e-5 * np.abs(expected.p).max())
    # A turn of the normal is across it, and as large as the normal's change.
    turns = gains.turn[:, :, :6] * noise
    np.testing.assert_allclose(
        np.trace(turns @ np.swapaxes(turns, 1, 2), axis1=1, axis2=2), np.trace(expected.n, axis1=1, axis2=2), rtol=1e-5
    )


@pytest.mark.parametrize("layer", [None, LAYER], ids=["rigid", "soft"])
@pytest.mark.parametrize("surface", SURFACES[:2], ids=lambda surface: type(surface).__name__)
def test_the_covariance_by_the_radius_is_that_of_its_gains(surface: Surface, layer: SoftLayer | None) -> None:
    gains = contact_gains(pushes(surface, 5), surface, layer)
    found = contact_covariance(
        gains.solutions, surface, layer=layer, sigma_moment=0.0, sigma_force=0.0, sigma_radius=1e-3
    )
    moved, turned = 1e-3 * gains.point[:, :, 6], 1e-3 * gains.turn[:, :, 6]
    changed = np.cross(turned, gains.solutions.n_S)
    assert np.linalg.norm(changed, axis=1).max() > 0.01  # by friction
    for told, a, b in ((found.p, moved, moved), (found.n, changed, changed), (found.pn, moved, changed)):
        expected = np.einsum("ki,kj->kij", a, b)
        np.testing.assert_allclose(told, expected, atol=1e-4 * np.abs(expected).max())


@pytest.mark.parametrize("surface", SURFACES, ids=lambda surface: type(surface).__name__)
def test_the_gains_say_which_way_a_contact_moves(surface: Surface) -> None:
    wrench, change = pushes(surface, 1)[0], np.array([3e-6, -2e-6, 1e-6, -3e-4, 4e-4, 2e-4])
    gains = contact_gains(wrench[None], surface, LAYER)
    before, after = (solve_contact(F_S, surface, layer=LAYER) for F_S in (wrench, wrench + change))
    moved, turned = gains.point[0, :, :6] @ change, gains.turn[0, :, :6] @ change
    np.testing.assert_allclose(after.p_SC - before.p_SC, moved, atol=0.01 * np.linalg.norm(moved))
    np.testing.assert_allclose(after.n_S - before.n_S, np.cross(turned, before.n_S), atol=0.01 * np.linalg.norm(turned))


@pytest.mark.parametrize("layer", [None, LAYER], ids=["rigid", "soft"])
def test_a_push_through_the_middle_of_a_thicker_sphere_is_felt_farther_out(layer: SoftLayer | None) -> None:
    n = np.array([0.6, 0.0, 0.8])
    gains = contact_gains(np.concatenate([np.zeros(3), -2.0 * n])[None], Sphere(0.01), layer)
    np.testing.assert_allclose(gains.point[0, :, 6], n, atol=1e-6)
    np.testing.assert_allclose(gains.turn[0, :, 6], 0.0, atol=1e-6)


def test_what_is_no_contact_has_no_gains() -> None:
    gains = contact_gains(np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.001]]), Sphere(0.01), None)
    assert not gains.solutions.valid[0]
    assert not gains.point.any()
    assert not gains.turn.any()


@pytest.mark.parametrize("surface", SURFACES, ids=lambda surface: type(surface).__name__)
def test_thicker_is_thicker_along_every_normal(surface: Surface) -> None:
    p = surface.sample(np.random.default_rng(1), 50)
    out = thicker(surface, 0.0005).value(p + 0.0005 * surface.normal(p))
    inside = thicker(surface, 0.0005).value(p)
    assert np.abs(out).max() < 0.1 * np.abs(inside).min()


def test_the_wrench_of_a_contact_is_that_which_it_was_found_from() -> None:
    wrench = pushes(SURFACES[1], 1)[0]
    wrench[:3] += [0.001, -0.0005, 0.0008]  # a torque about the normal, and a contact elsewhere
    solution = solve_contact(wrench, SURFACES[1])
    assert np.linalg.norm(solution.local_torque) > 5e-4
    np.testing.assert_allclose(wrench_of(solution), wrench, atol=1e-9)
