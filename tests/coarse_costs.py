"""The cost of contacts on an object's coarse field at a given pose, as the pair search reckons it at proposed ones."""

import numpy as np

from tactopose_drake.core.searches.pairs.pair_pose_kernels import coarse_cost
from tactopose_drake.core.searches.pairs.pair_poses import kernel_field
from tactopose_drake.core.shape.coarse_field import CoarseField


def cost_at(field: CoarseField, table: np.ndarray, X_PO: np.ndarray) -> float:
    """Of a table (k, 8) of contacts, see `contact_table`, at a pose (3, 4)."""
    contacts = table.copy()
    contacts[:, :3] = (table[:, :3] - X_PO[:, 3]) / field.spacing
    x, y, z = (tuple(row) for row in X_PO[:, :3].tolist())
    return float(coarse_cost(kernel_field(field), contacts, (0.0, 0.0, 0.0), x, y, z, np.inf))
