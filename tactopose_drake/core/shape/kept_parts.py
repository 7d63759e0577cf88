"""Derived parts of a model that are made when first needed, and then cached on disk.

Each is identified by a hash of its inputs, so it does not matter which model it was made for. As with a model itself,
data from a file are checked before compiled loops read them: types, shapes and indices; the cache's checksum protects
the numbers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.shape import model_cache
from tactopose_drake.core.shape.model_arrays import Layout, have_layout
from tactopose_drake.core.shape.model_cache import Arrays
from tactopose_drake.core.shape.pair_features import TABLE_SIZE, PairFeatures, build_pair_features
from tactopose_drake.core.shape.surface_samples import SurfaceSamples
from tactopose_drake.core.shape.surfel_kernels import BLOCK
from tactopose_drake.core.shape.surfels import Surfels, make_surfels
from tactopose_drake.core.validation import FloatArray


def has_pair_features(samples: SurfaceSamples, area: float, symmetry_poses: FloatArray) -> bool:
    """Whether `pair_features` would find them on disk."""
    return model_cache.has(_pair_features_key(samples, area, symmetry_poses))


def has_surfels(vertices: FloatArray, faces: NDArray[np.int32], area: float, spacing: float) -> bool:
    """Whether `surfels` would find them on disk."""
    return model_cache.has(_surfels_key(vertices, faces, area, spacing))


def pair_features(samples: SurfaceSamples, area: float, symmetry_poses: FloatArray) -> PairFeatures:
    """The same as `build_pair_features`, loaded from disk if cached."""
    arrays = model_cache.load_or_make(
        _pair_features_key(samples, area, symmetry_poses),
        _are_pair_features,
        lambda: _arrays_of(build_pair_features(samples, area, symmetry_poses), _PAIR_FEATURES),
    )
    spacing, length = float(arrays.pop("spacing")), float(arrays.pop("length"))
    return PairFeatures(**arrays, spacing=spacing, length=length)


def surfels(vertices: FloatArray, faces: NDArray[np.int32], area: float, spacing: float) -> Surfels:
    """The same as `make_surfels`, loaded from disk if cached."""
    arrays = model_cache.load_or_make(
        _surfels_key(vertices, faces, area, spacing),
        _are_surfels,
        lambda: _arrays_of(make_surfels(vertices, faces, area, spacing), _SURFELS),
    )
    cell, (nx, ny, nz) = float(arrays.pop("cell")), arrays.pop("shape").tolist()
    return Surfels(**arrays, cell=cell, shape=(nx, ny, nz), spacing=spacing)


def _arrays_of(part: PairFeatures | Surfels, layout: Layout) -> Arrays:
    return {name: np.asarray(getattr(part, name)) for name in layout}


def _pair_features_key(samples: SurfaceSamples, area: float, symmetry_poses: FloatArray) -> str:
    return model_cache.content_key("pair features", samples.points, samples.normals, repr(area), symmetry_poses)


def _surfels_key(vertices: FloatArray, faces: NDArray[np.int32], area: float, spacing: float) -> str:
    return model_cache.content_key("surfels", vertices, faces, repr(area), repr(spacing))


_PAIR_FEATURES: Layout = {
    "points": (np.float64, (None, 3)),
    "normals": (np.float64, (None, 3)),
    "spacing": (np.float64, ()),
    "length": (np.float64, ()),
    "features": (np.uint8, (None, 4)),
    "pairs": (np.int16, (None, 2)),
    "first": (np.int32, (TABLE_SIZE,)),
}
_SURFELS: Layout = {
    "blocks": (np.float32, (None, 9, BLOCK)),
    "balls": (np.float32, (None, 4)),
    "first": (np.int32, (None,)),
    "origin": (np.float64, (3,)),
    "cell": (np.float64, ()),
    "shape": (np.int64, (3,)),
}


def _are_pair_features(arrays: Arrays) -> bool:
    """Whether arrays from a file are valid pair features."""
    if not have_layout(arrays, _PAIR_FEATURES):
        return False
    points, pairs = arrays["points"], arrays["pairs"]
    return (
        len(points) == len(arrays["normals"])
        and len(pairs) == len(arrays["features"])
        and pairs.min(initial=0) >= 0
        and pairs.max(initial=0) < len(points)
        and _is_table(arrays["first"], len(pairs))
        and bool(0.0 < arrays["spacing"] <= arrays["length"])
    )


def _are_surfels(arrays: Arrays) -> bool:
    """Whether arrays from a file are valid surfels."""
    if not have_layout(arrays, _SURFELS) or arrays["shape"].min() < 1:
        return False
    nx, ny, nz = (int(n) for n in arrays["shape"])
    blocks, balls = arrays["blocks"], arrays["balls"]
    return (
        len(arrays["first"]) == nx * ny * (nz + 1)
        and len(blocks) == len(balls)
        and _is_table(arrays["first"], len(blocks) * BLOCK)
        and bool(arrays["cell"] > 0.0)
        and bool(np.isfinite(blocks).all() and np.isfinite(balls).all())
    )


def _is_table(first: NDArray[np.int32], count: int) -> bool:
    """Whether these are valid offsets of bins among `count` entries."""
    return bool(first[0] == 0 and first[-1] == count and np.all(first[1:] >= first[:-1]))
