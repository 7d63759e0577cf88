"""The cells of a tactile array: their positions and orientations, and the wedge of space that each one feels."""

import dataclasses

import numpy as np

from tactopose_drake.core.plain_values import ReadOnlyCopies
from tactopose_drake.core.validation import FloatArray, check_count, finite_array
from tactopose_drake.errors import InvalidInputError

# Tolerance of a cell's flatness, relative to its longest edge.
_FLATNESS = 1e-3
_SAME = 1e-6  # distance up to which cells are at the same place, m


@dataclasses.dataclass(frozen=True, eq=False)
class TactileLayout(ReadOnlyCopies):
    """Quadrilateral cells on a pad, flat or curved, with or without gaps.

    Each cell feels what happens inside a wedge: four planes through its edges that rise from the corners along `rays`.
    On a curved pad, neighbours that share two corners and their rays share the plane between them, so that no place
    above or below the pad is felt twice or missed.

    Attributes:
        corners: in the pad's frame T, shape (m, 4, 3), m; counterclockwise as seen from outside.
        rays: out of the pad, shape (m, 4, 3); of any positive length; the two rays of an edge are coplanar with it.
        p_TC: the cells' centres of area, shape (m, 3), m.
        n_T: their outward unit normals, shape (m, 3).
        areas: shape (m,), m^2.
        planes: of the wedges, shape (m, 4, 4): a point q is inside if planes[..., :3] @ q + planes[..., 3] >= 0.

    Raises:
        InvalidInputError: numbers that are not finite, no cell, a cell that is not flat, not convex or has no area, two
            cells at one place, or a ray that does not point out of its cell.
    """

    corners: FloatArray
    rays: FloatArray
    p_TC: FloatArray = dataclasses.field(init=False)
    n_T: FloatArray = dataclasses.field(init=False)
    areas: FloatArray = dataclasses.field(init=False)
    planes: FloatArray = dataclasses.field(init=False)

    def __post_init__(self) -> None:
        corners = np.array(finite_array("corners", self.corners, (None, 4, 3)))
        check_count("corners", len(corners), "cells")
        rays = np.array(finite_array("rays", self.rays, (len(corners), 4, 3)))
        p_TC, n_T, areas = _measures(corners)
        _check_places(p_TC)
        rays = _unit_rays(rays, n_T)
        planes = _planes(corners, rays)
        fields = {"corners": corners, "rays": rays, "p_TC": p_TC, "n_T": n_T, "areas": areas, "planes": planes}
        for name, value in fields.items():
            value.setflags(write=False)
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.corners)


def _measures(corners: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Centres of area, normals and areas of the cells; checks that cells are convex and flat."""
    edges = np.roll(corners, -1, axis=1) - corners
    turns = np.cross(edges, np.roll(edges, -1, axis=1))
    # A quadrilateral's vector area is half the cross product of its diagonals, flat or not.
    vector_areas = 0.5 * np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    areas = np.linalg.norm(vector_areas, axis=1)
    longest = np.linalg.norm(edges, axis=2).max(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        n_T = vector_areas / areas[:, None]
        height = np.einsum("mki,mi->mk", corners - corners[:, :1], n_T)
        convex = np.all(np.einsum("mki,mi->mk", turns, n_T) > 0, axis=1)
        flat = np.all(np.abs(height) <= _FLATNESS * longest[:, None], axis=1)
    for fits, what in ((convex, "convex with an area"), (flat, "flat")):
        if not fits.all():
            raise InvalidInputError(f"corners[{int(np.argmin(fits))}] must be a cell that is {what}.")
    halves = np.stack([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]], axis=1)  # two triangles a cell
    weights = 0.5 * np.linalg.norm(
        np.cross(halves[:, :, 1] - halves[:, :, 0], halves[:, :, 2] - halves[:, :, 0]), axis=2
    )
    p_TC = np.einsum("mt,mti->mi", weights, halves.mean(axis=2)) / weights.sum(axis=1, keepdims=True)
    return p_TC, n_T, areas


def _check_places(p_TC: FloatArray) -> None:
    """Raises InvalidInputError if two of the cells' centres (m, 3) coincide."""
    _, firsts, place = np.unique(np.round(p_TC / _SAME), axis=0, return_index=True, return_inverse=True)
    first = firsts[place.ravel()]
    again = int(np.argmax(first != np.arange(len(p_TC))))
    if again:  # Index 0 means no repetition, as the first cell cannot be one.
        raise InvalidInputError(f"corners[{again}] must be elsewhere than cell {first[again]}, not in the same place.")


def _unit_rays(rays: FloatArray, n_T: FloatArray) -> FloatArray:
    """Normalises rays, and checks their direction."""
    outwards = np.einsum("mki,mi->mk", rays, n_T) > 0
    if not outwards.all():
        cell, corner = np.argwhere(~outwards)[0]
        raise InvalidInputError(f"rays[{cell}, {corner}] must point out of the cell, not into it.")
    unit: FloatArray = rays / np.linalg.norm(rays, axis=2, keepdims=True)
    return unit


def _planes(corners: FloatArray, rays: FloatArray) -> FloatArray:
    """The four planes of each wedge, shape (m, 4, 4); plane k goes through the corners k and k + 1."""
    edges = np.roll(corners, -1, axis=1) - corners
    inward = np.cross(rays + np.roll(rays, -1, axis=1), edges)
    inward /= np.linalg.norm(inward, axis=2, keepdims=True)
    offset = -np.einsum("mki,mki->mk", inward, corners)
    return np.concatenate([inward, offset[..., None]], axis=2)
