"""A simulated object of another size, with bumps, than its mesh says."""

import math

import numpy as np
from numpy.typing import NDArray
from pydrake.common import MemoryFile
from pydrake.geometry import InMemoryMesh, Mesh, ReadObjToTriangleSurfaceMesh, SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from tactopose_drake.core.validation import FloatArray
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
    """Makes an object's collision meshes larger, and puts smooth bumps on them; its mass stays.

    Args:
        plant: the simulator's plant, not finalized yet.
        scene_graph: its geometry.
        instance: the object.
        scale: by which it is larger, about its centre of mass.
        surface_sigma: root mean square height of the bumps, m.
        generator: where they are.

    Raises:
        InvalidInputError: if a collision shape is not a mesh of an OBJ file.
    """
    inspector = scene_graph.model_inspector()
    waves = _Waves(generator, surface_sigma)
    for body in map(plant.get_body, plant.GetBodyIndices(instance)):
        middle_O = body.default_spatial_inertia().get_com()
        for geometry in plant.GetCollisionGeometriesForBody(body):
            shape = inspector.GetShape(geometry)
            if not isinstance(shape, Mesh) or shape.extension() != ".obj" or not shape.source().is_path():
                raise InvalidInputError(
                    f"SimulatedErrors.object_scale, object_surface_sigma: the collision shape of {body.name()!r} is a "
                    f"{type(shape).__name__}; allowed are meshes of OBJ files."
                )
            X_OG = inspector.GetPoseInFrame(geometry)
            mesh = ReadObjToTriangleSurfaceMesh(shape.source().path())
            faces = np.array([[t.vertex(i) for i in range(3)] for t in mesh.triangles()])
            p_OV = X_OG.multiply(np.array(mesh.vertices()).T * np.asarray(shape.scale3())[:, None]).T
            p_OV = middle_O + scale * (p_OV - middle_O)
            p_OV = p_OV + waves.heights(p_OV)[:, None] * _normals(p_OV, faces)
            text = _obj(X_OG.inverse().multiply(p_OV.T).T, faces)
            source = InMemoryMesh(mesh_file=MemoryFile(text, ".obj", f"{body.name()}, as it is simulated"))
            scene_graph.ChangeShape(plant.get_source_id(), geometry, Mesh(source, 1.0))


class _Waves:
    """A smooth random height, of a root mean square: plane waves of one length, in random directions."""

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
    """Outward unit normals at the vertices, those of their faces weighted by area."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    normals = np.zeros_like(vertices)
    for i in range(3):
        np.add.at(normals, faces[:, i], np.cross(b - a, c - a))
    unit: FloatArray = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return unit


def _obj(vertices: FloatArray, faces: NDArray[np.int64]) -> str:
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices.tolist()]
    lines += [f"f {i} {j} {k}" for i, j, k in (faces + 1).tolist()]
    return "\n".join(lines) + "\n"
