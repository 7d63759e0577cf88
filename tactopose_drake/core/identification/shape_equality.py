"""Whether two objects have the same shape, wherever their meshes lie in their frames: then no touch tells them apart.

Shapes that are equal have equal areas, volumes and moments of inertia. Of those, one is laid onto the other: points
spread over the first are taken for contacts with the second, the pair search finds the poses that explain them, and all
surface samples are compared there, the first object's with the second's surface and the other way round.
"""

import math
from dataclasses import dataclass

import numpy as np

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.poses import inverse, transform_points
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.searches.pair_search import PairSearch
from tactopose_drake.core.searches.touch_space import TouchSpace
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.shape.symmetry_judge import SymmetryDetectionParams
from tactopose_drake.core.validation import FloatArray


@dataclass(frozen=True, kw_only=True)
class ShapeEqualityParams:
    """What counts as equal, and how thoroughly an alignment is searched for."""

    # Of the 95th percentile of the distances from each one's samples to the other's surface, as a share of the size:
    # that of a symmetry.
    tolerance: float = SymmetryDetectionParams().tolerance
    outlier_factor: float = 3.0  # the farthest sample, in tolerances: a small handle makes another object
    # In tolerances: volumes and areas change by at most about this many times the relative change of a length, moments
    # by more.
    change_factor: float = 6.0
    probes: int = 16  # contacts that are searched with
    refined_points: int = 300  # contacts of the refinement after it
    refined_poses: int = 8  # of the poses that are found so many, the best ones
    sigma_normal: float = math.radians(5.0)  # of all these contacts, rad


def find_alignment(
    a: ObjectModel, b: ObjectModel, params: ShapeEqualityParams = ShapeEqualityParams()
) -> FloatArray | None:
    """The pose X_BA (3, 4) of the frame of object a in that of b at which the two coincide; None where none does.

    Args:
        a: an object.
        b: another.
        params: what counts as equal, and how thoroughly to search.
    """
    if not _are_alike(a, b, params):
        return None
    if a.content_hash == b.content_hash:
        return np.eye(3, 4)
    probes = _touch(a, params.probes, params)
    search, space, generator = PairSearch(model=b, contacts=probes), TouchSpace(b, probes), np.random.default_rng(0)
    found = search.minimize(SurfaceContact(b.grid, probes), space, generator)
    points = SurfaceContact(b.grid, _touch(a, params.refined_points, params))
    refined = LevenbergMarquardt().refine(points, found.X_PO[: params.refined_poses])
    for X_AB in refined.ranked().X_PO:
        X_BA = inverse(X_AB)
        if _lie_on(a.samples.points, X_BA, b, params) and _lie_on(b.samples.points, X_AB, a, params):
            return X_BA
    return None


def _touch(model: ObjectModel, count: int, params: ShapeEqualityParams) -> Contacts:
    """Samples of the surface, evenly spread, as contacts in the object's own frame."""
    chosen = np.linspace(0, len(model.samples), count, endpoint=False).astype(np.intp)
    points, normals = model.samples.points[chosen], model.samples.normals[chosen]
    sigma_position = np.full(len(points), params.tolerance * model.size)
    return Contacts(points, normals, sigma_normal=params.sigma_normal).with_arrays(sigma_position=sigma_position)


def _are_alike(a: ObjectModel, b: ObjectModel, params: ShapeEqualityParams) -> bool:
    """Whether what no motion changes is about equal."""
    first, second = (
        np.log([model.area, model.volume, *np.linalg.eigvalsh(model.inertia / model.mass)]) for model in (a, b)
    )
    return bool(np.abs(first - second).max() <= params.change_factor * params.tolerance)


def _lie_on(points: FloatArray, X: FloatArray, model: ObjectModel, params: ShapeEqualityParams) -> bool:
    """Whether points (n, 3), placed by X (3, 4), lie on a model's surface."""
    distance = np.abs(model.grid.distance(transform_points(X, points))) / model.size
    tolerance = params.tolerance
    return bool(np.quantile(distance, 0.95) <= tolerance and distance.max() <= params.outlier_factor * tolerance)
