"""The exact check of an object's poses against a hand's collision geometry.

Drake takes the convex hull of a mesh wherever it measures the distance between two shapes, and so fills a mug. Its
contact surfaces take the mesh as it is: between a rigid mesh and a compliant shape the contact surface is that part of
the mesh's surface that lies within the shape. How deep a point lies in a convex shape is a concave function of the
point, so over the whole object it is greatest either on that surface or at the shape's own deepest point, if that one
is in the object. The two together give the depth for thin walls and for solid bodies alike.
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from pydrake.common import MemoryFile
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddRigidHydroelasticProperties,
    Capsule,
    CollisionFilterDeclaration,
    ContactSurface,
    Convex,
    Cylinder,
    Ellipsoid,
    GeometryId,
    GeometrySet,
    HydroelasticContactRepresentation,
    InMemoryMesh,
    Mesh,
    ProximityProperties,
    QueryObject,
    Role,
    RoleAssign,
    SceneGraph,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import BodyIndex, RigidBody
from pydrake.systems.framework import Context, DiagramBuilder

from tactopose_drake.core.poses import inverse, transform_points
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray, finite_array
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.hand.geometry import BodySpheres
from tactopose_drake.hand.hand_config import HandConfig
from tactopose_drake.hand.hand_in_plant import Hand, add_fixed_hand
from tactopose_drake.hand.reading_ranges import ReadingRanges
from tactopose_drake.hand.shape_depth import ShapeDepth, shape_depth
from tactopose_drake.hand.thinned_hull import thinned_hull

# How far the facets that stand for a round shape may lie below it, m.
_FACET_ERROR = 5e-5


@dataclass(frozen=True, eq=False)
class Collisions:
    """How deep an object reaches into a hand, for each of B poses.

    Attributes:
        depth: the greatest depth of a point of the object below the surface of a shape of the hand, shape (B,), m; 0
            where the two do not touch. It ends at the depth of the shape itself, half its thickness.
        link: the link of the hand that the object reaches deepest into, B of them; None where it touches none.
    """

    depth: FloatArray
    link: tuple[str | None, ...]


@dataclass(frozen=True)
class _Solid:
    """A shape of the hand: the link that it is on, and the depth in it."""

    link: str
    depth: ShapeDepth


class _Deepest(NamedTuple):
    """One item of `Collisions`."""

    depth: float
    link: str | None


class HandCollision:
    """Checks poses of an object against a hand that is posed by its joints.

    Depths are exact up to 0.05 mm, by which the facets that stand for a round shape may lie below it; only where a wall
    that is thinner than the cells of the model's grid runs through the middle of a shape, the depth may come out short
    by about the wall's thickness. A mesh of the hand counts as its convex hull; planes are left out.
    """

    def __init__(self, hand: HandConfig, model: ObjectModel) -> None:
        """Builds a diagram of the hand and the object, in about half a second.

        Raises:
            InvalidInputError: if the hand has no collision geometry.
        """
        builder = DiagramBuilder()
        self._plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.001)
        self._hand = add_fixed_hand(self._plant, hand)
        self._object = _add_object(self._plant, model)
        self._plant.Finalize()
        self._ranges = ReadingRanges.of(self._plant)
        self._solids = _soften(self._plant, scene_graph, self._hand)
        if not self._solids:
            raise InvalidInputError(f"hand: {hand.model} has no collision geometry.")
        inspector = scene_graph.model_inspector()
        self._spheres = BodySpheres.from_inspector(self._plant, inspector, self._hand.model_instance)
        self._model, self._diagram = model, builder.Build()

    @property
    def num_positions(self) -> int:
        """The number of the hand's joint positions."""
        return int(self._plant.num_positions(self._hand.model_instance))

    def knows_all(self, q: FloatArray) -> bool:
        """Whether all readings of the hand's joints, shape (nq,), can be true: none is NaN or far beyond its limits."""
        every = np.zeros(self._plant.num_positions())
        self._plant.SetPositionsInArray(self._hand.model_instance, q, every)
        return bool(self._ranges.told(every).all())

    def make_scratch(self) -> Context:
        """What `check` works in; to be used by one thread at a time."""
        return self._diagram.CreateDefaultContext()

    def check(
        self, q: ArrayLike, X_PO: ArrayLike, *, enough: float = math.inf, scratch: Context | None = None
    ) -> Collisions:
        """Measures how deep the object reaches into the hand.

        Args:
            q: the hand's joint positions, in the order of a plant of the hand alone, shape (nq,), rad.
            X_PO: poses of the object, shape (B, 3, 4).
            enough: m; of a pose that is evidently deeper no more than that is found out, which saves time: its depth is
                then a lower bound above `enough`.
            scratch: of `make_scratch`; a new one is made otherwise, in about 20 ms.

        Raises:
            InvalidInputError: a number that is not finite, or a shape that does not fit.
        """
        q = finite_array("q", q, (self.num_positions,))
        X_PO = finite_array("X_PO", X_PO, (None, 3, 4))
        context = self._plant.GetMyMutableContextFromRoot(self.make_scratch() if scratch is None else scratch)
        self._plant.SetPositions(context, self._hand.model_instance, q)
        X_WP = self._hand.palm_frame.CalcPoseInWorld(context)
        evident, swallowed = self._evident(context, X_WP, X_PO), self._swallowed(context, X_WP, X_PO)
        found = []
        for i, X in enumerate(X_PO):
            if evident[i].depth <= enough:
                found.append(self._deepest(context, X_WP @ RigidTransform(X), swallowed[i]))
            else:
                found.append(evident[i])
        return Collisions(np.array([deepest.depth for deepest in found]), tuple(deepest.link for deepest in found))

    def _evident(self, context: Context, X_WP: RigidTransform, X_PO: FloatArray) -> list[_Deepest]:
        """A lower bound for each pose, from the distances of spheres within the hand to the object.

        Between its nodes the grid is off by no more than half of a cell's diagonal: distances change by no more than
        the way.
        """
        X_WB = self._plant.get_body_poses_output_port().Eval(context)
        p_PH = X_WP.inverse().multiply(self._spheres.positions(X_WB).T).T
        grid = self._model.grid
        distance = grid.distance(transform_points(inverse(X_PO), p_PH)) + 0.5 * math.sqrt(3.0) * grid.spacing
        depth = self._spheres.radius - np.maximum(distance, 0.0)
        at = depth.argmax(axis=1)
        links = [self._plant.get_body(BodyIndex(self._spheres.body[sphere])).name() for sphere in at]
        return [_Deepest(float(row[sphere]), link) for row, sphere, link in zip(depth, at, links, strict=True)]

    def _swallowed(self, context: Context, X_WP: RigidTransform, X_PO: FloatArray) -> list[list[_Solid]]:
        """For each pose the shapes whose deepest point is in the object."""
        query: QueryObject = self._plant.get_geometry_query_input_port().Eval(context)
        p_WD = np.array([query.GetPoseInWorld(g) @ solid.depth.deepest for g, solid in self._solids.items()])
        p_PD = X_WP.inverse().multiply(p_WD.T).T
        inside = self._model.grid.distance(transform_points(inverse(X_PO), p_PD)) < 0
        solids = list(self._solids.values())
        return [[solids[i] for i in np.flatnonzero(row)] for row in inside]

    def _deepest(self, context: Context, X_WO: RigidTransform, swallowed: list[_Solid]) -> _Deepest:
        """Of the object's pose X_WO, when these shapes' deepest points are in the object."""
        self._plant.SetFreeBodyPose(context, self._object, X_WO)
        query: QueryObject = self._plant.get_geometry_query_input_port().Eval(context)
        found = [_Deepest(solid.depth.at(solid.depth.deepest), solid.link) for solid in swallowed]
        for surface in query.ComputeContactSurfaces(HydroelasticContactRepresentation.kPolygon):
            geometry = surface.id_M() if surface.id_M() in self._solids else surface.id_N()
            solid = self._solids[geometry]
            p_GQ = query.GetPoseInWorld(geometry).inverse() @ _deepest_vertex(surface)
            found.append(_Deepest(max(0.0, solid.depth.at(p_GQ)), solid.link))
        return max(found, default=_Deepest(0.0, None), key=lambda deepest: deepest.depth)


