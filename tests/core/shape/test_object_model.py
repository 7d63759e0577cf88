import copy
import dataclasses
import math
import os
import pickle
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tactopose_drake.core.mesh.repair import MeshRepairWarning
from tactopose_drake.core.poses import transform_points
from tactopose_drake.core.shape import model_building, model_cache
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.shape.symmetry import RotationalSymmetry
from tactopose_drake.errors import (
    InvalidFileError,
    InvalidInputError,
    InvalidMeshError,
    MeshUnitsError,
    TactoposeError,
    UnknownNameError,
)
from tests.core.meshes import ball, create, cube, inside_out, random_pose, shape_poor_in_symmetry

SIDES = np.array([0.05, 0.08, 0.12])
BOX = create.box(SIDES)
BYTES = 16 * 200_000
# A folder of closed meshes, such as scans of household objects.
MESHES = sorted(Path(os.environ.get("TACTOPOSE_TEST_MESHES", "nowhere")).glob("*.obj"))


@pytest.fixture(autouse=True)
def cache_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(model_cache.FOLDER_VARIABLE, str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def no_building(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[], None]]:
    def forbid() -> None:
        def fail(*_: object, **__: object) -> None:
            raise AssertionError("the costly work began")

        monkeypatch.setattr(model_building, "build_grid", fail)

    return forbid


def model_of(mesh: trimesh.Trimesh | str | Path, **options: object) -> ObjectModel:
    return ObjectModel.from_mesh(mesh, max_grid_bytes=BYTES, **options)  # type: ignore[arg-type]


def all_arrays(model: ObjectModel) -> dict[str, np.ndarray]:
    return {
        "vertices": model.vertices,
        "faces": model.faces,
        "values": model.grid.values,
        "origin": model.grid.origin,
        "points": model.samples.points,
        "normals": model.samples.normals,
        "center_of_mass": model.center_of_mass,
        "inertia": model.inertia,
        "symmetry_poses": model.symmetry_poses,
        "symmetry_misfits": model.symmetry_misfits,
        "likenesses": model.likenesses,
        "coarse_values": model.coarse_field.values,
        "coarse_origin": model.coarse_field.origin,
    }


def assert_same(a: ObjectModel, b: ObjectModel) -> None:
    for (name, first), second in zip(all_arrays(a).items(), all_arrays(b).values(), strict=True):
        np.testing.assert_array_equal(first, second, err_msg=name)
    for name in ("name", "volume", "mass", "size", "repairs", "content_hash"):
        assert getattr(a, name) == getattr(b, name)
    assert [(s.order, *s.axis, *s.point) for s in a.symmetries] == [(s.order, *s.axis, *s.point) for s in b.symmetries]


def test_a_box_s_figures() -> None:
    X = trimesh.transformations.translation_matrix([0.01, 0.02, 0.03])
    model = model_of(BOX.copy().apply_transform(X))
    volume = SIDES.prod()
    assert model.volume == pytest.approx(volume)
    assert model.mass == pytest.approx(1000 * volume)
    assert model.size == pytest.approx(np.linalg.norm(SIDES))
    np.testing.assert_allclose(model.center_of_mass, [0.01, 0.02, 0.03])
    square = SIDES**2
    np.testing.assert_allclose(model.inertia, model.mass / 12 * np.diag(square.sum() - square), atol=1e-12)
    assert len(model.samples) == 3000
    assert np.abs(model.grid.distance(model.samples.points)).max() < model.grid.spacing
    assert [s.order for s in model.symmetries] == [2, 2, 2]
    assert model.symmetry_poses.shape == (4, 3, 4)
    assert model.repairs == ()


def test_what_grows_moves_its_surface_along_normals_and_tangents() -> None:
    sphere = trimesh.creation.icosphere(4, 0.05)
    outward, along = model_of(sphere).growth
    assert outward == pytest.approx(0.05, rel=1e-3)
    assert along < 0.001
    # About another point than its middle, a third of the square of that one's distance more along each direction.
    outward, along = model_of(sphere, center_of_mass=[0.0, 0.0, 0.03]).growth
    assert outward == pytest.approx(math.sqrt(0.05**2 + 0.03**2 / 3.0), rel=0.01)
    assert along == pytest.approx(math.sqrt(0.03**2 / 3.0), rel=0.02)


def test_half_turns_are_about_the_principal_axes_through_the_middle() -> None:
    X = random_pose(np.random.default_rng(4))
    box = model_of(BOX.copy().apply_transform(X))
    for turn in box.half_turns:
        turned = transform_points(turn, box.vertices)
        gaps = np.linalg.norm(turned[:, None] - box.vertices, axis=2)
        np.testing.assert_allclose(gaps.min(axis=1), 0.0, atol=1e-9)
        assert np.trace(turn[:, :3]) == pytest.approx(-1.0)
    assert len({tuple(np.round(turn[:, :3].ravel(), 6)) for turn in box.half_turns}) == 3


