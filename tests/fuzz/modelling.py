"""The fuzzer's target `ObjectModel.from_mesh`, with small meshes of trimesh."""

import warnings

import numpy as np
import trimesh

import tactopose_drake as tp
from tactopose_drake.core.mesh.repair import MeshRepairWarning
from tests.fuzz import touches
from tests.fuzz.targets import Arguments, Target, build


def mesh_arguments(rng: np.random.Generator) -> Arguments:
    size = touches.log_uniform(rng, 0.01, 0.2)
    shapes = {
        "box": lambda: trimesh.creation.box(rng.uniform(0.2, 1.0, 3)),
        "ball": lambda: trimesh.creation.icosphere(int(rng.integers(0, 3)), 0.5),
        "cylinder": lambda: trimesh.creation.cylinder(0.3, 1.0, sections=int(rng.integers(3, 20))),
        "cone": lambda: trimesh.creation.cone(0.3, 1.0, sections=int(rng.integers(3, 20))),
        "hull": lambda: trimesh.convex.convex_hull(rng.normal(scale=0.3, size=(12, 3))),
    }
    mesh = shapes[str(rng.choice(list(shapes)))]()
    vertices, faces = np.array(mesh.vertices) * size, np.array(mesh.faces)
    return {
        "mesh": {"vertices": vertices, "faces": faces},
        "name": touches.maybe(rng, 0.3, lambda: "thing"),
        "mass": touches.maybe(rng, 0.5, lambda: touches.log_uniform(rng, 0.01, 3.0)),
        "center_of_mass": touches.maybe(rng, 0.3, lambda: rng.normal(scale=0.01, size=3)),
        "symmetry": str(rng.choice(["auto", "none"])),
        "samples": int(rng.choice([100, 300])),
        "max_grid_bytes": int(rng.choice([2**16, 2**18])),
    }


def from_mesh(arguments: Arguments) -> None:
    given = dict(arguments)
    mesh = given.pop("mesh")
    if isinstance(mesh, dict):
        try:
            mesh = build(lambda vertices, faces: trimesh.Trimesh(vertices, faces, process=False), mesh)
            mesh = trimesh.Trimesh(np.array(mesh.vertices), np.array(mesh.faces), process=False)
        except Exception:
            return  # It is trimesh that refuses.
        if mesh.vertices.shape[1:] != (3,) or mesh.faces.shape[1:] != (3,):
            return  # No mesh of trimesh's, but attributes that it does not check.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MeshRepairWarning)
        model = tp.ObjectModel.from_mesh(mesh, **given, cache=False)
    numbers = [model.volume, model.mass, model.size, model.area]
    assert np.isfinite(numbers).all()
    assert min(numbers) > 0.0
    for array in (model.vertices, model.center_of_mass, model.inertia, model.samples.points, model.samples.normals):
        assert np.isfinite(array).all()


TARGETS = [Target(mesh_arguments, from_mesh, 0.3)]
