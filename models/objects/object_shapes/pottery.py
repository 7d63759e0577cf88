"""A mug with a handle, sculpted as a distance field. It stands on z = 0; lengths in m."""

import numpy as np
import trimesh
from numpy.typing import NDArray

from .fields import disc, smooth_cut, smooth_union, tube
from .sculpting import sculpt

Array = NDArray[np.float64]


def _mug_field(p: Array) -> Array:
    turn = np.linspace(-np.pi / 2, np.pi / 2, 25)
    reach = 0.036 + 0.034 * np.maximum(np.cos(turn), 0.0) ** 0.8
    handle = np.stack([reach, np.zeros_like(turn), 0.05 + 0.029 * np.sin(turn)], axis=-1)
    outside = smooth_union(disc(p, 0.041, 0.0, 0.095, 0.002), tube(p, handle, 0.0055), 0.006)
    return smooth_cut(outside, disc(p, 0.0365, 0.006, 0.14, 0.004), 0.003)


def mug() -> trimesh.Trimesh:
    """A coffee mug, hollow, its handle in the plane y = 0 towards +x."""
    return sculpt(_mug_field, [[-0.044, -0.044, -0.003], [0.08, 0.044, 0.099]], 0.0015, 8e-5, (0.0012, 0.006))
