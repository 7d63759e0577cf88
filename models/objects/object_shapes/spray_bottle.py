"""A trigger spray bottle: an oval body and a head that is screwed on askew, so that no symmetry is left."""

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from .fields import box, capsule, disc, ellipsoid, smooth_cut, smooth_union, tube
from .sculpting import sculpt

Array = NDArray[np.float64]

HEAD_TURN = np.deg2rad(17.0)  # of the head against the body, about z

# The body's half length in x, half width in y, and middle in x, over the height (m).
_HEIGHTS = np.array([0.0, 0.045, 0.085, 0.112, 0.138, 0.157, 0.168, 0.19])
_half_length = PchipInterpolator(_HEIGHTS, [0.0405, 0.0405, 0.0375, 0.0335, 0.0300, 0.0180, 0.0130, 0.0130])
_half_width = PchipInterpolator(_HEIGHTS, [0.0275, 0.0275, 0.0265, 0.0250, 0.0235, 0.0165, 0.0130, 0.0130])
_middle = PchipInterpolator(_HEIGHTS, [-0.003, -0.003, -0.005, -0.006, -0.003, 0.0, 0.0, 0.0])

_TRIGGER_REACH = [0.0395, 0.0335, 0.0305, 0.0312, 0.0345, 0.0345, 0.03]  # of its middle line in x, from below, m


def _body(p: Array) -> Array:
    z = np.clip(p[..., 2], _HEIGHTS[0], _HEIGHTS[-1])
    a, b = _half_length(z), _half_width(z)
    x, y = p[..., 0] - _middle(z), p[..., 1]
    # A superellipse of degree 3: flatter sides than an ellipse.
    scaled = (np.abs(x / a) ** 3 + np.abs(y / b) ** 3) ** (1 / 3)
    wall = (scaled - 1.0) * b
    ends = np.abs(p[..., 2] - 0.09) - 0.09
    shell = -smooth_union(-wall, -ends, 0.006)
    return smooth_cut(shell, ellipsoid(p, (0.0, 0.0, -0.004), (0.028, 0.018, 0.008)), 0.003)


def _head(p: Array) -> Array:
    """The sprayer in its own frame: nozzle towards +x."""
    shroud = box(p, (0.004, 0.0, 0.2065), (0.035, 0.0125, 0.0125), 0.006)
    back = capsule(p, (-0.024, 0.0, 0.204), (-0.010, 0.0, 0.2065), 0.011, 0.0135)
    hood = capsule(p, (-0.02, 0.0, 0.2145), (0.034, 0.0, 0.2185), 0.0095, 0.0065)
    shape = smooth_union(smooth_union(shroud, back, 0.012), hood, 0.006)
    tilt = np.array([[1, 0, 0], [0, np.cos(0.35), -np.sin(0.35)], [0, np.sin(0.35), np.cos(0.35)]])
    nozzle = box(p, (0.046, 0.0, 0.2095), (0.009, 0.0095, 0.0095), 0.0025, tilt)
    nozzle = smooth_cut(nozzle, capsule(p, (0.055, 0.0, 0.2095), (0.065, 0.0, 0.2095), 0.0035), 0.001)
    return smooth_union(shape, nozzle, 0.0025)


def _trigger(p: Array) -> Array:
    height = np.linspace(0.2, 0.137, 19)
    reach = PchipInterpolator([0.137, 0.144, 0.154, 0.166, 0.179, 0.19, 0.2], _TRIGGER_REACH)(height)
    path = np.stack([reach, np.zeros_like(height), height], axis=-1)
    flattened = p * np.array([1.0, 0.55, 1.0])  # twice as wide as it is thick
    return tube(flattened, path, 0.0042)


def _field(p: Array) -> Array:
    c, s = np.cos(HEAD_TURN), np.sin(HEAD_TURN)
    turned = p @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    collar = disc(p, 0.0165, 0.1665, 0.1885, 0.0015)
    neck = disc(p, 0.0115, 0.16, 0.205, 0.001)
    head = smooth_union(_head(turned), _trigger(turned), 0.004)
    stem = np.minimum(smooth_union(_body(p), neck, 0.004), collar)
    thumb_rest = ellipsoid(p, (-0.012, -0.031, 0.112), (0.016, 0.009, 0.013))
    return smooth_union(smooth_cut(stem, thumb_rest, 0.006), head, 0.003)


def spray_bottle() -> trimesh.Trimesh:
    """A trigger spray bottle with a thumb rest on one side, its head turned by 17 degrees against the body."""
    return sculpt(_field, [[-0.05, -0.035, -0.004], [0.065, 0.035, 0.232]], 0.0013, 8e-5, (0.0014, 0.007))
