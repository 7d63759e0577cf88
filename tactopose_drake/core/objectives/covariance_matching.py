"""Patches against the covariance of the object's points that lie in front of the pads: the thesis' objective.

Source: [B16] J. Bimbo, thesis, 2016, section 5.2.4, eq. 5.8, and algorithm 5.2.
"""

from collections.abc import Sequence

import numpy as np

from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.geometry_checks import pose_batch
from tactopose_drake.core.objectives.covariance_kernels import FeltPads, pad_costs
from tactopose_drake.core.objectives.finite_differences import DifferencedObjective
from tactopose_drake.core.sensing.patches import Patch
from tactopose_drake.core.sensing.sensing_range import sensing_box
from tactopose_drake.core.shape.point_grid import PointGrid
from tactopose_drake.core.validation import FloatArray, positive_number


class CovarianceMatching(DifferencedObjective):
    """[B16] algorithm 5.2: for each pad that feels the object, how the points in front of it differ from the patch.

    With s the points of the cloud in the pad's sensing box, d the distance from the patch's centroid to the cloud, and
    Λ the patch's covariance in its eigenbasis, a pad costs, in metres,

    - |mean s - centroid| + h3 |cov s - Λ| + h2 (sum of the depths of s below the finger's stiff core) where the box
      holds more than three points and d is within the gate;
    - h1 d + h3 |Λ| elsewhere.

    The norm is the same in every frame, so covariances are compared in the pad's. A singular covariance, of two active
    cells or a row, is compared as it is; of one cell there is none, and its term is left out; a pad that feels nothing
    costs nothing. The listing's errors are corrected so: line 9 stands before its loop; line 22 adds, as line 19 does;
    the mean of line 17 is its norm, as in the text. The residuals are the square roots of twice the pads' costs.
    """

    def __init__(
        self,
        cloud: PointGrid,
        patches: Sequence[Patch],
        *,
        thickness: float = 0.002,
        height: float = 0.003,
        gate: float = 0.03,
        h1: float = 2.0,
        h2: float = 0.1,
        h3: float = 1000.0,
    ) -> None:
        """Places a sensing box on each pad.

        Args:
            cloud: the object's points.
            patches: what the pads feel, in P.
            thickness: of the pads' soft layer, m.
            height: of the sensing box above the pad, m.
            gate: the largest distance at which patches are compared, m. [B16]: 30 mm.
            h1: weight of the distance if there is no patch to compare.
            h2: weight of each point's depth below the finger's core.
            h3: weight of the covariance, 1/m.

        Raises:
            InvalidInputError: a number out of range, or a pad of one cell.
        """
        felt = [patch for patch in patches if patch.is_felt]
        boxes = [sensing_box(patch, thickness=thickness, height=height) for patch in felt]
        rotations = np.array([box.X_PB[:, :3] for box in boxes]).reshape(-1, 3, 3)
        centroids = np.array([patch.centroid for patch in felt]).reshape(-1, 3)
        covariances = np.array([patch.covariance for patch in felt]).reshape(-1, 3, 3)
        weights = np.array(
            [
                positive_number("gate", gate),
                positive_number("h1", h1),
                positive_number("h2", h2, allow_zero=True),
                positive_number("h3", h3, allow_zero=True),
            ]
        )
        self._arguments = (
            cloud.kernel_view,
            FeltPads(
                read_only(np.array([box.X_PB for box in boxes]).reshape(-1, 3, 4)),
                read_only(np.array([box.lower for box in boxes]).reshape(-1, 3)),
                read_only(np.array([box.upper for box in boxes]).reshape(-1, 3)),
                read_only(centroids),
                read_only(np.swapaxes(rotations, 1, 2) @ covariances @ rotations),
            ),
            weights,
        )
        self._count = len(felt)

    def residuals(self, X_PO: FloatArray) -> FloatArray:
        """Residuals (B, k) of poses (B, 3, 4), with k pads that feel the object."""
        costs = np.empty((len(X_PO), self._count))
        pad_costs(*self._arguments, pose_batch(X_PO), costs)
        return np.sqrt(2.0 * costs)
