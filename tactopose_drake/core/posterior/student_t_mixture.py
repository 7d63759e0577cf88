"""A mixture of Student-t densities over poses: the proposal of importance sampling.

Their tails are heavier than a Gaussian's, so no sample is so unlikely that its weight dominates. Components come in
groups; all of a group are densities over the increments (w, v) from the same pose, so that a sample is compared with
all of them by one logarithm.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.posterior import student_t_density_kernels, student_t_kernels
from tactopose_drake.core.validation import FloatArray


@dataclass(frozen=True, eq=False)
class StudentTMixture:
    """Student-t densities with the same degrees of freedom.

    Attributes:
        X_PO: the groups' poses, shape (g, 3, 4).
        group: which group each component belongs to, rising, shape (J,).
        center: the components' centres, increments from their groups' poses, shape (J, 6).
        information: the inverses of their scale matrices, over the same increments, shape (J, 6, 6).
        turns: the increments that change nothing, shape (J, 6, c). The densities are then over the other 6 - c
            dimensions.
        count: number of samples drawn of each, shape (J,), at least one: proportional to its mixture weight.
        freedom: the densities' degrees of freedom.
        farthest: squared Mahalanobis distance beyond which a pose does not belong to a component.
    """

    X_PO: FloatArray
    group: NDArray[np.intp]
    center: FloatArray
    information: FloatArray
    turns: FloatArray
    count: NDArray[np.intp]
    freedom: int
    farthest: float

    def sample(self, generator: np.random.Generator) -> FloatArray:
        """Draws poses, shape (count.sum(), 3, 4), in antithetic pairs within each component.

        The odd part about a component's centre cancels in means over the pairs. All groups use the same random numbers,
        so their order does not matter, and shares of similar groups are less noisy.
        """
        most = int(np.bincount(self.group, self.count).max())
        white = generator.standard_normal((most, 6))
        white /= np.sqrt(generator.chisquare(self.freedom, size=(most, 1)) / self.freedom)
        return draw(self.X_PO, self.group, self.center, self.information, self.count, white, opposed=True)

    def add_to(self, density: FloatArray, X_PO: FloatArray) -> None:
        """Adds each group's density at poses (B, 3, 4) to density (B, g).

        Densities are with respect to the volume of poses (rotations as small turns measure them, and translations,
        rad^3 m^3), times the number of samples: those of several mixtures thus add up to that of all their samples.
        """
        power = self.freedom + 6 - self.turns.shape[2]
        student_t_density_kernels.add_densities(self._components, self.freedom, power, self.X_PO, X_PO, density)

    def joined(self, other: StudentTMixture) -> StudentTMixture:
        """Returns one mixture of the components of both, which are about the same poses."""
        order = np.concatenate([self.group, other.group]).argsort(kind="stable")
        group, center, information, turns, count = (
            np.concatenate([getattr(self, name), getattr(other, name)])[order]
            for name in ("group", "center", "information", "turns", "count")
        )
        return StudentTMixture(self.X_PO, group, center, information, turns, count, self.freedom, self.farthest)

    @functools.cached_property
    def _components(self) -> student_t_density_kernels.Components:
        """The components as the kernels read them."""
        g, n, freedom = len(self.X_PO), 6 - self.turns.shape[2], self.freedom
        power = 0.5 * (freedom + n)
        constant = math.lgamma(power) - math.lgamma(0.5 * freedom) - 0.5 * n * math.log(math.pi * freedom)
        prepared = student_t_kernels.Preparation(
            np.zeros(g + 1, dtype=np.intp), self.information.copy(), np.zeros(g), np.empty(len(self.group))
        )
        student_t_kernels.prepare(self.group, self.turns, self.center, self.count, constant, self.farthest, prepared)
        first, information, reach, scale = map(read_only, prepared)
        return student_t_density_kernels.Components(first, read_only(self.center), information, reach, scale)


def draw(
    X_group: FloatArray,
    group: NDArray[np.intp],
    center: FloatArray,
    information: FloatArray,
    count: NDArray[np.intp],
    white: FloatArray,
    *,
    opposed: bool,
) -> FloatArray:
    """Draws poses (B, 3, 4), `count` (J,) of each component, from the white increments (w, 6) that all groups share.

    If they are opposed, samples come in antithetic pairs; see `StudentTMixture.sample`.
    """
    X_PO = np.empty((int(count.sum()), 3, 4))
    student_t_kernels.draw(X_group, group, center, information, count, white, opposed, X_PO)
    return X_PO


def across_turns(information: FloatArray, turns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Projects the turns (J, 6, c) out of information (J, 6, 6).

    Returns:
        The information across the turns, shape (J, 6, 6), and the log determinants that remain, shape (J,).
    """
    across, logarithm = information.copy(), np.empty(len(information))
    student_t_kernels.leave_out(np.ascontiguousarray(turns), across, logarithm)
    return across, logarithm


def in_chart(
    X_group: FloatArray, group: NDArray[np.intp], X_PO: FloatArray, information: FloatArray, turns: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Expresses poses, and information and directions at them, in increments from their groups' poses.

    Args:
        X_group: the groups' poses, shape (g, 3, 4).
        group: which group each pose belongs to, shape (J,).
        X_PO: the poses, shape (J, 3, 4).
        information: by the increments at the poses, shape (J, 6, 6).
        turns: directions at the poses, shape (J, 6, c).

    Returns:
        The increments (J, 6), the information (J, 6, 6) and the directions (J, 6, c).
    """
    center, inside, moved = np.empty((len(X_PO), 6)), np.empty((len(X_PO), 6, 6)), turns.copy()
    student_t_kernels.enter_chart(X_group, group, X_PO, information, center, inside, moved)
    return center, inside, moved
