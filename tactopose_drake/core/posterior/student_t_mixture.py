"""A mixture of Student-t densities over poses: what a belief is sampled from.

Their tails are heavier than a Gaussian's, so that no sample that a Gaussian would hardly propose counts for all others.
The components come in groups; all of a group are over the increments (w, v) from one pose, so that a sample is compared
with all of them by one logarithm.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.posterior import student_t_kernels
from tactopose_drake.core.validation import FloatArray


class Increments(NamedTuple):
    """From the poses of groups to poses.

    Attributes:
        u: increments (w, v), shape (B, g, 6).
        volume: of increments over that of poses there, shape (B, g).
    """

    u: FloatArray
    volume: FloatArray


def find_increments(X_group: FloatArray, X_PO: FloatArray) -> Increments:
    """The increments from poses (g, 3, 4) to poses (B, 3, 4)."""
    shape = len(X_PO), len(X_group)
    increments = Increments(np.empty((*shape, 6)), np.empty(shape))
    student_t_kernels.find_increments(X_group, X_PO, *increments)
    return increments


@dataclass(frozen=True, eq=False)
class StudentTMixture:
    """Student-t densities, all of the same degrees of freedom.

    Attributes:
        X_PO: the groups' poses, shape (g, 3, 4).
        group: which group each component belongs to, rising, shape (J,).
        center: the components' middles, increments from their groups' poses, shape (J, 6).
        information: the inverses of their scale matrices, over the same increments, shape (J, 6, 6).
        turns: the increments that change nothing, shape (J, 6, c). The densities are then over the other 6 - c
            dimensions.
        count: how many samples are drawn of each, shape (J,), at least one: its share of the density is theirs.
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
        """Poses, shape (count.sum(), 3, 4), every second one of a component opposite to the one before it.

        Means over them are less noisy so: what is odd about a component's middle cancels. Groups have their random
        numbers in common: the groups' order does not matter, and of groups that are alike the shares are less noisy.
        """
        most = int(np.bincount(self.group, self.count).max())
        white = generator.standard_normal((most, 6))
        white /= np.sqrt(generator.chisquare(self.freedom, size=(most, 1)) / self.freedom)
        return draw(self.X_PO, self.group, self.center, self.information, self.count, white, opposed=True)

    def add_to(self, density: FloatArray, increments: Increments) -> None:
        """Adds to densities (B, g) of poses, by their increments from the groups' poses, each group's share of these.

        They are by the volume of poses (of rotations, as small turns measure it, and translations, rad^3 m^3), and
        times the number of the samples: so the densities of several mixtures add up to that of all their samples.
        """
        power = self.freedom + 6 - self.turns.shape[2]
        student_t_kernels.add_densities(self._components, self.freedom, power, *increments, density)

    @functools.cached_property
    def _components(self) -> student_t_kernels.Components:
        """The densities, as kernels read them."""
        g, n, freedom = len(self.X_PO), 6 - self.turns.shape[2], self.freedom
        power = 0.5 * (freedom + n)
        constant = math.lgamma(power) - math.lgamma(0.5 * freedom) - 0.5 * n * math.log(math.pi * freedom)
        prepared = student_t_kernels.Preparation(
            np.zeros(g + 1, dtype=np.intp), self.information.copy(), np.zeros(g), np.empty(len(self.group))
        )
        student_t_kernels.prepare(self.group, self.turns, self.center, self.count, constant, self.farthest, prepared)
        first, information, reach, scale = map(read_only, prepared)
        return student_t_kernels.Components(first, read_only(self.center), information, reach, scale)


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
    """Poses (B, 3, 4), so many (J,) of each component, from the white increments (w, 6) that all groups share.

    If they are opposed, every second one of a component is opposite to the one before it; see `StudentTMixture`.
    """
    X_PO = np.empty((int(count.sum()), 3, 4))
    student_t_kernels.draw(X_group, group, center, information, count, white, opposed, X_PO)
    return X_PO


def across_turns(information: FloatArray, turns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Information (J, 6, 6) over the directions across the turns (J, 6, c) alone, and the logarithms (J,) of what is
    left of its determinants.
    """
    across, logarithm = information.copy(), np.empty(len(information))
    student_t_kernels.leave_out(np.ascontiguousarray(turns), across, logarithm)
    return across, logarithm


def in_chart(
    X_group: FloatArray, group: NDArray[np.intp], X_PO: FloatArray, information: FloatArray, turns: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Poses, information and directions at them, as increments from their groups' poses and changes of those.

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
