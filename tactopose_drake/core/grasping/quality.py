"""The quality of a grasp: which wrenches its contacts can resist, and with which certainty.

The contacts' forces act on the object's surface: each measured point is moved to the nearest point of the model's
surface at the given pose, and the friction cone is about the model's normal there, not the measured one. So contacts
without normals count too, noise does not tilt the cones, and the quality depends on the pose, which gives its
probability over a belief. A measured normal tells on which side of a thin wall the finger is: noise may have moved the
point nearer to the other side of a card or a glass. How far the points were moved is part of the result: contacts that
are millimetres off the surface are not contacts with the object at that pose.

Sources: [B16] J. Bimbo, thesis, 2016, sections 2.1 and 6.2.2. [FC92] C. Ferrari and J. Canny, Planning optimal grasps,
ICRA 1992. [P94] N. Pollard, Parallel methods for synthesizing whole-hand grasps from generalized prototypes, 1994
(object wrench space).
"""

import dataclasses
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.geometry_checks import pose_near
from tactopose_drake.core.grasping.wrench_space import Norm, WrenchSpace, cone_wrenches
from tactopose_drake.core.plain_values import ReadOnlyCopies, seal
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture, checked_mixture
from tactopose_drake.core.posterior.moved_origin import about_middle
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import (
    MOST_FRICTION,
    FloatArray,
    instance_of,
    known_name,
    limited,
    positive_number,
    whole_number,
)
from tactopose_drake.errors import InvalidInputError

# More edges or samples add no accuracy, and exhaust memory and time.
MOST_EDGES, MOST_SAMPLES = 64, 10**6
_MOST_TASK = 1e9  # largest component of a task wrench, N m and N
# How many times a point is moved along the normal by its distance: the first leaves an error from the grid and the
# surface's curvature.
_PROJECTIONS = 3
# Steps along a measured normal in which a point nearer to the other side of a wall is moved to its own side, m.
_STEPS_OUT = np.linspace(0.0, 0.005, 11)[1:]
_OPPOSED = -0.5  # cosine between two normals below which they belong to two sides
_PUSHED = 400  # approximate number of points of the surface that are pushed, which determines the time


@dataclasses.dataclass(frozen=True, eq=False)
class GraspQuality(ReadOnlyCopies):
    """The quality of one grasp; wrenches are about the centre of mass, in the axes of O, torques over `length`.

    Its arrays are read-only.

    Attributes:
        force_closure: whether any wrench can be resisted if the fingers press hard enough. This takes three contacts:
            point contacts cannot resist a torque about the line through two of them.
        radius: of the largest ball in the wrench space: the wrench that is resisted whatever its direction, N for each
            N of normal force; 0 without force closure. [FC92]
        task_scale: the largest multiple of the task's wrenches that is resisted; None without a task.
        space: the wrench space.
        length: by which torques are divided, m.
        p_OC: the contacts moved to the surface, shape (k, 3), m.
        n_OC: outward unit normals there, shape (k, 3).
        distance: of the measured points from the surface, negative inside, shape (k,), m.
    """

    force_closure: bool
    radius: float
    task_scale: float | None
    space: WrenchSpace
    length: float
    p_OC: FloatArray
    n_OC: FloatArray
    distance: FloatArray

    def __repr__(self) -> str:
        task = "" if self.task_scale is None else f", task_scale {self.task_scale:.3g}"
        return (
            f"<GraspQuality: {len(self.p_OC)} contacts, {'' if self.force_closure else 'no '}force closure, "
            f"radius {self.radius:.3g}{task}>"
        )

    @property
    def volume(self) -> float:
        """Volume of the wrench space, N^6; for the time it takes with the norm "Linf" see `WrenchSpace.volume`."""
        return self.space.volume


