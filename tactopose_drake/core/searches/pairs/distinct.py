"""Thins out poses that nearly coincide."""

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.searches.pairs.distinct_kernels import mark_first_in_cell
from tactopose_drake.core.validation import FloatArray


def distinct_poses(X_PO: FloatArray, length: float, angle: float) -> NDArray[np.bool_]:
    """Marks the first of poses (B, 3, 4) in each cell of this size, m and about rad; shape (B,)."""
    distinct = np.empty(len(X_PO), dtype=np.bool_)
    mark_first_in_cell(X_PO, 1.0 / length, 1.0 / angle, distinct)
    return distinct
