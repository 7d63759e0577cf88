import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactopose_drake.core import poses
from tactopose_drake.core.surfaces import Capsule, Cylinder, Ellipsoid, Sphere, Superquadric, Surface
from tactopose_drake.errors import InvalidInputError
from tests.core.touches import SURFACES, placed, seeds

every_surface = pytest.mark.parametrize("surface", SURFACES.values(), ids=SURFACES)


@every_surface
@given(seed=seeds)
@settings(max_examples=20)
def test_samples_lie_on_the_surface_and_the_gradient_points_out(surface: Surface, seed: int) -> None:
    generator = np.random.default_rng(seed)
    surface = placed(surface, generator)
    p_SQ = surface.sample(generator, 50)
    n_S = surface.normal(p_SQ)
    np.testing.assert_allclose(surface.value(p_SQ), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(n_S, axis=1), 1.0, atol=1e-12)
    assert (surface.value(p_SQ + 1e-4 * n_S) > 0).all()
    assert (surface.value(p_SQ - 1e-4 * n_S) < 0).all()


@every_surface
@given(seed=seeds, scale=st.floats(0.3, 3.0))
@settings(max_examples=20)
def test_derivatives_agree_with_central_differences(surface: Surface, seed: int, scale: float) -> None:
    generator = np.random.default_rng(seed)
    surface = placed(surface, generator)
    p_SQ = surface.X_SF[:, 3] + scale * (surface.sample(generator, 10) - surface.X_SF[:, 3])
    step = 1e-8
    # Creases and the seam between side and end are where differences mean nothing: they are tested apart.
    p_FQ = poses.transform_points(poses.inverse(surface.X_SF), p_SQ)
    smooth = (np.abs(p_FQ) > 2e-4).all(axis=1) & (np.abs(np.abs(p_FQ[:, 2]) - 0.007) > 2e-4)
    p_SQ = p_SQ[smooth]
    gradient, hessian = surface.gradient(p_SQ), surface.hessian(p_SQ)
    for axis, unit in enumerate(np.eye(3)):
        up, down = p_SQ + step * unit, p_SQ - step * unit
        slope = (surface.value(up) - surface.value(down)) / (2 * step)
        np.testing.assert_allclose(gradient[:, axis], slope, rtol=1e-5, atol=1e-4 / 0.009)
        turn = (surface.gradient(up) - surface.gradient(down)) / (2 * step)
        np.testing.assert_allclose(hessian[:, axis], turn, rtol=1e-4, atol=1e-3 / 0.009**2)


@every_surface
@given(seed=seeds)
@settings(max_examples=20)
def test_the_surface_is_convex(surface: Surface, seed: int) -> None:
    generator = np.random.default_rng(seed)
    surface = placed(surface, generator)
    p_SQ = surface.sample(generator, 40)
    n_S = surface.normal(p_SQ)
    # No point of a convex surface lies beyond the tangent plane of another.
    beyond = np.einsum("ik,ijk->ij", n_S, p_SQ[None] - p_SQ[:, None])
    assert beyond.max() < 1e-12
    assert np.linalg.eigvalsh(surface.hessian(p_SQ)).min() > -1e-9 / 0.009**2


