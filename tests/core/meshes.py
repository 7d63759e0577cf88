"""Meshes that several tests share, sound and broken, in metres."""

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from tactopose_drake.core.mesh.loading import RawMesh

SIZE = 0.06
create = trimesh.creation


def raw(mesh: trimesh.Trimesh) -> RawMesh:
    return RawMesh(np.array(mesh.vertices), np.array(mesh.faces, dtype=np.int64))


def arrays(mesh: trimesh.Trimesh) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    return np.array(mesh.vertices), np.array(mesh.faces, dtype=np.int32)


def cube(side: float = SIZE, at: ArrayLike = (0.0, 0.0, 0.0)) -> trimesh.Trimesh:
    return create.box((side, side, side), transform=trimesh.transformations.translation_matrix(at))


def die() -> trimesh.Trimesh:
    """A cube without symmetry: one of its sides has a dent."""
    mesh = cube().subdivide().subdivide().subdivide()
    dent = np.linalg.norm(mesh.vertices - [SIZE / 2, 0.008, 0.015], axis=1) < 0.01
    mesh.vertices[dent, 0] -= 0.004
    return mesh


def ball(radius: float = 0.04, subdivisions: int = 3) -> trimesh.Trimesh:
    return create.icosphere(subdivisions, radius)


def joined(*meshes: trimesh.Trimesh) -> trimesh.Trimesh:
    vertices, faces, offset = [], [], 0
    for mesh in meshes:
        vertices.append(mesh.vertices)
        faces.append(mesh.faces + offset)
        offset += len(mesh.vertices)
    return trimesh.Trimesh(np.concatenate(vertices), np.concatenate(faces), process=False)


def inside_out(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    return trimesh.Trimesh(mesh.vertices, mesh.faces[:, ::-1], process=False)


def without(mesh: trimesh.Trimesh, faces: NDArray[np.bool_]) -> trimesh.Trimesh:
    return trimesh.Trimesh(mesh.vertices, mesh.faces[~faces], process=False)


def random_pose(generator: np.random.Generator, reach: float = 0.1) -> NDArray[np.float64]:
    """A homogeneous matrix (4, 4)."""
    X = trimesh.transformations.random_rotation_matrix(generator.random(3))
    X[:3, 3] = generator.uniform(-reach, reach, 3)
    return np.array(X)


def smooth_shape() -> trimesh.Trimesh:
    """A smooth body without symmetry, some 10 cm long."""
    mesh = create.icosphere(subdivisions=5, radius=1.0)
    x, y, z = mesh.vertices.T
    mesh.vertices *= (0.04 * (1 + 0.2 * x + 0.15 * x * y + 0.1 * z**3))[:, None] * np.array([0.7, 1.0, 1.3])
    return mesh


def shape_poor_in_symmetry() -> trimesh.Trimesh:
    """Three overlapping boxes united: closed, concave, sharp, without symmetry."""
    return trimesh.boolean.union(
        [
            create.box((0.1, 0.04, 0.03)),
            create.box((0.03, 0.07, 0.05), transform=trimesh.transformations.translation_matrix((0.03, 0.03, 0.02))),
            create.box((0.02, 0.02, 0.09), transform=trimesh.transformations.translation_matrix((-0.035, -0.01, 0.03))),
        ],
        engine="manifold",
    )


def scanned_can(unevenness: float = 1.0) -> trimesh.Trimesh:
    """A can of 68 x 102 mm, off round by 1 to 2 % of its diameter times the unevenness, as photographs leave one."""
    profile = np.concatenate([[[0.0, -0.051]], [[0.034, z] for z in np.linspace(-0.051, 0.051, 25)], [[0.0, 0.051]]])
    mesh = create.revolve(profile, sections=96)
    x, y, z = mesh.vertices.T
    angle = np.arctan2(y, x)
    waves = 0.012 * np.sin(2 * angle + 0.7) + 0.01 * np.sin(3 * angle + 40.0 * z) + 0.006 * np.sin(5 * angle - 60.0 * z)
    mesh.vertices[:, :2] *= (1.0 + unevenness * waves - 0.4 * z)[:, None]  # a little narrower at its upper end
    return mesh
