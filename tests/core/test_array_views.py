"""Arrays in compiled code: they are what NumPy's are, and other code's arrays stay numba's."""

from typing import NamedTuple

import numba
import numpy as np
import pytest
from numba.core import types
from numba.core.codegen import JITCodeLibrary

from tactopose_drake.core.array_views import Fields, View, borrowed
from tactopose_drake.core.compilation import Floats2, Floats3, Longs1, OutFloats1, OutFloats3, kernel


class Pair(NamedTuple):
    values: OutFloats3
    scale: float


def read(a: Floats3, at: Longs1, out: OutFloats1) -> int:
    i, j, k = at
    row, local = a[i, j], np.empty((2, 3))
    for m in range(6):
        local[m // 3, m % 3] = 10.0 * m
    out[0] = a[i, j, k]
    out[1] = a[-1, -2, k - 4]
    out[2] = a[i][j][k]
    out[3] = row[len(row) - 1] + row.size
    out[4] = a.reshape(-1)[7]
    out[5] = local[-1, 1] + local[0, at[0]]
    total = 0.0
    for number in row[1:3]:
        total += number
    out[-1] = total
    return a.shape[1]


def write(pair: Pair) -> None:
    values = pair.values
    values[0, 1, 2] = pair.scale
    values[-1, 0][-1] = 2.0 * pair.scale
    values[1] = 3.0
    values[0, 0, :2] = values[1, 1, :2]


def test_they_are_read_as_elsewhere() -> None:
    a = np.random.default_rng(0).normal(size=(2, 3, 4))
    expected, found = np.zeros(8), np.zeros(8)
    at = np.array([1, 2, 3])
    assert kernel(read)(a, at, found) == read(a, at, expected) == 3
    np.testing.assert_array_equal(found, expected)


def test_they_are_written_as_elsewhere() -> None:
    expected, found = np.zeros((3, 2, 4)), np.zeros((3, 2, 4))
    write(Pair(expected, 7.0))
    kernel(write)(Pair(found, 7.0))
    np.testing.assert_array_equal(found, expected)
    assert found[2, 0, 3] == 14.0


def test_what_is_read_cannot_be_written() -> None:
    def spoil(a: Floats2) -> None:
        a[0, 0] = 1.0

    with pytest.raises(numba.TypingError, match="readonly"):
        kernel(spoil)(np.zeros((2, 2)))


def test_one_version_serves_all_arrays() -> None:
    numbers = types.Array(types.float64, 2, "C")
    assert borrowed(numbers) == View(types.float64, 2, readonly=False)
    assert borrowed(types.Array(types.float64, 2, "C", readonly=True)) == View(types.float64, 2, readonly=True)
    assert borrowed(types.Array(types.float64, 2, "F")) == types.Array(types.float64, 2, "F")
    assert borrowed(types.NamedTuple([numbers, types.float64], Pair)) == Fields(
        [View(types.float64, 2, readonly=False), types.float64], Pair
    )


def test_code_of_others_is_compiled_as_ever() -> None:
    first = numba.njit(lambda a: a[0])
    assert first(np.arange(3.0)) == 0.0
    (compiled,) = first.overloads.values()
    assert type(compiled.library) is JITCodeLibrary
    assert type(compiled.signature.args[0]) is types.Array
