import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactopose_drake.core import poses
from tactopose_drake.core.sensing.intrinsic_contact import solve_contact, solve_contacts
from tactopose_drake.core.surfaces import Capsule, Cylinder, Ellipsoid, Sphere, Superquadric, Surface
from tests.core.touches import ROUND_SURFACES, SURFACES, placed, seeds, touch

every_surface = pytest.mark.parametrize("surface", SURFACES.values(), ids=SURFACES)
METHODS = ("auto", "newton")


@every_surface
@pytest.mark.parametrize("method", METHODS)
@given(seed=seeds, friction=st.floats(0.0, 2.0), patch_radius=st.sampled_from([0.0, 0.003]))
@settings(max_examples=30)
def test_the_touched_point_is_found(
    surface: Surface, method: str, seed: int, friction: float, patch_radius: float
) -> None:
    generator = np.random.default_rng(seed)
    surface = placed(surface, generator)
    touches = touch(surface, generator, 50, friction=friction, patch_radius=patch_radius)
    found = solve_contacts(touches.F_S, surface, method=method)  # type: ignore[arg-type]
    assert found.valid.all(), set(found.reason)
    normal_force = np.sum(touches.f_S * touches.n_S, axis=1, keepdims=True) * touches.n_S
    np.testing.assert_allclose(found.p_SC, touches.p_SC, atol=1e-11)
    # The normal turns by the error of the point times the curvature, which has no bound on a crease.
    creases = isinstance(surface, Superquadric) and max(surface.exponents) > 1
    tolerance = 1e-4 if creases else 1e-8
    np.testing.assert_allclose(found.n_S, touches.n_S, atol=tolerance)
    np.testing.assert_allclose(found.normal_force, normal_force, atol=10 * tolerance)
    np.testing.assert_allclose(found.friction_force, touches.f_S - normal_force, atol=10 * tolerance)
    np.testing.assert_allclose(found.local_torque, touches.torque, atol=0.1 * tolerance)
    assert (found.residual < 1e-10).all()
    np.testing.assert_array_equal(found.deformation, 0.0)


@every_surface
@given(seed=seeds)
@settings(max_examples=30)
def test_any_valid_answer_explains_the_wrench(surface: Surface, seed: int) -> None:
    generator = np.random.default_rng(seed)
    surface = placed(surface, generator)
    moment, force = generator.normal(scale=0.005, size=(50, 3)), generator.normal(size=(50, 3))
    F_S = np.hstack([moment + np.cross(surface.X_SF[:, 3], force), force])
    found = solve_contacts(F_S, surface)
    p, n, torque = found.p_SC[found.valid], found.n_S[found.valid], found.local_torque[found.valid]
    force, moment = F_S[found.valid, 3:], F_S[found.valid, :3]
    np.testing.assert_allclose(np.cross(p, force) + torque, moment, atol=1e-10)  # eq. 2.2
    np.testing.assert_allclose(surface.value(p), 0.0, atol=1e-10)
    np.testing.assert_allclose(n, surface.normal(p), atol=1e-6)
    np.testing.assert_allclose(np.cross(torque, n), 0.0, atol=1e-12)
    np.testing.assert_allclose(found.normal_force[found.valid] + found.friction_force[found.valid], force, atol=1e-12)
    np.testing.assert_allclose(np.cross(found.normal_force[found.valid], n), 0.0, atol=1e-12)
    assert (np.sum(force * n, axis=1) < 0).all()
    assert not np.isfinite(found.p_SC[~found.valid]).any()


@pytest.mark.parametrize("surface", [SURFACES[name] for name in SURFACES if name not in ("cylinder", "hemisphere")])
@given(seed=seeds)
@settings(max_examples=20)
def test_a_closed_surface_always_has_exactly_one_contact(surface: Surface, seed: int) -> None:
    if surface is SURFACES["capsule"]:
        surface = SURFACES["capsule with two ends"]
    generator = np.random.default_rng(seed)
    touches = touch(surface, generator, 30, friction=4.0, patch_radius=0.009)
    found = solve_contacts(touches.F_S, surface)
    # Existence: even far from any real grip. Uniqueness: the contact found is the one that was made.
    assert found.valid.all(), set(found.reason)
    np.testing.assert_allclose(found.p_SC, touches.p_SC, atol=1e-9)


