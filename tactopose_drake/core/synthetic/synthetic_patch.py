"""Synthetic patches on an object's surface, for tests, benchmarks, and studies without a simulator."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tactopose_drake.core.geometry_checks import pose_matrix
from tactopose_drake.core.poses import exp_so3
from tactopose_drake.core.sensing.patches import Patch, describe_patch
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.shape.signed_distance import DistanceGrid
from tactopose_drake.core.synthetic.synthetic_touch import random_surface_points
from tactopose_drake.core.validation import FloatArray, whole_number
from tactopose_drake.errors import InvalidInputError


@dataclass(frozen=True, kw_only=True)
class PadTouchParams:
    """The pads' layer, and how places for pads are chosen."""

    alpha: float = 1e-7  # depth over pressure, m/Pa: 1 mm deep for 10 kPa
    places_per_pad: int = 10  # random ones, of which the one farthest from the earlier pads is taken
    tries_per_place: int = 4  # most points of the surface that are tried per place
    fewest_cells: int = 3  # that must be pressed at a place
    ray_steps: int = 60  # samples along the ray from a cell inwards out of the object, up to four times the depth


def flat_pad(rows: int = 8, columns: int = 3, pitch: float = 0.0025) -> FloatArray:
    """Cells of a flat pad centred on the origin, shape (rows columns, 3), m; its z axis points out of it."""
    x, y = (np.arange(rows) - 0.5 * (rows - 1)) * pitch, (np.arange(columns) - 0.5 * (columns - 1)) * pitch
    return np.array([[a, b, 0.0] for a in x for b in y])


def touch_with_pads(
    model: ObjectModel,
    X_PO: ArrayLike,
    count: int,
    generator: np.random.Generator,
    *,
    cells: FloatArray | None = None,
    depth: float = 0.0012,
    lean: float = math.radians(6.0),
    sigma_position: float = 0.0009,
    sigma_rotation: float = math.radians(5.0),
    sigma_depth: float = 0.0001,
    params: PadTouchParams = PadTouchParams(),
) -> tuple[Patch, ...]:
    """Flat pads whose centre is pressed into random points of the surface, measured with noise.

    The pads' soft layers are beds of springs: a cell's pressure is proportional to how deep the object is in the pad
    there. Errors of the hand's joints shift and rotate a pad as a whole.

    Args:
        model: the object.
        X_PO: its true pose, shape (3, 4); a `RigidTransform` or a 4x4 matrix will do.
        count: number of pads, >= 1; each is the one of some random places that is farthest from the earlier ones.
        generator: of the random numbers.
        cells: of each pad relative to its centre, shape (n, 3), m; those of `flat_pad()` by default.
        depth: of a pad's centre in the surface, m.
        lean: standard deviation of a pad's tilt from the surface about each axis, rad.
        sigma_position: standard deviation of each coordinate of a pad's position, m.
        sigma_rotation: standard deviation of a small rotation of a pad about each axis, rad.
        sigma_depth: standard deviation of each active cell's depth, m.
        params: the pads' layer, and how places are chosen.

    Raises:
        InvalidInputError: a pose that is no rigid transform, a count that is not a whole number above 0, or too few
            places on the object on which enough cells can be pressed.
    """
    X_PO, count = pose_matrix("X_PO", X_PO), whole_number("count", count, least=1)
    cells = flat_pad() if cells is None else cells
    places = _places(model, cells, depth, lean, params.places_per_pad * count, generator, params)
    pads = places[:1]
    for i in range(1, count):
        some = places[i::count]
        gaps = [min(float(np.linalg.norm(p - q)) for q, _, _ in pads) for p, _, _ in some]
        pads.append(some[int(np.argmax(gaps))])
    patches = []
    for p_OT, R_OT, depths in pads:
        R_PT = exp_so3(generator.normal(size=3) * sigma_rotation) @ X_PO[:, :3] @ R_OT
        p_PT = X_PO[:, :3] @ p_OT + X_PO[:, 3] + generator.normal(size=3) * sigma_position
        noise = generator.normal(size=len(cells)) * sigma_depth
        pressure = np.where(depths > 0, np.maximum(depths + noise, 0.0), 0.0) / params.alpha
        n_PT = np.tile(R_PT[:, 2], (len(cells), 1))
        patches.append(describe_patch(cells @ R_PT.T + p_PT, pressure, alpha=params.alpha, n_PT=n_PT))
    return tuple(patches)


def _places(
    model: ObjectModel,
    cells: FloatArray,
    depth: float,
    lean: float,
    count: int,
    generator: np.random.Generator,
    params: PadTouchParams,
) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
    """Pads' poses p_OT (3,) and R_OT (3, 3), and the depths of the object at their cells (n,), m; `count` of them."""
    tries = params.tries_per_place * count
    points, normals = random_surface_points(model, tries, generator)
    z = (exp_so3(generator.normal(size=(tries, 3)) * lean) @ -normals[..., None])[..., 0]
    x = np.cross(z, generator.normal(size=(tries, 3)))
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    R_OT = np.stack([x, np.cross(z, x), z], axis=-1)
    p_OT = points - depth * normals
    found: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    for p, R in zip(p_OT, R_OT, strict=True):
        depths = _depths(model.grid, cells @ R.T + p, -R[:, 2], np.linspace(0.0, 4.0 * depth, params.ray_steps))
        if np.isfinite(depths).all() and np.count_nonzero(depths) >= params.fewest_cells:
            found.append((p, R, depths))
            if len(found) == count:
                return found
    raise InvalidInputError(f"{model.name} must have {count} places for pads, not {len(found)}, in {tries} tries.")


def _depths(grid: DistanceGrid, p_OT: FloatArray, inward: FloatArray, way: FloatArray) -> FloatArray:
    """How far each cell (n, 3) must move along `inward` (3,) to leave the object, shape (n,), m.

    The ray is sampled at distances `way` (s,), m. The result is 0 outside the object, and infinite if no sample leaves.
    """
    phi = grid.distance(p_OT[:, None] + way[:, None] * inward)
    inside = phi[:, 0] < 0
    depths = np.where(inside, np.inf, 0.0)
    left = np.flatnonzero(inside & np.any(phi >= 0, axis=1))
    step = np.argmax(phi[left] >= 0, axis=1)
    before, after = phi[left, step - 1], phi[left, step]
    depths[left] = way[step - 1] + before / (before - after) * way[1]
    return depths
