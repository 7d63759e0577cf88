"""What is taken for a number, and in which form it is passed on."""

import dataclasses
import datetime
import decimal
import fractions
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.force_balance import ForceBalance
from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.evidence.hand_geometry import HandGeometry
from tactopose_drake.core.geometry_checks import pose_matrix, unit_vectors
from tactopose_drake.core.parameter_checks import check_numbers
from tactopose_drake.core.poses import exp_so3, make_poses
from tactopose_drake.core.validation import finite_array, flag, known_name, number_array, positive_number, whole_number
from tactopose_drake.errors import InvalidInputError, UnknownNameError

cyclic: list[Any] = []
cyclic.append(cyclic)
WRONG = {
    "text": "3",
    "bytes": b"3",
    "byte array": bytearray(b"3"),
    "True": True,
    "numpy's True": np.True_,
    "nothing": None,
    "decimal": decimal.Decimal("0.5"),
    "fraction": fractions.Fraction(1, 2),
    "date": np.datetime64("2024-01-01"),
    "time": np.timedelta64(5, "s"),
    "Python's time": datetime.timedelta(seconds=1),
    "complex": 1.0 + 0.0j,
    "masked": np.ma.masked,
    "object": object(),
    "an object that is a number": np.array(1.0, dtype=object),
    "too large": 10**400,
}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", sorted(WRONG))
def test_what_is_no_number_is_refused_alone_and_among_numbers(name: str) -> None:
    value = WRONG[name]
    with pytest.raises(InvalidInputError, match=r"^x must be a "):
        finite_array("x", value, ())
    with pytest.raises(InvalidInputError, match=r"^x"):
        finite_array("x", [1.0, value], (2,))
    with pytest.raises(InvalidInputError, match=r"^x"):
        finite_array("x", [[1.0, 2.0], [value, 3]], (2, 2))


@pytest.mark.parametrize(
    "value",
    [
        ["1", "2"],
        np.array(["1", "2"]),
        np.array([b"1", b"2"]),
        np.array([True, False]),
        [np.array([True]), np.array([1.0])],
        np.array([1.0, 2.0], dtype=object),
        np.array([1.0, 2.0], dtype=complex),
        np.array([1, 2], dtype="M8[s]"),
        np.array([1, 2], dtype="m8[s]"),
        [[1.0, 2.0], [3.0]],
        np.ma.masked_array([1.0, 2.0], [False, True]),
        [np.ma.masked_array([1.0], [True]), [2.0]],
        {"x": 1.0},
        cyclic,
        np.zeros(2, dtype=[("x", float)]),
    ],
)
def test_arrays_of_anything_else_are_refused(value: Any) -> None:
    with pytest.raises(InvalidInputError, match=r"^x"):
        finite_array("x", value, (2,), (2, 1), (2, 2))


def test_a_masked_entry_does_not_count_as_what_is_behind_the_mask() -> None:
    masked = np.ma.masked_array(np.zeros((2, 3)), [[0, 0, 0], [0, 1, 0]])
    with pytest.raises(InvalidInputError, match=r"p_PC\[1, 1\] must be a finite number, not masked"):
        Contacts(masked)
    np.testing.assert_array_equal(Contacts(np.ma.masked_array(np.ones((2, 3)))).p_PC, 1.0)


numbers = arrays.arrays(
    st.sampled_from(["f2", "f4", ">f8", "<f8", "g", "i1", ">i4", "i8", "u2"]),
    arrays.array_shapes(min_dims=2, max_dims=2),
    elements={"min_value": 0, "max_value": 100},
)


