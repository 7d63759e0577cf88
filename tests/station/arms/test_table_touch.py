"""A touch of the table by what a hand holds."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.plane_contact import PlaneContact
from tactopose_drake.station.arms.table_touch import TableTouch, forces_on_hand, rise_of_force, touched_planes

FINGERS = ("first", "middle", "thumb")
P_PC = np.array([[0.03, 0.0, 0.1], [-0.03, 0.01, 0.1], [0.0, -0.02, 0.12]])


def test_the_table_moves_with_what_the_fingertips_hold() -> None:
    X_PS = {name: RigidTransform(RollPitchYaw(0.1, 0.2, 0.3), p_PC) for name, p_PC in zip(FINGERS, P_PC, strict=True)}
    n_P = np.array([0.6, 0.0, 0.8])
    touch = TableTouch(PlaneContact(np.array([0.3, -0.2, 0.1]), n_P, 0.0004), Contacts(P_PC), FINGERS, X_PS)
    same = touch.as_of(X_PS, 0.0)
    np.testing.assert_allclose(same.p_PQ, touch.plane.p_PQ, atol=1e-12)
    np.testing.assert_allclose(same.n_P, n_P, atol=1e-12)
    # All fingers sag alike, and turn what they hold.
    moved = RigidTransform(RollPitchYaw(0.01, -0.02, 0.015), [0.001, -0.002, 0.0015])
    after = touch.as_of({name: moved @ X for name, X in X_PS.items()}, 0.0)
    np.testing.assert_allclose(after.n_P, moved.rotation().multiply(n_P), atol=2e-3)
    for p_PC in P_PC:
        height = (moved.multiply(p_PC) - after.p_PQ) @ after.n_P
        assert abs(height - (p_PC - touch.plane.p_PQ) @ n_P) < 1e-4
    assert after.sigma == touch.plane.sigma


def test_the_earlier_a_touch_the_less_it_tells() -> None:
    """What turns in the hand turns on the same way: after twice as many touches it is off by twice as much."""
    X_PS = {name: RigidTransform(p_PC) for name, p_PC in zip(FINGERS, P_PC, strict=True)}
    plane = PlaneContact(np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.0003)
    planes = touched_planes([TableTouch(plane, Contacts(P_PC), FINGERS, X_PS)] * 3, X_PS, 0.0004)
    np.testing.assert_allclose([one.sigma for one in planes], 1e-4 * np.sqrt([9 + 64, 9 + 16, 9]))
    assert touched_planes([], X_PS, 0.0004) == ()


def test_what_presses_is_the_rise_of_the_forces_along_the_normal() -> None:
    f_PC = np.array([[1.0, 0.0, -0.2], [-1.0, 0.0, 0.1], [0.0, 0.0, 0.3]])
    forces = forces_on_hand(Contacts(P_PC, f_PC=f_PC), FINGERS, np.array([0.0, 0.0, 1.0]))
    assert forces == pytest.approx({"first": -0.2, "middle": 0.1, "thumb": 0.3})
    assert forces_on_hand(Contacts(P_PC), FINGERS, np.array([0.0, 0.0, 1.0])) == {}
    later = {"first": 0.1, "middle": 0.2, "thumb": 0.3}
    assert rise_of_force(forces, later) == pytest.approx(0.4)
    # Of a finger that is felt at one time only nothing is known.
    assert rise_of_force(forces, {"middle": 0.2, "ring": 3.0}) == pytest.approx(0.1)
    assert rise_of_force(forces, {}) == rise_of_force({}, forces) == 0.0
