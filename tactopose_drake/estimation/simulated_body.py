"""One body of an SDF, URDF or MJCF file: its collision shapes as one mesh, its mass and centre of mass."""

import warnings
from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh
from pydrake.geometry import Box, Capsule, Convex, Cylinder, Ellipsoid, Mesh, Role, SceneGraphInspector, Shape, Sphere
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex, RigidBody

from tactopose_drake.core.mesh.loading import RawMesh, load_mesh
from tactopose_drake.core.mesh.primitives import box_mesh, capsule_mesh, cylinder_mesh, sphere_mesh
from tactopose_drake.core.mesh.repair import MeshRepairWarning, repair_mesh
from tactopose_drake.core.validation import FloatArray, kind_name
from tactopose_drake.errors import InvalidFileError
from tactopose_drake.estimation.hull_vertices import hull_vertices
from tactopose_drake.resources import add_model, make_parser, passing_builder


class SimulatedBody(NamedTuple):
    """A body's shape in its own frame, its mass, kg, and centre of mass, shape (3,), m; None if it has no mass."""

    shape: trimesh.Trimesh
    mass: float | None
    center_of_mass: FloatArray | None


class BodyMass(NamedTuple):
    """A body's mass, kg, and centre of mass in its own frame, shape (3,), m; None if it has no mass."""

    mass: float | None
    center_of_mass: FloatArray | None


def read_body(path: Path) -> SimulatedBody:
    """Reads the only body of an SDF, URDF or MJCF file.

    Raises:
        InvalidFileError: if the file cannot be read, or holds more than one body or no shape with an inside.
        InvalidMeshError: if a mesh that is combined with other shapes cannot be repaired.
        MeshUnitsError: if such a mesh does not have the size of an object in metres.

    Warns:
        MeshRepairWarning: once for each repair of a mesh that is combined with other shapes; a single shape is returned
            as it is in the file.
    """
    with passing_builder() as builder:
        plant, scene_graph = AddMultibodyPlantSceneGraph(builder, plant=MultibodyPlant(time_step=0.001))
        instance = add_model(make_parser(plant), path)
        plant.Finalize()
        body = _only_body(path, plant, instance)
        shape = _union(path, plant, scene_graph.model_inspector(), body)
    return SimulatedBody(shape, *_mass_of(body))


def read_mass(path: Path) -> BodyMass:
    """Reads the mass of the only body of an SDF, URDF or MJCF file.

    Raises:
        InvalidFileError: if the file cannot be read, or holds more than one body.
    """
    plant = MultibodyPlant(time_step=0.001)
    instance = add_model(make_parser(plant), path)
    plant.Finalize()
    return _mass_of(_only_body(path, plant, instance))


def _only_body(path: Path, plant: MultibodyPlant, instance: ModelInstanceIndex) -> RigidBody:
    bodies = [plant.get_body(index) for index in plant.GetBodyIndices(instance)]
    if len(bodies) != 1:
        raise InvalidFileError(f"{path} must hold 1 link, not {len(bodies)}.")
    return bodies[0]


def _mass_of(body: RigidBody) -> BodyMass:
    mass = body.default_mass()
    return BodyMass(mass or None, body.default_com() if mass else None)


def _union(path: Path, plant: MultibodyPlant, inspector: SceneGraphInspector, body: RigidBody) -> trimesh.Trimesh:
    """The collision shapes of a body as one mesh, in the body's frame."""
    meshes = []
    for geometry in inspector.GetGeometries(plant.GetBodyFrameIdOrThrow(body.index()), Role.kProximity):
        mesh = _mesh(path, inspector.GetShape(geometry))
        mesh.apply_transform(inspector.GetPoseInFrame(geometry).GetAsMatrix4())
        meshes.append(mesh)
    if not meshes:
        raise InvalidFileError(f"{path} must have a collision shape, but has none.")
    if len(meshes) == 1:
        return meshes[0]
    united: trimesh.Trimesh = trimesh.boolean.union([_closed(path, mesh) for mesh in meshes], engine="manifold")
    return united


def _closed(path: Path, mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """A closed mesh, as the union needs it; in some files faces do not share vertices, which is repaired."""
    if mesh.is_volume:
        return mesh
    repaired = repair_mesh(RawMesh(mesh.vertices, mesh.faces), str(path))
    for repair in repaired.repairs:
        warnings.warn(f"{path.stem}: {repair}.", MeshRepairWarning, stacklevel=2)
    return trimesh.Trimesh(repaired.vertices, repaired.faces, process=False)


def _mesh(path: Path, shape: Shape) -> trimesh.Trimesh:
    if isinstance(shape, Box):
        return box_mesh(shape.size())
    if isinstance(shape, Cylinder):
        return cylinder_mesh(shape.radius(), shape.length())
    if isinstance(shape, Sphere):
        return sphere_mesh(shape.radius())
    if isinstance(shape, Capsule):
        return capsule_mesh(shape.radius(), shape.length())
    if isinstance(shape, Ellipsoid):
        ball = sphere_mesh(1.0)
        return trimesh.Trimesh(ball.vertices * [shape.a(), shape.b(), shape.c()], ball.faces, process=False)
    if isinstance(shape, Convex):
        of_hull: trimesh.Trimesh = trimesh.convex.convex_hull(hull_vertices(shape.GetConvexHull()))
        return of_hull
    if isinstance(shape, Mesh) and shape.source().is_path():
        raw, scale = load_mesh(shape.source().path()), shape.scale3()
        # A mirrored mesh is inside out: reverse its faces.
        faces = raw.faces if np.prod(scale) > 0.0 else raw.faces[:, ::-1]
        # Drake turns a glTF file's y axis up before it scales: (x, y, z) becomes (x, -z, y).
        vertices = raw.vertices[:, [0, 2, 1]] * [1.0, -1.0, 1.0] if shape.extension() == ".gltf" else raw.vertices
        return trimesh.Trimesh(vertices * scale, faces, process=False)
    raise InvalidFileError(f"{path} must have collision shapes with an inside, not {kind_name(type(shape))}.")