def grasp_quality(
    model: ObjectModel,
    contacts: Contacts,
    X_PO: object,
    *,
    friction: float,
    norm: Norm = "L1",
    edges: int = 8,
    length: float | None = None,
    task: ArrayLike | Literal["object"] | None = None,
) -> GraspQuality:
    """Evaluates the contacts as a grasp.

    Args:
        model: the object.
        contacts: in the palm frame; their points are used, and their normals, if known, for the side of a wall.
        X_PO: the object's pose in the palm, a RigidTransform or its matrix.
        friction: coefficient of friction.
        norm: how forces are bounded: "L1", the sum of the normal forces is 1 N; "Linf", each of them is.
        edges: of the pyramid inscribed into a friction cone.
        length: by which torques are divided, m; by default `lever`, the distance of the object's farthest point from
            its centre of mass.
        task: wrenches that disturb the object, about the centre of mass in the axes of P, shape (t, 6), torque first,
            N m and N; or "object": pushes of 1 N with this friction anywhere on its surface [P94].

    Raises:
        InvalidInputError: a friction below 0, fewer than 3 edges or more than 64, a length that is not positive, an
            X_PO that is invalid or farther away than 10 m, a task of another shape or of zeros only, or a value of
            another type.
        UnknownNameError: a norm that does not exist.
    """
    friction, length = _check(model, contacts, friction, edges, length, norm)
    X = pose_near("X_PO", X_PO)
    if isinstance(task, str):
        known_name("task", task, ["object"])
    elif task is not None:
        task = limited("task", task, (None, 6), most=_MOST_TASK)
        if not task.any():
            raise InvalidInputError("task must have at least one wrench that is not zero.")
    n_OQ = None if contacts.n_PC is None else contacts.n_PC @ X[:, :3]
    p_OC, n_OC, distance = on_surface(model, (contacts.p_PC - X[:, 3]) @ X[:, :3], n_OQ)
    space = WrenchSpace(cone_wrenches(p_OC - model.center_of_mass, n_OC, friction, edges, length), norm)
    scale = None
    if isinstance(task, str):
        scale = space.scale(object_wrenches(model, friction, edges, length))
    elif task is not None:
        wrenches = np.asarray(task).reshape(-1, 2, 3) @ X[:, :3]
        scale = space.scale((wrenches / [[length], [1.0]]).reshape(-1, 6))
    quality = GraspQuality(space.is_force_closure, space.radius, scale, space, length, p_OC, n_OC, distance)
    seal(quality)
    return quality


class ClosureProbability(NamedTuple):
    """The probability that a grasp has force closure.

    Attributes:
        value: share of the sampled poses with force closure.
        standard_error: of the value, due to the number of samples.
    """

    value: float
    standard_error: float


def force_closure_probability(
    model: ObjectModel,
    contacts: Contacts,
    belief: GaussianMixture,
    *,
    friction: float,
    edges: int = 8,
    samples: int = 500,
    seed: int = 0,
) -> ClosureProbability:
    """The probability that the grasp has force closure, over the belief about the object's pose.

    Args:
        model: the object.
        contacts: in the palm frame.
        belief: of the pose; `PoseEstimate.modes`, or `PoseBelief.mixture`.
        friction: coefficient of friction.
        edges: of the pyramid inscribed into a friction cone.
        samples: number of poses drawn from the belief.
        seed: of the random numbers.

    Raises:
        InvalidInputError: a friction or a seed below 0, fewer than 3 edges or more than 64, no sample or more than
            a million, a belief without a mode, or a value of another type.
    """
    friction, length = _check(model, contacts, friction, edges, None, "L1")
    model, belief = about_middle(model, checked_mixture("belief", belief))
    samples = whole_number("samples", samples, least=1, most=MOST_SAMPLES)
    seed = whole_number("seed", seed, least=0)
    X_PO = belief.sample(samples, np.random.default_rng(seed))
    p_OC = np.einsum("bkj,bji->bki", contacts.p_PC - X_PO[:, None, :, 3], X_PO[:, :, :3])
    n_OQ = None if contacts.n_PC is None else np.einsum("kj,bji->bki", contacts.n_PC, X_PO[:, :, :3])
    p_OC, n_OC, _ = on_surface(model, p_OC, n_OQ)
    primitives = cone_wrenches(p_OC - model.center_of_mass, n_OC, friction, edges, length)
    share = float(np.mean([WrenchSpace(wrenches).is_force_closure for wrenches in primitives]))
    return ClosureProbability(share, float(np.sqrt(share * (1.0 - share) / samples)))


