import dataclasses

import numpy as np
import pytest

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.force_balance import ForceBalance
from tactopose_drake.core.objectives.wrench_balance import WrenchBalance
from tactopose_drake.core.poses import exp_so3, make_poses, random_rotations, retract, transform_points
from tactopose_drake.errors import InvalidInputError
from tests.core.balanced_forces import balanced_forces
from tests.core.objectives.laws import check_derivatives

MASS = 0.4
CENTER = np.array([0.01, -0.02, 0.05])
BALANCE = ForceBalance(9.81 * np.array([0.6, 0.0, -0.8]))


def hold(seed: int, count: int = 4) -> tuple[Contacts, np.ndarray]:
    """Contacts whose forces on the fingertips carry the object, and its pose (3, 4)."""
    generator = np.random.default_rng(seed)
    X_PO = make_poses(random_rotations(generator, 1), generator.normal(size=(1, 3)) * 0.05)[0]
    c = transform_points(X_PO, CENTER[None])[0]
    p_PC = c + generator.normal(size=(count, 3)) * 0.04
    f_PC = balanced_forces(generator.normal(size=(count, 3)) * 2.0, p_PC, c, MASS * BALANCE.gravity_P)
    return Contacts(p_PC, f_PC=f_PC), X_PO


def test_an_object_at_rest_is_balanced() -> None:
    for seed in range(10):
        contacts, X_PO = hold(seed)
        residuals = WrenchBalance(contacts, BALANCE, MASS, CENTER).residuals(X_PO[None])
        np.testing.assert_allclose(residuals, 0.0, atol=1e-9)


def test_the_other_sign_of_the_forces_is_not_balanced() -> None:
    contacts, X_PO = hold(1)
    assert contacts.f_PC is not None
    pulled = dataclasses.replace(contacts, f_PC=-contacts.f_PC)
    assert WrenchBalance(pulled, BALANCE, MASS, CENTER).cost(X_PO[None])[0] > 100.0


def test_only_the_way_across_gravity_is_told() -> None:
    contacts, X_PO = hold(2)
    balance = WrenchBalance(contacts, BALANCE, MASS, CENTER)
    down = BALANCE.gravity_P / np.linalg.norm(BALANCE.gravity_P)
    across = np.cross(down, [0.0, 1.0, 0.0])
    lowered, moved = (retract(X_PO, np.concatenate([np.zeros(3), 0.03 * way])) for way in (down, across))
    R_PO = exp_so3(np.array([1.0, 2.0, 0.5])) @ X_PO[:, :3]
    turned = make_poses(R_PO, transform_points(X_PO, CENTER[None])[0] - R_PO @ CENTER)
    cost = balance.cost(np.stack([lowered, turned, moved]))
    np.testing.assert_allclose(cost[:2], 0.0, atol=1e-12)
    assert cost[2] > 10.0


def test_the_forces_tell_whether_the_mass_fits() -> None:
    contacts, X_PO = hold(3)
    residuals = WrenchBalance(contacts, BALANCE, 2.0 * MASS, CENTER).residuals(X_PO[None])[0]
    # The weight that is missing, in units of the noise of the sum of four forces.
    assert np.linalg.norm(residuals[3:]) == pytest.approx(MASS * 9.81 / (2.0 * 0.05))


def test_noise_makes_residuals_of_unit_variance() -> None:
    contacts, X_PO = hold(4, count=5)
    assert contacts.f_PC is not None
    sigma_position, sigma_force = np.linspace(0.0005, 0.002, 5), np.linspace(0.02, 0.1, 5)
    balance = dataclasses.replace(BALANCE, sigma_torque=1e-9)
    generator = np.random.default_rng(5)
    samples = []
    for _ in range(3000):
        noisy = Contacts(
            contacts.p_PC + generator.normal(size=(5, 3)) * sigma_position[:, None],
            f_PC=contacts.f_PC + generator.normal(size=(5, 3)) * sigma_force[:, None],
            sigma_position=sigma_position,
            sigma_force=sigma_force,
        )
        samples.append(WrenchBalance(noisy, balance, MASS, CENTER).residuals(X_PO[None])[0])
    # The standard error of a covariance of 3000 samples is 0.026 on the diagonal, 0.018 beside it.
    np.testing.assert_allclose(np.cov(np.array(samples), rowvar=False), np.eye(6), atol=0.12)


def test_torques_of_the_fingertips_are_noise_too() -> None:
    contacts, X_PO = hold(6)
    off = retract(X_PO, np.array([0.0, 0.0, 0.0, 0.02, 0.01, 0.0]))[None]
    firm, soft = (
        WrenchBalance(contacts, dataclasses.replace(BALANCE, sigma_torque=sigma), MASS, CENTER).cost(off)[0]
        for sigma in (0.0005, 0.5)
    )
    # Four fingertips, whose torques now are all of the noise.
    c = transform_points(off[0], CENTER[None])[0]
    assert contacts.f_PC is not None
    moment = np.sum(np.cross(contacts.p_PC - c, contacts.f_PC), axis=0)
    assert soft == pytest.approx(0.5 * moment @ moment / (4 * 0.5**2), rel=1e-3)
    assert firm > 100.0 * soft


@pytest.mark.parametrize("angle", [0.0, 1e-8, 1.0, np.pi])
def test_the_derivatives_are_exact(angle: float) -> None:
    generator = np.random.default_rng(7)
    contacts, _ = hold(7)
    turned = make_poses(exp_so3(angle * np.array([[0.36, -0.48, 0.8]])), generator.normal(size=(1, 3)) * 0.01)
    check_derivatives(
        WrenchBalance(contacts, BALANCE, MASS, CENTER), retract(turned, generator.normal(size=(20, 6)) * 0.05)
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"gravity_P": [0.0, np.nan, -9.81]}, r"gravity_P\[1\] must be .*, not nan"),
        ({"gravity_P": -9.81}, r"gravity_P must have the shape \(3,\), not \(\)"),
        ({"gravity_P": [0.0, 0.0, -9.81], "sigma_torque": 0.0}, "sigma_torque must be a number > 0, not 0"),
    ],
)
def test_a_bad_balance_is_refused(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        ForceBalance(**arguments)  # type: ignore[arg-type]