@every_surface
@given(seed=seeds)
@settings(max_examples=10)
def test_moving_the_frame_moves_the_surface(surface: Surface, seed: int) -> None:
    generator = np.random.default_rng(seed)
    moved = placed(surface, generator)
    p_FQ = 1.3 * surface.sample(generator, 10)
    p_SQ = poses.transform_points(moved.X_SF, p_FQ)
    R_SF = moved.X_SF[:, :3]
    np.testing.assert_allclose(moved.value(p_SQ), surface.value(p_FQ), rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(moved.gradient(p_SQ) @ R_SF, surface.gradient(p_FQ), rtol=1e-7, atol=1e-6)


@given(seed=seeds)
@settings(max_examples=20)
def test_sphere_ellipsoid_and_superquadric_coincide(seed: int) -> None:
    p = np.random.default_rng(seed).uniform(-0.02, 0.02, (20, 3))
    p[0] = 0.0, 0.0, 0.008  # the pole and the planes of symmetry, where powers of zero meet
    p[1] = 0.008, 0.0, 0.0
    sphere, ellipsoid = Sphere(radius=0.009), Ellipsoid(semi_axes=(0.009, 0.009, 0.009))
    # A hair off the exponent 1, so that the general formulas are run and not those of the ellipsoid
    superquadric = Superquadric(semi_axes=(0.009, 0.009, 0.009), exponents=(1.0 + 1e-13, 1.0 - 1e-13))
    np.testing.assert_allclose(sphere.value(p), np.sum(p * p, axis=1) / 0.009**2 - 1.0, atol=1e-14)
    for other in (ellipsoid, superquadric):
        np.testing.assert_allclose(other.value(p), sphere.value(p), atol=1e-11)
        np.testing.assert_allclose(other.gradient(p), sphere.gradient(p), atol=1e-6)
        np.testing.assert_allclose(other.hessian(p), sphere.hessian(p), atol=1e-11 / 0.009**2)


def test_a_capsule_is_a_cylinder_with_spheres() -> None:
    capsule = Capsule(radius=0.009, length=0.02, two_ended=True)
    fingertip = Capsule(radius=0.009, length=0.02)
    cylinder = Cylinder(radius=0.009, length=0.02)
    side = np.array([[0.004, 0.005, 0.003], [0.009, 0.0, -0.0099]])
    top = np.array([[0.001, 0.002, 0.019], [0.0, 0.0, 0.025]])
    bottom = -top
    shift = np.array([0.0, 0.0, 0.01])
    sphere = Sphere(radius=0.009)
    for surface in (capsule, fingertip):
        np.testing.assert_allclose(surface.value(side), cylinder.value(side))
        np.testing.assert_allclose(surface.value(top), sphere.value(top - shift))
        np.testing.assert_allclose(surface.hessian(top), sphere.hessian(top - shift))
    np.testing.assert_allclose(capsule.value(bottom), sphere.value(bottom + shift))
    np.testing.assert_allclose(fingertip.value(bottom), cylinder.value(bottom))


@pytest.mark.parametrize("exponents", [(0.1, 0.1), (1.5, 1.5), (0.1, 1.5), (1.0, 1.0)])
def test_derivatives_stay_finite_on_planes_of_symmetry(exponents: tuple[float, float]) -> None:
    superquadric = Superquadric(semi_axes=(0.009, 0.008, 0.012), exponents=exponents)
    p = np.array([[0.009, 0, 0], [0, -0.008, 0], [0, 0, 0.012], [0.004, 0.004, 0], [0.004, 0, -0.004]])
    assert np.isfinite(superquadric.hessian(p)).all()
    np.testing.assert_allclose(superquadric.normal(p[:3]), [[1, 0, 0], [0, -1, 0], [0, 0, 1]], atol=1e-12)


def test_samples_reach_all_of_a_capsule() -> None:
    surface = Capsule(radius=0.009, length=0.018)
    p = surface.sample(np.random.default_rng(0), 3000)
    assert p[:, 2].min() < -0.0088
    assert p[:, 2].max() > 0.0178
    # A hemisphere has the area of a cylinder of length `radius`: a third of this fingertip's.
    assert np.mean(p[:, 2] > 0.009) == pytest.approx(1 / 3, abs=0.03)


def test_the_frame_may_be_any_kind_of_pose() -> None:
    X_SF = poses.make_poses(poses.exp_so3(np.array([[0.1, 0.2, 0.3]])), np.array([[0.1, 0.2, 0.3]]))[0]

    class Pose:
        def GetAsMatrix34(self) -> np.ndarray:
            return X_SF

    as_44 = np.vstack([X_SF, [0, 0, 0, 1]])
    for pose in (X_SF, X_SF.tolist(), as_44, Pose()):
        np.testing.assert_array_equal(Sphere(radius=0.009, X_SF=pose).X_SF, X_SF)


def test_surfaces_are_frozen() -> None:
    sphere = Sphere(radius=0.009)
    with pytest.raises(dataclasses.FrozenInstanceError):
        sphere.radius = 0.01  # type: ignore[misc]
    with pytest.raises(ValueError, match="read-only"):
        sphere.X_SF[0, 3] = 1.0


@pytest.mark.parametrize("kind", [Ellipsoid, Superquadric])
def test_surfaces_keep_no_array_of_the_caller_s(kind: type[Ellipsoid | Superquadric]) -> None:
    semi_axes = np.array([0.008, 0.01, 0.012])
    surface = kind(semi_axes=semi_axes)  # type: ignore[arg-type]
    semi_axes *= 2.0
    assert surface.semi_axes == (0.008, 0.01, 0.012)
    points = surface.sample(np.random.default_rng(0), 10)
    np.testing.assert_allclose(surface.value(points), 0.0, atol=1e-9)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Sphere(radius=0.0), r"radius must be a number > 0, not 0"),
        (lambda: Sphere(radius=math.nan), r"radius must be .*, not nan"),
        (lambda: Ellipsoid(semi_axes=(0.01, -0.01, 0.01)), r"semi_axes\[1\] must be a number > 0, not -0\.01"),
        (lambda: Ellipsoid(semi_axes=(0.01, 0.01)), r"semi_axes must have the shape .*, not \(2,\)"),  # type: ignore[arg-type]
        (lambda: Cylinder(radius=0.01, length=0.0), r"length must be .*, not 0"),
        (lambda: Capsule(radius=0.01, length=-0.1), r"length must be a number >= 0, not -0.1"),
        (
            lambda: Superquadric(semi_axes=(1, 1, 1), exponents=(2.0, 1.0)),
            r"exponents\[0\] must be a number from 0\.1 to 1\.5, not 2",
        ),
        (
            lambda: Superquadric(semi_axes=(1, 1, 1), exponents=(1.0, 0.01)),
            r"exponents\[1\] must be a number from 0\.1 to 1\.5, not 0\.01",
        ),
        (lambda: Sphere(radius=1, X_SF=2 * np.eye(3, 4)), r"X_SF must have a rotation matrix as its left 3x3 block"),
        (
            lambda: Sphere(radius=1, X_SF=np.diag([1.0, 1, -1, 1])),
            r"X_SF must have a rotation matrix as its left 3x3 block",
        ),
        (lambda: Sphere(radius=1, X_SF=np.ones((4, 4)) + np.eye(4)), r"X_SF must "),
        (lambda: Sphere(radius=1, X_SF=np.vstack([np.eye(3, 4), [0, 0, 1, 1]])), r"X_SF must have the last row"),
        (lambda: Sphere(radius=1, X_SF=np.eye(3)), r"X_SF must have the shape .*, not \(3, 3\)"),
        (lambda: Sphere(radius=1, X_SF=np.full((3, 4), np.nan)), r"X_SF\[0, 0\] must be .*, not nan"),
        (lambda: Sphere(radius=1).value([[0, 0, math.inf]]), r"p_SQ\[0, 2\] must be .*, not inf"),
        (lambda: Sphere(radius=1).value([0, 0, 1]), r"p_SQ must have the shape .*, not \(3,\)"),
    ],
)
def test_impossible_surfaces_are_refused(make, message: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InvalidInputError, match=message):
        make()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Sphere(radius=12.5), "radius must be at most 1 m, not 12.5 m"),
        (lambda: Ellipsoid((10, 20, 30)), r"semi_axes must be at most 1 m, not \[10.0, 20.0, 30.0\] m"),
        (lambda: Superquadric((9.0, 9.0, 9.0)), r"semi_axes must be at most 1 m, not \[9.0, 9.0, 9.0\] m"),
        (lambda: Capsule(0.009, 14.0), "length must be at most 1 m, not 14.0 m"),
        (lambda: Cylinder(9.0, 0.02), "radius must be at most 1 m, not 9.0 m"),
        (
            lambda: Sphere(0.01, X_SF=poses.make_poses(np.eye(3), np.array([0, 0, 12.0]))),
            r"X_SF.translation must have coordinates from -1 to 1 m, not \[.*12.0\] m",
        ),
        (
            lambda: Sphere(0.01, X_SF=poses.make_poses(np.eye(3), np.array([1e300, 0, 0]))),
            r"X_SF.translation must have coordinates from -1 to 1 m, not \[1e\+300",
        ),
    ],
)
def test_fingertips_in_millimetres_are_refused(make: Callable[[], Surface], message: str) -> None:
    with pytest.raises(InvalidInputError, match=rf"^{message}.*\. Multiply by 0.001 what is in millimetres"):
        make()