def on_surface(
    model: ObjectModel, p_OQ: FloatArray, n_OQ: FloatArray | None = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The surface points nearest to given points, on the sides that normals show.

    Args:
        model: the object.
        p_OQ: points in O, shape (..., 3), m.
        n_OQ: measured outward unit normals, shape (..., 3), or None.

    Returns:
        Points (..., 3), m; outward normals there (..., 3); signed distances of the given points (...), m.
    """
    distance, normal = model.grid.distance_and_normal(p_OQ)
    p_OC, off = p_OQ, distance
    if n_OQ is not None:
        p_OC, off, normal = _on_felt_side(model, p_OQ, n_OQ, distance, normal)
    is_moved = np.any(p_OC != p_OQ, axis=-1)
    for _ in range(_PROJECTIONS):
        p_OC = p_OC - off[..., None] * normal
        off, found = model.grid.distance_and_normal(p_OC)
        # In a wall thinner than the grid's spacing the field's normals may belong to either side.
        normal = np.where(np.sum(found * normal, axis=-1, keepdims=True) > 0.0, found, normal)
    return p_OC, normal, np.where(is_moved, np.sum((p_OQ - p_OC) * normal, axis=-1), distance)


def _on_felt_side(
    model: ObjectModel, p_OQ: FloatArray, n_OQ: FloatArray, distance: FloatArray, normal: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Points, distances and normals; points nearer to the side opposite to their normal are moved out along it."""
    opposed = np.sum(n_OQ * normal, axis=-1) < _OPPOSED
    if not opposed.any():
        return p_OQ, distance, normal
    p_OS, distance, normal = p_OQ.copy(), distance.copy(), normal.copy()
    out = p_OQ[opposed][:, None] + _STEPS_OUT[:, None] * n_OQ[opposed][:, None]  # (o, steps, 3)
    off, found = model.grid.distance_and_normal(out)
    agrees = np.sum(found * n_OQ[opposed][:, None], axis=-1) > 0.0
    row, step = np.arange(len(out)), agrees.argmax(axis=1)
    there = agrees.any(axis=1)
    rows = tuple(axis[there] for axis in np.nonzero(opposed))
    p_OS[rows], distance[rows], normal[rows] = (each[row, step][there] for each in (out, off, found))
    return p_OS, distance, normal


def lever(model: ObjectModel) -> float:
    """The distance of the object's farthest point from its centre of mass, m: the longest lever arm of any force."""
    return float(np.linalg.norm(model.vertices - model.center_of_mass, axis=1).max())


def object_wrenches(model: ObjectModel, friction: float, edges: int, length: float) -> FloatArray:
    """Wrenches of pushes of 1 N on the surface, in the axes of O, shape (t, 6), torque over the length first, N.

    Args:
        model: the object.
        friction: coefficient of friction.
        edges: of the pyramid inscribed into a friction cone.
        length: by which torques are divided, m.
    """
    some = slice(None, None, max(1, len(model.samples) // _PUSHED))
    p_OQ, n_OQ = model.samples.points[some], model.samples.normals[some]
    return cone_wrenches(p_OQ - model.center_of_mass, n_OQ, friction, edges, length).reshape(-1, 6)


def _check(
    model: ObjectModel, contacts: Contacts, friction: float, edges: int, length: float | None, norm: str
) -> tuple[float, float]:
    """Checks all arguments; returns the friction and the length."""
    instance_of("model", model, ObjectModel)
    instance_of("contacts", contacts, Contacts)
    known_name("norm", norm, get_args(Norm))
    whole_number("edges", edges, least=3, most=MOST_EDGES)
    friction = positive_number("friction", friction, allow_zero=True, most=MOST_FRICTION)
    return friction, lever(model) if length is None else positive_number("length", length, least=1e-6, most=1e3)
