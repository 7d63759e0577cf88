"""The compiled inner loops of the Monte Carlo search: weights, the roulette wheel, and the noise.

A particle is a row (q, t): a quaternion wxyz and a translation that move the object from the centre of the searched
space, R_PO = R_center R(q) and p_PO = p_center + t.

Source: [B16] J. Bimbo, thesis, 2016, sections 4.2.4 and 4.2.5.
"""

import numpy as np

from tactopose_drake.core.compilation import kernel, part
from tactopose_drake.core.kernel_types import Floats1, Floats2, OutFlags1, OutFloats1, OutFloats2, OutFloats3


@kernel
def weigh(
    cost: Floats1, scale: float, power: float, weight: OutFloats1, sums: OutFloats1, first: int, last: int
) -> None:
    """Weights of the costs from `first` to before `last`, and running sums of all weights; costs are over `scale`."""
    for j in range(first, last):
        weight[j] = (1.0 + 1.0 / (1.0 + max(cost[j], 0.0) / scale)) ** power  # [B16] eq. 4.9
        sums[j] = weight[j] + (sums[j - 1] if j > 0 else 0.0)


@part
def find_parent(sums: Floats1, count: int, mark: float) -> int:
    """The particle d of the first `count` at which the sum of weights from the end down to d first exceeds the mark.

    The thesis sums from the end, which takes half of all particles for each new one if all weigh about the same. Here
    bisection of the running sums finds the same particle.
    """
    before = sums[count - 1] - mark
    low, high = 0, count - 1
    while low < high:
        middle = (low + high + 1) // 2
        if sums[middle - 1] < before:
            low = middle
        else:
            high = middle - 1
    return low


@kernel
def breed(
    particles: OutFloats2,
    sums: Floats1,
    count: int,
    draws: Floats1,
    noise: Floats2,
    center: Floats2,
    X: OutFloats3,
) -> None:
    """Copies a parent for each draw, adds noise (m, 7), and appends it after the first `count`; fills their poses X."""
    for i in range(len(draws)):
        parent = find_parent(sums, count, draws[i] * sums[count - 1])
        child, length = particles[count + i], 0.0
        for a in range(7):
            child[a] = particles[parent, a] + noise[i, a]
            if a < 4:
                length += child[a] ** 2
        for a in range(4):
            child[a] /= np.sqrt(length)
    place(particles[count : count + len(draws)], center, X)


@kernel
def place(particles: Floats2, center: Floats2, X: OutFloats3) -> None:
    """Poses X (m, 3, 4) of particles (m, 7) relative to the centre (3, 4). [B16] eq. 2.19."""
    R = np.empty((3, 3))
    for b in range(len(particles)):
        w, x, y, z = particles[b, 0], particles[b, 1], particles[b, 2], particles[b, 3]
        R[0, 0], R[0, 1], R[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)
        R[1, 0], R[1, 1], R[1, 2] = 2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)
        R[2, 0], R[2, 1], R[2, 2] = 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)
        for i in range(3):
            for j in range(3):
                X[b, i, j] = center[i, 0] * R[0, j] + center[i, 1] * R[1, j] + center[i, 2] * R[2, j]
            X[b, i, 3] = center[i, 3] + particles[b, 4 + i]


@kernel
def mark_different(particles: Floats2, rotation: float, translation: float, different: OutFlags1) -> None:
    """Marks each particle that differs from all marked ones before it. [B16] section 4.2.7.

    Two differ if their quaternions (up to sign) or their translations are farther apart than the given distances.
    """
    for b in range(len(particles)):
        different[b] = True
        for a in range(b):
            if not different[a]:
                continue
            dot, square = 0.0, 0.0
            for c in range(4):
                dot += particles[a, c] * particles[b, c]
            for c in range(4, 7):
                square += (particles[a, c] - particles[b, c]) ** 2
            if 2.0 - 2.0 * abs(dot) < rotation**2 and square < translation**2:  # |q_a - q_b|^2 of unit quaternions
                different[b] = False
                break
