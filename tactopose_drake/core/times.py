"""Comparisons of times that do not depend on their rounding, and so not on what a clock shows."""

TIME_ROUNDING = 1e-6
"""Times that differ by less, s, are the same: clocks that count since 1970 are rounded to a quarter of that."""


def has_passed(now: float, since: float, period: float) -> bool:
    """Whether at least a period, s, has passed since a time."""
    return now > since + period - TIME_ROUNDING


def has_exceeded(now: float, since: float, period: float) -> bool:
    """Whether more than a period, s, has passed since a time."""
    return now > since + period + TIME_ROUNDING