def check_collisions(hand: HandConfig, model: ObjectModel, q: ArrayLike, X_PO: ArrayLike) -> Collisions:
    """`HandCollision.check` for once; to check more than once, keep a `HandCollision`."""
    return HandCollision(hand, model).check(q, X_PO)


def keep_clear(estimate: PoseEstimate, collisions: Collisions, tolerance: float) -> tuple[PoseEstimate, bool]:
    """The estimate without the hypotheses that collide.

    Where no other explains the touch, either the hand's shape, its joints or the touch is not what it seems; then all
    stay, and the status is "ambiguous". An estimate that explains nothing stays as it is.

    Args:
        estimate: of the poses that were checked.
        collisions: of its hypotheses.
        tolerance: the depth that is no collision yet, m: soft skin gives way, and poses have errors.

    Returns:
        The estimate, and whether it is clear of the hand.
    """
    clear = [bool(depth <= tolerance) for depth in collisions.depth]
    if estimate.status == "no_solution":
        return estimate, all(clear)
    if any(is_clear and h.explains_touch for is_clear, h in zip(clear, estimate.hypotheses, strict=True)):
        return estimate if all(clear) else estimate.keep(clear), True
    return replace(estimate, status="ambiguous"), False


def _deepest_vertex(surface: ContactSurface) -> FloatArray:
    """The vertex p_WQ of a contact surface that is deepest in the compliant shape: there its pressure is greatest."""
    mesh, pressure = surface.poly_mesh_W(), surface.poly_e_MN()
    p_WQ: FloatArray = mesh.vertex(max(range(mesh.num_vertices()), key=pressure.EvaluateAtVertex))
    return p_WQ


