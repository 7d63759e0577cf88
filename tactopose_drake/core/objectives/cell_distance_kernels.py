"""The distances of a pad's active cells from the surface's points, compiled."""

import numpy as np

from tactopose_drake.core.compilation import kernel
from tactopose_drake.core.kernel_types import Floats2, Floats3, Longs1, OutFloats2
from tactopose_drake.core.kernels.pose_kernels import to_object
from tactopose_drake.core.shape.point_grid_kernels import Cloud, nearest_square


@kernel
def pad_costs(
    cloud: Cloud,
    cells: Floats2,
    ends: Longs1,
    X_PO: Floats3,
    costs: OutFloats2,
) -> None:
    """Fills costs (B, k) with the mean squared distance of cells ends[k] to before ends[k + 1] to the cloud, m^2."""
    q = np.empty(3)
    for b in range(X_PO.shape[0]):
        for k in range(costs.shape[1]):
            total = 0.0
            for i in range(ends[k], ends[k + 1]):
                to_object(X_PO[b], cells[i], q)
                total += nearest_square(cloud, q[0], q[1], q[2])
            costs[b, k] = total / (ends[k + 1] - ends[k])
