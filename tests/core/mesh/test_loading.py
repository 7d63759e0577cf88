import zipfile
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tactopose_drake.core.mesh.loading import load_mesh, mesh_file, mesh_name
from tactopose_drake.errors import InvalidFileError, InvalidInputError, UnknownNameError
from tests.core.meshes import ball, cube


@pytest.mark.parametrize("ending", ["obj", "stl", "ply", "off", "glb", "dae"])
def test_formats_of_trimesh_are_read(tmp_path: Path, ending: str) -> None:
    mesh = ball()
    path = tmp_path / f"thing.{ending}"
    mesh.export(path)
    loaded = load_mesh(path)
    assert len(loaded.faces) == len(mesh.faces)
    np.testing.assert_allclose(loaded.vertices[loaded.faces].min(axis=(0, 1)), mesh.bounds[0], atol=1e-6)
    assert mesh_name(path) == "thing"


def _with_unit(path: Path, unit: str) -> Path:
    """A cube of 60 in a unit of so many metres in Collada, or of that name in 3MF."""
    cube(60.0).export(path)
    if path.suffix == ".dae":
        path.write_text(path.read_text().replace("<up_axis>", f'<unit name="a unit" meter="{unit}"/><up_axis>'))
        return path
    with zipfile.ZipFile(path) as archive:
        contents = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in contents.items():
            archive.writestr(name, content.replace(b' unit="millimeter"', unit.encode()))
    return path


@pytest.mark.parametrize(
    ("name", "unit", "size"),
    [
        ("centimetres.dae", "0.01", 0.6),
        ("millimetres.dae", "0.001", 0.06),
        ("metres.dae", "1.0", 60.0),
        ("millimetres.3mf", ' unit="millimeter"', 0.06),
        ("microns.3mf", ' unit="micron"', 60e-6),
        ("inches.3mf", ' unit="inch"', 1.524),
        ("unsaid.3mf", "", 0.06),
    ],
)
def test_files_that_state_their_unit_come_out_in_metres(tmp_path: Path, name: str, unit: str, size: float) -> None:
    loaded = load_mesh(_with_unit(tmp_path / name, unit))
    np.testing.assert_allclose(np.ptp(loaded.vertices, axis=0), size, rtol=1e-9)


@pytest.mark.parametrize(
    ("name", "unit"), [("a.dae", "0"), ("a.dae", "-1"), ("a.dae", "nan"), ("a.3mf", ' unit="pint"')]
)
def test_units_that_are_none_are_named(tmp_path: Path, name: str, unit: str) -> None:
    path = _with_unit(tmp_path / name, unit)
    with pytest.raises(
        InvalidFileError, match=r"a\.(dae|3mf): the unit must be one of length, .*, not .*(meters|pint)"
    ):
        load_mesh(path)


def test_scenes_are_joined_with_their_parts_in_place() -> None:
    scene = trimesh.Scene()
    for x in (0.0, 0.1):
        scene.add_geometry(cube(0.02), transform=trimesh.transformations.translation_matrix((x, 0, 0)))
    loaded = load_mesh(scene)
    assert loaded.faces.shape == (24, 3)
    np.testing.assert_allclose(loaded.vertices.max(axis=0), [0.11, 0.01, 0.01])


def test_a_mesh_is_copied() -> None:
    mesh = cube()
    loaded = load_mesh(mesh)
    loaded.vertices[:] = 0.0
    assert mesh.extents.max() > 0.05


def test_a_path_may_be_text_and_of_any_case(tmp_path: Path) -> None:
    path = tmp_path / "THING.STL"
    path.write_bytes(trimesh.exchange.stl.export_stl(cube()))
    assert load_mesh(str(path)).faces.shape == (12, 3)


@pytest.mark.parametrize(
    ("name", "fault"), [("missing.obj", "there is no such file"), (".", "must be a file, not a folder")]
)
def test_missing_files_are_named(tmp_path: Path, name: str, fault: str) -> None:
    with pytest.raises(InvalidFileError, match=rf"{tmp_path}.*:? {fault}"):
        mesh_file(tmp_path / name)


def test_a_name_that_is_too_long_for_a_file_is_refused() -> None:
    with pytest.raises(
        InvalidFileError, match=r"^mesh must be a file's path, not 'x{59}\.\.\. \(File name too long\)\.$"
    ):
        load_mesh("x" * 300 + ".obj")


def test_unknown_formats_are_named_with_those_known(tmp_path: Path) -> None:
    path = tmp_path / "mesh.docx"
    path.touch()
    with pytest.raises(
        UnknownNameError, match=r"mesh.docx: the mesh format must be one of .*\.obj.*\.stl.*, not '.docx'"
    ):
        load_mesh(path)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("index.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n"),
        ("index.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n"),
        ("broken.glb", "glTF"),
        ("broken.3mf", "PK"),
        ("broken.ply", "ply\nformat ascii 1.0\nelement vertex nine\n"),
    ],
)
def test_broken_files_are_named_with_the_reason(tmp_path: Path, name: str, content: str) -> None:
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(InvalidFileError, match=rf"{name} cannot be read as a mesh \(\w+: .+\)\."):
        load_mesh(path)


def test_other_types_are_refused() -> None:
    with pytest.raises(InvalidInputError, match=r"mesh must be a file's path, .*, not an int"):
        load_mesh(7)  # type: ignore[arg-type]
