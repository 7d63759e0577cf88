"""Surfaces that are fitted to points find the form that the points are of."""

import numpy as np
import pytest

from tactopose_drake.core import poses
from tactopose_drake.core.surfaces import Capsule, Sphere, Superquadric, Surface
from tactopose_drake.core.surfaces.surface_fitting import fit_surface, residual, surface_distances

X_SF = poses.make_poses(poses.exp_so3(np.array([0.3, -0.2, 0.5])), np.array([0.002, -0.03, 0.014]))


def points_on(surface: Surface) -> np.ndarray:
    return surface.sample(np.random.default_rng(0), 500)


def test_distances_are_exact_from_a_sphere_and_along_the_normal_elsewhere() -> None:
    sphere = Sphere(0.01, X_SF=X_SF)
    p = points_on(sphere)
    np.testing.assert_allclose(surface_distances(sphere, p + 0.002 * sphere.normal(p)), 0.002, atol=1e-12)
    boxy = Superquadric((0.01, 0.012, 0.02), (0.5, 0.6), X_SF=X_SF)
    p = points_on(boxy)
    np.testing.assert_allclose(surface_distances(boxy, p + 1e-6 * boxy.normal(p)), 1e-6, rtol=0.02)


@pytest.mark.parametrize(
    "surface",
    [
        Sphere(0.011, X_SF=X_SF),
        Capsule(0.008, 0.03, X_SF=X_SF),
        Superquadric((0.0105, 0.0125, 0.02), (0.5, 0.3), X_SF=X_SF),
    ],
    ids=lambda surface: type(surface).__name__,
)
def test_the_form_that_points_are_of_is_found(surface: Surface) -> None:
    p = points_on(surface)
    found = fit_surface(p, X_SF[:, 2])
    assert type(found) is type(surface)
    assert residual(found, p) < 1e-4
    assert found.half_width == pytest.approx(surface.half_width, abs=2e-4)
    if isinstance(found, Capsule):
        assert found.X_SF[:, 2] @ X_SF[:, 2] > 0.999  # its round end is where the finger ends


def test_a_simpler_form_is_kept_while_it_is_about_as_good() -> None:
    nearly_round = Superquadric((0.01, 0.01005, 0.0101), (1.0, 1.0), X_SF=X_SF)
    assert isinstance(fit_surface(points_on(nearly_round), X_SF[:, 2]), Sphere)


@pytest.mark.parametrize(("exponent", "kind"), [(0.77, Sphere), (0.70, Superquadric)])
def test_about_as_good_is_half_as_much_again(exponent: float, kind: type[Surface]) -> None:
    """What is left of the points is their own roughness of 0.4 mm, and what a sphere cannot follow."""
    boxy, generator = Superquadric((0.01,) * 3, (exponent,) * 2, X_SF=X_SF), np.random.default_rng(0)
    p = boxy.sample(generator, 400)
    p = p + 4e-4 * generator.normal(size=(len(p), 1)) * boxy.normal(p)
    found = fit_surface(p, X_SF[:, 2])
    assert type(found) is kind
    if kind is Sphere:
        assert 1.3 < residual(found, p) / residual(boxy, p) < 1.5


def test_what_is_exact_to_a_fifth_of_a_millimetre_is_good_enough() -> None:
    nearly_round = Superquadric((0.01, 0.01, 0.01), (0.9, 0.9), X_SF=X_SF)
    p = points_on(nearly_round)
    found = fit_surface(p, X_SF[:, 2])
    assert isinstance(found, Sphere)  # though many times as far off as the exact fit
    assert 1e-4 < residual(found, p) < 2e-4


def test_an_end_that_is_nearly_flat_is_fitted_by_no_sphere_larger_than_a_hand() -> None:
    across = np.random.default_rng(0).uniform(-0.02, 0.02, size=(400, 2))
    points = np.column_stack([across, np.sqrt(1.5**2 - (across**2).sum(axis=1)) - 1.48])
    surface = fit_surface(points, np.array([0.0, 0.0, 1.0]))
    assert not isinstance(surface, Sphere)
    assert residual(surface, points) < 1e-3
