"""The mesh of an object that is known only from some depth images, and an estimate of its error.

The images are fused into a truncated signed distance on a grid [C96], whose zero level is the surface. What no image
has seen is taken to be solid, up to where some image has seen through, and within the bounds that are known otherwise,
such as a table top: the backs of a reconstructed object are too large, rarely too small. The error of such a back is
estimated by leaving each image out in turn, and comparing with the one left out.

Sources: [C96] B. Curless and M. Levoy, A volumetric method for building complex models from range images, SIGGRAPH,
1996.
"""

import dataclasses
import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import manifold3d
import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial import cKDTree

from tactopose_drake.core.geometry_checks import pose_matrix
from tactopose_drake.core.number_kinds import entry_of
from tactopose_drake.core.parameter_checks import check_numbers, params_of
from tactopose_drake.core.poses import transform_points
from tactopose_drake.core.validation import FloatArray, instance_of, number_array
from tactopose_drake.core.vision.depth_pictures import DepthCameraModel, rays
from tactopose_drake.core.vision.level_set_kernels import depth_inside
from tactopose_drake.errors import InvalidInputError

_MOST_CELLS = 20_000_000
_LEAST_POINTS = 100
# Standard deviations of the smoothing of distances, in cells: against single pixels' noise, and, if the surface then
# touches itself, more.
_SMOOTHINGS = 1.0, 1.4, 2.0
_RIM = 6  # cells kept beyond what is solid
_BEYOND = 0.5  # how far unseen parts may extend beyond what is seen, as a share of its size


@dataclasses.dataclass(kw_only=True, slots=True)
class FusionParams:
    """The resolution of the fusion."""

    spacing: float = 0.002  # of the grid, m
    truncation: float = 0.006  # of distances, m: an image has no information deeper behind a surface

    def validate(self) -> None:
        """Raises InvalidInputError if a value is out of its range."""
        check_numbers("FusionParams", self)


@dataclass(frozen=True, eq=False)
class DepthView:
    """One depth image of an object at rest, with nothing else in it.

    Attributes:
        depth: shape (height, width), m, above 0; infinite where nothing is seen, so that the object is not there, and
            NaN where the camera has no answer.
        X_CO: pose of the frame that the object's mesh is to have, in the camera, shape (3, 4); a RigidTransform is
            taken too.
        camera: that took the image.

    Raises:
        InvalidInputError: an image of another size than the camera's, a depth of 0 or below, or an invalid pose.
    """

    depth: FloatArray
    X_CO: FloatArray
    camera: DepthCameraModel

    def __post_init__(self) -> None:
        instance_of("DepthView.camera", self.camera, DepthCameraModel)
        depth = number_array("DepthView.depth", self.depth, (self.camera.height, self.camera.width))
        wrong = np.argwhere(depth <= 0.0)
        if len(wrong):
            raise InvalidInputError(
                f"{entry_of('DepthView.depth', wrong[0])} must be a number > 0, infinity where nothing is seen, or NaN "
                f"where the camera has no answer, not {depth[tuple(wrong[0])]:g}."
            )
        object.__setattr__(self, "depth", depth)
        object.__setattr__(self, "X_CO", pose_matrix("DepthView.X_CO", self.X_CO))

    @property
    def p_OQ(self) -> FloatArray:
        """The points seen, in the object's frame, shape (n, 3), m."""
        seen = np.isfinite(self.depth)
        p_CQ = rays(self.camera)[seen] * self.depth[seen][:, None]
        points: FloatArray = (p_CQ - self.X_CO[:, 3]) @ self.X_CO[:, :3]
        return points

    def depth_behind(self, p_OQ: FloatArray) -> FloatArray:
        """Depth of the surface seen at the pixels of points (n, 3), minus that of the points, shape (n,), m.

        Infinite where nothing is seen, NaN outside the image and where the camera has no answer.
        """
        p_CQ = transform_points(self.X_CO, p_OQ)
        z = np.maximum(p_CQ[:, 2], 1e-6)
        column = np.floor(self.camera.focal_length * p_CQ[:, 0] / z + 0.5 * self.camera.width).astype(int)
        row = np.floor(self.camera.focal_length * p_CQ[:, 1] / z + 0.5 * self.camera.height).astype(int)
        inside = (column >= 0) & (column < self.camera.width) & (row >= 0) & (row < self.camera.height)
        behind = np.full(len(p_OQ), np.nan)
        behind[inside] = self.depth[row[inside], column[inside]] - p_CQ[inside, 2]
        return behind


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """The reconstructed object.

    Attributes:
        vertices: of a closed mesh, in the object's frame, shape (v, 3), m.
        faces: vertex indices, shape (f, 3).
        seen: whether each vertex lies on what some image has seen, shape (v,); the others close the mesh.
        seen_sigma: standard deviation of the seen part of the surface, along its normal, m.
        unseen_sigma: the same for the other part.
        unseen_share: share of the surface that is unseen.
    """

    vertices: FloatArray
    faces: NDArray[np.int32]
    seen: NDArray[np.bool_]
    seen_sigma: float
    unseen_sigma: float
    unseen_share: float

    @property
    def surface_sigma(self) -> float:
        """Rms error of the surface as a whole, for `ObjectModel`, m."""
        return math.hypot(
            math.sqrt(1.0 - self.unseen_share) * self.seen_sigma, math.sqrt(self.unseen_share) * self.unseen_sigma
        )


