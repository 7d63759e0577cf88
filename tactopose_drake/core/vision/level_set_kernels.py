"""Interpolation of a grid's values at single points, compiled."""

from tactopose_drake.core.compilation import kernel
from tactopose_drake.core.kernel_types import Floats3, Triple


@kernel
def depth_inside(values: Floats3, origin: Triple, spacing: float, x: float, y: float, z: float) -> float:
    """The negative of the grid's values, interpolated at a point: positive where they are negative.

    Beyond the grid its outermost cells are extrapolated.
    """
    at = (x - origin[0]) / spacing, (y - origin[1]) / spacing, (z - origin[2]) / spacing
    i = min(max(int(at[0]), 0), values.shape[0] - 2)
    j = min(max(int(at[1]), 0), values.shape[1] - 2)
    k = min(max(int(at[2]), 0), values.shape[2] - 2)
    u, v, w = at[0] - i, at[1] - j, at[2] - k
    total = 0.0
    for side in range(2):
        low = values[i + side, j, k] * (1.0 - w) + values[i + side, j, k + 1] * w
        high = values[i + side, j + 1, k] * (1.0 - w) + values[i + side, j + 1, k + 1] * w
        total -= (u if side else 1.0 - u) * (low * (1.0 - v) + high * v)
    return total
