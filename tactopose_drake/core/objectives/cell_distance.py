"""Active cells against the nearest points of the object: the thesis' benchmark for tactile arrays, much like ICP's.

Source: [B16] J. Bimbo, thesis, 2016, algorithm 5.3.
"""

from collections.abc import Sequence

import numpy as np

from tactopose_drake.core.geometry_checks import pose_batch
from tactopose_drake.core.objectives.cell_distance_kernels import pad_costs
from tactopose_drake.core.objectives.finite_differences import DifferencedObjective
from tactopose_drake.core.sensing.patches import Patch
from tactopose_drake.core.shape.point_grid import PointGrid
from tactopose_drake.core.validation import FloatArray


class CellDistance(DifferencedObjective):
    """Mean squared distance of each pad's active cells to the cloud, summed over the pads, m^2. [B16] algorithm 5.3.

    A cell's point is where its pressure puts the object's surface. The listing's n counts the cells of one pad. The
    residuals are the square roots of twice the pads' costs; a pad that feels nothing costs nothing.
    """

    def __init__(self, cloud: PointGrid, patches: Sequence[Patch]) -> None:
        felt = [patch.points[patch.active] for patch in patches if patch.is_felt]
        cells = np.concatenate([np.empty((0, 3)), *felt])
        ends = np.cumsum([0, *(len(points) for points in felt)])
        self._arguments = (cloud.kernel_view, cells, ends)

    def residuals(self, X_PO: FloatArray) -> FloatArray:
        """Residuals (B, k) of poses (B, 3, 4), m, with k pads that feel the object."""
        costs = np.empty((len(X_PO), len(self._arguments[-1]) - 1))
        pad_costs(*self._arguments, pose_batch(X_PO), costs)
        return np.sqrt(2.0 * costs)
