"""The spheres that fill the hand, grouped into neighbourhoods, as kernels read them."""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import kernel, read_only
from tactopose_drake.core.kernel_types import Floats1, Floats2, Longs1, OutFlags1, OutFloats1, OutLongs1, Singles3


class Spheres(NamedTuple):
    """The hand's spheres by neighbourhoods, read-only: neighbourhood g is start[g]:start[g + 1].

    Attributes:
        p: centres in P, shape (h, 3), m.
        radius: shape (h,), m.
        reach: none of the spheres from this one to the neighbourhood's last reaches further than this from the centre
            of the neighbourhood's first, shape (h,), m.
        start: the first sphere of each neighbourhood, and one past the last, shape (g + 1,).
        leaders: x, y and z of the centre of each neighbourhood's first sphere, and its reach, shape (4, g), m.
        allowed: permitted penetration of each neighbourhood, shape (g,), m.
        weight: of the penetration beyond that, shape (g,), 1/m.
        coarse: the object's distances at every fourth node of its grid, see `DistanceGrid.coarse_distances`.
    """

    p: Floats2
    radius: Floats1
    reach: Floats1
    start: Longs1
    leaders: Floats2
    allowed: Floats1
    weight: Floats1
    coarse: Singles3


_NO_NUMBERS = read_only(np.empty(0))
NO_SPHERES = Spheres(
    read_only(np.empty((0, 3))),
    _NO_NUMBERS,
    _NO_NUMBERS,
    read_only(np.zeros(1, dtype=np.int64)),
    read_only(np.empty((4, 0))),
    _NO_NUMBERS,
    _NO_NUMBERS,
    read_only(np.empty((0, 0, 0), dtype=np.float32)),
)
"""Stands for the hand where its volume is unknown."""


@kernel
def gather_neighbourhoods(
    p: Floats2, order: Longs1, width: float, group: OutLongs1, distance: OutFloats1, leads: OutFlags1
) -> None:
    """Partitions points (h, 3) into groups (h,): each point in the order that is not in one yet leads a new group.

    The group takes all ungrouped points within `width` of its leader. Writes the distances (h,) from the leaders, and
    who leads (h,).
    """
    group[:] = -1
    leads[:] = False
    count = 0
    for seed in order:
        if group[seed] >= 0:
            continue
        leads[seed] = True
        for i in range(p.shape[0]):
            if group[i] < 0:
                dx, dy, dz = p[i, 0] - p[seed, 0], p[i, 1] - p[seed, 1], p[i, 2] - p[seed, 2]
                d = np.sqrt(dx * dx + dy * dy + dz * dz)
                if d <= width:
                    group[i], distance[i] = count, d
        count += 1
