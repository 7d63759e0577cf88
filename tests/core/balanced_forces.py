"""Contact forces on an object at rest."""

import numpy as np

from tactopose_drake.core.poses import skew


def balanced_forces(f_PC: np.ndarray, p_PC: np.ndarray, center: np.ndarray, weight_P: np.ndarray) -> np.ndarray:
    """The forces on the fingertips (k, 3), nearest to the given ones, that carry a weight (3,) at a centre (3,)."""
    grasp = np.concatenate([np.hstack(list(skew(p_PC - center))), np.tile(np.eye(3), len(p_PC))])
    missing = grasp @ f_PC.ravel() - np.concatenate([np.zeros(3), weight_P])
    balanced: np.ndarray = f_PC - (np.linalg.pinv(grasp) @ missing).reshape(-1, 3)
    return balanced
