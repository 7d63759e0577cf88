"""The distances of a pad's felt cells from the surface's points."""

import numpy as np
from numba import njit

from tactopose_drake.core.kernels.pose_kernels import to_object
from tactopose_drake.core.shape.point_grid_kernels import nearest_square


@njit(cache=True, nogil=True, error_model="numpy")
def pad_costs(points, starts, seeds, origin, spacing, cells, ends, X_PO, costs):  # type: ignore[no-untyped-def]
    """Mean squared distance of the cells ends[k] to ends[k + 1] to the cloud, m^2, into costs (B, k)."""
    q = np.empty(3)
    for b in range(X_PO.shape[0]):
        for k in range(costs.shape[1]):
            total = 0.0
            for i in range(ends[k], ends[k + 1]):
                to_object(X_PO[b], cells[i], q)
                total += nearest_square(points, starts, seeds, origin, spacing, q[0], q[1], q[2])
            costs[b, k] = total / (ends[k + 1] - ends[k])
