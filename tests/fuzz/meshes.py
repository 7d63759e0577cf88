"""Kinds of the fuzzer: damaged mesh files, whole models of them, and damaged caches.

`repairs` loads and repairs, thousands a minute; `models` goes on to the distance grid, symmetries and samples; `caches`
loads a model whose file in the cache was damaged, and wants the same model as without.
"""

import contextlib
import functools
import os
import resource
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from unittest import mock

import numpy as np
import trimesh

from tactopose_drake.core.mesh.loading import load_mesh
from tactopose_drake.core.mesh.repair import MeshRepairWarning, RepairedMesh, repair_mesh
from tactopose_drake.core.shape import model_building, model_cache
from tactopose_drake.core.shape.model_cache import Arrays
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.errors import TactoposeError
from tests.fuzz import mesh_files

GRID_BYTES = 160_000
SAMPLES = 100
BUILT = 0.002  # share of the refused caches behind which the model is built anew; others get the arrays of the first
MEMORY = 2**20  # kB that one call may add to what the process has needed so far


@contextmanager
def damaged_file(rng: np.random.Generator, hostile: float) -> Iterator[Path]:
    """A damaged file in a folder in which nothing may have changed when the call is over."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the damage, and of the exporters
        file = _file(rng, hostile)
    with tempfile.TemporaryDirectory() as top:
        folder = Path(top, "meshes")
        folder.mkdir()
        Path(top, mesh_files.OUTSIDE).write_bytes(bytes(3000))
        (folder / "link.bin").symlink_to(Path(top, mesh_files.OUTSIDE))
        os.mkfifo(folder / "pipe.bin")
        path = mesh_files.place(file, folder)
        before = sorted(Path(top).rglob("*"))
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        try:
            yield path
        except TactoposeError as error:
            _check_message(str(error))
            raise
        finally:
            assert sorted(Path(top).rglob("*")) == before, "files were made or removed"
            grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - memory
            assert grown < MEMORY, f"{file.name} needed {grown} kB"


def _check_message(message: str) -> None:
    assert "\n" not in message, f"several lines: {message}"
    assert len(message) < 1000, f"long: {message}"


def _file(rng: np.random.Generator, hostile: float) -> mesh_files.MeshFile:
    if rng.random() < hostile:
        return mesh_files.hostile(rng)
    vertices, faces = mesh_files.joined(rng)
    for _ in range(rng.integers(0, 4)):
        vertices, faces = mesh_files.damage(rng, vertices, faces)
    file = mesh_files.write(rng, vertices, faces, str(rng.choice(mesh_files.FORMATS)))
    return file._replace(content=mesh_files.damage_bytes(rng, file.content)) if rng.random() < 0.3 else file


def check_solid(vertices: np.ndarray, faces: np.ndarray, inertia: np.ndarray, volume: float) -> None:
    """What holds of every mesh that is accepted, told without the package's own means."""
    assert np.isfinite(vertices).all()
    assert faces.min() >= 0
    assert faces.max() < len(vertices)
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    there = np.unique(edges, axis=0)
    assert len(there) == len(edges), "an edge is twice the same way"
    assert np.array_equal(there, np.unique(edges[:, ::-1], axis=0)), "an edge has no face beyond"
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert np.all(mesh.area_faces > 0.0)
    assert volume > 0.0
    moments = np.linalg.eigvalsh(inertia)
    assert moments[0] > 0.0, f"principal moments {moments}"
    assert moments[2] <= moments[0] + moments[1], f"principal moments {moments}"


def repairs(rng: np.random.Generator) -> None:
    """Loads and repairs a damaged file."""
    with damaged_file(rng, hostile=0.03) as path:
        mesh: RepairedMesh = repair_mesh(load_mesh(path), str(path))
    check_solid(mesh.vertices, mesh.faces, mesh.properties.inertia, mesh.properties.volume)


def models(rng: np.random.Generator) -> None:
    """Makes a whole model of a damaged file."""
    with damaged_file(rng, hostile=0.0) as path, warnings.catch_warnings():
        warnings.simplefilter("ignore", MeshRepairWarning)
        model = ObjectModel.from_mesh(path, samples=SAMPLES, max_grid_bytes=GRID_BYTES, cache=False)
    check_solid(model.vertices, model.faces, model.inertia, model.volume)
    assert model.mass > 0.0
    check_model(model)


