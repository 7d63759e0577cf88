"""Height maps of a gel that an object is pressed into, simulated from the object's distance field."""

import numpy as np
from numpy.typing import ArrayLike

from tactopose_drake.core.geometry_checks import pose_matrix
from tactopose_drake.core.poses import compose, inverse, transform_points
from tactopose_drake.core.sensing.height_maps import HeightMapSensor
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray

_STEP = 1e-4  # between samples along a ray into the gel, m


def press_gel(
    model: ObjectModel,
    X_PO: ArrayLike,
    X_PT: ArrayLike,
    sensor: HeightMapSensor,
    shape: tuple[int, int],
    generator: np.random.Generator,
    *,
    sigma_depth: float = 2e-5,
) -> FloatArray:
    """The depth map of a flat gel that yields exactly where the object is.

    The gel is a bed of springs: it neither bulges beside the object nor smooths its edges.

    Args:
        model: the object.
        X_PO: its true pose, shape (3, 4).
        X_PT: the pad's true pose, shape (3, 4); the object may be in front of it, and up to `most_depth` in it.
        sensor: the interpretation of the map.
        shape: rows and columns of pixels.
        generator: of the noise.
        sigma_depth: standard deviation of each touched pixel's depth, m.

    Returns:
        Shape `shape`, m.
    """
    rows, columns = shape
    width, height = sensor.pixel_size
    x, y = (np.arange(columns) - 0.5 * (columns - 1)) * width, (np.arange(rows) - 0.5 * (rows - 1)) * height
    X_OT = compose(inverse(pose_matrix("X_PO", X_PO)), pose_matrix("X_PT", X_PT))
    p_TQ = np.stack([*(axis.ravel() for axis in np.meshgrid(x, y)), np.zeros(rows * columns)], axis=1)
    depth, before = np.zeros(rows * columns), model.grid.distance(transform_points(X_OT, p_TQ))
    for z in np.arange(0.0, sensor.most_depth, _STEP) + _STEP:
        # Only pixels with the object at this depth can be deeper.
        inside = np.flatnonzero(before < 0.0)
        if not len(inside):
            break
        p_TQ[:, 2] = -z
        after = np.full(len(depth), np.inf)
        after[inside] = model.grid.distance(transform_points(X_OT, p_TQ[inside]))
        share = np.clip(before[inside] / (before[inside] - after[inside]), 0.0, 1.0)
        depth[inside] = z - _STEP + _STEP * np.where(after[inside] < 0.0, 1.0, share)
        before = after
    noise = generator.normal(size=depth.shape) * sigma_depth
    return np.where(depth > 0.0, np.maximum(depth + noise, 0.0), 0.0).reshape(shape)
