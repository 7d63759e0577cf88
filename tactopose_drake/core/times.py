"""Comparisons of times that do not depend on their rounding, and so not on what a clock shows."""

import math

TIME_ROUNDING = 1e-6
"""Times that differ by less, s, are the same: clocks that count since 1970 are rounded to a quarter of that."""


def has_passed(now: float, since: float, period: float) -> bool:
    """Whether at least a period, s, has passed since a time."""
    return now > since + period - TIME_ROUNDING


def has_exceeded(now: float, since: float, period: float) -> bool:
    """Whether more than a period, s, has passed since a time."""
    return now > since + period + TIME_ROUNDING


def offset_of_delayed(latency: float, period: float) -> float:
    """The offset, s, of periodic events that each come `latency` after one of the events at whole periods.

    Less than a period. If it is not 0, half the rounding is added: when another event stops Drake's clock at the same
    time up to rounding, Drake skips a periodic event with an offset.
    """
    offset = latency - period * math.floor(latency / period + 1e-6)
    return offset + 0.5 * TIME_ROUNDING if offset > 1e-6 * period else 0.0
