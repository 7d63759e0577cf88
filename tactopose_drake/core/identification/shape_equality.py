"""Tests whether two objects have the same shape in different frames, so that no touch tells them apart.

Equal shapes have equal areas, volumes and moments of inertia. If these agree, the objects are aligned: points spread
over the first are taken for contacts with the second, the pair search finds the poses that explain them, the best of
these are refined with more points, and there all surface samples of each object are compared with the surface of the
other.
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

    # On the 95th percentile of the distances of each one's samples from the other's surface, as a share of the size;
    # the same as for symmetries.
    tolerance: float = SymmetryDetectionParams().tolerance
    outlier_factor: float = 3.0  # on the largest distance, in tolerances: a small handle makes another object
    # In tolerances: volumes and areas change by at most about this multiple of the relative change of a length, moments
    # by more.
    change_factor: float = 6.0
    probes: int = 16  # contacts in the search
    refined_points: int = 1000  # contacts in the refinement, some of them on each part that makes another object
    refined_poses: int = 128  # most poses that are refined, the best ones
    sigma_normal: float = math.radians(5.0)  # of all these contacts, rad


def find_alignment(
    a: ObjectModel, b: ObjectModel, params: ShapeEqualityParams = ShapeEqualityParams()
) -> FloatArray | None:
    """Finds the pose X_BA (3, 4) of the frame of object a in that of b at which the two coincide; None if none does.

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
    # Few probes, or none, lie on a small part that breaks a symmetry: more points tell which poses are the best.
    best = np.argsort(points.cost(found.X_PO), kind="stable")[: params.refined_poses]
    refined = LevenbergMarquardt().refine(points, found.X_PO[best])
    for X_AB in refined.ranked().X_PO:
        X_BA = inverse(X_AB)
        if _lie_on(a.samples.points, X_BA, b, params) and _lie_on(b.samples.points, X_AB, a, params):
            return X_BA
    return None


def _touch(model: ObjectModel, count: int, params: ShapeEqualityParams) -> Contacts:
    """Evenly spread surface samples as contacts in the object's own frame."""
    some, sigma_position = model.samples.thinned(count), np.full(count, params.tolerance * model.size)
    return Contacts(some.points, some.normals, sigma_normal=params.sigma_normal).with_arrays(
        sigma_position=sigma_position
    )


def _are_alike(a: ObjectModel, b: ObjectModel, params: ShapeEqualityParams) -> bool:
    """Whether the invariants of rigid motion agree: area, volume and principal moments."""
    first, second = (
        np.log([model.area, model.volume, *np.linalg.eigvalsh(model.inertia / model.mass)]) for model in (a, b)
    )
    return bool(np.abs(first - second).max() <= params.change_factor * params.tolerance)


def _lie_on(points: FloatArray, X: FloatArray, model: ObjectModel, params: ShapeEqualityParams) -> bool:
    """Whether points (n, 3), placed by X (3, 4), lie on a model's surface."""
    distance = np.abs(model.grid.distance(transform_points(X, points))) / model.size
    tolerance = params.tolerance
    return bool(np.quantile(distance, 0.95) <= tolerance and distance.max() <= params.outlier_factor * tolerance)
