"""Quantiles of the chi-square distribution.

SciPy has them too, but loading its special functions takes longer than a hundred estimates.

Source: [NR] W. H. Press et al., Numerical Recipes, 3rd edition, 2007, section 6.2 (the series, and Lentz's continued
fraction).
"""

import functools
import math
from statistics import NormalDist

_ROUNDING = 1e-15  # relative tolerance of the series, the continued fraction and Newton's steps


@functools.lru_cache
def chi_square_limit(freedom: int, chance: float) -> float:
    """The quantile that a chi-square variable with `freedom` degrees of freedom exceeds with probability `chance`.

    The chance is above 0 and below 1. Newton's method on its logarithm, started at Wilson and Hilferty's approximation.
    """
    share = 2.0 / (9.0 * freedom)
    root = 1.0 - share - NormalDist().inv_cdf(chance) * math.sqrt(share)
    limit = freedom * max(root, 0.1) ** 3
    for _ in range(50):
        # The incomplete gamma functions over the density's scale, kept as a logarithm: it is tiny far out.
        a, x = 0.5 * freedom, 0.5 * limit
        log_scale = a * math.log(x) - x - math.lgamma(a)
        is_upper = x > a + 1.0
        log_tail = (
            log_scale + math.log(_fraction(a, x)) if is_upper else math.log1p(-math.exp(log_scale) * _series(a, x))
        )
        step = (log_tail - math.log(chance)) * math.exp(log_tail - log_scale) * limit
        limit = max(limit + step, 0.5 * limit)
        if abs(step) <= 4.0 * _ROUNDING * limit:
            break
    return limit


def _series(a: float, x: float) -> float:
    """The lower incomplete gamma function over x^a exp(-x), for x up to a + 1, by its series."""
    value = term = 1.0 / a
    n = 0
    while term > _ROUNDING * value:
        n += 1
        term *= x / (a + n)
        value += term
    return value


def _fraction(a: float, x: float) -> float:
    """The upper incomplete gamma function over x^a exp(-x), for x above a + 1, by Lentz's continued fraction."""
    tiny = 1e-300
    b = x + 1.0 - a
    c, d = 1.0 / tiny, 1.0 / b
    value = d
    for i in range(1, 10_000):
        product = -i * (i - a)
        b += 2.0
        d = product * d + b
        d = 1.0 / (d if abs(d) > tiny else tiny)
        c = b + product / c
        c = c if abs(c) > tiny else tiny
        value *= d * c
        if abs(d * c - 1.0) <= _ROUNDING:
            break
    return value
