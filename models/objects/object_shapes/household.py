"""Everyday objects that are boxes or that one profile describes.

Each function makes a closed mesh that stands on z = 0 with its long axis on z; lengths in m.
"""

import numpy as np
import trimesh
from numpy.typing import NDArray

from .boxes import rounded_box
from .lofts import loft, rounded_profile

Array = NDArray[np.float64]

SEGMENTS = 72  # around the axis: a divisor of every symmetry used here, and 0.03 mm off a round 33 mm radius


def cube() -> trimesh.Trimesh:
    """A toy block of 60 mm."""
    return rounded_box((0.06, 0.06, 0.06), 0.001, 0.005)


def tea_box() -> trimesh.Trimesh:
    """A carton of 20 tea bags; three different edges, so that half turns are its only symmetries."""
    return rounded_box((0.085, 0.062, 0.135), 0.001, 0.006)


def cylinder() -> trimesh.Trimesh:
    """A plain cylinder, 60 mm wide and 120 mm high."""
    corners = [(0, 0, 0), (0.03, 0, 0.001), (0.03, 0.12, 0.001), (0, 0.12, 0)]
    return loft(rounded_profile(corners, 0.006), SEGMENTS)


def soda_can() -> trimesh.Trimesh:
    """A 330 ml drinks can: domed bottom inside a standing ring, tapered neck, lid below the rim."""
    dome = [(r, 0.0105 - 7.0 * r**2, 0.0) for r in np.linspace(0, 0.021, 5)]
    corners = [
        *dome,
        (0.0232, 0.0, 0.0012),
        (0.0262, 0.0, 0.0012),
        (0.0331, 0.0095, 0.006),
        (0.0331, 0.1005, 0.008),
        (0.0263, 0.1105, 0.003),
        (0.0272, 0.115, 0.0008),
        (0.0252, 0.115, 0.0008),
        (0.0240, 0.1105, 0.0005),
        (0, 0.1110, 0),
    ]
    return loft(rounded_profile(corners, 0.004), SEGMENTS)


def wine_glass() -> trimesh.Trimesh:
    """A sturdy wine glass with an open bowl, its wall 2.6 mm and thicker towards the stem."""
    outside = [
        (0, 0, 0),
        (0.035, 0, 0.0012),
        (0.035, 0.003, 0.0012),
        (0.0085, 0.009, 0.02),
        (0.0043, 0.03, 0.03),
        (0.0043, 0.078, 0.02),
        (0.0265, 0.0935, 0.02),
        (0.0395, 0.122, 0.035),
        (0.0335, 0.180, 0.001),
    ]
    inside = [
        (0.0309, 0.180, 0.001),
        (0.0366, 0.1225, 0.033),
        (0.0245, 0.0965, 0.018),
        (0, 0.086, 0),
    ]
    return loft(rounded_profile(outside + inside, 0.004), SEGMENTS)
