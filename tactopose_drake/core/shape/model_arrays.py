"""The layout of a cached model's arrays, and the validation of arrays that come from a file.

Compiled loops do not check indices, so their input must be checked before: types, shapes, ranges, finite numbers, and
that vertices, faces, grid and samples are of the same object.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.mesh.repair import LARGEST_SIZE, SMALLEST_SIZE
from tactopose_drake.core.mesh.solid import DENSITY
from tactopose_drake.core.shape import model_cache
from tactopose_drake.core.shape.coarse_field import coarse_shape
from tactopose_drake.core.shape.model_cache import Arrays
from tactopose_drake.core.shape.signed_distance import grid_shape

Layout = dict[str, tuple[type[np.generic], tuple[int | None, ...]]]
"""Types and shapes of arrays, by name; None stands for any length."""

_LAYOUT: Layout = {
    "vertices": (np.float64, (None, 3)),
    "faces": (np.int32, (None, 3)),
    "distances": (np.float32, (None, None, None, 4)),
    "grid_origin": (np.float64, (3,)),
    "grid_spacing": (np.float64, ()),
    "coarse_values": (np.int8, (None, 4)),
    "sample_points": (np.float64, (None, 3)),
    "sample_normals": (np.float64, (None, 3)),
    "volume": (np.float64, ()),
    "centroid": (np.float64, (3,)),
    "inertia": (np.float64, (3, 3)),
    "axes": (np.float64, (None, 3)),
    "orders": (np.int64, (None,)),
    "near_axes": (np.float64, (None, 3)),
    "symmetry_poses": (np.float64, (None, 3, 4)),
    "symmetry_misfits": (np.float64, (None,)),
    "likenesses": (np.float64, (None, 3, 4)),
    "repairs": (np.uint8, (None,)),
    "content_hash": (np.uint8, (32,)),
}
_LARGEST_DISTANCE = 2.0 * LARGEST_SIZE  # of a node of the grid from the surface, m
_UNIT = 1e-6  # relative tolerance for rounding


def describe_a_model(arrays: Arrays, samples: int) -> bool:
    """Whether the arrays are a valid model with this number of surface samples."""
    if not have_layout(arrays, _LAYOUT):
        return False
    with np.errstate(over="ignore", invalid="ignore"):  # for numbers that are too large, which are then rejected
        return _shape_is_sound(arrays, samples) and _rest_is_sound(arrays)


def have_layout(arrays: Arrays, layout: Layout) -> bool:
    """Whether exactly these arrays exist, with finite doubles."""
    if arrays.keys() != layout.keys():
        return False
    for name, (kind, shape) in layout.items():
        array = arrays[name]
        if array.dtype != kind or array.ndim != len(shape):
            return False
        if any(wanted not in (None, length) for wanted, length in zip(shape, array.shape, strict=True)):
            return False
        if kind is np.float64 and not np.isfinite(array).all():
            return False
    return True


def _shape_is_sound(arrays: Mapping[str, NDArray[Any]], samples: int) -> bool:
    """Whether faces, grid and samples are consistent with the vertices."""
    vertices, faces, distances = arrays["vertices"], arrays["faces"], arrays["distances"]
    if not len(vertices) or not len(faces) or faces.min() < 0 or faces.max() >= len(vertices):
        return False
    if min(distances.shape) < 2 or not arrays["grid_spacing"] > 0.0:
        return False
    # A NaN among them makes minimum and maximum NaN, and the comparison false.
    if not (distances.min() >= -_LARGEST_DISTANCE and distances.max() <= _LARGEST_DISTANCE):
        return False
    lower, upper, h = vertices.min(axis=0), vertices.max(axis=0), float(arrays["grid_spacing"])
    size = float(np.linalg.norm(upper - lower))
    if not SMALLEST_SIZE <= size <= LARGEST_SIZE or not 1e-3 < h / size * max(distances.shape) < 1e3:
        return False
    if distances.shape[:3] != grid_shape(lower, upper, h):
        return False
    if len(arrays["coarse_values"]) != math.prod(coarse_shape(distances.shape[:3])):
        return False
    middle = arrays["grid_origin"] + 0.5 * h * (np.array(distances.shape[:3]) - 1)
    if np.any(np.abs(middle - 0.5 * (lower + upper)) > _UNIT * size):
        return False
    points, normals = arrays["sample_points"], arrays["sample_normals"]
    slack = _UNIT * size
    return (
        len(points) == len(normals) == samples
        and bool(np.all((points >= lower - slack) & (points <= upper + slack)))
        and _are_unit(normals)
    )


def _rest_is_sound(arrays: Mapping[str, NDArray[Any]]) -> bool:
    """Whether the mass properties, symmetries and texts are valid."""
    axes, orders, poses = arrays["axes"], arrays["orders"], arrays["symmetry_poses"]
    lower, upper = arrays["vertices"].min(axis=0), arrays["vertices"].max(axis=0)
    size, inertia, centroid = float(np.linalg.norm(upper - lower)), arrays["inertia"], arrays["centroid"]
    volume = float(arrays["volume"])
    every = np.concatenate([poses, arrays["likenesses"]])
    R, p = every[:, :, :3], every[:, :, 3]
    reach = 2.0 * (float(np.linalg.norm(centroid)) + size)
    if not 0.0 < volume <= (1.0 + _UNIT) * float(np.prod(upper - lower)) or np.abs(p).max(initial=0.0) > reach:
        return False
    if np.abs(R).max(initial=0.0) > 2.0 or np.abs(inertia).max() > DENSITY * volume * size**2:
        return False
    moments = np.linalg.eigvalsh(inertia)
    return (
        bool(moments[0] > 0.0 and moments[2] <= moments[0] + moments[1])
        and bool(np.all(np.abs(inertia - inertia.T) <= _UNIT * moments[2]))
        and bool(np.all((centroid >= lower) & (centroid <= upper)))
        and len(axes) == len(orders)
        and _are_unit(axes)
        and _are_unit(arrays["near_axes"])
        and bool(np.all((orders == 0) | (orders >= 2)))
        and len(poses) == len(arrays["symmetry_misfits"]) > 0
        and bool(np.all((arrays["symmetry_misfits"] >= 0.0) & (arrays["symmetry_misfits"] <= _LARGEST_DISTANCE)))
        and bool(np.all(np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)) <= _UNIT))
        and _are_texts(arrays["repairs"])
        and arrays["content_hash"].tobytes() == content_hash(arrays["vertices"], arrays["faces"]).encode()
    )


def _are_unit(rows: NDArray[Any]) -> bool:
    if np.abs(rows).max(initial=0.0) > 2.0:
        return False
    return bool(np.all(np.abs(np.linalg.norm(rows, axis=1) - 1.0) <= _UNIT))


def _are_texts(content: NDArray[Any]) -> bool:
    try:
        texts = json.loads(content.tobytes())
    except (ValueError, RecursionError):
        return False
    return isinstance(texts, list) and all(isinstance(text, str) for text in texts)


def content_hash(vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> str:
    """Identifies a repaired mesh, by 32 hexadecimal digits."""
    return model_cache.content_key(vertices, faces)