def reconstruct(
    views: Sequence[DepthView], bounds: FloatArray | None = None, params: FusionParams | None = None
) -> Reconstruction:
    """Reconstructs an object from some depth images.

    Args:
        views: two or more.
        bounds: lowest and highest coordinates that the object may have, in its frame, shape (2, 3), m, infinite if
            unknown: for example, it stands on a table. None if nothing is known.
        params: the resolution.

    Raises:
        InvalidInputError: fewer than two images, too few points, an object too large for the grid, or bounds that leave
            nothing of it.
    """
    params = params_of(FusionParams, params)
    if len(views) < 2:
        raise InvalidInputError(f"views must be at least 2, not {len(views)}.")
    box = _box(views, bounds, params)
    volume = _Volume.of(views, params, box)
    vertices, faces = volume.surface()
    seen = _is_seen(vertices, views, params)
    corners = vertices[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    unseen_share = float(np.average(1.0 - seen[faces].mean(axis=1), weights=area))
    off = np.concatenate([volume.distance(view.p_OQ) for view in views])
    # Errors common to an image do not show in how well its own points fit.
    seen_depths = [(view.camera, view.depth[np.isfinite(view.depth)]) for view in views]
    common = [
        math.sqrt(camera.common_share) * camera.depth_noise * np.median(depths) ** 2
        for camera, depths in seen_depths
        if len(depths)
    ]
    seen_sigma = math.hypot(_rms(off), float(np.mean(common)))
    return Reconstruction(
        vertices, faces, seen, seen_sigma, max(seen_sigma, _left_out_error(views, params, box)), unseen_share
    )


def _left_out_error(views: Sequence[DepthView], params: FusionParams, box: FloatArray) -> float:
    """Rms distance of the surface that images close without having seen it from what is seen, m.

    For each image left out, the vertices count that no other image has seen, and that this one sees, or sees through:
    given this image, their error is their distance from anything that is seen.
    """
    off, coarse = [np.zeros(0)], dataclasses.replace(params, spacing=2.0 * params.spacing)
    seen = cKDTree(np.concatenate([view.p_OQ for view in views]))
    for i, view in enumerate(views):
        others = [*views[:i], *views[i + 1 :]]
        vertices = _Volume.of(others, coarse, box).surface()[0]
        closing = vertices[~_is_seen(vertices, others, params)]
        judged = closing[view.depth_behind(closing) > -0.5 * params.truncation]
        off.append(np.asarray(seen.query(judged)[0]))
    return _rms(np.concatenate(off))


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def _is_seen(p_OQ: FloatArray, views: Sequence[DepthView], params: FusionParams) -> NDArray[np.bool_]:
    """Whether each of points (n, 3) lies on what some image has seen."""
    seen = np.zeros(len(p_OQ), dtype=np.bool_)
    for view in views:
        seen |= np.abs(view.depth_behind(p_OQ)) < 0.5 * params.truncation
    return seen


def _box(views: Sequence[DepthView], bounds: FloatArray | None, params: FusionParams) -> FloatArray:
    """Lowest and highest coordinates that the object may have, shape (2, 3), m."""
    points = np.concatenate([view.p_OQ for view in views])
    if len(points) < _LEAST_POINTS:
        raise InvalidInputError(f"views must see at least {_LEAST_POINTS} points, not {len(points)}.")
    size = np.ptp(points, axis=0).max()
    box = np.stack([points.min(axis=0) - _BEYOND * size, points.max(axis=0) + _BEYOND * size])
    if bounds is not None:
        lowest, highest = number_array("bounds", bounds, (2, 3))
        box = np.stack([np.maximum(box[0], lowest), np.minimum(box[1], highest)])
        if not np.all(box[0] < box[1]):  # Nor with a NaN.
            raise InvalidInputError(
                "bounds must be the lowest and the highest coordinates, m, of a box that contains seen points, not "
                f"{[lowest.tolist(), highest.tolist()]}."
            )
    if np.prod(np.ptp(box, axis=0) / params.spacing + 8) > _MOST_CELLS:
        raise InvalidInputError(
            f"FusionParams.spacing must be larger than {params.spacing:g} m for views that see {1e3 * size:.0f} mm."
        )
    return box


@dataclass(frozen=True, eq=False)
class _Volume:
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
    def of(cls, views: Sequence[DepthView], params: FusionParams, box: FloatArray) -> "_Volume":
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

    def cropped(self) -> "_Volume":
        """The part of the grid around what is solid."""
        solid = np.argwhere(self.values < 0.0)
        if not len(solid):
            raise _nothing_left()
        first = np.maximum(solid.min(axis=0) - _RIM, 0)
        last = np.minimum(solid.max(axis=0) + _RIM + 1, self.values.shape)
        kept = self.values[tuple(slice(*ends) for ends in zip(first, last, strict=True))]
        return _Volume(kept, self.origin + self.spacing * first, self.spacing)

    def distance(self, p_OQ: FloatArray) -> FloatArray:
        """Interpolated distances at points (n, 3), shape (n,), m."""
        places = ((p_OQ - self.origin) / self.spacing).T
        found: FloatArray = map_coordinates(self.values, places, order=1, mode="nearest")
        return found

    def surface(self) -> tuple[FloatArray, NDArray[np.int32]]:
        """The closed mesh of the zero level, its largest part: vertices (v, 3), m, and faces (f, 3).

        Raises:
            InvalidInputError: if there is none.
        """
        for smoothing in _SMOOTHINGS:
            smooth = gaussian_filter(self.values, smoothing, mode="nearest")
            vertices, faces = _zero_level(smooth, self.origin, self.spacing)
            # Coincident vertices count as one: an edge of four faces would not be watertight.
            if trimesh.Trimesh(vertices, faces).is_watertight:
                return vertices, faces
        raise InvalidInputError("FusionParams.spacing must be smaller for views whose surface touches itself.")


def _nothing_left() -> InvalidInputError:
    return InvalidInputError("views must leave something of the object, but the poses of the cameras do not fit.")


def _zero_level(values: FloatArray, origin: FloatArray, step: float) -> tuple[FloatArray, NDArray[np.int32]]:
    """The mesh of the largest component in which values on a grid are negative."""
    corner = float(origin[0]), float(origin[1]), float(origin[2])
    inside = functools.partial(depth_inside, np.ascontiguousarray(values), corner, step)
    end = origin + step * (np.array(values.shape) - 1)
    parts = manifold3d.Manifold.level_set(inside, [*corner, *end.tolist()], step).decompose()
    if not parts:
        raise _nothing_left()
    mesh = max(parts, key=lambda part: part.volume()).to_mesh64()
    return np.array(mesh.vert_properties[:, :3]), np.array(mesh.tri_verts, dtype=np.int32)
