"""What the tests of patches share."""

import numpy as np

from tactopose_drake.core.poses import make_poses, random_rotations
from tactopose_drake.core.sensing.patches import Patch, describe_patch
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.synthetic.synthetic_patch import touch_with_pads

NOISE = {"sigma_depth": 0.0004, "share": 0.15, "sigma_position": 0.0011, "sigma_rotation": 0.07}
ALPHA = 1e-7
IDENTITY = np.eye(3, 4)[None]
OUT = np.tile([0.0, 0.0, 1.0], (24, 1))


def random_pose(seed: int) -> np.ndarray:
    generator = np.random.default_rng(seed)
    return make_poses(random_rotations(generator, 1), generator.normal(size=(1, 3)) * 0.02)[0]


def pads_on(model: ObjectModel, seed: int, count: int = 3) -> tuple[np.ndarray, list[Patch]]:
    """A pose and pads that touch there, with some cells that feel nothing, some dead and some saturated."""
    X_PO, generator = random_pose(seed), np.random.default_rng(seed)
    patches = []
    for patch in touch_with_pads(model, X_PO, count, generator, depth=0.0008):
        pressure = patch.pressure.copy()
        pressure[generator.integers(24, size=3)] = np.nan
        limits = {"threshold": 1500.0, "saturation": float(np.nanquantile(pressure, 0.9)) + 1e3}
        patches.append(describe_patch(patch.p_PT, pressure, alpha=patch.alpha, n_PT=patch.n_PT, **limits))
    return X_PO, patches