@given(numbers, st.sampled_from(["as it is", "transposed", "strided", "read-only", "list", "masked"]))
def test_numbers_of_any_width_and_layout_become_the_same_array(array: Any, layout: str) -> None:
    ways = {
        "as it is": lambda: array,
        "transposed": lambda: np.asfortranarray(array),
        "strided": lambda: np.repeat(array, 2, axis=1)[:, ::2],
        "read-only": lambda: np.frombuffer(array.tobytes(), array.dtype).reshape(array.shape),
        "list": lambda: [list(row) for row in array],
        "masked": lambda: np.ma.masked_array(array),
    }
    given_array = ways[layout]()
    taken = finite_array("x", given_array, (None, None))
    assert type(taken) is np.ndarray
    assert taken.dtype == np.dtype(np.float64)
    assert taken.dtype.isnative
    assert taken.flags.c_contiguous
    assert taken.flags.aligned
    assert taken.flags.owndata
    assert taken.flags.writeable
    assert not np.shares_memory(taken, np.asarray(given_array))
    np.testing.assert_array_equal(taken, np.asarray(array, dtype=np.float64))


def test_large_integers_are_numbers_and_large_floats_are_infinite() -> None:
    np.testing.assert_array_equal(finite_array("x", [10**30, 1], (2,)), [1e30, 1.0])
    with pytest.raises(InvalidInputError, match=r"x\[1\] must be a finite number, not inf"):
        finite_array("x", np.array([1, np.longdouble("1e4000")]), (2,))
    np.testing.assert_array_equal(number_array("x", [math.nan, math.inf], (2,)), [math.nan, math.inf])


@pytest.mark.parametrize(
    "value", [None, 1.5, True, np.True_, "a", 3.0, math.nan, [1], np.array([1]), np.timedelta64(5)]
)
def test_what_is_no_integer_is_refused(value: Any) -> None:
    with pytest.raises(InvalidInputError, match=r"seed must be an integer >= 0, not .*"):
        whole_number("seed", value, least=0)


def test_integers_have_bounds() -> None:
    assert whole_number("n", np.int8(3), least=3, most=3) == 3
    with pytest.raises(InvalidInputError, match="n must be an integer >= 3, not 2"):
        whole_number("n", 2, least=3)
    with pytest.raises(InvalidInputError, match="n must be an integer from 3 to 4, not 5"):
        whole_number("n", 5, least=3, most=4)


def test_flags_and_names_are_of_their_types() -> None:
    assert flag("f", np.True_) is True
    with pytest.raises(InvalidInputError, match="f must be True or False, not 1"):
        flag("f", 1)
    assert known_name("method", "a", {"a": 1}) == "a"
    for value in ([], None, "b", 1, np.array(["a", "a"])):
        with pytest.raises(UnknownNameError, match=r"method must be one of a, not .*"):
            known_name("method", value, {"a": 1})


def test_numbers_have_bounds() -> None:
    assert positive_number("x", np.float32(0.5)) == 0.5
    assert positive_number("x", 0, allow_zero=True, least=0.1, most=1.0) == 0.0
    with pytest.raises(InvalidInputError, match=r"x must be a number from 0.1 to 1, or 0, not 0.05"):
        positive_number("x", 0.05, allow_zero=True, least=0.1, most=1.0)
    with pytest.raises(InvalidInputError, match="x must be a number from 0 to 1, not 2"):
        positive_number("x", 2.0, most=1.0)


@dataclasses.dataclass(kw_only=True)
class Numbers:
    count: int = 3
    seed: int = 0
    share: float = 0.5
    width: float | None = None
    name: str = "any"


def test_a_dataclass_s_numbers_are_of_their_defaults_kinds() -> None:
    def check(**values: Any) -> None:
        check_numbers("Numbers", Numbers(**values), may_be_zero=("seed",), most={"share": 1.0})

    check()
    check(count=np.int64(1), seed=0, share=1, width=2.0)
    for values, message in (
        ({"count": 2.5}, r"Numbers\.count must be an integer >= 1, not 2\.5"),
        ({"count": 0}, r"Numbers\.count must be an integer >= 1, not 0"),
        ({"seed": -1}, r"Numbers\.seed must be an integer >= 0, not -1"),
        ({"share": 1.5}, r"Numbers\.share must be a number from 0 to 1, not 1\.5"),
        ({"share": "half"}, r"Numbers\.share must be a number, not 'half'"),
        ({"width": 0.0}, r"Numbers\.width must be a number > 0, not 0"),
    ):
        with pytest.raises(InvalidInputError, match=message):
            check(**values)