def _add_object(plant: MultibodyPlant, model: ObjectModel) -> RigidBody:
    """The object as a free body, rigid; its frame is O."""
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in model.vertices]
    lines += [f"f {a} {b} {c}" for a, b, c in model.faces + 1]
    mesh = Mesh(mesh_data=InMemoryMesh(mesh_file=MemoryFile("\n".join(lines), ".obj", model.name)), scale=1.0)
    body = plant.AddRigidBody("grasped_object", plant.AddModelInstance("grasped_object"))
    properties = ProximityProperties()
    AddRigidHydroelasticProperties(model.size, properties)
    plant.RegisterCollisionGeometry(body, RigidTransform(), mesh, "surface", properties)
    return body


def _soften(plant: MultibodyPlant, scene_graph: SceneGraph, hand: Hand) -> dict[GeometryId, _Solid]:
    """Makes the hand's shapes compliant, finely faceted and blind to each other; returns them."""
    inspector, source = scene_graph.model_inspector(), plant.get_source_id()
    solids: dict[GeometryId, _Solid] = {}
    for index in plant.GetBodyIndices(hand.model_instance):
        for geometry in inspector.GetGeometries(plant.GetBodyFrameIdOrThrow(index), Role.kProximity):
            shape = inspector.GetShape(geometry)
            depth = shape_depth(shape)
            if depth is None:
                scene_graph.RemoveRole(source, geometry, Role.kProximity)
                continue
            if isinstance(shape, Mesh | Convex):
                scene_graph.ChangeShape(source, geometry, thinned_hull(shape))
            properties = ProximityProperties()
            AddCompliantHydroelasticProperties(_facet_length(shape), 1.0, properties)
            scene_graph.AssignRole(source, geometry, properties, RoleAssign.kReplace)
            solids[geometry] = _Solid(plant.get_body(index).name(), depth)
    scene_graph.collision_filter_manager().Apply(CollisionFilterDeclaration().ExcludeWithin(GeometrySet(list(solids))))
    return solids


def _facet_length(shape: Shape) -> float:
    """The length of facets that lie no deeper than `_FACET_ERROR` below a round shape, m; any for a shape of planes."""
    if isinstance(shape, Sphere | Capsule | Cylinder):
        radius = shape.radius()
    elif isinstance(shape, Ellipsoid):
        radius = min(shape.a(), shape.b(), shape.c()) ** 2 / max(shape.a(), shape.b(), shape.c())
    else:
        radius = 1.0
    return math.sqrt(8.0 * radius * _FACET_ERROR)
