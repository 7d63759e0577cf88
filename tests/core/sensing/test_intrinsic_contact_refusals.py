"""Wrenches that no contact explains, or none that is allowed, and input that is none."""

import math

import numpy as np
import pytest
from hypothesis import given, settings

from tactopose_drake.core.sensing.intrinsic_contact import MIN_FORCE, FingertipSolver, solve_contact, solve_contacts
from tactopose_drake.core.sensing.soft_layer import SoftLayer
from tactopose_drake.core.surfaces import Capsule, Cylinder, Sphere, Superquadric, Surface
from tactopose_drake.errors import InvalidInputError, UnknownNameError
from tests.core.touches import SURFACES, placed, seeds, touch

every_surface = pytest.mark.parametrize("surface", SURFACES.values(), ids=SURFACES)
METHODS = ("auto", "newton")


def wrench(p: list[float], f: list[float]) -> np.ndarray:
    return np.concatenate([np.cross(p, f), f])


@every_surface
def test_a_force_that_passes_by_is_no_contact(surface: Surface) -> None:
    surface = placed(surface, np.random.default_rng(3))
    R_SF, p_SF = surface.X_SF[:, :3], surface.X_SF[:, 3]
    for axis in range(3):
        f, aside = R_SF[:, (axis + 1) % 3], 0.03 * R_SF[:, axis]
        for method in METHODS:
            solution = solve_contact(wrench(p_SF + aside, f), surface, method=method)  # type: ignore[arg-type]
            assert not solution.valid
            # On an endless side a line can pass the finger's end by and still cross the surface beyond it
            assert "passes the surface by" in solution.reason or "outside" in solution.reason
            assert np.isnan(solution.p_SC).all()
            assert np.isnan(solution.local_torque).all()
            assert math.isnan(solution.residual)


def test_a_force_that_passes_by_is_no_contact_despite_noise() -> None:
    generator = np.random.default_rng(0)
    F_S = wrench([0.0, 0.012, 0.0], [1.0, 0.0, 0.0]) + generator.normal(size=(1000, 6)) * ([2e-5] * 3 + [3e-3] * 3)
    for surface in (Sphere(radius=0.009), Superquadric(semi_axes=(0.009, 0.009, 0.009), exponents=(0.8, 0.8))):
        found = solve_contacts(F_S, surface)
        assert not found.valid.any()
        assert set(found.reason) == {"no single contact explains the wrench: the force passes the surface by"}


@pytest.mark.parametrize(
    ("surface", "p", "f"),
    [
        (Capsule(radius=0.009, length=0.014), [0.0, 0.0, 0.016], [0.0, 0.1, 1.0]),
        (Capsule(radius=0.009, length=0.0), [0.0, 0.0, 0.009], [0.0, 0.0, 1.0]),
        (Capsule(radius=0.009, length=0.0), [0.0, 0.0054, 0.0072], [0.0, 0.0, 1.0]),
    ],
)
def test_a_pull_is_no_contact_on_an_open_surface(surface: Surface, p: list[float], f: list[float]) -> None:
    solution = solve_contact(wrench(p, f), surface)
    assert not solution.valid
    assert solution.reason == "the force pulls on the surface; a contact can only push"


def test_a_pull_on_a_closed_surface_is_the_push_on_its_far_side() -> None:
    solution = solve_contact(wrench([0, 0, 0.009], [0, 0, 1.0]), Sphere(radius=0.009))
    np.testing.assert_allclose(solution.p_SC, [0, 0, -0.009], atol=1e-15)


@every_surface
def test_a_force_beyond_all_reason_is_no_contact(surface: Surface) -> None:
    touches = touch(surface, np.random.default_rng(5), 6, friction=0.3)
    strengths = np.array([0.9e3, 1e3, 2e3, 1e20, 1e150, 1e305]) / np.linalg.norm(touches.f_S, axis=1)
    found = solve_contacts(strengths[:, None] * touches.F_S, surface)
    np.testing.assert_array_equal(found.valid, [True] + 5 * [False])
    assert set(found.reason[1:]) == {"the force is beyond 1000 N: it must be in millinewtons"}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("surface", "p", "f"),
    [
        (Cylinder(radius=0.009, length=0.02), [0.009, 0.0, 0.0101], [-1.0, 0.2, 0.1]),
        (Cylinder(radius=0.009, length=0.02), [0.009, 0.0, -0.0101], [-1.0, 0.2, 0.1]),
        (Capsule(radius=0.009, length=0.02), [0.0, 0.009, -0.0101], [0.3, -1.0, 0.1]),
        (Capsule(radius=0.009, length=0.0), [0.0, 0.009, -0.0001], [0.3, -1.0, 0.1]),
    ],
)
def test_the_edge_of_an_open_surface(surface: Surface, p: list[float], f: list[float], method: str) -> None:
    beyond = solve_contact(wrench(p, f), surface, method=method)  # type: ignore[arg-type]
    assert not beyond.valid
    assert beyond.reason == "the contact would lie outside of the part of the surface that can be touched"
    p = [p[0], p[1], p[2] + math.copysign(0.0001, -p[2])]  # on the edge itself, which belongs to the surface
    np.testing.assert_allclose(solve_contact(wrench(p, f), surface, method=method).p_SC, p, atol=1e-12)  # type: ignore[arg-type]


