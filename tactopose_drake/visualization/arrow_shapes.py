"""Arrow meshes of unit size for free directions: around the z axis, and in both directions along it."""

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.validation import FloatArray

_TUBE, _HEAD_RADIUS = 0.014, 0.05  # of an arrow around the axis
_TURNS = 3  # arrows around the axis; at least one is visible from any side
_TURN, _HEAD = np.radians(80.0), np.radians(11.0)  # angles that the shaft and the head of each cover
_SHAFT, _POINT_RADIUS, _POINT = 0.006, 0.019, 0.065  # radii of an arrow along the axis, and length of its heads
_SIDES = 12

TURN_TIP = (float(np.cos(_TURN)), float(np.sin(_TURN)), 0.0)
SLIDE_TIP = (0.0, 0.0, 0.5)
"""Positions of the arrows' labels."""


def turn_arrow() -> tuple[FloatArray, NDArray[np.int32]]:
    """Vertices (v, 3) and faces (f, 3) of right-handed arrows around the z axis, on a circle of radius 1."""
    shaft = np.linspace(0.0, _TURN, 16)
    angle = np.concatenate([shaft[:1], shaft, shaft[-1:], [_TURN + _HEAD]])
    radius = np.concatenate([[0.0], np.full(16, _TUBE), [_HEAD_RADIUS, 0.0]])
    parts = []
    for start in 2.0 * np.pi * np.arange(_TURNS) / _TURNS:
        outward = np.stack([np.cos(start + angle), np.sin(start + angle), np.zeros_like(angle)], axis=1)
        upward = np.broadcast_to([0.0, 0.0, 1.0], outward.shape)
        parts.append(_around(outward, upward, outward, radius))
    faces = [part[1] + turn * len(parts[0][0]) for turn, part in enumerate(parts)]
    return np.concatenate([part[0] for part in parts]), np.concatenate(faces).astype(np.int32)


def slide_arrow() -> tuple[FloatArray, NDArray[np.int32]]:
    """Vertices (v, 3) and faces (f, 3) of a double-headed arrow of length 1 along the z axis, about the origin."""
    inner = 0.5 - _POINT
    height = np.array([-0.5, -inner, -inner, inner, inner, 0.5])
    radius = np.array([0.0, _POINT_RADIUS, _SHAFT, _SHAFT, _POINT_RADIUS, 0.0])
    center = np.stack([np.zeros(6), np.zeros(6), height], axis=1)
    x, y = np.broadcast_to([1.0, 0.0, 0.0], (6, 3)), np.broadcast_to([0.0, 1.0, 0.0], (6, 3))
    return _around(center, x, y, radius)


def _around(
    center: FloatArray, first: FloatArray, second: FloatArray, radius: FloatArray
) -> tuple[FloatArray, NDArray[np.int32]]:
    """A tube through n circles: centres (n, 3), two orthogonal directions in each circle's plane (n, 3), radii (n,)."""
    angle = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
    offset = np.cos(angle)[None, :, None] * first[:, None] + np.sin(angle)[None, :, None] * second[:, None]
    vertices = (center[:, None] + radius[:, None, None] * offset).reshape(-1, 3)
    ring, side = np.meshgrid(np.arange(len(center) - 1), np.arange(_SIDES), indexing="ij")
    a, b = (ring * _SIDES + side).ravel(), (ring * _SIDES + (side + 1) % _SIDES).ravel()
    faces = np.concatenate([np.stack([a, b, a + _SIDES], axis=1), np.stack([b, b + _SIDES, a + _SIDES], axis=1)])
    return vertices, faces.astype(np.int32)
