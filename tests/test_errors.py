"""The package's errors: what they say comes out of another process as it went in."""

import copy
import pickle

import pytest

from tactopose_drake import errors


@pytest.mark.parametrize(
    "error",
    [
        errors.UnknownNameError("method", "newton", ["pair_search", "direct"]),
        errors.EndOfLogError("the log ends", whole=False),
        errors.BusError("no bus"),
        errors.InvalidInputError("seed: is -1; allowed are whole numbers from 0."),
    ],
)
def test_an_error_is_pickled_with_all_that_it_says(error: errors.TactoposeError) -> None:
    error.add_note("This is of contacts[3].")
    for again in (pickle.loads(pickle.dumps(error)), copy.copy(error)):
        assert type(again) is type(error)
        assert (str(again), again.args, vars(again)) == (str(error), error.args, vars(error))
