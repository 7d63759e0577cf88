"""The spheres that fill the hand, in neighbourhoods, as kernels read them."""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import kernel, read_only
from tactopose_drake.core.kernel_types import Floats1, Floats2, Longs1, OutFlags1, OutFloats1, OutLongs1, Singles3


class Spheres(NamedTuple):
    """The hand's spheres in neighbourhoods, read-only: neighbourhood g is start[g]:start[g + 1].

    Attributes:
        p: centres in P, shape (h, 3), m.
        radius: shape (h,), m.
        reach: no sphere of a neighbourhood, from this one on, reaches further from the centre of its first, shape (h,),
            m.
        start: shape (g + 1,).
        leaders: coordinates of the centres of neighbourhoods' firsts, and their reach, shape (4, g), m.
        allowed: how deep each neighbourhood may be in the object, shape (g,), m.
        weight: by which what is beyond that counts, shape (g,), 1/m.
        coarse: the object's distances at each fourth node of its grid, see `DistanceGrid.coarse_distances`.
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
"""What kernels read where the hand's volume is not known."""


@kernel
def gather_neighbourhoods(
    p: Floats2, order: Longs1, width: float, group: OutLongs1, distance: OutFloats1, leads: OutFlags1
) -> None:
    """Parts points (h, 3) into groups (h,): the next in the order that is left takes all that are left within a width.

    Such a one leads (h,) its group; distances (h,) are from there.
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