def check_model(model: ObjectModel) -> None:
    """What holds of the grid, the samples and the symmetries of every model."""
    assert np.isfinite(model.grid.values).all()
    assert len(model.samples) == SAMPLES
    np.testing.assert_allclose(np.linalg.norm(model.samples.normals, axis=1), 1.0, atol=1e-9)
    np.testing.assert_array_less(np.abs(model.grid.distance(model.samples.points)), 2.0 * model.grid.spacing)
    distance, normal = model.grid.distance_and_normal(model.vertices[:100])
    assert np.isfinite(distance).all()
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1.0, atol=1e-6)
    assert np.isfinite(model.symmetry_poses).all()
    assert np.isfinite(model.symmetry_misfits).all()
    assert np.isfinite(model.surfels(0.005).blocks).all()
    pairs = model.pair_features.pairs
    assert np.all((pairs >= 0) & (pairs < SAMPLES))


@functools.cache
def _kept() -> tuple[Path, str, bytes, Arrays, ObjectModel]:
    """A cache folder that holds one model: the file's name, content and arrays, and the model."""
    folder = Path(tempfile.mkdtemp(prefix="fuzzed_cache"))
    with mock.patch.dict(os.environ, {model_cache.FOLDER_VARIABLE: str(folder)}):
        model = _model()
        (file,) = folder.iterdir()
        arrays = model_cache.load(file.stem)
        assert arrays is not None
        return folder, file.name, file.read_bytes(), _copied(arrays), model


def _model() -> ObjectModel:
    mesh = trimesh.creation.box((0.05, 0.07, 0.11))
    return ObjectModel.from_mesh(mesh, samples=SAMPLES, max_grid_bytes=GRID_BYTES)


def _copied(arrays: Arrays) -> Arrays:
    return {key: np.array(array) for key, array in arrays.items()}


def caches(rng: np.random.Generator) -> None:
    """Loads a model whose file in the cache was damaged, or changed and signed anew."""
    folder, name, content, arrays, built = _kept()
    is_built = rng.random() < BUILT
    building = contextlib.nullcontext() if is_built else mock.patch.object(model_building, "build_arrays", _first_built)
    with mock.patch.dict(os.environ, {model_cache.FOLDER_VARIABLE: str(folder)}), building:
        path = folder / name
        path.unlink(missing_ok=True)
        if rng.random() < 0.5:
            path.write_bytes(damage_file(rng, content))
        else:
            model_cache.store(path.stem, damage_arrays(rng, _copied(arrays)))
        found = _model()
        assert model_cache.load(path.stem) is not None, "what was damaged is not mended"
    for name in ("vertices", "faces", "inertia", "center_of_mass", "symmetry_poses"):
        assert np.array_equal(getattr(found, name), getattr(built, name)), name
    assert np.array_equal(found.samples.points, built.samples.points)
    assert np.array_equal(found.grid.values, built.grid.values)
    assert (found.repairs, found.content_hash, found.volume) == (built.repairs, built.content_hash, built.volume)


def _first_built(*_: object) -> Arrays:
    return _copied(_kept()[3])


def damage_file(rng: np.random.Generator, content: bytes) -> bytes:
    """Flips bits, swaps blocks, cuts off, or makes the header anything; something is different afterwards."""
    data = bytearray(content)
    what = int(rng.integers(5))
    while bytes(data) == content:
        if what == 0:
            data[int(rng.integers(len(data)))] ^= 1 << int(rng.integers(8))
        elif what == 1:
            length = int(rng.choice([8, 64, 4096]))
            a, b = (int(n) * length for n in rng.integers(len(data) // length, size=2))
            data[a : a + length], data[b : b + length] = data[b : b + length], data[a : a + length]
        elif what == 2:
            del data[int(rng.integers(len(data))) :]
        elif what == 3:
            data = bytearray(mesh_files.damage_bytes(rng, bytes(data[:2000])) + content[2000:])
        else:
            data = bytearray(rng.bytes(int(rng.integers(200))))
    return bytes(data)


def damage_arrays(rng: np.random.Generator, arrays: Arrays) -> Arrays:
    """Arrays of which one is of another shape or type, missing, or holds a number that it must not hold."""
    name = str(rng.choice([key for key, array in arrays.items() if array.size]))
    array = arrays[name]
    what = int(rng.integers(6))
    if what == 0:
        del arrays[name]
    elif what == 1:
        arrays[name] = array.astype(np.float16 if array.dtype != np.float16 else np.int8)
    elif what == 2:
        arrays[name] = array[..., None]
    elif what == 3 and array.ndim:
        arrays[name] = array[:0]
    else:
        flat = array.reshape(-1)
        if array.dtype.kind == "f":
            flat[rng.integers(flat.size)] = rng.choice([np.nan, np.inf, -np.inf, 1e30, -1e30])
        elif name == "faces":
            flat[rng.integers(flat.size)] = rng.choice([-1, len(arrays["vertices"]), 2**31 - 1, -(2**31)])
        elif name == "orders":
            flat[rng.integers(flat.size)] = rng.choice([-1, 1])
        else:
            flat.view(np.uint8)[0] ^= 0xFF
    return arrays
