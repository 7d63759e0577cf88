"""Contact properties that a model's file leaves unspecified, so that any hand can grasp in the simulator.

Hydroelastic contact needs a compliant shape on at least one side, and Drake supports compliant meshes only as volume
meshes. Models of hands mostly specify neither, and consist of surface meshes.
"""

from collections.abc import Iterator

from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddRigidHydroelasticProperties,
    Capsule,
    CollisionFilterDeclaration,
    Cylinder,
    DefaultProximityProperties,
    Ellipsoid,
    GeometryId,
    GeometrySet,
    Mesh,
    ProximityProperties,
    Role,
    RoleAssign,
    SceneGraph,
    SceneGraphConfig,
    SceneGraphInspector,
    Shape,
    Sphere,
)
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Context

from tactopose_drake.core.validation import instance_of
from tactopose_drake.hand.geometry_query import geometry_query
from tactopose_drake.hand.thinned_hull import thinned_hull

_MODULUS = 3e7  # Pa, of a hard rubber that is deformed by a tenth of a millimetre
_FINEST, _COARSEST = 0.002, 0.006  # m, length of the facets that approximate a shape
_NEAREST_VERTICES = 5e-4  # least distance between vertices of a hull, m
_VOLUME_MESHES = {".vtk"}


def make_compliant(plant: MultibodyPlant, scene_graph: SceneGraph, instance: ModelInstanceIndex) -> None:
    """Makes those shapes of a hand compliant that its file declares neither compliant nor rigid.

    A surface mesh is replaced by its convex hull, which also represents it elsewhere in this package.
    """
    inspector, source = scene_graph.model_inspector(), plant.get_source_id()
    for geometry in list(_unsaid(plant, inspector, instance)):
        shape = inspector.GetShape(geometry)
        properties = _but_hydroelastic(inspector.GetProximityProperties(geometry))
        AddCompliantHydroelasticProperties(_facet_length(shape), _MODULUS, properties)
        scene_graph.AssignRole(source, geometry, properties, RoleAssign.kReplace)
        if isinstance(shape, Mesh) and shape.extension() not in _VOLUME_MESHES:
            scene_graph.ChangeShape(source, geometry, thinned_hull(shape, _NEAREST_VERTICES))


def leave_friction_out(scene_graph: SceneGraph) -> None:
    """Keeps Drake from assigning default proximity properties, which costs time: each such shape is faceted again.

    Drake does so when the first context is created. Shapes that are only checked for overlaps need no such properties.
    """
    none = DefaultProximityProperties(
        hydroelastic_modulus=None,
        resolution_hint=None,
        dynamic_friction=None,
        static_friction=None,
        hunt_crossley_dissipation=None,
        relaxation_time=None,
        point_stiffness=None,
    )
    scene_graph.set_config(SceneGraphConfig(default_proximity_properties=none))


def make_meshes_rigid(plant: MultibodyPlant, scene_graph: SceneGraph, instance: ModelInstanceIndex) -> None:
    """Makes those meshes of an object rigid that its file declares neither rigid nor compliant."""
    inspector, source = scene_graph.model_inspector(), plant.get_source_id()
    for geometry in list(_unsaid(plant, inspector, instance)):
        if isinstance(inspector.GetShape(geometry), Mesh):
            properties = _but_hydroelastic(inspector.GetProximityProperties(geometry))
            AddRigidHydroelasticProperties(_COARSEST, properties)
            scene_graph.AssignRole(source, geometry, properties, RoleAssign.kReplace)


def rigid_shapes(plant: MultibodyPlant, inspector: SceneGraphInspector, instance: ModelInstanceIndex) -> list[str]:
    """The shapes that a model's file declares rigid, each with its link, as text."""
    return [
        f"{inspector.GetName(geometry).rpartition('::')[2]!r} of link {link!r}"
        for link, geometry in _shapes(plant, inspector, instance)
        if _says(inspector, geometry) and not _has(inspector, geometry, "hydroelastic_modulus")
    ]


