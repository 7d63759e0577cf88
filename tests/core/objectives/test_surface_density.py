"""The exact likelihood of contacts at edges and corners of a box, where a closed form tells it."""

import math

import numpy as np

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.objectives.surface_density import SurfaceDensity
from tests.core.models import brick

HALF = np.array([0.03, 0.045, 0.065])


def by_areas(p: np.ndarray, sigma: float) -> float:
    """The Gaussian about a point, summed over a box's faces, over what a plane through it would give."""
    total = 0.0
    for axis in range(3):
        across = 1.0
        for other in {0, 1, 2} - {axis}:
            ends = (HALF[other] * np.array([1.0, -1.0]) - p[other]) / (math.sqrt(2.0) * sigma)
            across *= 0.5 * (math.erf(ends[0]) - math.erf(ends[1]))
        total += across * sum(math.exp(-0.5 * ((p[axis] - face) / sigma) ** 2) for face in (-HALF[axis], HALF[axis]))
    return total


def test_at_edges_it_is_as_exact_for_each_contact_whichever_others_there_are() -> None:
    """Each contact's discs are as fine as its own standard deviation needs, or finer."""
    generator, sigmas = np.random.default_rng(0), (0.0009, 0.003, 0.009)
    sigma = generator.choice(sigmas, size=900)
    p = generator.uniform(-HALF, HALF, (900, 3))
    for row, axis in enumerate(generator.integers(3, size=900)):
        for edge in (axis, (axis + 1) % 3):
            p[row, edge] = HALF[edge]
    p += 1.5 * sigma[:, None] * generator.normal(size=p.shape)
    expected = np.array([by_areas(*each) for each in zip(p, sigma, strict=True)])
    box = brick(*(2.0 * HALF).tolist())
    off = SurfaceDensity(box, Contacts(p, sigma_position=sigma)).densities(np.eye(3, 4)[None])[0] - expected
    for each in sigmas:
        assert np.sqrt(np.mean(off[sigma == each] ** 2)) < 0.04
