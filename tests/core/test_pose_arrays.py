"""Poses of any form of numbers are read as such, and those of another shape are refused, not read beyond their end."""

from collections.abc import Callable

import numpy as np
import pytest

import tactopose_drake as tp
from tactopose_drake.core.objectives import ContactSum, PriorObjective, SurfaceContact
from tactopose_drake.core.posterior import free_directions, truth_errors
from tactopose_drake.core.shape import nearest_images, turn_toward
from tactopose_drake.core.synthetic import touch_surface
from tactopose_drake.errors import InvalidInputError

# Two poses whose numbers every form holds exactly.
X_PO = np.tile(np.eye(3, 4), (2, 1, 1))
X_PO[1, :, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
MOVED = (2.0 * 2.0**0.5) / 3.0  # mean distance by which the second moves the ends of the unit vectors
ROD = tp.ObjectModel.from_cylinder(0.02, 0.1)
TOUCH = SurfaceContact(ROD.grid, touch_surface(ROD, X_PO[0], 3, np.random.default_rng(0)))
PRIOR = PriorObjective(tp.PosePrior(X_PO[0]))
FUNCTIONS: dict[str, Callable[..., object]] = {
    "cost": TOUCH.cost,
    "residuals": TOUCH.residuals,
    "normal_equations": lambda X: TOUCH.normal_equations(X).cost,
    "sum": ContactSum(TOUCH, PRIOR).cost,
    "prior": PRIOR.cost,
    "turn_toward": lambda X: turn_toward(X, X_PO[0], ROD.symmetries),
    "nearest_images": lambda X: nearest_images(X, X_PO[0], ROD.symmetry_turns, ROD.symmetries),
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_poses_of_any_numbers_are_read_and_those_of_another_shape_refused(name: str) -> None:
    function, wanted = FUNCTIONS[name], FUNCTIONS[name](X_PO)
    for form in (X_PO.tolist(), X_PO.astype(np.float32), X_PO.astype(int), np.asfortranarray(X_PO)):
        np.testing.assert_array_equal(function(form), wanted)
    for wrong in (X_PO[:, :, :3], X_PO[0], X_PO[:, :2]):
        with pytest.raises(InvalidInputError, match=r"X_PO must have the shape \(n, 3, 4\), not \("):
            function(wrong)


def test_other_arrays_are_read_likewise() -> None:
    information = np.tile(np.diag([1.0, 1, 0, 4, 4, 4]), (2, 1, 1))
    wanted = free_directions(information, 0.1)
    for form in (information.tolist(), information.astype(np.float32), np.asfortranarray(information)):
        np.testing.assert_array_equal(free_directions(form, 0.1), wanted)
    with pytest.raises(InvalidInputError, match=r"touch_information must have the shape \(n, 6, 6\), not \(6, 6\)"):
        free_directions(information[0], 0.1)
    for form in (X_PO.tolist(), X_PO.astype(np.float32)):
        assert truth_errors(np.eye(3).tolist(), np.eye(3), X_PO[0].tolist(), form)[0].tolist() == [0.0, MOVED]
    with pytest.raises(InvalidInputError, match=r"p_OQ must have the shape \(\.\.\., 3\), not \(5, 2\)"):
        ROD.grid.distance(np.zeros((5, 2)))
    with pytest.raises(InvalidInputError, match=r"X_reference must have the shape \(3, 4\), not \(4, 4\)"):
        turn_toward(X_PO, np.eye(4), ROD.symmetries)
    with pytest.raises(InvalidInputError, match=r"X_PO must have the shape \(3, 4\) or \(4, 4\), not \(3, 3\)"):
        touch_surface(ROD, np.eye(3), 3, np.random.default_rng(0))