@every_surface
@given(seed=seeds)
@settings(max_examples=10)
def test_too_weak_a_force_is_no_contact(surface: Surface, seed: int) -> None:
    generator = np.random.default_rng(seed)
    weak = touch(surface, generator, 20, force=0.999 * MIN_FORCE).F_S
    strong = touch(surface, generator, 20, force=1.001 * MIN_FORCE).F_S
    found = solve_contacts(weak, surface)
    assert not found.valid.any()
    assert set(found.reason) == {"the force is below min_force (0.05 N)"}
    assert all(found[k].is_untouched for k in range(len(found)))
    lone = solve_contact(weak[0], surface, min_force=1.5)
    assert lone.reason == "the force is below min_force (1.5 N)"
    assert lone.is_untouched
    assert np.isnan(found.normal_force).all()
    assert solve_contacts(strong, surface).valid.all()
    assert solve_contacts(weak, surface, min_force=0.01).valid.all()
    assert not solve_contacts(strong, surface, min_force=1.0).valid.any()


def test_no_wrench_is_no_contact() -> None:
    for min_force in (0.0, 0.1):
        assert solve_contact(np.zeros(6), Sphere(radius=0.009), min_force=min_force).reason
    assert len(solve_contacts(np.zeros((0, 6)), Sphere(radius=0.009))) == 0


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("column", [0, 5])
def test_a_wrench_that_is_not_finite(bad: float, column: int) -> None:
    F_S = touch(Sphere(radius=0.009), np.random.default_rng(0), 3).F_S
    F_S[1, column] = bad
    found = solve_contacts(F_S, Sphere(radius=0.009))
    np.testing.assert_array_equal(found.valid, [True, False, True])
    assert found.reason[1] == "the wrench is not finite"
    assert np.isnan(found.p_SC[1]).all()
    with pytest.raises(InvalidInputError, match=rf"F_S\[{column}\] must be .*, not {bad}"):
        solve_contact(F_S[1], Sphere(radius=0.009))


@every_surface
@given(seed=seeds)
@settings(max_examples=10)
def test_friction_is_bounded_by_its_coefficient(surface: Surface, seed: int) -> None:
    touches = touch(surface, np.random.default_rng(seed), 30, friction=0.8)
    normal_force = -np.sum(touches.f_S * touches.n_S, axis=1)
    friction = np.linalg.norm(touches.f_S + normal_force[:, None] * touches.n_S, axis=1) / normal_force
    found = solve_contacts(touches.F_S, surface, friction_coefficient=0.5)
    unclear = np.abs(friction - 0.5) < 1e-4
    np.testing.assert_array_equal(found.valid[~unclear], (friction < 0.5)[~unclear])
    assert set(found.reason) <= {"", "the friction force exceeds what friction_coefficient allows"}


def test_local_torque_is_bounded_by_friction() -> None:
    sphere = Sphere(radius=0.009)
    for coefficient, torque, valid in (
        (0.5, 0.0044, True),
        (0.5, 0.0046, False),
        (None, 0.02, True),
        (None, 0.1, False),
    ):
        for sign in (1, -1):
            F_S = [0, 0, sign * torque, 0, 0, -1.0]
            solution = solve_contact(F_S, sphere, friction_coefficient=coefficient)
            assert solution.valid == valid
            assert valid or solution.reason.startswith("the local torque exceeds")


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda s: solve_contact(np.zeros(5), s), r"F_S must have the shape \(6,\), not \(5,\)"),
        (lambda s: solve_contact(np.zeros((1, 6)), s), r"F_S must have the shape .*, not \(1, 6\)"),
        (lambda s: solve_contact("wrench", s), r"F_S.* must (be a number|consist of numbers), not"),
        (lambda s: FingertipSolver(s).solve(np.ones(5)), r"F_S must have the shape \(6,\), not \(5,\)"),
        (lambda s: FingertipSolver(s).solve(np.ones(9)), r"F_S must have the shape \(6,\), not \(9,\)"),
        (lambda s: solve_contacts(np.zeros(6), s), r"F_S must have the shape \(n, 6\), not \(6,\)"),
        (lambda s: solve_contacts(np.zeros((2, 3)), s), r"F_S must have the shape .*, not \(2, 3\)"),
        (lambda s: solve_contacts([["a"] * 6], s), r"F_S.* must (be a number|consist of numbers), not"),
        (lambda s: solve_contact(np.zeros(6), s, min_force=-1.0), r"min_force must be .*, not -1"),
        (lambda s: solve_contact(np.zeros(6), s, friction_coefficient=0.0), r"friction_coefficient must be .*, not 0"),
        (
            lambda s: solve_contact(np.zeros(6), s, layer=SoftLayer(thickness=0.01, stiffness=1e3)),
            r"thickness must be less than .*, not 0.01 m",
        ),
    ],
)
def test_unusable_input_is_refused(call, message: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InvalidInputError, match=message):
        call(Sphere(radius=0.009))


def test_an_unknown_method_is_refused_with_the_known_ones() -> None:
    with pytest.raises(UnknownNameError, match=r"method must be one of auto, newton.*, not 'guess'"):
        solve_contact(np.zeros(6), Sphere(radius=0.009), method="guess")  # type: ignore[arg-type]


def test_a_solver_takes_a_column_of_a_log_as_it_takes_a_row() -> None:
    solver, log = FingertipSolver(Sphere(radius=0.009)), np.array([[0, 0, 0, 0, 0, -1.0], [0, 0.001, 0, 1.0, 0, -1.0]])
    for row, column in zip(log, log.T.copy().T, strict=True):
        expected = solver.solve(row)
        assert expected.valid
        for same in (column, row.tolist(), row.astype(np.float32)):
            np.testing.assert_allclose(solver.solve(same).p_SC, expected.p_SC, rtol=1e-6, atol=1e-12)
