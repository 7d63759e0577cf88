"""The cost of contacts on an object's coarse field at a given pose, as the pair search reckons it at proposed ones."""

import numpy as np

from tactopose_drake.core.searches.pairs.pair_lane_kernels import AXES, COST, LANES, SIZE, add_cost
from tactopose_drake.core.searches.pairs.pair_poses import kernel_field
from tactopose_drake.core.shape.coarse_field import CoarseField


def cost_at(field: CoarseField, table: np.ndarray, X_PO: np.ndarray) -> float:
    """Of a table (k, 8) of contacts, see `contact_table`, at a pose (3, 4)."""
    contacts, rows = table.astype(np.float32), np.zeros((SIZE // LANES, LANES), dtype=np.float32)
    contacts[:, :3] = (table[:, :3] - X_PO[:, 3]) / field.spacing
    rows[int(AXES) // LANES :, 0][:9] = X_PO[:, :3].ravel()
    w = rows.ravel()
    for contact in contacts:
        add_cost(kernel_field(field), contact, 1, w)
    return float(w[COST])
