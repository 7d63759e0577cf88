"""A small copy of the distance grid, with which bad poses are rejected at a few nanoseconds per contact.

It keeps every few nodes, as four bytes each, read without interpolation: a megabyte that fits into a core's own cache,
unlike the grid itself. Its error, about a third of a voxel, is small beside that of the poses it ranks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.shape.signed_distance import DistanceGrid
from tactopose_drake.core.validation import FloatArray


@dataclass(frozen=True, kw_only=True)
class CoarseFieldParams:
    """How small the copy is, and how it rounds."""

    max_voxels: int = 250_000  # approximately: a megabyte, which fits into a core's own cache
    steps: float = 6.0  # quantisation steps of the distance in a voxel: it saturates at 127 steps, or 21 voxels


@dataclass(frozen=True, eq=False)
class CoarseField:
    """Distance and normal in cubic voxels.

    Attributes:
        values: shape (voxels, 4): distance in `step`, normal in 127ths.
        shape: number of voxels along x, y and z.
        origin: the first voxel's centre in O, shape (3,), m.
        spacing: m.
        step: the unit of the distances, m.
    """

    values: NDArray[np.int8]
    shape: tuple[int, int, int]
    origin: FloatArray
    spacing: float
    step: float


def coarsen(grid: DistanceGrid, params: CoarseFieldParams = CoarseFieldParams()) -> CoarseField:
    """Subsamples a grid to about as many nodes as `params` say."""
    stride, offset = _every(grid.shape, params)
    nodes = grid.values[offset[0] :: stride, offset[1] :: stride, offset[2] :: stride]
    scale = np.array([params.steps / (stride * grid.spacing), 127.0, 127.0, 127.0], dtype=np.float32)
    values = np.rint(np.clip(nodes * scale, -127.0, 127.0)).astype(np.int8).reshape(-1, 4)
    values.setflags(write=False)
    return over_grid(grid, values, params)


def over_grid(
    grid: DistanceGrid, values: NDArray[np.int8], params: CoarseFieldParams = CoarseFieldParams()
) -> CoarseField:
    """The field with values (voxels, 4) that were taken from a grid."""
    stride, offset = _every(grid.shape, params)
    spacing, origin = stride * grid.spacing, grid.origin + grid.spacing * np.array(offset)
    origin.setflags(write=False)
    return CoarseField(values, coarse_shape(grid.shape, params), origin, spacing, spacing / params.steps)


def coarse_shape(shape: tuple[int, ...], params: CoarseFieldParams = CoarseFieldParams()) -> tuple[int, int, int]:
    """Number of voxels along x, y and z of the field for a grid with this number of nodes."""
    stride, offset = _every(shape, params)
    nx, ny, nz = (len(range(start, n, stride)) for start, n in zip(offset, shape, strict=True))
    return nx, ny, nz


def _every(shape: tuple[int, ...], params: CoarseFieldParams) -> tuple[int, list[int]]:
    """The stride with which nodes are kept, and the index of the first along each axis."""
    stride = max(1, round(math.cbrt(np.prod(shape) / params.max_voxels)))
    return stride, [((n - 1) % stride) // 2 for n in shape]
