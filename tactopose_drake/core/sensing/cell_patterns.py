"""Cells given one by one, for arrays without a regular pattern."""

import dataclasses

import numpy as np

from tactopose_drake.core.geometry_checks import unit_vectors
from tactopose_drake.core.sensing.tactile_layout import TactileLayout
from tactopose_drake.core.validation import FloatArray, check_count, finite_array, positive_number
from tactopose_drake.errors import InvalidInputError

_MAX_CELLS = 10_000  # of an array; the finest real ones have some hundreds
_SAME = 1e-6  # distance up to which corners are the same, m


@dataclasses.dataclass(kw_only=True, slots=True)
class CornerPattern:
    """Quadrilateral cells given by their corners, `!CornerPattern` in YAML; numbered in this order.

    Neighbours that share corners share the wall between them.
    """

    # Four corners of each cell, counterclockwise as seen from outside, m.
    cells: list[list[list[float]]] = dataclasses.field(default_factory=list)

    def make(self) -> TactileLayout:
        """The layout.

        Raises:
            InvalidInputError: a value out of its range; the message names it.
        """
        check_count("CornerPattern.cells", len(self.cells), "cells", most=_MAX_CELLS)
        corners = finite_array("CornerPattern.cells", self.cells, (None, 4, 3))
        across = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
        length = np.linalg.norm(across, axis=1, keepdims=True)
        normals = across / np.where(length > 0.0, length, 1.0)
        _, corner = np.unique(np.round(corners.reshape(-1, 3) / _SAME), axis=0, return_inverse=True)
        rays = np.zeros((corner.max() + 1, 3))
        np.add.at(rays, corner.ravel(), np.repeat(normals, 4, axis=0))
        return TactileLayout(corners, rays[corner.ravel()].reshape(-1, 4, 3))


@dataclasses.dataclass(kw_only=True, slots=True)
class PointPattern:
    """Square cells given by their centres, `!PointPattern` in YAML; numbered in this order."""

    points: list[list[float]] = dataclasses.field(default_factory=list)  # the cells' centres, m
    normals: list[list[float]] = dataclasses.field(default_factory=list)  # out of the pad, unit vectors; one for all
    along: list[float] = dataclasses.field(default_factory=lambda: [1.0, 0.0, 0.0])  # direction of two of the edges
    cell: float = 0.001  # edge of a cell, m

    def make(self) -> TactileLayout:
        """The layout.

        Raises:
            InvalidInputError: a value out of its range; the message names it.
        """
        check_count("PointPattern.points", len(self.points), "points", most=_MAX_CELLS)
        points = finite_array("PointPattern.points", self.points, (None, 3))
        normals = unit_vectors("PointPattern.normals", self.normals or [[0.0, 0.0, 1.0]], (None, 3))
        if len(normals) not in (1, len(points)):
            raise InvalidInputError(
                f"PointPattern.normals must be 1, or as many as the {len(points)} points, not {len(normals)}."
            )
        edge = positive_number("PointPattern.cell", self.cell)
        along = unit_vectors("PointPattern.along", self.along, (3,))
        first, second = _edges(np.broadcast_to(normals, points.shape), along)
        halves = ((-1, -1), (1, -1), (1, 1), (-1, 1))
        corners = np.stack([points + 0.5 * edge * (a * first + b * second) for a, b in halves], axis=1)
        return TactileLayout(corners, np.broadcast_to(normals[:, None], corners.shape))


def _edges(normals: FloatArray, along: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit vectors along the edges of cells with these normals (m, 3), the first as close to `along` as possible."""
    first = along - (normals @ along)[:, None] * normals
    length = np.linalg.norm(first, axis=1, keepdims=True)
    if not np.all(length > 1e-3):
        cell = int(np.argmin(length))
        raise InvalidInputError(f"PointPattern.along must be another direction than the normal of cell {cell}.")
    first /= length
    return first, np.cross(normals, first)
