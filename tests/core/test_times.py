"""Periods that end at a time, by clocks of different zero."""

import pytest

from tactopose_drake.core.times import has_exceeded, has_passed


@pytest.mark.parametrize("zero", [0.0, 2.0**20 + 0.1, 1.7e9, -1.7e9])
def test_a_period_is_as_long_by_every_clock(zero: float) -> None:
    for count in range(1000):
        now, period = zero + 0.01 * count, 0.01 * count
        assert has_passed(now, zero, period)
        assert not has_exceeded(now, zero, period)
        assert not has_passed(now, zero, period + 0.01)
        assert has_exceeded(now, zero, period - 0.01)
