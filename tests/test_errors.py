"""The package's errors: what they say comes out of another process as it went in."""

import copy
import pickle

import numpy as np
import pytest

from tactopose_drake import errors


@pytest.mark.parametrize(
    "error",
    [
        errors.UnknownNameError("method", "newton", ["pair_search", "direct"]),
        errors.EndOfLogError("the log ends", whole=False),
        errors.BusError("no bus"),
        errors.InvalidInputError("seed must be an integer >= 0, not -1."),
    ],
)
def test_an_error_is_pickled_with_all_that_it_says(error: errors.TactoposeError) -> None:
    error.add_note("This is of contacts[3].")
    for again in (pickle.loads(pickle.dumps(error)), copy.copy(error)):
        assert type(again) is type(error)
        assert (str(again), again.args, vars(again)) == (str(error), error.args, vars(error))


@pytest.mark.parametrize(
    ("value", "says"),
    [
        ("newton", "'newton'"),
        ("newton\n" * 2, r"'newton\nnewton\n'"),
        ("x" * 10_000, f"'{'x' * 59}..."),
        (np.eye(2), "array([[1., 0.], [0., 1.]])"),
        (np.eye(9), "an ndarray"),
        pytest.param(10**5000, "an int", id="digits"),
    ],
)
def test_values_are_shown_in_one_short_line(value: object, says: str) -> None:
    assert errors.shown(value) == says
    assert str(errors.UnknownNameError("method", value, ["direct"])) == (f"method must be one of direct, not {says}.")
