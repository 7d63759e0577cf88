"""Patterns of cells as they stand in YAML: rows and capsules given by a few numbers, or cells given one by one."""

import dataclasses
import math

import numpy as np

from tactopose_drake.core.geometry_checks import unit_vectors
from tactopose_drake.core.sensing.tactile_layout import TactileLayout
from tactopose_drake.core.validation import (
    FloatArray,
    check_count,
    finite_array,
    positive_number,
    positive_numbers,
    whole_number,
)
from tactopose_drake.errors import InvalidInputError

_MAX_CELLS = 10_000  # of an array; the finest real ones have some hundreds
_ROUNDING = 0.02  # tolerance of a position as a share of a cell, as of a drawing in hundredths of a millimetre
_SAME = 1e-6  # distance up to which corners are the same, m


def _check_count(name: str, count: float) -> None:
    if not count <= _MAX_CELLS:
        raise InvalidInputError(f"{name} must make at most {_MAX_CELLS} cells, not {count:.4g}.")


@dataclasses.dataclass(kw_only=True, slots=True)
class CellRow:
    """Equal rectangular cells side by side."""

    center: list[float] = dataclasses.field(default_factory=lambda: [0.0, 0.0, 0.0])  # centre of the row, m
    tangent_deg: float = 0.0  # angle by which the pad has bent away from its normal here, deg
    count: int = 1  # number of cells in the row
    cell: list[float] = dataclasses.field(default_factory=lambda: [0.001, 0.001])  # size along the pad and across it, m


@dataclasses.dataclass(kw_only=True, slots=True)
class RowPattern:
    """Rows of cells on a pad that is flat or bent one way, `!RowPattern` in YAML.

    Cells are numbered row by row. Within a row they proceed in the direction `along` x `normal`, about which the pad
    bends. Rows must not overlap: a contact on both would count twice.
    """

    along: list[float] = dataclasses.field(default_factory=lambda: [1.0, 0.0, 0.0])  # from row to row, a unit vector
    normal: list[float] = dataclasses.field(default_factory=lambda: [0.0, 0.0, 1.0])  # out of the pad, a unit vector
    pitch: float = 0.001  # distance from one cell of a row to the next, m
    rows: list[CellRow] = dataclasses.field(default_factory=list)

    def make(self) -> TactileLayout:
        """The layout.

        Raises:
            InvalidInputError: a value out of its range, or a row that overlaps another; the message names it.
        """
        along = unit_vectors("RowPattern.along", self.along, (3,))
        normal = unit_vectors("RowPattern.normal", self.normal, (3,))
        if abs(along @ normal) > 1e-6:
            raise InvalidInputError(f"RowPattern.normal must be at right angles to `along`, not {self.normal}.")
        positive_number("RowPattern.pitch", self.pitch)
        check_count("RowPattern.rows", len(self.rows), "rows")
        _check_count("RowPattern.rows", sum(row.count for row in self.rows))
        across = np.cross(along, normal)
        angles = np.radians([self._check(i, row).tangent_deg for i, row in enumerate(self.rows)])[:, None]
        tangents = np.cos(angles) * along - np.sin(angles) * normal
        normals = np.cos(angles) * normal + np.sin(angles) * along
        self._check_overlaps(along, normal)
        # The wall between two rows bisects the angle between them.
        rising = normals + np.concatenate([normals[:1], normals[:-1]])
        ending = normals + np.concatenate([normals[1:], normals[-1:]])
        corners, rays = [], []
        for i, row in enumerate(self.rows):
            length, width = row.cell
            steps = self.pitch * (np.arange(row.count) - 0.5 * (row.count - 1))
            centers = np.array(row.center) + np.outer(steps, across)
            # Seen from outside with `along` upwards, `across` points to the right.
            halves = ((-1, -1), (-1, 1), (1, 1), (1, -1))
            corners.append(
                centers[:, None] + [0.5 * (a * length * tangents[i] + b * width * across) for a, b in halves]
            )
            rays.append(np.broadcast_to([rising[i], rising[i], ending[i], ending[i]], (row.count, 4, 3)))
        return TactileLayout(np.concatenate(corners), np.concatenate(rays))

    def _check(self, index: int, row: CellRow) -> CellRow:
        name = f"RowPattern.rows[{index}]"
        finite_array(f"{name}.center", row.center, (3,))
        finite_array(f"{name}.tangent_deg", row.tangent_deg, ())
        _, width = positive_numbers(f"{name}.cell", row.cell, (2,))
        whole_number(f"{name}.count", row.count, least=1)
        if row.count > 1 and width > self.pitch * (1 + 1e-9):
            raise InvalidInputError(f"{name}.cell[1] must be at most the pitch, {self.pitch:g} m, not {width:g} m.")
        return row

    def _check_overlaps(self, along: FloatArray, normal: FloatArray) -> None:
        """Raises InvalidInputError if cells of two rows overlap, unless they are on opposite sides of the pad."""
        centers = np.array([row.center for row in self.rows]) @ np.stack([along, normal, np.cross(along, normal)], 1)
        angles = np.radians([row.tangent_deg for row in self.rows])
        half, width = 0.5 * (1.0 - _ROUNDING) * np.array([row.cell for row in self.rows]).T
        last = np.array([row.count - 1 for row in self.rows])
        first = centers[:, 2] - 0.5 * self.pitch * last
        for i in range(len(self.rows) - 1):
            others = slice(i + 1, None)
            turn, mean = 0.5 * (angles[others] - angles[i]), 0.5 * (angles[others] + angles[i])
            over, up, _ = (centers[others] - centers[i]).T
            reach = half[others] + half[i]
            # Rows that share an edge of a bent pad are this far apart along the mean of their directions.
            is_over = np.abs(np.cos(mean) * over - np.sin(mean) * up) < reach * np.cos(turn)
            is_near = np.abs(np.sin(mean) * over + np.cos(mean) * up) < reach
            apart = first[others] - first[i]
            steps = np.clip(np.rint(-apart / self.pitch), -last[i], last[others])  # to the nearest cell of the other
            is_beside = np.abs(apart + steps * self.pitch) < width[others] + width[i]
            overlap = is_over & is_near & is_beside & (np.cos(2.0 * turn) > 0.0)
            if overlap.any():
                j = i + 1 + int(overlap.argmax())
                raise InvalidInputError(
                    f"RowPattern.rows[{j}].center must not be {self.rows[j].center}, where its cells overlap those of "
                    f"rows[{i}], at {self.rows[i].center}."
                )


