import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tactopose_drake.core.mesh import loading
from tactopose_drake.core.mesh.loading import load_mesh
from tactopose_drake.core.mesh.plain_obj import plain_obj
from tactopose_drake.resources import model_path

OBJECTS = sorted(Path(model_path("objects", "mug.obj")).parent.glob("*.obj"))
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"


@pytest.mark.parametrize("path", OBJECTS, ids=lambda path: path.stem)
def test_plain_files_are_read_as_trimesh_does(path: Path) -> None:
    with path.open("rb") as file:
        expected = trimesh.load_scene(file, file_type="obj", process=False, skip_materials=True).to_mesh()
    found = plain_obj(path.read_bytes())
    assert found is not None
    np.testing.assert_array_equal(found[0], expected.vertices)
    np.testing.assert_array_equal(found[1], expected.faces)


@pytest.mark.parametrize("face", ["f 1 2 3", "f  1//1 2//2 3//3 ", "# a triangle\n\nf 1 2 3\r\n"])
def test_faces_are_named_in_either_way(face: str) -> None:
    found = plain_obj(f"{TRIANGLE}{face}".encode())
    assert found is not None
    np.testing.assert_array_equal(found[0], [[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    np.testing.assert_array_equal(found[1], [[0, 1, 2]])


@pytest.mark.parametrize(
    "rest",
    [
        "",
        "f",
        "f 1 2",
        "f 1 2 3 1",
        "f 1 2 4",
        "f 0 1 2",
        "f -3 -2 -1",
        "f 1 1 2",  # a vertex without a face
        "f 1/1 2/2 3/3",
        "f 1//2 2//3 3//1",
        "f 1// 2// 3//",
        "f a b c",
        "f 1 2 99999999999999999999",
        "o part\nf 1 2 3",
        "usemtl red\nf 1 2 3",
        "v 0 0\nf 1 2 3",
        "v 0 0 x\nf 1 2 4\nf 1 3 4",
        "v 0 0 1 0.5 0.5 0.5\nf 1 2 4\nf 1 3 4",
        "f 1 2 \\\n3",
    ],
)
def test_other_files_are_left_to_trimesh(rest: str) -> None:
    assert plain_obj((TRIANGLE + rest).encode()) is None


def test_files_with_more_in_them_are_read_all_the_same(tmp_path: Path) -> None:
    path = tmp_path / "quad.obj"
    path.write_text(f"{TRIANGLE}v 1 1 0\no square\nf 1 2 4 3\n")
    assert load_mesh(path).faces.shape == (2, 3)


def test_the_model_of_a_plain_file_is_built_without_trimesh() -> None:
    code = f"""
import sys
from tactopose_drake import ObjectModel
ObjectModel.from_mesh({str(OBJECTS[0])!r}, cache=False)
sys.exit("trimesh" in sys.modules)
"""
    subprocess.run([sys.executable, "-c", code], check=True)


def test_large_files_are_left_to_trimesh(monkeypatch: pytest.MonkeyPatch) -> None:
    path = Path(model_path("objects", "mug.obj"))
    expected = load_mesh(path)
    read: list[int] = []
    monkeypatch.setattr(loading, "plain_obj", lambda content: read.append(len(content)))
    monkeypatch.setattr(loading, "LARGEST_PLAIN", path.stat().st_size - 1)
    np.testing.assert_array_equal(load_mesh(path).vertices, expected.vertices)
    assert not read
    monkeypatch.setattr(loading, "LARGEST_PLAIN", path.stat().st_size)
    load_mesh(path)
    assert read == [path.stat().st_size]
