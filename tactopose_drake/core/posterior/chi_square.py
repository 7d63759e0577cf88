"""Quantiles of the chi-square distribution.

SciPy has them too, but loading its special functions takes longer than a hundred estimates.

Source: [NR] W. H. Press et al., Numerical Recipes, 3rd edition, 2007, section 6.2 (Lentz's continued fraction).
"""

import math
from statistics import NormalDist

_ROUNDING = 1e-15  # relative: where the fraction, and Newton's steps, end


def chi_square_limit(freedom: int, chance: float) -> float:
    """What a chi-square variable of so many degrees of freedom exceeds by a chance, 0.05 at the most.

    Newton's method on the chance's logarithm, which is concave, from Wilson and Hilferty's approximation.
    """
    share = 2.0 / (9.0 * freedom)
    limit = max(freedom * (1.0 - share - NormalDist().inv_cdf(chance) * math.sqrt(share)) ** 3, freedom + 2.0)
    for _ in range(50):
        fraction = _fraction(0.5 * freedom, 0.5 * limit)
        # The upper tail is fraction * density * limit, which are taken as logarithms: both are very small far out.
        density = (0.5 * freedom - 1.0) * math.log(0.5 * limit) - 0.5 * limit - math.lgamma(0.5 * freedom)
        excess = density + math.log(0.5 * limit * fraction) - math.log(chance)
        step = excess * fraction * limit
        limit = max(limit + step, freedom + 2.0)
        if abs(step) <= 4.0 * _ROUNDING * limit:
            break
    return limit


def _fraction(a: float, x: float) -> float:
    """The upper incomplete gamma function over x^a exp(-x), for x above a + 1."""
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
