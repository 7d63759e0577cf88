import numpy as np
import pytest
from pydrake.math import RigidTransform

import tactopose_drake as tp
from tactopose_drake.estimation.descriptions import (
    determined_sigmas,
    false_contacts_line,
    free_line,
    meaning,
    sigma_cells,
    sigma_line,
)
from tactopose_drake.resources import model_path


def test_the_sigmas_are_of_what_is_determined_alone() -> None:
    # Sure to 3, 4 and 12 mm along three axes, of which nothing determines the last; to 2 degrees about each.
    covariance = np.diag(np.square([*np.radians([2.0, 2.0, 2.0]), 0.003, 0.004, 0.012]))
    hypothesis = tp.PoseHypothesis(RigidTransform(), 1.0, 1.0, covariance, np.eye(6)[5:], True)
    assert sigma_line(hypothesis, 0.1) == "Where determined, by its own account: \u00b1 5.0 mm, \u00b1 3.5 deg."


def test_where_all_is_determined_table_and_representation_say_the_same() -> None:
    covariance = np.diag(np.square([*np.radians([1.0, 2.0, 2.0]), 0.003, 0.004, 0.012]))
    hypothesis = tp.PoseHypothesis(RigidTransform(), 1.0, 1.0, covariance, np.zeros((0, 6)))
    assert sigma_cells(hypothesis, 0.1) == ("13.0", "3.0")
    assert "\u00b1 13.0 mm, \u00b1 3.0 deg" in repr(hypothesis)
    assert " 13.0 " in tp.PoseEstimate((hypothesis,), "ok", 0.01).table()


@pytest.mark.parametrize(
    ("free", "line", "cells"),
    [
        (np.eye(6), "", ("\u2013", "\u2013")),
        # A ball's turns: of a direction that is nearly free hardly anything is known.
        (np.eye(6)[:3] + 1e-3 * np.eye(6)[3:], "\u00b1 5.2 mm", ("5.2", "\u2013")),
        (np.eye(6)[3:], "\u00b1 3.5 deg", ("\u2013", "3.5")),
    ],
)
def test_of_what_nothing_is_determined_there_is_no_sigma(free: np.ndarray, line: str, cells: tuple[str, str]) -> None:
    covariance = np.diag(np.square([*np.radians([2.0, 2.0, 2.0]), 0.003, 0.003, 0.003]))
    hypothesis = tp.PoseHypothesis(RigidTransform(), 1.0, 1.0, covariance, free)
    assert sigma_line(hypothesis, 0.1) == (f"Where determined, by its own account: {line}." if line else "")
    assert sigma_cells(hypothesis, 0.1) == cells
    assert [np.isnan(sigma) for sigma in determined_sigmas(hypothesis, 0.1)] == [
        cells[1] == "\u2013",
        cells[0] == "\u2013",
    ]


def test_of_what_is_half_determined_there_is_a_sigma() -> None:
    covariance = np.diag(np.square([*np.radians([2.0, 2.0, 2.0]), 0.003, 0.003, 0.003]))
    two_slides = tp.PoseHypothesis(RigidTransform(), 1.0, 1.0, covariance, np.eye(6)[3:5])
    assert sigma_cells(two_slides, 0.1) == ("3.0", "3.5")
    # Two turns, and a screw about the third axis: at half the size, 5 cm, a radian moves 5 cm, and it slides by 8 cm.
    free = np.zeros((3, 6))
    free[0, 0] = free[1, 1] = free[2, 2] = 1.0
    free[2, 5] = 0.08
    left = 0.08**2 / (0.05**2 + 0.08**2)  # of the third turn
    assert left > 0.5
    rotation, _ = determined_sigmas(tp.PoseHypothesis(RigidTransform(), 1.0, 1.0, covariance, free), 0.1)
    assert not np.isnan(rotation)


def test_an_ambiguous_estimate_says_why() -> None:
    cube = tp.ObjectModel.from_mesh(model_path("objects", "cube.obj"))
    single = tp.estimate_pose(cube, tp.Contacts([[0.0, 0.0, 0.1]]))
    assert single.status == "ambiguous"
    assert meaning(single).startswith("the touch does not determine a pose")
    half = tp.PoseHypothesis(RigidTransform(), 1.0, 0.5, np.eye(6), np.zeros((0, 6)))
    assert meaning(tp.PoseEstimate((half, half), "ambiguous", 0.1)).startswith("several poses explain the touch")
    # As one is whose every pose collides with the hand.
    alone = tp.PoseHypothesis(RigidTransform(), 1.0, 1.0, np.eye(6), np.zeros((0, 6)))
    said = meaning(tp.PoseEstimate((alone,), "ambiguous", 0.1))
    assert said == "one pose carries most of the probability, but is not certain"


@pytest.mark.parametrize(
    ("direction", "name"),
    [
        ([0, 0, 1, 0, 0, 0.01], "turn about the object's z"),
        ([0.1, 0, 0.1, 0, 0, 1], "slide along the object's y"),
        ([0, 0, 1, 0, 0.5, 0], "turn about the object's z with a slide of 500 mm/rad along the object's x"),
        ([0, 0, 0, 1, 0, -1], "slide along the object's (0.00, 0.71, -0.71)"),
    ],
)
def test_a_free_direction_is_named_in_the_axes_of_the_object(direction: list[float], name: str) -> None:
    X_PO = RigidTransform(np.array([[0.0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0]]))
    free = np.array([direction]) / np.linalg.norm(direction)
    assert (
        free_line(tp.PoseHypothesis(X_PO, 1.0, 1.0, np.eye(6), free, True)) == f"Not determined by the touch: {name}."
    )


@pytest.mark.parametrize(
    ("is_false", "line"),
    [
        ([False, False], ""),
        ([False, True], "Probably not of this object: contact 2."),
        ([True, False, True, True], "Probably not of this object: contacts 1, 3 and 4."),
    ],
)
def test_false_contacts_are_named_by_their_numbers(is_false: list[bool], line: str) -> None:
    assert false_contacts_line(np.array(is_false)) == line


def test_a_false_contact_is_named_by_its_finger_where_that_is_known() -> None:
    said = false_contacts_line(np.array([False, True]), ("first", "thumb"))
    assert said == "Probably not of this object: contact 2 (thumb)."
