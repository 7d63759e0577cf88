import io
import json
import struct
import zipfile
from pathlib import Path

import pytest
import trimesh

from tactopose_drake.core.mesh import loading
from tactopose_drake.core.mesh.loading import load_mesh
from tactopose_drake.errors import InvalidFileError, InvalidMeshError, UnknownNameError
from tests.core.meshes import cube
from tests.fuzz import mesh_files

BUFFER = "gltf_buffer_0.bin"


def gltf(folder: Path, **changes: object) -> Path:
    """A cube as glTF, with changes to the file's first buffer, accessor or node."""
    files = {name: bytes(content) for name, content in cube().scene().export(file_type="gltf").items()}
    tree = json.loads(files.pop("model.gltf"))
    for name, content in files.items():
        (folder / name).write_bytes(content)
    for place, change in changes.items():
        tree[place][0].update(change)
    path = folder / "cube.gltf"
    path.write_text(json.dumps(tree))
    return path


def test_gltf_reads_its_buffers(tmp_path: Path) -> None:
    assert load_mesh(gltf(tmp_path)).faces.shape == (12, 3)


@pytest.mark.parametrize("way", ["above", "link", "absolute"])
def test_files_outside_the_folder_are_not_read(tmp_path: Path, way: str) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    path = gltf(folder)
    outside = tmp_path / "outside.bin"
    (folder / BUFFER).rename(outside)
    (folder / "link.bin").symlink_to(outside)
    uri = {"above": "../outside.bin", "link": "link.bin", "absolute": str(outside)}[way]
    tree = json.loads(path.read_text())
    tree["buffers"][0]["uri"] = uri
    path.write_text(json.dumps(tree))
    with pytest.raises(InvalidFileError, match="is not one that may be read"):
        load_mesh(path)


def test_buffers_larger_than_allowed_are_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = gltf(tmp_path)
    monkeypatch.setattr(loading, "LARGEST_FILE", path.stat().st_size)
    (tmp_path / BUFFER).write_bytes(bytes(path.stat().st_size + 1))
    with pytest.raises(InvalidFileError, match="is not one that may be read"):
        load_mesh(path)


def test_a_damaged_gltf_is_not_replaced_by_another_model(tmp_path: Path) -> None:
    gltf(tmp_path).rename(tmp_path / "model.gltf")
    path = tmp_path / "damaged.gltf"
    path.write_text("{")
    with pytest.raises(InvalidFileError, match=r"damaged\.gltf cannot be read as a mesh .JSONDecodeError"):
        load_mesh(path)


def test_numbers_made_of_nothing_are_bounded(tmp_path: Path) -> None:
    with pytest.raises(InvalidFileError, match="must list at most 60000000 rows of numbers, not 1000000008"):
        load_mesh(gltf(tmp_path, accessors={"count": 10**9}))


def test_a_short_glb_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "thing.glb"
    path.write_bytes(b"glTF" + struct.pack("<II", 2, 10**9))
    with pytest.raises(InvalidFileError, match=r"thing\.glb cannot be read"):
        load_mesh(path)


@pytest.mark.parametrize(("name", "inner"), [("bomb.3mf", "3D/3dmodel.model"), ("bomb.zae", "scene.dae")])
def test_archives_that_unpack_to_too_much_are_not_unpacked(tmp_path: Path, name: str, inner: str) -> None:
    packed = io.BytesIO()
    with (
        zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open(inner, "w") as file,
    ):
        for _ in range(257):
            file.write(bytes(2**20))
    path = tmp_path / name
    path.write_bytes(packed.getvalue())
    with pytest.raises(InvalidFileError, match="must unpack to at most 268435456 bytes, not 269484032"):
        load_mesh(path)


def test_archives_of_any_files_are_not_meshes(tmp_path: Path) -> None:
    path = tmp_path / "mesh.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("cube.stl", cube().export(file_type="stl"))
    with pytest.raises(UnknownNameError, match=r"must be one of \.3mf.*, not '\.zip'"):
        load_mesh(path)


@pytest.mark.parametrize("ending", ["dae", "3mf"])
def test_parts_of_parts_are_counted_before_they_are_placed(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"thing.{ending}"
    for depth in (2, 40):
        document = mesh_files.nested_nodes(depth) if ending == "dae" else mesh_files.nested_components(depth)
        path.write_bytes(document if ending == "dae" else mesh_files.packed({"3D/3dmodel.model": document}))
        if depth == 2:
            assert load_mesh(path).faces.shape == (24, 3)
        else:
            with pytest.raises(InvalidFileError, match="must place at most 2000 parts"):
                load_mesh(path)


def test_files_larger_than_allowed_are_not_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "cube.stl"
    cube().export(path)
    monkeypatch.setattr(loading, "LARGEST_FILE", 100)
    with pytest.raises(InvalidFileError, match=r"cube.stl must have at most 100 bytes, not \d+\."):
        load_mesh(path)


@pytest.mark.parametrize(("bound", "what"), [("MOST_FACES", "faces, not 12"), ("MOST_VERTICES", "vertices, not 8")])
def test_more_faces_or_vertices_than_allowed_are_refused(
    monkeypatch: pytest.MonkeyPatch, bound: str, what: str
) -> None:
    monkeypatch.setattr(loading, bound, 7)
    with pytest.raises(InvalidMeshError, match=f"mesh must have at most 7 {what}\\."):
        load_mesh(cube())
    scene = trimesh.Scene([cube()])
    with pytest.raises(InvalidMeshError, match=f"must have at most 7 {what}"):
        load_mesh(scene)


def test_readers_neither_warn_nor_print(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "thing.stl"
    path.write_text("solid\nfacet normal 0 0 x\nvertex 1e999 0 0\nendsolid")
    with pytest.raises(InvalidFileError, match=r"thing\.stl cannot be read") as caught:
        load_mesh(path)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", ["~nobody-of-this-name/mug.obj", "a\0b.obj"])
def test_what_is_no_path_is_refused(name: str) -> None:
    with pytest.raises(InvalidFileError, match=r"must be a file's path|there is no such file"):
        load_mesh(name)
