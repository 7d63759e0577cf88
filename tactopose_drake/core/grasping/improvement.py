"""Where a finger should move to hold the object better: the grasp's quality after a move to points of the surface.

The other fingers stay; of the moved one only the friction cone matters. Whether the finger can get there is another
question, answered by its workspace. Source: [B16] J. Bimbo, thesis, 2016, section 6.2.2 and figure 6.3.
"""

import dataclasses
import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.hand_geometry import HandGeometry
from tactopose_drake.core.geometry_checks import pose_matrix
from tactopose_drake.core.grasping.finger_reach import FingerReach
from tactopose_drake.core.grasping.quality import grasp_quality
from tactopose_drake.core.grasping.wrench_space import WrenchSpace, cone_wrenches
from tactopose_drake.core.poses import transform_points
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray, whole_number


@dataclasses.dataclass(frozen=True, kw_only=True)
class ReachabilityParams:
    """What counts as reachable."""

    touches: int = 2000  # most touches of a finger that are searched for
    least_alignment: float = 0.5  # cosine of the angle between normals on one side of a wall


@dataclasses.dataclass(frozen=True, eq=False)
class ImprovementMap:
    """The quality of a grasp after one finger has moved; n points.

    Attributes:
        current: radius of the wrench space before the move, N.
        p_OQ: points of the surface that the finger may move to, shape (n, 3), m.
        n_OQ: outward normals there, shape (n, 3).
        radius: of the wrench space after the move, shape (n,), N.
    """

    current: float
    p_OQ: FloatArray
    n_OQ: FloatArray
    radius: FloatArray

    @property
    def level(self) -> FloatArray:
        """The change of quality, from -1 (no longer holds) over 0 (as good as now) to 1 (the best), shape (n,)."""
        gain = self.radius - self.current
        best, worst = max(gain.max(initial=0.0), 1e-12), max(self.current, 1e-12)
        level: FloatArray = np.where(gain > 0.0, gain / best, gain / worst)
        return level


def improvement_map(
    model: ObjectModel,
    contacts: Contacts,
    X_PO: object,
    finger: int,
    *,
    friction: float,
    edges: int = 8,
    points: int = 1000,
) -> ImprovementMap:
    """Evaluates the grasp with one finger moved to each of sampled points of the surface.

    Each point takes the convex hull of its wrench space, some milliseconds on one core; all cores are used.

    Args:
        model: the object.
        contacts: in the palm frame.
        X_PO: the object's pose in the palm, a RigidTransform or its matrix.
        finger: index of the contact that moves.
        friction: coefficient of friction.
        edges: of the pyramid that approximates a friction cone.
        points: number of points of the surface; no more than the model has samples.

    Raises:
        InvalidInputError: if `finger` or `points` is out of range, or `grasp_quality` rejects an input.
    """
    whole_number("finger", finger, least=0, most=len(contacts) - 1)
    whole_number("points", points, least=1, most=len(model.samples))
    now = grasp_quality(model, contacts, X_PO, friction=friction, edges=edges)
    some = np.linspace(0, len(model.samples) - 1, points).astype(np.intp)
    p_OQ, n_OQ = model.samples.points[some], model.samples.normals[some]
    moved = cone_wrenches(p_OQ - model.center_of_mass, n_OQ, friction, edges, now.length)
    others = np.delete(now.space.primitives, finger, axis=0)

    def radius(wrenches: FloatArray) -> float:
        return WrenchSpace(np.concatenate([others, wrenches[None]])).radius

    with ThreadPoolExecutor(os.cpu_count()) as executor:  # Qhull releases the interpreter lock.
        found = np.fromiter(executor.map(radius, moved), np.float64, points)
    return ImprovementMap(now.radius, p_OQ, n_OQ, found)


def reachable_points(
    finger: FingerReach,
    model: ObjectModel,
    X_PO: object,
    p_OQ: FloatArray,
    n_OQ: FloatArray,
    generator: np.random.Generator,
    *,
    others: HandGeometry | None = None,
    params: ReachabilityParams = ReachabilityParams(),
) -> NDArray[np.bool_]:
    """Which points of the surface a finger can touch with its tip.

    The finger's touches are found by inverse kinematics from samples of its workspace; a point is reachable if there is
    a touch nearer than the points' spacing, on the same side of the wall.

    Args:
        finger: the finger.
        model: the object.
        X_PO: its pose in the palm.
        p_OQ: points of the surface, shape (n, 3), m.
        n_OQ: outward normals there, shape (n, 3).
        generator: chooses among the workspace's samples.
        others: the rest of the hand, which the finger must stay clear of.
        params: what counts as reachable.

    Returns:
        Whether each point is reachable, shape (n,).
    """
    X = pose_matrix("X_PO", X_PO)
    touches = finger.touches(model.grid, X, generator, params.touches)
    clear = np.ones(len(touches), dtype=np.bool_)
    if others is not None and len(touches):
        clear = finger_clearance(finger, touches.q, others) > 0.0
    if not clear.any():
        return np.zeros(len(p_OQ), dtype=np.bool_)
    spacing = np.sqrt(model.area / len(p_OQ))
    near = cKDTree(touches.p_PC[clear]).query_ball_point(transform_points(X, p_OQ), spacing)
    n_PQ, n_PC = n_OQ @ X[:, :3].T, touches.n_PC[clear]
    least = params.least_alignment
    return np.array([bool(np.any(n_PC[rows] @ n > least)) for rows, n in zip(near, n_PQ, strict=True)])


def finger_clearance(finger: FingerReach, q: FloatArray, others: HandGeometry) -> FloatArray:
    """The least distance of a finger's last two links at joint positions (B, m) from other spheres, shape (B,), m.

    Earlier links hardly move from where they are fixed to the hand, and may touch it there.
    """
    geometry = finger.geometry
    last = geometry.on_last_links
    centres = np.concatenate([geometry.spheres(q)[:, last], geometry.tip(q)[:, None]], axis=1)
    radius = np.append(geometry.radius[last], geometry.tip_radius)
    gaps = [(cdist(at, others.p_PH) - others.radius).min(axis=1) - radius for at in centres]
    clearance: FloatArray = np.array(gaps).reshape(-1, len(radius)).min(axis=1)
    return clearance
