import numpy as np
import pytest

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


@pytest.mark.parametrize("seed", range(8))
def test_each_combination_is_found_wherever_its_unknowns_stand_and_what_hardly_counts_is_not_named(seed: int) -> None:
    generator = np.random.default_rng(seed)
    place = generator.permutation(9)
    # By unknown: 0 against 1, 2 with 3 and a little of 4, and 5 against 6 with 7; the last is known.
    free = np.zeros((3, 9))
    free[0, place[[0, 1]]] = 2.0, -1.5
    free[1, place[[2, 3, 4]]] = -1.0, -0.6, 0.3
    free[2, place[[5, 6, 7]]] = 1.0, -0.9, 0.5
    free *= generator.choice([-1.0, 1.0], size=(3, 1))
    basis = np.linalg.qr(free.T)[0]
    found = undetermined(1e-4 * np.eye(9) + basis @ basis.T, [f"u{i}" for i in range(9)])
    a, b, c, d, _, e, f, g, _ = (f"u{i}" for i in place)
    assert {each.text for each in found} == {f"{a} against {b}", f"{c} with {d}", f"{e} with {g} against {f}"}
    by_text = {each.text: each for each in found}
    assert by_text[f"{a} against {b}"].parts == (place[0], place[1])
    assert by_text[f"{e} with {g} against {f}"].parts == (place[5], place[6], place[7])
    assert by_text[f"{e} with {g} against {f}"].signs == (1, -1, 1)