def test_mass_and_centre_of_mass_may_be_given() -> None:
    plain = model_of(BOX)
    model = model_of(BOX, mass=0.3, center_of_mass=[0.0, 0.0, -0.02])
    assert model.mass == 0.3
    np.testing.assert_allclose(model.center_of_mass, [0.0, 0.0, -0.02])
    np.testing.assert_allclose(model.inertia, plain.inertia * 0.3 / plain.mass)
    # The symmetries are those of the shape.
    assert len(model.symmetry_poses) == 4


def test_the_model_turns_with_the_mesh() -> None:
    X = random_pose(np.random.default_rng(5))
    mesh = shape_poor_in_symmetry()
    still, moved = model_of(mesh), model_of(mesh.copy().apply_transform(X))
    R, p = X[:3, :3], X[:3, 3]
    assert moved.volume == pytest.approx(still.volume)
    np.testing.assert_allclose(moved.center_of_mass, R @ still.center_of_mass + p, atol=1e-9)
    np.testing.assert_allclose(moved.inertia, R @ still.inertia @ R.T, atol=1e-9 * still.mass)
    points = still.samples.points @ R.T + p
    assert np.percentile(np.abs(moved.grid.distance(points)), 95) < 0.25 * moved.grid.spacing


def test_a_model_cannot_be_changed() -> None:
    built, told = model_of(BOX), model_of(BOX, symmetry=[RotationalSymmetry([0.0, 0.0, 1.0], [0.0, 0.0, 0.0], 2)])
    copies = built.about_middle, pickle.loads(pickle.dumps(built)), copy.deepcopy(built)
    for model in (built, model_of(BOX), told, *copies):
        with pytest.raises(dataclasses.FrozenInstanceError):
            model.mass = 1.0  # type: ignore[misc]
        of_use = {name: getattr(model, name) for name in ("middle", "hull_vertices", "half_turns")}
        for name, array in (all_arrays(model) | of_use).items():
            assert not array.flags.writeable, name


def test_a_mesh_file_and_a_mesh_make_the_same_model(tmp_path: Path) -> None:
    mesh = cube()
    path = tmp_path / "die.stl"
    mesh.export(path)
    from_file = model_of(path)
    assert from_file.name == "die"
    assert model_of(path, name="cube").name == "cube"
    from_mesh = model_of(trimesh.load_mesh(path, process=False))
    assert from_mesh.name == "mesh"
    assert_same(dataclasses.replace(from_mesh, name="die"), from_file)


@pytest.mark.parametrize("ending", ["obj", "glb"])
def test_the_second_time_the_cache_answers(tmp_path: Path, no_building: Callable[[], None], ending: str) -> None:
    path = tmp_path / f"thing.{ending}"
    shape_poor_in_symmetry().export(path)
    built = model_of(path)
    no_building()
    assert_same(model_of(path), built)
    # Mass is no part of what is kept.
    assert model_of(path, mass=2.0).mass == 2.0
    with pytest.raises(AssertionError, match="costly work"):
        model_of(path, cache=False)


def test_another_content_or_option_is_another_model(tmp_path: Path, cache_folder: Path) -> None:
    path = tmp_path / "thing.obj"
    path.write_text(trimesh.exchange.obj.export_obj(cube()))
    first = model_of(path)
    for options in ({"samples": 500}, {"spacing": 0.004}, {"symmetry": "none"}, {"symmetry_tolerance": 0.02}):
        model_of(path, **options)
    assert len(list(cache_folder.iterdir())) == 5
    path.write_text(trimesh.exchange.obj.export_obj(cube(0.05)))
    second = model_of(path)
    assert len(list(cache_folder.iterdir())) == 6
    assert second.volume == pytest.approx(0.05**3)
    assert first.content_hash != second.content_hash


def test_a_damaged_cache_is_rebuilt_and_rewritten(cache_folder: Path, no_building: Callable[[], None]) -> None:
    built = model_of(BOX)
    (path,) = cache_folder.iterdir()
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    assert_same(model_of(BOX), built)
    assert path.read_bytes() == content
    no_building()
    assert_same(model_of(BOX), built)