def test_a_force_without_torque_is_found_on_a_flat_box() -> None:
    # f.m = 0, where the ellipsoid that the iteration falls back to is often missed though the box is hit
    box = Superquadric(semi_axes=(0.003, 0.02, 0.008), exponents=(0.2, 0.4))
    touches = touch(box, np.random.default_rng(0), 3000, friction=2.0, patch_radius=0.0)
    found = solve_contacts(touches.F_S, box)
    assert found.valid.all()
    np.testing.assert_allclose(found.p_SC, touches.p_SC, atol=1e-11)


@pytest.mark.parametrize("surface", [SURFACES[name] for name in ROUND_SURFACES], ids=ROUND_SURFACES)
@given(seed=seeds)
@settings(max_examples=30)
def test_closed_form_and_iteration_agree(surface: Surface, seed: int) -> None:
    generator = np.random.default_rng(seed)
    surface = placed(surface, generator)
    touches = touch(surface, generator, 50, friction=1.5)
    noisy = touches.F_S + generator.normal(size=(50, 6)) * ([1e-4] * 3 + [0.02] * 3)
    closed, iterated = (solve_contacts(noisy, surface, method=method) for method in METHODS)  # type: ignore[arg-type]
    np.testing.assert_array_equal(closed.valid, iterated.valid)
    np.testing.assert_allclose(closed.p_SC, iterated.p_SC, atol=1e-11)
    assert (closed.iterations == 0).all()
    assert (iterated.iterations[iterated.valid] > 0).any()


@every_surface
@given(seed=seeds)
@settings(max_examples=20)
def test_moving_the_sensor_frame_moves_the_answer(surface: Surface, seed: int) -> None:
    generator = np.random.default_rng(seed)
    X_RS = poses.make_poses(poses.random_rotations(generator, 1), generator.uniform(-0.05, 0.05, (1, 3)))[0]
    moved = dataclasses.replace(surface, X_SF=poses.compose(X_RS, surface.X_SF))
    touches = touch(surface, generator, 20)
    f_R = touches.F_S[:, 3:] @ X_RS[:, :3].T
    m_R = touches.F_S[:, :3] @ X_RS[:, :3].T + np.cross(X_RS[:, 3], f_R)
    in_S, in_R = solve_contacts(touches.F_S, surface), solve_contacts(np.hstack([m_R, f_R]), moved)
    np.testing.assert_allclose(in_R.p_SC, poses.transform_points(X_RS, in_S.p_SC), atol=1e-10)
    np.testing.assert_allclose(in_R.normal_force, in_S.normal_force @ X_RS[:, :3].T, atol=1e-3)
    np.testing.assert_allclose(in_R.local_torque, in_S.local_torque @ X_RS[:, :3].T, atol=1e-6)


@every_surface
@given(seed=seeds, scale=st.floats(0.1, 50.0))
@settings(max_examples=20)
def test_a_larger_force_leaves_the_point(surface: Surface, seed: int, scale: float) -> None:
    touches = touch(surface, np.random.default_rng(seed), 20)
    found, scaled = solve_contacts(touches.F_S, surface), solve_contacts(scale * touches.F_S, surface)
    np.testing.assert_allclose(scaled.p_SC, found.p_SC, atol=1e-11)
    np.testing.assert_allclose(scaled.friction_force, scale * found.friction_force, atol=1e-3 * scale)


@given(seed=seeds)
@settings(max_examples=30)
def test_sphere_ellipsoid_and_superquadric_agree(seed: int) -> None:
    axes = (0.009, 0.009, 0.009)
    touches = touch(Sphere(radius=0.009), np.random.default_rng(seed), 30)
    # A hair off the exponent 1, so that the superquadric is iterated and not taken for an ellipsoid
    nearly_one = Superquadric(semi_axes=axes, exponents=(1.0 + 1e-13, 1.0 - 1e-13))
    for surface in (Sphere(radius=0.009), Ellipsoid(semi_axes=axes), Superquadric(semi_axes=axes), nearly_one):
        found = solve_contacts(touches.F_S, surface)
        np.testing.assert_allclose(found.p_SC, touches.p_SC, atol=1e-10)
        assert (found.iterations > 0).all() == (surface is nearly_one)


