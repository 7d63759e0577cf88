"""Layouts and pressure fields whose integrals are known."""

import itertools

import numpy as np

from tactopose_drake.core.sensing.tactile_array import PressureField
from tactopose_drake.core.sensing.tactile_layout import TactileLayout
from tactopose_drake.core.sensing.tactile_patterns import CapsulePattern, CellRow, RowPattern


def grid(rows: int = 12, columns: int = 8, cell: float = 0.001) -> TactileLayout:
    """Square cells without gaps, centred on the origin, the rows along x, the normal z."""
    x = cell * (np.arange(rows) - 0.5 * (rows - 1))
    return RowPattern(
        pitch=cell, rows=[CellRow(center=[float(at), 0, 0], count=columns, cell=[cell, cell]) for at in x]
    ).make()


def fingertip() -> TactileLayout:
    """A round fingertip with few and large cells, so that their edges matter."""
    return CapsulePattern(cell=0.003).make()


def polygon(center: np.ndarray, slope: np.ndarray, radius: float = 0.003, corners: int = 5) -> PressureField:
    """A flat regular polygon over the plane z = 0, tilted by `slope`, with a pressure that is linear on it."""
    angle = 2 * np.pi * (np.arange(corners) + 0.3) / corners
    xy = np.asarray(center) + radius * np.column_stack([np.cos(angle), np.sin(angle)])
    vertices = np.column_stack([xy, xy @ slope])
    return PressureField(vertices, 2e4 + xy @ np.array([3e6, -2e6]), np.concatenate([[corners], np.arange(corners)]))


def field_around(layout: TactileLayout, depth: float) -> PressureField:
    """A smooth pressure on the layout's own cells, moved inwards along a capsule of 9 mm radius on the z axis."""
    corners = layout.corners.reshape(-1, 3)
    axis_point = np.column_stack([np.zeros((len(corners), 2)), np.clip(corners[:, 2], 0.0, 0.014)])
    vertices = axis_point + (corners - axis_point) * (1 - depth / 0.009)
    pressure = 5e4 * (1 + np.sin(300 * vertices[:, 0]) * np.cos(200 * vertices[:, 2]))
    index = np.arange(len(corners)).reshape(-1, 4)
    triangles = np.concatenate([index[:, [0, 1, 2]], index[:, [0, 2, 3]]])
    return PressureField(vertices, pressure, np.insert(triangles, 0, 3, axis=1).ravel())


def refined(field: PressureField) -> PressureField:
    """The same field on faces cut into triangles about a point inside of each."""
    vertices, pressure, faces = list(field.vertices), list(field.pressure), []
    start = 0
    while start < len(field.faces):
        index = field.faces[start + 1 : start + 1 + field.faces[start]]
        weight = np.random.default_rng(start).dirichlet(np.ones(len(index)))
        # A linear field over a plane is linear in any affine combination of its points only if they are affinely
        # independent, so the point is taken inside a triangle of the face.
        weight[3:] = 0
        weight /= weight.sum()
        vertices.append(weight @ field.vertices[index])
        pressure.append(weight @ field.pressure[index])
        for a, b in zip(index, np.roll(index, -1), strict=True):
            faces += [3, a, b, len(vertices) - 1]
        start += len(index) + 1
    return PressureField(np.array(vertices), np.array(pressure), np.array(faces))


def total_force(field: PressureField) -> np.ndarray:
    """The integral of -p n over the whole field, by formula."""
    force = np.zeros(3)
    start = 0
    while start < len(field.faces):
        index = field.faces[start + 1 : start + 1 + field.faces[start]]
        for b, c in itertools.pairwise(index[1:]):
            triangle = [index[0], b, c]
            p, q, r = field.vertices[triangle]
            force -= 0.5 * np.cross(q - p, r - p) * field.pressure[triangle].mean()
        start += len(index) + 1
    return force