def unsaid_shapes(plant: MultibodyPlant, inspector: SceneGraphInspector, instance: ModelInstanceIndex) -> list[str]:
    """The link of each shape that a model's file declares neither rigid nor compliant."""
    return [link for link, geometry in _shapes(plant, inspector, instance) if not _says(inspector, geometry)]


def self_collisions(plant: MultibodyPlant, context: Context, instance: ModelInstanceIndex) -> list[tuple[str, str]]:
    """Names of the pairs of a model's links whose shapes overlap at the context's joint positions.

    Args:
        plant: finalized plant in a diagram with its SceneGraph.
        context: the plant's context in that diagram.
        instance: the model.
    """
    return sorted({(a, b) for _, _, a, b in _overlaps(plant, context, instance)})


def let_overlap(plant: MultibodyPlant, scene_graph: SceneGraph, context: Context, instance: ModelInstanceIndex) -> None:
    """Filters collisions between shapes of a model that overlap in the context's posture, as real links do not.

    Raises:
        InvalidInputError: if an argument has a wrong type, or the context is not the plant's in a diagram with its
            SceneGraph.
    """
    instance_of("plant", plant, MultibodyPlant)
    instance_of("scene_graph", scene_graph, SceneGraph)
    instance_of("context", context, Context)
    instance_of("instance", instance, ModelInstanceIndex)
    manager = scene_graph.collision_filter_manager()
    for a, b, _, _ in _overlaps(plant, context, instance):
        manager.Apply(CollisionFilterDeclaration().ExcludeWithin(GeometrySet([a, b])))


def _overlaps(
    plant: MultibodyPlant, context: Context, instance: ModelInstanceIndex
) -> list[tuple[GeometryId, GeometryId, str, str]]:
    query = geometry_query(plant, context)
    link_of = {geometry: link for link, geometry in _shapes(plant, query.inspector(), instance)}
    found = []
    for pair in query.ComputePointPairPenetration():
        if pair.id_A in link_of and pair.id_B in link_of:
            a, b = sorted((link_of[pair.id_A], link_of[pair.id_B]))
            found.append((pair.id_A, pair.id_B, a, b))
    return found


def _shapes(
    plant: MultibodyPlant, inspector: SceneGraphInspector, instance: ModelInstanceIndex
) -> Iterator[tuple[str, GeometryId]]:
    """A model's collision shapes, each with its link's name."""
    for index in plant.GetBodyIndices(instance):
        for geometry in inspector.GetGeometries(plant.GetBodyFrameIdOrThrow(index), Role.kProximity):
            yield plant.get_body(index).name(), geometry


def _unsaid(
    plant: MultibodyPlant, inspector: SceneGraphInspector, instance: ModelInstanceIndex
) -> Iterator[GeometryId]:
    for _, geometry in _shapes(plant, inspector, instance):
        if not _says(inspector, geometry):
            yield geometry


def _says(inspector: SceneGraphInspector, geometry: GeometryId) -> bool:
    return _has(inspector, geometry, "compliance_type")


def _has(inspector: SceneGraphInspector, geometry: GeometryId, name: str) -> bool:
    return bool(inspector.GetProximityProperties(geometry).HasProperty("hydroelastic", name))


def _but_hydroelastic(said: ProximityProperties) -> ProximityProperties:
    """A copy of a shape's properties without the hydroelastic ones."""
    properties = ProximityProperties(said)
    if properties.HasGroup("hydroelastic"):
        for name in list(properties.GetPropertiesInGroup("hydroelastic")):
            properties.RemoveProperty("hydroelastic", name)
    return properties


def _facet_length(shape: Shape) -> float:
    """Facet length that suits a shape's radius of curvature, m."""
    if isinstance(shape, Sphere | Capsule | Cylinder):
        radius = float(shape.radius())
    elif isinstance(shape, Ellipsoid):
        radius = float(min(shape.a(), shape.b(), shape.c()))
    else:
        return _COARSEST
    return min(max(0.2 * radius, _FINEST), _COARSEST)
