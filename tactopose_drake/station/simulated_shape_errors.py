"""Shape errors of a simulated object: a scale and bumps that its mesh does not have."""

import math

import numpy as np
from numpy.typing import NDArray
from pydrake.common import MemoryFile
from pydrake.geometry import InMemoryMesh, Mesh, ReadObjToTriangleSurfaceMesh, SceneGraph, Shape
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from tactopose_drake.core.validation import FloatArray, kind_name
from tactopose_drake.errors import InvalidInputError

_WAVES = 40
_BUMP_LENGTH = 0.03  # m, from one bump to the next


def change_object(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    instance: ModelInstanceIndex,
    scale: float,
    surface_sigma: float,
    generator: np.random.Generator,
) -> None:
    """Scales an object's collision and visual meshes and adds smooth bumps to them; its mass stays.

    Args:
        plant: the simulator's plant, not finalized yet.
        scene_graph: its SceneGraph.
        instance: the object.
        scale: scale about its centre of mass.
        surface_sigma: root mean square height of the bumps, m; visual meshes have them only if they are OBJ files.
        generator: draws the places of the bumps.

    Raises:
        InvalidInputError: if a collision shape is not a mesh of an OBJ file.
    """
    inspector, source_id = scene_graph.model_inspector(), plant.get_source_id()
    waves = _Waves(generator, surface_sigma)
    for body in map(plant.get_body, plant.GetBodyIndices(instance)):
        middle_O = body.default_spatial_inertia().get_com()
        colliding = plant.GetCollisionGeometriesForBody(body)
        for geometry in [*colliding, *plant.GetVisualGeometriesForBody(body)]:
            shape, X_OG = inspector.GetShape(geometry), inspector.GetPoseInFrame(geometry)
            if _is_obj(shape):
                scene_graph.ChangeShape(source_id, geometry, _other_mesh(shape, X_OG, middle_O, scale, waves))
            elif geometry in colliding:
                raise InvalidInputError(
                    f"SimulatedErrors.object_scale, object_surface_sigma: the collision shape of {body.name()!r} must "
                    f"be the mesh of an OBJ file, not {kind_name(type(shape))}."
                )
            elif isinstance(shape, Mesh):
                p_OG = middle_O + scale * (X_OG.translation() - middle_O)
                larger = Mesh(shape.source(), scale * np.asarray(shape.scale3()))
                scene_graph.ChangeShape(source_id, geometry, larger, RigidTransform(X_OG.rotation(), p_OG))


def _is_obj(shape: Shape) -> bool:
    return isinstance(shape, Mesh) and shape.extension() == ".obj" and shape.source().is_path()


def _other_mesh(shape: Mesh, X_OG: RigidTransform, middle_O: FloatArray, scale: float, waves: "_Waves") -> Mesh:
    """The mesh of an OBJ file, in its own frame, scaled about a point of the object and with bumps."""
    mesh = ReadObjToTriangleSurfaceMesh(shape.source().path())
    faces = np.array([[t.vertex(i) for i in range(3)] for t in mesh.triangles()])
    p_OV = X_OG.multiply(np.array(mesh.vertices()).T * np.asarray(shape.scale3())[:, None]).T
    p_OV = middle_O + scale * (p_OV - middle_O)
    p_OV = p_OV + waves.heights(p_OV)[:, None] * _normals(p_OV, faces)
    text = _obj(X_OG.inverse().multiply(p_OV.T).T, faces)
    name = f"{shape.source().path().name}, as it is simulated"
    return Mesh(InMemoryMesh(mesh_file=MemoryFile(text, ".obj", name)), 1.0)


class _Waves:
    """A smooth random height field with a given rms: plane waves of one wavelength in random directions."""

    def __init__(self, generator: np.random.Generator, sigma: float) -> None:
        directions = generator.normal(size=(_WAVES, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        self._vectors = 2.0 * math.pi / _BUMP_LENGTH * directions
        self._phases = generator.uniform(0.0, 2.0 * math.pi, size=_WAVES)
        self._height = sigma * math.sqrt(2.0 / _WAVES)

    def heights(self, points: FloatArray) -> FloatArray:
        heights: FloatArray = self._height * np.cos(points @ self._vectors.T + self._phases).sum(axis=1)
        return heights


def _normals(vertices: FloatArray, faces: NDArray[np.int64]) -> FloatArray:
    """Outward unit normals at the vertices: area-weighted means of the adjacent faces' normals."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    normals = np.zeros_like(vertices)
    for i in range(3):
        np.add.at(normals, faces[:, i], np.cross(b - a, c - a))
    unit: FloatArray = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return unit


def _obj(vertices: FloatArray, faces: NDArray[np.int64]) -> str:
    """The text of an OBJ file with normals, which renderers need."""
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices.tolist()]
    lines += [f"vn {x:.6g} {y:.6g} {z:.6g}" for x, y, z in _normals(vertices, faces).tolist()]
    lines += [f"f {i}//{i} {j}//{j} {k}//{k}" for i, j, k in (faces + 1).tolist()]
    return "\n".join(lines) + "\n"
