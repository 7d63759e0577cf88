"""A small copy of the distance grid, to throw away bad poses at a few nanoseconds a contact.

Every few nodes one is kept, as four bytes, read without interpolation: a megabyte that stays in a core's own cache,
where the grid itself does not fit. Its error, about a third of a voxel, is small beside that of the poses it judges.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tactopose_drake.core.contacts import Contacts
from tactopose_drake.core.signed_distance import DistanceGrid
from tactopose_drake.core.validation import FloatArray

MAX_VOXELS = 250_000

_STEPS = 6.0
"""Steps of the distance in a voxel: it is told apart up to 127 steps, or 21 voxels."""


@dataclass(frozen=True, eq=False)
class CoarseField:
    """Distance and normal in cubic voxels.

    Attributes:
        values: shape (voxels, 4): distance in `step`, normal in 127ths.
        shape: number of voxels along x, y and z.
        origin: the first voxel's centre in O, shape (3,), m.
        spacing: m.
    """

    values: NDArray[np.int8]
    shape: tuple[int, int, int]
    origin: FloatArray
    spacing: float

    @property
    def step(self) -> float:
        """The unit of the distances, m."""
        return self.spacing / _STEPS


def coarsen(grid: DistanceGrid, max_voxels: int = MAX_VOXELS) -> CoarseField:
    """Takes every so many nodes of a grid that about `max_voxels` are left."""
    stride = max(1, round(float(np.cbrt(np.prod(grid.shape) / max_voxels))))
    offset = [((n - 1) % stride) // 2 for n in grid.shape]
    nodes = grid.values[offset[0] :: stride, offset[1] :: stride, offset[2] :: stride]
    spacing = stride * grid.spacing
    scale = np.array([_STEPS / spacing, 127.0, 127.0, 127.0], dtype=np.float32)
    values = np.rint(np.clip(nodes * scale, -127.0, 127.0)).astype(np.int8).reshape(-1, 4)
    values.setflags(write=False)
    nx, ny, nz = nodes.shape[:3]
    return CoarseField(values, (nx, ny, nz), grid.origin + grid.spacing * np.array(offset), spacing)


def contact_table(field: CoarseField, contacts: Contacts, sigma_position: float, sigma_normal: float) -> FloatArray:
    """What `coarse_cost` reads of each contact, shape (k, 8): point, normal, weights of their squared differences.

    The standard deviations say how far off the poses are that will be judged; the sensors' own and the voxels' are
    added.
    """
    table = np.zeros((len(contacts), 8))
    table[:, :3] = contacts.p_PC
    variance = np.asarray(contacts.sigma_position) ** 2 + sigma_position**2 + field.spacing**2 / 12.0
    table[:, 6] = field.step**2 / variance
    if contacts.n_PC is not None:
        table[:, 3:6] = contacts.n_PC
        table[:, 7] = 1.0 / (np.asarray(contacts.sigma_normal) ** 2 + sigma_normal**2)
    return table


@njit(cache=True, inline="always", error_model="numpy")
def coarse_cost(values, shape, origin, inverse_spacing, steps, table, X, limit):  # type: ignore[no-untyped-def]
    """Sum of the squared whitened differences at the pose X (3, 4), or some number beyond the limit.

    The contacts' `table` is that of `contact_table`; `steps` is how many steps of the distance are in a voxel.
    """
    nx, ny, nz = shape
    total = 0.0
    for m in range(table.shape[0]):
        x, y, z = table[m, 0] - X[0, 3], table[m, 1] - X[1, 3], table[m, 2] - X[2, 3]
        # Voxels from the first one's centre.
        u = (X[0, 0] * x + X[1, 0] * y + X[2, 0] * z - origin[0]) * inverse_spacing
        v = (X[0, 1] * x + X[1, 1] * y + X[2, 1] * z - origin[1]) * inverse_spacing
        w = (X[0, 2] * x + X[1, 2] * y + X[2, 2] * z - origin[2]) * inverse_spacing
        a, b, c = min(max(u, 0.0), nx - 1.0), min(max(v, 0.0), ny - 1.0), min(max(w, 0.0), nz - 1.0)
        at = np.uintp((int(a + 0.5) * ny + int(b + 0.5)) * nz + int(c + 0.5))
        d = float(values[at, 0])
        if u != a or v != b or w != c:
            d += steps * np.sqrt((u - a) ** 2 + (v - b) ** 2 + (w - c) ** 2)
        total += d * d * table[m, 6]
        if table[m, 7] > 0.0:
            n0, n1, n2 = table[m, 3], table[m, 4], table[m, 5]
            e = values[at, 1] / 127.0 - (X[0, 0] * n0 + X[1, 0] * n1 + X[2, 0] * n2)
            f = values[at, 2] / 127.0 - (X[0, 1] * n0 + X[1, 1] * n1 + X[2, 1] * n2)
            g = values[at, 3] / 127.0 - (X[0, 2] * n0 + X[1, 2] * n1 + X[2, 2] * n2)
            total += (e * e + f * f + g * g) * table[m, 7]
        if total > limit:
            break
    return total
