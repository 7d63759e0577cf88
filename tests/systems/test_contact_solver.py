import numpy as np
import pytest
from pydrake.math import RigidTransform

from tactopose_drake.core.sensing.intrinsic_contact import ContactSolution
from tactopose_drake.core.sensing.soft_layer import SoftLayer
from tactopose_drake.core.surfaces import Capsule, Sphere
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.systems.contact_solver import ContactSolver, ContactSolverParams

X_SF = RigidTransform([0, 0, 0.02]).GetAsMatrix34()
SURFACES = {"first": Sphere(radius=0.009, X_SF=X_SF), "thumb": Capsule(radius=0.011, length=0.01, X_SF=X_SF)}


def push(p_SC: np.ndarray, f_S: np.ndarray) -> np.ndarray:
    return np.concatenate([np.cross(p_SC, f_S), f_S])


def solve(wrenches: dict[str, np.ndarray], **params: float) -> dict[str, ContactSolution]:
    solver = ContactSolver(SURFACES, ContactSolverParams(**params))
    context = solver.CreateDefaultContext()
    for finger, wrench in wrenches.items():
        solver.GetInputPort(f"wrench_{finger}").FixValue(context, wrench)
    return solver.GetOutputPort("contact_solutions").Eval(context)


def test_each_finger_is_solved_on_its_own_surface() -> None:
    n = np.array([0.6, 0.0, 0.8])
    p_first, p_thumb = 0.009 * n + X_SF[:, 3], 0.011 * n + X_SF[:, 3] + [0, 0, 0.005]
    f = np.array([-1.0, 0.3, -1.9])
    solutions = solve({"first": push(p_first, f), "thumb": push(p_thumb, 2 * f)})
    assert list(solutions) == ["first", "thumb"]
    np.testing.assert_allclose(solutions["first"].p_SC, p_first, atol=1e-9)
    np.testing.assert_allclose(solutions["thumb"].p_SC, p_thumb, atol=1e-9)
    for finger, scale in (("first", 1), ("thumb", 2)):
        total = solutions[finger].normal_force + solutions[finger].friction_force
        np.testing.assert_allclose(total, scale * f, atol=1e-9)


def test_a_soft_skin_is_pressed_in_where_a_finger_has_one() -> None:
    layer = SoftLayer(thickness=0.002, stiffness=5000.0)
    solver = ContactSolver(SURFACES, layers={"first": layer})
    context = solver.CreateDefaultContext()
    n, f = np.array([0.6, 0.0, 0.8]), 2.5
    p_first, p_thumb = (0.009 - f / 5000.0) * n + X_SF[:, 3], 0.011 * n + X_SF[:, 3] + [0, 0, 0.005]
    for finger, p_SC in (("first", p_first), ("thumb", p_thumb)):
        solver.GetInputPort(f"wrench_{finger}").FixValue(context, push(p_SC, -f * n))
    solutions = solver.GetOutputPort("contact_solutions").Eval(context)
    np.testing.assert_allclose(solutions["first"].p_SC, p_first, atol=1e-8)
    assert solutions["first"].deformation == pytest.approx(0.0005)
    np.testing.assert_allclose(solutions["thumb"].p_SC, p_thumb, atol=1e-8)
    assert solutions["thumb"].deformation == 0.0


def test_what_a_sensor_reads_without_a_touch_is_taken_off() -> None:
    wrench, bias = push(np.array([0, 0, 0.029]), np.array([0, 0.1, -1.0])), np.array([0.002, 0, 0.001, 0.3, -0.2, 0.4])
    solver = ContactSolver(SURFACES, biases={"thumb": bias})
    context = solver.CreateDefaultContext()
    solver.GetInputPort("wrench_first").FixValue(context, wrench)
    solver.GetInputPort("wrench_thumb").FixValue(context, wrench + bias)
    solutions, expected = (
        solver.GetOutputPort("contact_solutions").Eval(context),
        solve({"first": wrench, "thumb": wrench}),
    )
    for finger, solution in solutions.items():
        assert solution.valid
        np.testing.assert_allclose(solution.p_SC, expected[finger].p_SC, atol=1e-9)


def test_a_finger_without_a_reading_is_invalid_and_says_so() -> None:
    good = push(np.array([0, 0, 0.029]), np.array([0, 0, -1.0]))
    solutions = solve({"first": np.full(6, np.nan), "thumb": good})
    assert not solutions["first"].valid
    assert "not finite" in solutions["first"].reason
    assert np.all(np.isnan(solutions["first"].p_SC))
    assert solutions["thumb"].valid


def test_a_finger_without_a_sensor_is_one_without_a_reading() -> None:
    good = push(np.array([0, 0, 0.029]), np.array([0, 0, -1.0]))
    solutions = solve({"thumb": good})
    assert not solutions["first"].valid
    assert not solutions["first"].is_untouched
    assert solutions["first"].reason == "no wrench is connected"
    assert solutions["thumb"].valid


def test_the_solution_follows_the_wrench_and_does_not_linger() -> None:
    solver = ContactSolver(SURFACES)
    context = solver.CreateDefaultContext()
    wrench = push(np.array([0, 0, 0.029]), np.array([0, 0, -1.0]))
    for finger in SURFACES:
        solver.GetInputPort(f"wrench_{finger}").FixValue(context, wrench)
    assert solver.GetOutputPort("contact_solutions").Eval(context)["first"].valid
    solver.GetInputPort("wrench_first").FixValue(context, np.full(6, np.nan))
    solutions = solver.GetOutputPort("contact_solutions").Eval(context)
    assert not solutions["first"].valid
    assert solutions["thumb"].valid


def test_a_force_below_the_threshold_is_no_contact() -> None:
    weak = push(np.array([0, 0, 0.029]), np.array([0, 0, -0.3]))
    assert not solve({"first": weak, "thumb": weak}, min_force=0.5)["first"].valid
    assert solve({"first": weak, "thumb": weak}, min_force=0.2)["first"].valid
    assert solve({"first": weak, "thumb": weak}, min_force=0.0)["first"].valid


def test_friction_beyond_the_coefficient_is_no_contact() -> None:
    n = np.array([0, 0, 1.0])
    wrench = push(0.009 * n + X_SF[:, 3], np.array([0.9, 0, -1.0]))
    assert not solve({"first": wrench, "thumb": wrench}, friction_coefficient=0.5)["first"].valid
    assert solve({"first": wrench, "thumb": wrench}, friction_coefficient=1.5)["first"].valid


@pytest.mark.parametrize(
    ("params", "name"), [({"min_force": -1.0}, "min_force"), ({"friction_coefficient": 0.0}, "fric")]
)
def test_a_bad_parameter_is_named(params: dict[str, float], name: str) -> None:
    with pytest.raises(InvalidInputError, match=name):
        ContactSolver(SURFACES, ContactSolverParams(**params))