@dataclasses.dataclass(kw_only=True, slots=True)
class CapsulePattern:
    """Cells without gaps on one side and the end of a capsule, `!CapsulePattern` in YAML.

    The capsule stands along z; its hemisphere's centre is at z = `length`. The cells cover the side towards -y from
    z = 0 on and bend over the end. They are numbered row by row, from z = 0 to the end, each row from -x to x. On the
    hemisphere cells become narrower towards the rim.
    """

    radius: float = 0.009  # radius of the capsule, m
    length: float = 0.014  # length of the cylindrical part that is covered, m
    cell: float = 0.001  # largest edge of a cell, m
    half_angle_deg: float = 60.0  # angle from -y to the rim on either side, deg
    end_angle_deg: float = 80.0  # angle from the hemisphere's root to the last row, deg

    def make(self) -> TactileLayout:
        """The layout.

        Raises:
            InvalidInputError: a value out of its range; the message names it.
        """
        for name in ("radius", "length", "cell"):
            positive_number(f"CapsulePattern.{name}", getattr(self, name))
        for name in ("half_angle_deg", "end_angle_deg"):
            if not 0 < getattr(self, name) < 90:
                raise InvalidInputError(
                    f"CapsulePattern.{name} must be above 0 and below 90, not {getattr(self, name):g}."
                )
        half, end = math.radians(self.half_angle_deg), math.radians(self.end_angle_deg)
        around, up = 2 * half * self.radius / self.cell, (self.length + end * self.radius) / self.cell
        _check_count("CapsulePattern.cell", max(around, up, around * up))
        columns = math.ceil(2 * half * self.radius / self.cell)
        z = np.linspace(0.0, self.length, math.ceil(self.length / self.cell) + 1)
        bend = np.linspace(0.0, end, math.ceil(end * self.radius / self.cell) + 1)[1:]
        psi = np.linspace(-half, half, columns + 1)
        x, down = self.radius * np.sin(psi), self.radius * np.cos(psi)
        side = np.stack(np.broadcast_arrays(x, -down, z[:, None]), axis=2)
        over = np.stack(
            np.broadcast_arrays(x, -down * np.cos(bend)[:, None], self.length + down * np.sin(bend)[:, None]), axis=2
        )
        nodes = np.concatenate([side, over])
        corners = np.stack([nodes[:-1, :-1], nodes[:-1, 1:], nodes[1:, 1:], nodes[1:, :-1]], axis=2).reshape(-1, 4, 3)
        rays = corners.copy()
        rays[..., 2] -= np.clip(corners[..., 2], 0.0, self.length)
        return TactileLayout(corners, rays)


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
