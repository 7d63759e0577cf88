"""Whether two objects have the same shape, wherever their meshes lie in their frames: then no touch tells them apart.

Shapes that are equal have equal areas, volumes and moments of inertia. Of those, one is laid onto the other: points
spread over the first are taken for contacts with the second, the pair search finds the poses that explain them, and all
surface samples are compared there, the first object's with the second's surface and the other way round.
"""

import numpy as np

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.poses import inverse, transform_points
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.searches.pair_search import PairSearch
from tactopose_drake.core.searches.touch_space import TouchSpace
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.shape.symmetry_detection import TOLERANCE
from tactopose_drake.core.validation import FloatArray

# Contacts that are searched with; points and poses of the refinement after it.
_PROBES, _POINTS, _POSES = 16, 300, 8
_SIGMA_NORMAL = np.radians(5.0)
# Volumes and areas change by at most about this many times the relative change of a length; moments by more.
_CHANGE = 6.0
# The farthest sample, in tolerances: a small handle makes another object.
_OUTLIER_FACTOR = 3.0


def find_alignment(a: ObjectModel, b: ObjectModel, tolerance: float = TOLERANCE) -> FloatArray | None:
    """The pose X_BA (3, 4) of the frame of object a in that of b at which the two coincide; None where none does.

    Args:
        a: an object.
        b: another.
        tolerance: the 95th percentile of the distances from each one's samples to the other's surface, as a share of
            the size; the farthest sample may be three times as far.
    """
    if not _are_alike(a, b, tolerance):
        return None
    if a.content_hash == b.content_hash:
        return np.eye(3, 4)
    probes = _touch(a, _PROBES, tolerance)
    search, space, generator = PairSearch(model=b, contacts=probes), TouchSpace(b, probes), np.random.default_rng(0)
    found = search.minimize(SurfaceContact(b.grid, probes), space, generator)
    refined = LevenbergMarquardt().refine(SurfaceContact(b.grid, _touch(a, _POINTS, tolerance)), found.X_PO[:_POSES])
    for X_AB in refined.ranked().X_PO:
        X_BA = inverse(X_AB)
        if _lie_on(a.samples.points, X_BA, b, tolerance) and _lie_on(b.samples.points, X_AB, a, tolerance):
            return X_BA
    return None


def _touch(model: ObjectModel, count: int, tolerance: float) -> Contacts:
    """Samples of the surface, evenly spread, as contacts in the object's own frame."""
    chosen = np.linspace(0, len(model.samples), count, endpoint=False).astype(np.intp)
    points, normals = model.samples.points[chosen], model.samples.normals[chosen]
    return Contacts(points, normals, sigma_position=tolerance * model.size, sigma_normal=_SIGMA_NORMAL)


def _are_alike(a: ObjectModel, b: ObjectModel, tolerance: float) -> bool:
    """Whether what no motion changes is about equal."""
    first, second = (
        np.log([model.area, model.volume, *np.linalg.eigvalsh(model.inertia / model.mass)]) for model in (a, b)
    )
    return bool(np.abs(first - second).max() <= _CHANGE * tolerance)


def _lie_on(points: FloatArray, X: FloatArray, model: ObjectModel, tolerance: float) -> bool:
    """Whether points (n, 3), placed by X (3, 4), lie on a model's surface."""
    distance = np.abs(model.grid.distance(transform_points(X, points))) / model.size
    return bool(np.quantile(distance, 0.95) <= tolerance and distance.max() <= _OUTLIER_FACTOR * tolerance)
