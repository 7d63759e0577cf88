"""The geometries of a hand as coloured triangle meshes, for pictures."""

import dataclasses
from collections.abc import Sequence
from typing import Self

import numpy as np
import trimesh
from numpy.typing import NDArray
from pydrake.geometry import (
    Box,
    Capsule,
    Convex,
    Cylinder,
    Ellipsoid,
    IllustrationProperties,
    Mesh,
    Role,
    SceneGraphInspector,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, ModelInstanceIndex
from pydrake.systems.framework import Context

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.estimation.hull_vertices import hull_vertices

_GREY = (0.62, 0.64, 0.67)
READABLE_MESHES = (".obj", ".vtk", ".gltf")
"""Mesh formats of which Drake computes convex hulls."""


@dataclasses.dataclass(frozen=True, eq=False)
class Triangles:
    """A coloured triangle mesh in a frame F.

    Attributes:
        vertices: shape (v, 3), m.
        faces: vertex indices, shape (f, 3).
        colour: red, green, blue of each vertex, shape (v, 3), 0 to 1.
    """

    vertices: FloatArray
    faces: NDArray[np.int32]
    colour: FloatArray


def sphere_triangles(centers: FloatArray, radii: FloatArray) -> Triangles:
    """Grey spheres, such as those that fill a hand, from centres (n, 3) and radii (n,), m, in the centres' frame."""
    ball = trimesh.creation.icosphere(subdivisions=1)
    vertices = (centers[:, None] + radii[:, None, None] * ball.vertices).reshape(-1, 3)
    faces = ball.faces + len(ball.vertices) * np.arange(len(radii))[:, None, None]
    return Triangles(vertices, faces.reshape(-1, 3).astype(np.int32), np.tile(_GREY, (len(vertices), 1)))


@dataclasses.dataclass(frozen=True, eq=False)
class BodyMeshes:
    """Triangle meshes that are fixed on bodies of a plant.

    Attributes:
        body: index in the plant of each mesh's body B.
        meshes: the meshes, each in its body's frame.
    """

    body: tuple[int, ...]
    meshes: tuple[Triangles, ...]

    @classmethod
    def from_inspector(
        cls,
        plant: MultibodyPlant,
        inspector: SceneGraphInspector,
        *model_instances: ModelInstanceIndex,
        colliding: bool = False,
    ) -> Self:
        """The geometries of model instances.

        A body's illustration geometries are used; its proximity geometries if `colliding` is true, or if Drake can read
        none of the illustration geometries.
        """
        body, meshes = [], []
        for index in (index for instance in model_instances for index in plant.GetBodyIndices(instance)):
            frame = plant.GetBodyFrameIdOrThrow(index)
            shown, solid = (
                [(g, _mesh(inspector.GetShape(g))) for g in inspector.GetGeometries(frame, role)]
                for role in (Role.kIllustration, Role.kProximity)
            )
            use_shown = not colliding and any(mesh is not None for _, mesh in shown)
            for geometry, mesh in shown if use_shown else solid:
                if mesh is not None:
                    vertices = inspector.GetPoseInFrame(geometry).multiply(np.array(mesh.vertices).T).T
                    colour = np.tile(_diffuse(inspector.GetIllustrationProperties(geometry)), (len(vertices), 1))
                    body.append(int(index))
                    meshes.append(Triangles(vertices, np.array(mesh.faces, dtype=np.int32), colour))
        return cls(tuple(body), tuple(meshes))

    @classmethod
    def in_palm(
        cls, plant: MultibodyPlant, context: Context, palm_frame: Frame, *, colliding: bool = False
    ) -> Triangles:
        """The geometries of the palm's model instance, in P, at the joint positions of a plant's context.

        Raises:
            InvalidInputError: if the plant is not connected to a SceneGraph.
        """
        query_port = plant.get_geometry_query_input_port()
        if not query_port.HasValue(context):
            raise InvalidInputError(
                "context must be of a plant that is connected to a SceneGraph, which holds the hand's shapes."
            )
        inspector = query_port.Eval(context).inspector()
        meshes = cls.from_inspector(plant, inspector, palm_frame.model_instance(), colliding=colliding)
        X_PW = palm_frame.CalcPoseInWorld(context).inverse()
        X_WB = plant.get_body_poses_output_port().Eval(context)
        return meshes.merged([X_PW @ X for X in X_WB])

    def merged(self, X_FB: Sequence[RigidTransform]) -> Triangles:
        """All meshes as one mesh in F, given the poses of all bodies of the plant in F."""
        vertices, faces, colour = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.int32)], [np.zeros((0, 3))]
        start = 0
        for body, mesh in zip(self.body, self.meshes, strict=True):
            vertices.append(X_FB[body].multiply(mesh.vertices.T).T)
            faces.append(mesh.faces + np.int32(start))
            colour.append(mesh.colour)
            start += len(mesh.vertices)
        return Triangles(np.concatenate(vertices), np.concatenate(faces), np.concatenate(colour))


def _diffuse(properties: IllustrationProperties | None) -> tuple[float, float, float]:
    if properties is None or not properties.HasProperty("phong", "diffuse"):
        return _GREY
    rgba = properties.GetProperty("phong", "diffuse")
    return rgba.r(), rgba.g(), rgba.b()


def _mesh(shape: Shape) -> trimesh.Trimesh | None:
    """The shape's surface in its own frame; None for a half space or a mesh that Drake cannot read."""
    mesh: trimesh.Trimesh | None = None
    if isinstance(shape, Sphere):
        mesh = trimesh.creation.icosphere(subdivisions=3, radius=shape.radius())
    elif isinstance(shape, Capsule):
        mesh = trimesh.creation.capsule(height=shape.length(), radius=shape.radius(), count=[24, 24])
        mesh.apply_translation([0.0, 0.0, -mesh.bounds.mean(axis=0)[2]])
    elif isinstance(shape, Cylinder):
        mesh = trimesh.creation.cylinder(radius=shape.radius(), height=shape.length(), sections=48)
    elif isinstance(shape, Box):
        mesh = trimesh.creation.box(shape.size())
    elif isinstance(shape, Ellipsoid):
        mesh = trimesh.creation.icosphere(subdivisions=3)
        mesh.apply_scale([shape.a(), shape.b(), shape.c()])
    elif isinstance(shape, Mesh | Convex) and shape.extension() in READABLE_MESHES:
        mesh = trimesh.convex.convex_hull(hull_vertices(shape.GetConvexHull()))
    return mesh
