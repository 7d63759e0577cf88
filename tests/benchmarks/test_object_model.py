"""Time to build an object's model and to reload it, its memory, and the time of its parts.

`pytest -n 0 -s tests/benchmarks/test_object_model.py` prints them; --benchmark-json keeps them as extra_info. The first
compilation of the kernels is not in the times: each is called once before.
"""

import resource
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from tactopose_drake.core.mesh.loading import RawMesh
from tactopose_drake.core.mesh.repair import repair_mesh
from tactopose_drake.core.shape import model_cache
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.shape.signed_distance import build_grid
from tactopose_drake.core.shape.surface_samples import sample_surface
from tactopose_drake.core.shape.symmetry_detection import detect_symmetries
from tactopose_drake.core.shape.symmetry_judge import JudgedShape
from tactopose_drake.resources import model_path
from tests.core.meshes import arrays, create

MUG = model_path("objects", "mug.obj")  # some 15 000 faces


def memory(model: ObjectModel) -> int:
    """Bytes of all arrays."""
    grid, samples = model.grid, model.samples
    return sum(
        array.nbytes
        for array in (model.vertices, model.faces, grid.values, samples.points, samples.normals, model.symmetry_poses)
    )


def report(benchmark: Any, what: str, **figures: float) -> None:
    benchmark.extra_info.update(figures)
    text = ", ".join(f"{name} {value:.4g}" for name, value in figures.items())
    print(f"\n{what}: median {1e3 * benchmark.stats.stats.median:.1f} ms, {text}")  # noqa: T201


def test_build(benchmark: Any) -> None:
    model = benchmark.pedantic(ObjectModel.from_mesh, (MUG,), {"cache": False}, rounds=5, warmup_rounds=1)
    report(
        benchmark, "build", faces=len(model.faces), nodes=model.grid.values[..., 0].size, megabytes=memory(model) / 1e6
    )


def test_reload(benchmark: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(model_cache.FOLDER_VARIABLE, str(tmp_path))
    model = ObjectModel.from_mesh(MUG)
    benchmark.pedantic(ObjectModel.from_mesh, (MUG,), rounds=50)
    report(benchmark, "reload", faces=len(model.faces))


@pytest.mark.parametrize("faces", [81_920, 327_680])
def test_build_of_a_large_mesh(benchmark: Any, faces: int) -> None:
    mesh = create.icosphere({81_920: 6, 327_680: 7}[faces], 0.05).apply_scale([1.0, 0.8, 1.2])
    model = benchmark.pedantic(ObjectModel.from_mesh, (mesh,), {"cache": False}, rounds=2)
    report(benchmark, f"build of {faces} faces", megabytes=memory(model) / 1e6)


def test_repair(benchmark: Any) -> None:
    mesh = trimesh.load_mesh(MUG, process=False)
    raw = RawMesh(np.array(mesh.vertices), np.array(mesh.faces))
    benchmark(repair_mesh, raw, "mug")
    report(benchmark, "check and repair", faces=len(mesh.faces))


def test_grid(benchmark: Any) -> None:
    vertices, faces = arrays(trimesh.load_mesh(MUG))
    grid = benchmark.pedantic(build_grid, (vertices, faces), rounds=5, warmup_rounds=1)
    report(benchmark, "distance grid", nodes=grid.values[..., 0].size, spacing_mm=1e3 * grid.spacing)


def test_samples(benchmark: Any) -> None:
    vertices, faces = arrays(trimesh.load_mesh(MUG))
    benchmark.pedantic(sample_surface, (vertices, faces, 3000), rounds=5)
    report(benchmark, "3000 surface samples")


@pytest.mark.parametrize("shape", ["icosahedron", "box", "mug"])
def test_symmetries(benchmark: Any, shape: str) -> None:
    mesh = {
        "icosahedron": create.icosahedron().apply_scale(0.04),
        "box": create.box((0.05, 0.08, 0.12)),
        "mug": trimesh.load_mesh(MUG),
    }[shape]
    vertices, faces = arrays(mesh)
    properties = trimesh.triangles.mass_properties(vertices[faces])
    given = JudgedShape(
        sample_surface(vertices, faces, 3000),
        build_grid(vertices, faces),
        np.array(properties.center_mass),
        np.array(properties.inertia),
        float(np.linalg.norm(np.ptp(vertices, axis=0))),
    )
    found = benchmark.pedantic(detect_symmetries, (given,), rounds=5)
    report(benchmark, f"symmetries of the {shape}", axes=len(found))


@pytest.mark.parametrize("points", [100, 10_000])
def test_lookup(benchmark: Any, points: int) -> None:
    model = ObjectModel.from_mesh(MUG, cache=False)
    p_OQ = np.random.default_rng(0).uniform(model.grid.origin, model.grid.upper, (points, 3))
    benchmark(model.grid.distance_and_normal, p_OQ)
    report(benchmark, f"lookup of {points} points in plain numpy")


COLD = """
import time
from tactopose_drake.core.shape.object_model import ObjectModel
begin = time.perf_counter()
ObjectModel.from_mesh({path!r}, cache=False)
print(time.perf_counter() - begin)
"""


def test_first_build_with_compilation(benchmark: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))

    def build() -> float:
        command = [sys.executable, "-c", COLD.format(path=str(MUG))]
        return float(subprocess.run(command, capture_output=True, text=True, check=True).stdout)

    cold = benchmark.pedantic(build, rounds=1)
    compiled = build()
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e3
    report(benchmark, "first process", cold_s=cold, compiled_s=compiled, peak_megabytes=peak)