def test_a_transposed_matrix_is_no_pose() -> None:
    X = np.eye(4)
    X[:3] = make_poses(exp_so3(np.array([0.1, 0.2, 0.3])), np.array([0.01, 0.02, 0.03]))
    np.testing.assert_array_equal(pose_matrix("X", X), X[:3])
    with pytest.raises(
        InvalidInputError, match=r"X must have the last row \[0, 0, 0, 1\], not \[0.01, 0.02, 0.03, 1.0\]"
    ):
        pose_matrix("X", X.T)
    for taken in (pose_matrix("X", X), pose_matrix("X", np.asfortranarray(X[:3]))):
        assert taken.flags.c_contiguous
        assert taken.flags.owndata


@pytest.mark.parametrize("length", [0.0, 1e-300, 1e200, 1e308])
def test_directions_of_extreme_lengths_are_refused_without_a_warning(length: float) -> None:
    with pytest.raises(InvalidInputError, match=r"n\[0\] must have the length 1"):
        unit_vectors("n", [[length, length, 0.0]], (None, 3))


def test_points_in_millimetres_are_refused() -> None:
    message = r"\[1\] must have coordinates .*, not \[31.0, 2.0, 94.0\] m. Multiply by 0.001 what is in millimetres"
    points = [[0.0, 0.0, 0.1], [31, 2, 94]]
    with pytest.raises(InvalidInputError, match="^p_PC" + message):
        Contacts(points)
    with pytest.raises(InvalidInputError, match="^p_PH" + message):
        HandGeometry(points, [0.01, 0.01])
    with pytest.raises(InvalidInputError, match=r"mean.*millimetres"):
        GaussianPrior(make_poses(np.eye(3), np.array([31.0, 2.0, 94.0])))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: Contacts([[0, 0, 0]], sigma_position=1e-8),
            "sigma_position must be a number from 1e-07 to .*, not 1e-08",
        ),
        (
            lambda: Contacts([[0, 0, 0]], sigma_position=0.9),  # millimetres, the mistake in most files
            "sigma_position must be a number from 1e-07 to 0.1 m, not 0.9.",
        ),
        (lambda: Contacts([[0, 0, 0]], sigma_normal=1e-9), "sigma_normal must be a number from 1e-05 to .*, not 1e-09"),
        (
            lambda: Contacts([[0, 0, 0]], sigma_force=[1e9]),
            "sigma_force\\[0\\] must be a number from 1e-06 to .*, not 1e.09",
        ),
        (
            lambda: Contacts([[0, 0, 0]], f_PC=[[0, 1e9, 0]]),
            r"f_PC\[0, 1\] must be a number from -1e.06 to 1e.06, not 1e.09",
        ),
        (lambda: GaussianPrior(np.eye(3, 4), sigma_translation=1e-9), "sigma_translation must be .*, not 1e-09"),
        (lambda: GaussianPrior(np.eye(3, 4), sigma_rotation=1e9), "sigma_rotation must be .*, not 1e.09"),
        (lambda: HandGeometry([[0, 0, 0]], [1e-9]), "radius\\[0\\] must be .*, not 1e-09"),
        (lambda: HandGeometry([[0, 0, 0]], [1.0], 1e-9), "sigma must be .*, not 1e-09"),
        (lambda: ForceBalance([0, 0, -1e9]), r"gravity_P\[2\] must be .*, not -1e.09"),
        (lambda: ForceBalance([0, 0, -9.8], 1e-20), "sigma_torque must be .*, not 1e-20"),
    ],
)
def test_what_doubles_cannot_weigh_against_the_rest_is_refused(make: Any, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        make()
