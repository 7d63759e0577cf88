"""What a model's file does not say of its shapes' contact, so that any hand can grasp in the simulator.

Hydroelastic contact needs a compliant shape on at least one side, and Drake takes a mesh for compliant only as a volume
mesh. Hands mostly come without a word of either, and with meshes.
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

from tactopose_drake.hand.thinned_hull import thinned_hull

_MODULUS = 3e7  # Pa: a hard rubber's, which gives way by a tenth of a millimetre
_FINEST, _COARSEST = 0.002, 0.006  # m, length of the facets that stand for a shape
_NEAREST_VERTICES = 5e-4  # of a hull, m
_VOLUME_MESHES = {".vtk"}


def make_compliant(plant: MultibodyPlant, scene_graph: SceneGraph, instance: ModelInstanceIndex) -> None:
    """Makes a hand's shapes compliant of which its file says neither that nor that they are rigid.

    A mesh without a volume becomes its convex hull, as which it counts everywhere else.
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
    """Keeps Drake from giving shapes friction and the like, for each that it gives some is faceted once more.

    It does so in the first context. Shapes whose overlaps are only measured need neither.
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
    """Makes an object's meshes rigid of which its file says neither that nor that they are compliant."""
    inspector, source = scene_graph.model_inspector(), plant.get_source_id()
    for geometry in list(_unsaid(plant, inspector, instance)):
        if isinstance(inspector.GetShape(geometry), Mesh):
            properties = _but_hydroelastic(inspector.GetProximityProperties(geometry))
            AddRigidHydroelasticProperties(_COARSEST, properties)
            scene_graph.AssignRole(source, geometry, properties, RoleAssign.kReplace)


def rigid_shapes(plant: MultibodyPlant, inspector: SceneGraphInspector, instance: ModelInstanceIndex) -> list[str]:
    """The shapes that a model's file calls rigid, each with the link that it is on."""
    return [
        f"{inspector.GetName(geometry).rpartition('::')[2]!r} of link {link!r}"
        for link, geometry in _shapes(plant, inspector, instance)
        if _says(inspector, geometry) and not _has(inspector, geometry, "hydroelastic_modulus")
    ]


def unsaid_shapes(plant: MultibodyPlant, inspector: SceneGraphInspector, instance: ModelInstanceIndex) -> list[str]:
    """The links with shapes of which a model's file says neither that they are rigid nor compliant, once a shape."""
    return [link for link, geometry in _shapes(plant, inspector, instance) if not _says(inspector, geometry)]


def self_collisions(plant: MultibodyPlant, context: Context, instance: ModelInstanceIndex) -> list[tuple[str, str]]:
    """Pairs of a model's links whose shapes overlap in a posture, by name.

    Args:
        plant: finalized plant in a diagram with its SceneGraph.
        context: its context in that diagram's.
        instance: the model.
    """
    return sorted({(a, b) for _, _, a, b in _overlaps(plant, context, instance)})


def let_overlap(plant: MultibodyPlant, scene_graph: SceneGraph, context: Context, instance: ModelInstanceIndex) -> None:
    """Lets those shapes of a model pass through each other that overlap in a posture: in truth they do not collide."""
    manager = scene_graph.collision_filter_manager()
    for a, b, _, _ in _overlaps(plant, context, instance):
        manager.Apply(CollisionFilterDeclaration().ExcludeWithin(GeometrySet([a, b])))


def _overlaps(
    plant: MultibodyPlant, context: Context, instance: ModelInstanceIndex
) -> list[tuple[GeometryId, GeometryId, str, str]]:
    query = plant.get_geometry_query_input_port().Eval(context)
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
    """What is said of a shape but for its hydroelastic properties."""
    properties = ProximityProperties(said)
    if properties.HasGroup("hydroelastic"):
        for name in list(properties.GetPropertiesInGroup("hydroelastic")):
            properties.RemoveProperty("hydroelastic", name)
    return properties


def _facet_length(shape: Shape) -> float:
    """As fine as a shape's roundness asks for, m."""
    if isinstance(shape, Sphere | Capsule | Cylinder):
        radius = float(shape.radius())
    elif isinstance(shape, Ellipsoid):
        radius = float(min(shape.a(), shape.b(), shape.c()))
    else:
        return _COARSEST
    return min(max(0.2 * radius, _FINEST), _COARSEST)