@every_surface
@given(seed=seeds)
@settings(max_examples=10)
def test_one_wrench_is_solved_as_in_a_batch(surface: Surface, seed: int) -> None:
    touches = touch(surface, np.random.default_rng(seed), 5)
    touches.F_S[4, 3:] *= 1e-6
    batch = solve_contacts(touches.F_S, surface)
    assert len(batch) == 5
    for i, F_S in enumerate(touches.F_S):
        single = solve_contact(F_S, surface)
        for field in dataclasses.fields(single):
            np.testing.assert_array_equal(getattr(single, field.name), getattr(batch, field.name)[i])
            np.testing.assert_array_equal(getattr(batch[i], field.name), getattr(batch, field.name)[i])


def test_a_push_on_the_tip_by_hand() -> None:
    # 2 N down and 1 N along x on the tip of a hemisphere whose centre is 10 mm above the sensor
    capsule = Capsule(radius=0.009, length=0.02)
    F_S = [0.0, 0.019, 0.003, 1.0, 0.0, -2.0]  # p x f = (0, 0.019 * 1, 0), and 3 mN m about the normal
    solution = solve_contact(F_S, capsule)
    assert solution.valid
    assert solution.reason == ""
    np.testing.assert_allclose(solution.p_SC, [0, 0, 0.019], atol=1e-15)
    np.testing.assert_allclose(solution.n_S, [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(solution.normal_force, [0, 0, -2], atol=1e-12)
    np.testing.assert_allclose(solution.friction_force, [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(solution.local_torque, [0, 0, 0.003], atol=1e-12)


@every_surface
def test_the_seam_and_the_poles(surface: Surface) -> None:
    """Points where formulas change or axes vanish, each pressed straight, aslant and with a torque."""
    a, b, c = (0.009,) * 3 if surface.kind else surface.shape[:3]
    top = surface.shape[2] if surface.kind and math.isfinite(surface.shape[2]) else 0.0
    points = [[a, 0, top], [0, -b, top], [-a, 0, top], [0, 0, c + top]]
    if isinstance(surface, Cylinder):
        points.pop()
    for p in points:
        n = surface.normal([p])[0]
        for slant in ([0, 0, 0], [0.3, 0.2, 0.1], [0, 0, -0.4], [0.5, 0, 0]):
            f = -n + np.cross(n, slant)
            for torque in (0.0, 1e-3, -1e-3):
                F_S = np.concatenate([np.cross(p, f) + torque * n, f])
                for method in METHODS:
                    solution = solve_contact(F_S, surface, method=method)  # type: ignore[arg-type]
                    assert solution.valid, (p, slant, torque, method, solution.reason)
                    np.testing.assert_allclose(solution.p_SC, p, atol=1e-9)


def test_the_inputs_stay_and_the_answer_is_read_only() -> None:
    F_S = np.array([0, 0, 0, 0, 0, -1.0])
    before = F_S.copy()
    solution = solve_contact(F_S, Sphere(radius=0.009))
    np.testing.assert_array_equal(F_S, before)
    with pytest.raises(ValueError, match="read-only"):
        solution.p_SC[0] = 1.0


@pytest.mark.parametrize(("force", "limit"), [(1.0, 60e-6), (5.0, 12e-6)])
@pytest.mark.parametrize("name", ["sphere", "ellipsoid", "cylinder", "hemisphere"])
def test_the_point_is_exact_enough_with_a_nano17(name: str, force: float, limit: float) -> None:
    generator = np.random.default_rng(1)
    touches = touch(SURFACES[name], generator, 20_000, force=force, friction=0.8, patch_radius=0.001)
    noise = generator.normal(size=touches.F_S.shape) * ([1 / 64e3] * 3 + [1 / 320] * 3)
    found = solve_contacts(touches.F_S + noise, SURFACES[name])
    assert found.valid.mean() > 0.99  # the rest lies on the edge of an open surface
    error = np.linalg.norm(found.p_SC - touches.p_SC, axis=1)[found.valid]
    assert np.sqrt(np.mean(error**2)) < limit
