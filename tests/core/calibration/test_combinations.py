import numpy as np

from tactopose_drake.core.calibration.combinations import undetermined

NAMES = ("thumb offset 1", "thumb offset 2", "thumb offset 3", "thumb radius")


def posterior(measured: list[list[float]]) -> np.ndarray:
    """Of standard normal unknowns, of which some sums were measured well."""
    A = 100.0 * np.array(measured)
    return np.linalg.inv(np.eye(4) + A.T @ A)


def test_what_is_measured_is_not_named() -> None:
    assert undetermined(posterior(np.eye(4).tolist()), NAMES) == ()


def test_a_sum_that_was_measured_leaves_one_against_the_other() -> None:
    # Offsets 1 and 3 add up in every grasp; the others are known.
    (left,) = undetermined(posterior([[1, 0, 1, 0], [0, 1, 0, 0], [0, 0, 0, 1]]), NAMES)
    assert set(left.parts) == {0, 2}
    assert left.signs == (1, -1)
    assert left.text in ("thumb offset 1 against thumb offset 3", "thumb offset 3 against thumb offset 1")


def test_a_difference_that_was_measured_leaves_both_together() -> None:
    (left,) = undetermined(posterior([[1, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]]), NAMES)
    assert left.signs == (1, 1)
    assert " with " in left.text


def test_unknowns_of_which_nothing_was_measured_are_named_alone() -> None:
    found = undetermined(posterior([[1, 0, 0, 0], [0, 0, 1, 0]]), NAMES)
    assert sorted(combination.text for combination in found) == ["thumb offset 2", "thumb radius"]
