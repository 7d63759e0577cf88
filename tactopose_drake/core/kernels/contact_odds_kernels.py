"""The odds that contacts are false, relative to contacts as told, compiled; see `contact_mixture_kernels`."""

from typing import NamedTuple

from tactopose_drake.core.compilation import kernel
from tactopose_drake.core.kernel_types import Floats1, Floats2, OutFloats1, OutFloats3

# Keeps the density of other objects' contacts above 0, so that its logarithm is finite.
_LEAST_DENSITY = 1e-250


class Measured(NamedTuple):
    """What the odds of the kinds of k contacts depend on, read-only.

    Attributes:
        sigma_p, sigma_n: standard deviations of points and normals, shape (k,), m and rad.
        shares: `KindShares` of independently false contacts and of the single one, shape (6, 2).
        per_sigma: the density of a point anywhere over that of one as told, by the latter's standard deviation, 1/m.
        most_p, most_n: the largest standard deviations of contacts that are lost, m and rad.
        displacement: standard deviation of the displacement of those that are displaced, m.
        has_normals: whether there are normals.
    """

    sigma_p: Floats1
    sigma_n: Floats1
    shares: Floats2
    per_sigma: float
    most_p: float
    most_n: float
    displacement: float
    has_normals: bool


@kernel
def find_odds(measured: Measured, odds: OutFloats3, closeness: OutFloats1, exact: OutFloats1) -> None:
    """Writes the four rows of odds, and the closeness, of `Doubts`, shapes (4, 2, k) and (k,).

    And each contact's probability to be as told if all contacts lie exactly on the surface, shape (k,).
    """
    shares, per_sigma, together = measured.shares, measured.per_sigma, 1.0
    for i in range(closeness.shape[0]):
        # The density of a contact as told is uniform by area and Gaussian across the surface; that of one with
        # something else is uniform by volume. That of a normal as told is Gaussian on the sphere; of any, uniform.
        sigma_p, sigma_n = measured.sigma_p[i], measured.sigma_n[i]
        any_point, any_normal, lost_normal = min(per_sigma * sigma_p, 1.0), 1.0, 1.0
        lost_point, displaced = min(any_point, per_sigma * measured.most_p), min(sigma_p / measured.displacement, 1.0)
        if measured.has_normals:
            any_normal = min(0.5 * sigma_n**2, 1.0)
            lost_normal = min(any_normal, 0.5 * measured.most_n**2)
        for c in range(2):
            odds[0, c, i] = shares[1, c] / shares[0, c]
            odds[1, c, i] = shares[2, c] * any_normal / shares[0, c]
            odds[2, c, i] = shares[3, c] * displaced / shares[0, c]
            other, lost = shares[4, c] * any_point * any_normal, shares[5, c] * lost_point * lost_normal
            odds[3, c, i] = (lost + other) / shares[0, c]
        odds[3, 0, i] = max(odds[3, 0, i], _LEAST_DENSITY)
        closeness[i] = displaced**2
        own = 1.0 + odds[1, 0, i] + odds[2, 0, i] + odds[3, 0, i]
        exact[i] = (odds[1, 1, i] + odds[2, 1, i] + odds[3, 1, i]) / own
        together += exact[i]
    for i in range(closeness.shape[0]):
        own = 1.0 + odds[1, 0, i] + odds[2, 0, i] + odds[3, 0, i]
        exact[i] = (together - exact[i]) / (own * together)
