"""Depth images of an object fused into truncated signed distances on a grid [C96], whose zero level is the surface.

Sources: [C96] B. Curless and M. Levoy, A volumetric method for building complex models from range images, SIGGRAPH,
1996.
"""

import dataclasses
import functools
from collections.abc import Sequence
from dataclasses import dataclass

import manifold3d
import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial import cKDTree

from tactopose_drake.core.parameter_checks import check_numbers
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.core.vision.depth_view import DepthView
from tactopose_drake.core.vision.level_set_kernels import depth_inside
from tactopose_drake.errors import InvalidInputError

# Standard deviations of the smoothing of distances, in cells: against single pixels' noise, and, if the surface then
# touches itself, more.
_SMOOTHINGS = 1.0, 1.4, 2.0
_RIM = 6  # cells kept beyond what is solid


@dataclasses.dataclass(kw_only=True, slots=True)
class FusionParams:
    """The resolution of the fusion."""

    spacing: float = 0.002  # of the grid, m
    truncation: float = 0.006  # of distances, m: an image has no information deeper behind a surface

    def validate(self) -> None:
        """Raises InvalidInputError if a value is out of its range."""
        check_numbers("FusionParams", self)


@dataclass(frozen=True, eq=False)
class FusedVolume:
    """Truncated signed distances, negative inside, on a grid.

    Attributes:
        values: shape (nx, ny, nz), m.
        origin: of the grid, shape (3,), m.
        spacing: m.
    """

    values: FloatArray
    origin: FloatArray
    spacing: float

    @classmethod
    def of(cls, views: Sequence[DepthView], params: FusionParams, box: FloatArray) -> "FusedVolume":
        """Fuses images within a box (2, 3), m."""
        lowest, highest = box
        margin = 3.0 * params.spacing
        counts = np.ceil((highest - lowest + 2.0 * margin) / params.spacing).astype(int) + 1
        origin = lowest - margin
        axes = [origin[i] + params.spacing * np.arange(counts[i]) for i in range(3)]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        total, count = np.zeros(len(points)), np.zeros(len(points))
        for view in views:
            behind = view.depth_behind(points)
            known = behind > -params.truncation
            total[known] += np.minimum(behind[known], params.truncation)
            count += known
        # Solid where no image sees through.
        values = np.where(count > 0.0, total / np.maximum(count, 1.0), -params.truncation)
        outside = np.maximum(lowest - points, points - highest).max(axis=1)
        values = np.maximum(values, np.clip(outside, -params.truncation, params.truncation))
        return cls(values.reshape(counts), origin, params.spacing).cropped()

    def cropped(self) -> "FusedVolume":
        """The part of the grid around what is solid."""
        solid = np.argwhere(self.values < 0.0)
        if not len(solid):
            raise _nothing_left()
        first = np.maximum(solid.min(axis=0) - _RIM, 0)
        last = np.minimum(solid.max(axis=0) + _RIM + 1, self.values.shape)
        kept = self.values[tuple(slice(*ends) for ends in zip(first, last, strict=True))]
        return FusedVolume(kept, self.origin + self.spacing * first, self.spacing)

    def distance(self, p_OQ: FloatArray) -> FloatArray:
        """Interpolated distances at points (n, 3), shape (n,), m."""
        places = ((p_OQ - self.origin) / self.spacing).T
        found: FloatArray = map_coordinates(self.values, places, order=1, mode="nearest")
        return found

    def surface(self, p_OQ: FloatArray) -> tuple[FloatArray, NDArray[np.int32]]:
        """The closed mesh of the zero level, its part that is seen: vertices (v, 3), m, and faces (f, 3).

        What lies outside of all images is solid, too, and may be larger.

        Args:
            p_OQ: points seen, shape (n, 3), m, most of which lie on that part.

        Raises:
            InvalidInputError: if there is none.
        """
        for smoothing in _SMOOTHINGS:
            smooth = gaussian_filter(self.values, smoothing, mode="nearest")
            vertices, faces = _zero_level(smooth, self.origin, self.spacing, p_OQ)
            # Coincident vertices count as one: an edge of four faces would not be watertight.
            if trimesh.Trimesh(vertices, faces).is_watertight:
                return vertices, faces
        raise InvalidInputError("FusionParams.spacing must be smaller for views whose surface touches itself.")


def _nothing_left() -> InvalidInputError:
    return InvalidInputError("views must leave something of the object, but the poses of the cameras do not fit.")


def _zero_level(
    values: FloatArray, origin: FloatArray, step: float, p_OQ: FloatArray
) -> tuple[FloatArray, NDArray[np.int32]]:
    """The mesh of the component nearest to most points (n, 3) of those in which values on a grid are negative."""
    corner = float(origin[0]), float(origin[1]), float(origin[2])
    inside = functools.partial(depth_inside, np.ascontiguousarray(values), corner, step)
    end = origin + step * (np.array(values.shape) - 1)
    parts = manifold3d.Manifold.level_set(inside, [*corner, *end.tolist()], step).decompose()
    if not parts:
        raise _nothing_left()
    meshes = [part.to_mesh64() for part in parts]
    vertices = [np.array(mesh.vert_properties[:, :3]) for mesh in meshes]
    owner = np.repeat(np.arange(len(parts)), [len(each) for each in vertices])
    most = int(np.bincount(owner[cKDTree(np.concatenate(vertices)).query(p_OQ)[1]]).argmax())
    return vertices[most], np.array(meshes[most].tri_verts, dtype=np.int32)
