import hypothesis
import numpy as np
from hypothesis import strategies as st

from tactopose_drake.core.kernels.sorting_kernels import copy_matrix, copy_vector, select, sort_stably

# Few different numbers, so that many are equal.
numbers = st.lists(st.sampled_from([-np.inf, -2.5, 0.0, 1.0, 1.5, 3.0, np.inf]) | st.floats(-1e3, 1e3), max_size=70)


@hypothesis.given(numbers)
def test_the_order_is_numpys_stable_one(values: list[float]) -> None:
    array = np.array(values, dtype=np.float64)
    order, spare = np.empty(len(array), dtype=np.int64), np.empty(len(array), dtype=np.int64)
    sort_stably(array, order, spare)
    np.testing.assert_array_equal(order, np.argsort(array, kind="stable"))


@hypothesis.given(numbers.filter(len), st.data())
def test_a_rank_is_that_of_the_sorted_numbers(values: list[float], data: st.DataObject) -> None:
    array = np.array(values, dtype=np.float32)
    count = data.draw(st.integers(1, len(array)))
    rank = data.draw(st.integers(0, count - 1))
    expected, rest = np.sort(array[:count])[rank], array[count:].copy()
    assert select(array, count, rank) == expected
    np.testing.assert_array_equal(array[count:], rest)


def test_copies_are_whole_and_leave_what_is_beyond() -> None:
    source, target = np.arange(12.0).reshape(3, 4), np.full((4, 4), -1.0)
    copy_matrix(source, target[:3])
    np.testing.assert_array_equal(target, [*source, [-1.0] * 4])
    copy_vector(source[0], target[3])
    np.testing.assert_array_equal(target[3], source[0])
