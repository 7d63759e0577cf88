"""Everyday objects that are boxes, or swept from one profile.

Each function makes a closed mesh that stands on z = 0 with its long axis on z; lengths in m.
"""

import numpy as np
import trimesh
from numpy.typing import NDArray

from .boxes import rounded_box
from .lofts import loft, rounded_profile

Array = NDArray[np.float64]

SEGMENTS = 72  # around the axis: a multiple of every symmetry used here; 0.03 mm from the circle at a radius of 33 mm


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


def thermal_bottle() -> trimesh.Trimesh:
    """A half-litre vacuum bottle with its cup screwed on over a narrow groove."""
    corners = [
        (0, 0.002, 0),
        (0.024, 0.002, 0.001),
        (0.026, 0, 0.001),
        (0.034, 0, 0.003),
        (0.034, 0.168, 0.02),
        (0.0255, 0.186, 0.003),
        (0.0255, 0.1885, 0.0008),
        (0.0275, 0.1885, 0.0008),
        (0.026, 0.235, 0.004),
        (0, 0.235, 0),
    ]
    return loft(rounded_profile(corners, 0.006), SEGMENTS)


def wine_glass() -> trimesh.Trimesh:
    """A sturdy wine glass with an open bowl, its wall 2.6 mm and thicker towards the stem."""
    outside = [
        (0, 0, 0),
        (0.035, 0, 0.0012),
        (0.035, 0.003, 0.0012),
        (0.0085, 0.008, 0.02),
        (0.0043, 0.03, 0.03),
        (0.0043, 0.080, 0.014),
        (0.0315, 0.090, 0.024),
        (0.0415, 0.128, 0.06),
        (0.0335, 0.180, 0.001),
    ]
    inside = [
        (0.0309, 0.180, 0.001),
        (0.0388, 0.1285, 0.0574),
        (0.0300, 0.095, 0.0214),
        (0, 0.0845, 0),
    ]
    return loft(rounded_profile(outside + inside, 0.005), SEGMENTS)


def light_bulb() -> trimesh.Trimesh:
    """A pear-shaped bulb on its E27 cap; the thread is drawn as rings, which keeps the bulb round."""
    thread_z = np.linspace(0.0085, 0.0265, 31)
    thread = np.stack([0.0127 - 0.00055 * np.cos((thread_z - 0.0085) * (2 * np.pi / 0.0036)), thread_z], axis=1)
    cap = [(0, 0), (0.0035, 0.0002), (0.0046, 0.0012), (0.0052, 0.0026), (0.0082, 0.0042), (0.0115, 0.0068)]
    collar = [(0.0134, 0.0275), (0.0138, 0.0285), (0.0138, 0.0315)]
    start = np.deg2rad(-35.0)
    globe_angle = np.linspace(start, np.pi / 2, 27)
    globe = np.stack([0.03 * np.cos(globe_angle), 0.078 + 0.03 * np.sin(globe_angle)], axis=1)
    globe[-1, 0] = 0.0
    neck = _hermite(
        np.array(collar[-1]), np.array([0, 0.02]), globe[0], 0.02 * np.array([-np.sin(start), np.cos(start)])
    )
    return loft(np.concatenate([cap, thread, collar, neck, globe]), SEGMENTS)


def _hermite(a: Array, slope_a: Array, b: Array, slope_b: Array) -> Array:
    """Points strictly between a and b on the cubic with these end slopes, shape (7, 2)."""
    t = np.linspace(0, 1, 9)[1:-1, None]
    return (
        (2 * t**3 - 3 * t**2 + 1) * a
        + (t**3 - 2 * t**2 + t) * slope_a
        + (3 * t**2 - 2 * t**3) * b
        + (t**3 - t**2) * slope_b
    )


def pencil() -> trimesh.Trimesh:
    """A sharpened hexagonal pencil; where the cone meets the flats it leaves the usual scallops."""
    z = np.concatenate([[0, 0], np.arange(0.0006, 0.148, 0.003), np.linspace(0.149, 0.1745, 33), [0.175, 0.175]])
    r = np.full_like(z, 0.00385)
    r[[0, -1]], r[1] = 0.0, 0.0035

    def hexagon_and_cone(theta: Array, r: Array, z: Array) -> Array:
        hexagon = 0.0035 / np.cos(np.mod(theta, np.pi / 3) - np.pi / 6)
        cone = 0.00045 + (0.175 - z) * (0.0036 / 0.022)
        return np.minimum(np.minimum(r, hexagon), cone)

    return loft(np.stack([r, z], axis=1), SEGMENTS, hexagon_and_cone)


def screwdriver() -> trimesh.Trimesh:
    """A screwdriver with a six-lobed handle below and a flat blade at the top."""
    corners = [
        (0, 0, 0),
        (0.0125, 0, 0.006),
        (0.0155, 0.02, 0.02),
        (0.0155, 0.075, 0.02),
        (0.0095, 0.09, 0.004),
        (0.0115, 0.098, 0.002),
        (0.0115, 0.104, 0.002),
        (0.003, 0.107, 0.001),
        (0.003, 0.222, 0),
        (0, 0.222, 0),
    ]

    def lobes_and_blade(theta: Array, r: Array, z: Array) -> Array:
        rise = np.clip(np.minimum(z - 0.008, 0.084 - z) / 0.012, 0.0, 1.0)
        lobed = r * (1 - 0.09 * rise * rise * (3 - 2 * rise) * (0.5 - 0.5 * np.cos(6 * theta)) ** 2)
        half_thickness = 0.0005 + 0.0027 * np.clip((0.219 - z) / 0.022, 0.0, 1.0)
        return np.minimum(lobed, np.where(z > 0.19, half_thickness / np.maximum(np.abs(np.sin(theta)), 1e-3), np.inf))

    return loft(rounded_profile(corners, 0.003), SEGMENTS, lobes_and_blade)
