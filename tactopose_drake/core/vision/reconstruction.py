"""The mesh of an object that is known only from some depth images, and an estimate of its error.

What no image has seen is taken to be solid, up to where some image has seen through, and within the bounds that are
known otherwise, such as a table top: the backs of a reconstructed object are too large, rarely too small. The error of
such a back is estimated by leaving each image out in turn, and comparing with the one left out.
"""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from tactopose_drake.core.mesh.bodies import face_areas
from tactopose_drake.core.parameter_checks import params_of
from tactopose_drake.core.validation import FloatArray, number_array
from tactopose_drake.core.vision.depth_fusion import FusedVolume, FusionParams
from tactopose_drake.core.vision.depth_view import DepthView
from tactopose_drake.errors import InvalidInputError

_MOST_CELLS = 20_000_000
_LEAST_POINTS = 100
_BEYOND = 0.5  # how far unseen parts may extend beyond what is seen, as a share of its size


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
    volume = FusedVolume.of(views, params, box)
    vertices, faces = volume.surface(np.concatenate([view.p_OQ for view in views]))
    seen = _is_seen(vertices, views, params)
    unseen_share = float(np.average(1.0 - seen[faces].mean(axis=1), weights=face_areas(vertices, faces)))
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
    p_OQ = np.concatenate([view.p_OQ for view in views])
    seen = cKDTree(p_OQ)
    for i, view in enumerate(views):
        others = [*views[:i], *views[i + 1 :]]
        vertices = FusedVolume.of(others, coarse, box).surface(p_OQ)[0]
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