def test_without_a_writable_cache_models_are_built(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv(model_cache.FOLDER_VARIABLE, str(tmp_path / "file" / "below"))
    assert model_of(BOX).volume == pytest.approx(SIDES.prod())


BUILDER = """
import sys, trimesh
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.shape.symmetry import RotationalSymmetry
mesh = trimesh.creation.box((0.05, 0.08, 0.12))
print("ready", flush=True)
sys.stdin.readline()
model = ObjectModel.from_mesh(mesh, max_grid_bytes=3_200_000)
print(model.content_hash, model.volume, model.grid.values.sum(dtype=float))
"""


def test_two_processes_may_build_the_same_model_at_once(cache_folder: Path) -> None:
    builders = [
        subprocess.Popen([sys.executable, "-c", BUILDER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        for _ in range(2)
    ]
    for builder in builders:
        assert builder.stdout is not None
        assert builder.stdout.readline() == "ready\n"
    first, second = (builder.communicate("go\n", timeout=120)[0].split() for builder in builders)
    assert first == second
    assert len(list(cache_folder.iterdir())) == 1
    model = model_of(BOX)
    assert [model.content_hash, float(first[1])] == [first[0], model.volume]


def test_repairs_are_told_each_time() -> None:
    for _ in range(2):  # built, and from the cache
        with pytest.warns(MeshRepairWarning, match="ball: flipped the mesh, turned inside out") as caught:
            model = model_of(inside_out(ball()), name="ball")
        assert len(caught) == 1
        assert caught[0].filename == __file__
        assert model.repairs == ("flipped the mesh, turned inside out",)
        assert model.grid.distance(np.zeros(3)) < -0.03


BAD_MESHES: list[tuple[trimesh.Trimesh, type[TactoposeError]]] = [
    (trimesh.Trimesh(), InvalidMeshError),
    (create.box((0.1, 0.1, 1e-9)), InvalidMeshError),
    (cube(60.0), MeshUnitsError),
]


@pytest.mark.parametrize(("mesh", "error"), BAD_MESHES)
def test_bad_meshes_are_refused_before_the_work(
    mesh: trimesh.Trimesh, error: type[TactoposeError], no_building: Callable[[], None]
) -> None:
    no_building()
    with pytest.raises(error, match=r"mesh must "):
        model_of(mesh)


def test_errors_name_the_file(tmp_path: Path) -> None:
    path = tmp_path / "void.obj"
    path.write_text("# nothing\n")
    with pytest.raises(InvalidMeshError, match=rf"{path} must have faces"):
        model_of(path)
    with pytest.raises(InvalidFileError, match=r"missing.obj: there is no such file"):
        model_of(tmp_path / "missing.obj")


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"mass": 0.0}, InvalidInputError, "mass must be a number > 0, not 0"),
        ({"mass": np.nan}, InvalidInputError, "mass must be .*, not nan"),
        ({"center_of_mass": [0, 0]}, InvalidInputError, r"center_of_mass must have the shape .*, not \(2,\)"),
        ({"symmetry": "some"}, UnknownNameError, "symmetry must be one of auto, none.*, not 'some'"),
        ({"symmetry_tolerance": -0.1}, InvalidInputError, "symmetry_tolerance must be .*, not -0.1"),
        (
            {"symmetry": "none", "symmetry_tolerance": None},
            InvalidInputError,
            "symmetry_tolerance must be a number, not None",
        ),
        (
            {"symmetry": "none", "symmetry_tolerance": "abc"},
            InvalidInputError,
            "symmetry_tolerance must be a number, not 'abc'",
        ),
        ({"symmetry": [], "symmetry_tolerance": np.nan}, InvalidInputError, "symmetry_tolerance must be .*, not nan"),
        ({"max_grid_bytes": 10**400}, InvalidInputError, "max_grid_bytes must be an integer from 1 to .*, not an int"),
        ({"samples": 10}, InvalidInputError, "samples must be an integer from 100 to .*, not 10"),
        ({"spacing": 0.0}, InvalidInputError, "spacing must be .*, not 0"),
        ({"cache": "no"}, InvalidInputError, "cache must be True or False, not 'no'"),
    ],
)
def test_bad_options_are_refused_before_the_work(
    options: dict[str, object], error: type[TactoposeError], message: str, no_building: Callable[[], None]
) -> None:
    no_building()
    with pytest.raises(error, match=message):
        ObjectModel.from_mesh(BOX, **options)  # type: ignore[arg-type]


def test_what_does_not_fit_the_mesh_is_refused_built_or_from_the_cache(no_building: Callable[[], None]) -> None:
    box = create.box((0.1, 0.1, 0.1))
    wrong = [
        ({"spacing": 1.0}, "spacing must be at most the object's size, 0.173 m, not 1 m"),
        (
            {"center_of_mass": [5, 5, 5]},
            r"center_of_mass must be at most .* outside of its bounding box, not 8.57 m, at \[5.0, 5.0, 5.0\]",
        ),
    ]
    for options, message in wrong:
        with pytest.raises(InvalidInputError, match=message):
            model_of(box, **options)
    assert model_of(box, center_of_mass=[0.0, 0.0, 0.2]).center_of_mass[2] == 0.2
    no_building()
    with pytest.raises(InvalidInputError, match=r"center_of_mass must be .* outside of its bounding box, not"):
        model_of(box, center_of_mass=[5, 5, 5])


@pytest.mark.parametrize("path", MESHES, ids=lambda path: path.stem)
def test_other_closed_meshes_need_no_repair(path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model = model_of(path)
    assert model.grid.distance(model.center_of_mass) < 0
    assert np.mean(np.abs(model.grid.distance(model.samples.points))) < 0.1 * model.grid.spacing
