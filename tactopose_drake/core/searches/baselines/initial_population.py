"""The first particles of the Monte Carlo search: rows (q, t), see `roulette_kernels.py`.

Uniform and normal numbers come from a `numpy.random.Generator`, in place of rand() and the Box-Muller transform.

Source: [B16] J. Bimbo, thesis, 2016, section 4.2.3; [M72] G. Marsaglia, Choosing a point from the surface of a sphere,
Ann. Math. Stat., 1972.
"""

import itertools

import numpy as np

from tactopose_drake.core.validation import FloatArray

_STRAIGHT_SHARE = 0.3


def near_particles(generator: np.random.Generator, count: int, rotation: float, translation: float) -> FloatArray:
    """Particles normally distributed about the first guess, shape (count, 7). [B16] eqs. 4.4 and 4.5.

    Args:
        generator: of the random numbers.
        count: of particles.
        rotation: ss_r, of the quaternion's elements; half of a small angle.
        translation: ss_t, m.
    """
    r = generator.normal(size=(count, 7))
    q = np.column_stack([1.0 - r[:, 0] * rotation, r[:, 1:4] * rotation])
    return np.column_stack([q / np.linalg.norm(q, axis=1, keepdims=True), r[:, 4:] * translation])


def scattered_particles(generator: np.random.Generator, count: int, translation: float) -> FloatArray:
    """Particles with uniform translations in the cube of half side `translation` (ss_t, m), shape (count, 7).

    The first 30 % have axis-aligned orientations, the others uniformly random ones.
    """
    straight = straight_quaternions()
    first = straight[generator.integers(len(straight), size=round(_STRAIGHT_SHARE * count))]
    q = np.concatenate([first, uniform_quaternions(generator, count - len(first))])
    return np.column_stack([q, generator.uniform(-translation, translation, size=(count, 3))])


def straight_quaternions() -> FloatArray:
    """Axis-aligned ones, with one or two equal elements: turns by 0, 90 and 180 degrees, shape (10, 4)."""
    q = np.zeros((10, 4))
    chosen = [(i,) for i in range(4)] + list(itertools.combinations(range(4), 2))
    for row, elements in zip(q, chosen, strict=True):
        row[list(elements)] = 1.0 / np.sqrt(len(elements))
    return q


def uniform_quaternions(generator: np.random.Generator, count: int) -> FloatArray:
    """Uniformly random unit quaternions, shape (count, 4). [B16] eqs. 4.6 to 4.8, [M72]."""
    first, second = _in_unit_disk(generator, count), _in_unit_disk(generator, count)
    s_1, s_2 = np.sum(first**2, axis=1), np.sum(second**2, axis=1)
    return np.column_stack([first, np.sqrt((1.0 - s_1) / s_2)[:, None] * second])


def _in_unit_disk(generator: np.random.Generator, count: int) -> FloatArray:
    """Uniformly random points within the unit circle, shape (count, 2), by rejection sampling from the square."""
    points = np.empty((0, 2))
    while len(points) < count:
        drawn = generator.uniform(-1.0, 1.0, size=(2 * (count - len(points)), 2))
        points = np.concatenate([points, drawn[np.sum(drawn**2, axis=1) < 1.0]])
    return points[:count]
