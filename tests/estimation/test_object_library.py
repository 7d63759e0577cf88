import re
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface
from tactopose_drake.errors import InvalidFileError, InvalidInputError
from tactopose_drake.estimation import object_library
from tactopose_drake.estimation.identification import identify
from tactopose_drake.estimation.library_files import read_library
from tactopose_drake.estimation.object_library import LibraryWarning, ObjectLibrary, forget_models

BOX = trimesh.creation.box((0.08, 0.05, 0.03))
ROD = trimesh.creation.cylinder(0.01, 0.12, sections=32)


@pytest.fixture(scope="module", autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One for this file; the models in it are those of `BOX` and `ROD`."""
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("cache")
        patch.setenv("TACTOPOSE_CACHE_DIR", str(folder))
        yield folder


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    BOX.export(tmp_path / "box.stl")
    ROD.export(tmp_path / "rod.obj")
    (tmp_path / "README.md").write_text("no mesh")
    return tmp_path


def names(library: ObjectLibrary) -> list[str]:
    return [known.name for known in library.objects]


def open_with_warnings(path: Path) -> ObjectLibrary:
    with pytest.warns(LibraryWarning):
        return ObjectLibrary.open(path)


def test_the_meshes_of_a_folder_are_its_objects(folder: Path) -> None:
    progress: list[tuple[int, int]] = []
    library = ObjectLibrary.open(folder, on_progress=lambda done, total: progress.append((done, total)))
    assert names(library) == ["box", "rod"]
    assert library.skipped == ()
    assert progress == [(1, 2), (2, 2)]
    assert library.objects[1].load().volume == pytest.approx(ROD.volume, rel=1e-3)
    assert library.objects[1].load() is library.objects[1].load()


def test_an_interrupted_indexing_goes_on_where_it_stopped(
    folder: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TACTOPOSE_CACHE_DIR", str(tmp_path_factory.mktemp("new")))
    built: list[str] = []
    build = object_library._build
    monkeypatch.setattr(object_library, "_build", lambda known: built.append(known.name) or build(known))

    def interrupt(done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        ObjectLibrary.open(folder, on_progress=interrupt)
    assert built == ["box"]
    assert names(ObjectLibrary.open(folder)) == ["box", "rod"]
    assert built == ["box", "rod"]
    ObjectLibrary.open(folder)
    assert built == ["box", "rod"]


def test_a_library_that_the_cache_cannot_hold_is_told(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TACTOPOSE_CACHE_GB", "0.004")
    with pytest.warns(LibraryWarning, match=r"2 objects take about 0\.0 GB; TACTOPOSE_CACHE_GB allows 0\.004"):
        ObjectLibrary.open(folder)


def test_a_changed_mesh_is_another_object(folder: Path) -> None:
    before = ObjectLibrary.open(folder)
    ROD.export(folder / "box.stl")
    after = ObjectLibrary.open(folder)
    assert after.objects[0].content != before.objects[0].content
    forget_models()
    assert after.objects[0].load().size == pytest.approx(after.objects[1].load().size, rel=1e-3)


def test_a_mesh_that_changes_after_the_library_was_opened_is_named(folder: Path) -> None:
    library = ObjectLibrary.open(folder)
    ROD.export(folder / "box.stl")
    forget_models()
    with pytest.raises(InvalidFileError, match=r"box\.stl has changed since the library was opened"):
        library.objects[0].load()


def test_hidden_files_are_no_objects(folder: Path) -> None:
    (folder / "._box.stl").write_bytes(b"\x00\x05\x16\x07")  # as macOS has them
    assert repr(ObjectLibrary.open(folder)) == "<ObjectLibrary: 2 objects>"


@pytest.mark.parametrize("content", [b"", b"solid nothing", b"\x00\xff" * 200])
def test_a_corrupt_mesh_is_left_out(folder: Path, content: bytes) -> None:
    (folder / "broken.stl").write_bytes(content)
    with pytest.warns(LibraryWarning, match=r"broken is left out: .*broken\.stl"):
        library = ObjectLibrary.open(folder)
    assert names(library) == ["box", "rod"]
    assert [skipped.name for skipped in library.skipped] == ["broken"]
    assert repr(library) == "<ObjectLibrary: 2 objects, 1 left out>"


def test_of_two_meshes_with_one_name_the_first_counts(folder: Path) -> None:
    ROD.export(folder / "box.ply")
    with pytest.warns(LibraryWarning, match=r"box\.stl is left out: the name 'box' is that of box\.ply"):
        library = ObjectLibrary.open(folder)
    assert names(library) == ["box", "rod"]
    assert library.objects[0].load().size == pytest.approx(library.objects[1].load().size, rel=1e-3)


@pytest.mark.parametrize("broken", [False, True])
def test_a_library_without_objects_is_an_error(tmp_path: Path, broken: bool) -> None:
    if broken:
        (tmp_path / "broken.stl").write_text("nothing")
        with (
            pytest.warns(LibraryWarning),
            pytest.raises(
                InvalidFileError, match=r"must hold at least one object that can be used, but holds none \(broken"
            ),
        ):
            ObjectLibrary.open(tmp_path)
    else:
        with pytest.raises(InvalidFileError, match="must hold at least one object that can be used, but holds none"):
            ObjectLibrary.open(tmp_path)


@pytest.mark.parametrize("path", [None, 3, [], b"things"])
def test_what_is_no_path_is_refused(path: object) -> None:
    with pytest.raises(InvalidInputError, match=rf"^path must be a path, not {re.escape(repr(path))}"):
        ObjectLibrary.open(path)  # type: ignore[arg-type]


def test_an_executor_that_is_shut_down_is_refused(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TACTOPOSE_CACHE_DIR", str(tmp_path / "empty"))
    with ThreadPoolExecutor(1) as executor:
        pass
    with pytest.raises(InvalidInputError, match=r"^executor must be open, but takes no work"):
        ObjectLibrary.open(folder, executor=executor)


def test_a_missing_folder_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(InvalidFileError, match="there is no such folder or manifest"):
        ObjectLibrary.open(tmp_path / "missing")


def test_a_manifest_says_names_masses_and_symmetries(folder: Path) -> None:
    axis = {"axis": [0, 0, 1], "point": [0, 0, 0], "order": 0}
    manifest = {
        "pen": {"mesh": "rod.obj", "mass": 0.02, "symmetry": [axis]},
        "brick": {"mesh": "box.stl", "symmetry": "none", "surface_sigma": 0.001, "scale_sigma": 0.02},
    }
    (folder / "library.yaml").write_text(yaml.safe_dump(manifest))
    for path in (folder, folder / "library.yaml"):
        library = ObjectLibrary.open(path)
        assert names(library) == ["brick", "pen"]
        brick, pen = (known.load() for known in library.objects)
        assert (brick.symmetries, brick.mass_is_known) == ((), False)
        assert (brick.surface_sigma, brick.scale_sigma) == (0.001, 0.02)
        assert (pen.mass, pen.name, pen.surface_sigma, pen.scale_sigma) == (0.02, "pen", 0.0, 0.0)
        assert [(symmetry.order, symmetry.axis.tolist()) for symmetry in pen.symmetries] == [(0, [0.0, 0.0, 1.0])]


def test_a_manifest_says_what_the_unit_of_a_mesh_is(folder: Path) -> None:
    BOX.copy().apply_scale(1000.0).export(folder / "millimetres.stl")
    with pytest.warns(LibraryWarning, match=r"millimetres is left out: .* or `scale:` in a library\.yaml\."):
        metres = ObjectLibrary.open(folder)
    for scale in (0.001, 0.002):
        (folder / "library.yaml").write_text(f"brick: {{mesh: millimetres.stl, scale: {scale}}}\n")
        (brick,) = ObjectLibrary.open(folder).objects
        assert brick.load().size == pytest.approx(1000.0 * scale * metres.objects[0].load().size, rel=1e-3)


@pytest.mark.parametrize(
    ("entry", "reason"),
    [
        ("{mesh: missing.obj}", r"missing\.obj: there is no such file"),
        ("{mass: 1.0}", r"other must have the key 'mesh', but lacks it"),
        ("{mesh: box.stl, mas: 1.0}", r"other must have only the keys mesh, scale, mass, symmetry.*, not 'mas'"),
        ("{mesh: box.stl, mass: -1.0}", r"other\.mass must be a number > 0, not -1"),
        ("{mesh: box.stl, mass: 1.0e+5}", r"other\.mass must be a number from 1e-06 to 10000, not 100000"),
        ("{mesh: box.stl, surface_sigma: 1.0}", r"other\.surface_sigma must be a number from 0 to 0\.1, not 1"),
        ("{mesh: box.stl, scale_sigma: -0.1}", r"other\.scale_sigma must be a number >= 0, not -0\.1"),
        ("{mesh: box.stl, scale: 0}", r"other\.scale must be a number > 0, not 0"),
        ("{mesh: 3}", r"other\.mesh must be the path of a file, not 3"),
        ("box.stl", r"other must be a mapping .*, not 'box\.stl'"),
        ("{mesh: box.stl, symmetry: all}", r"other\.symmetry must be auto, none or a list of axes, not 'all'"),
        (
            "{mesh: box.stl, symmetry: [{axis: [0, 0, 1], point: [0, 0, 0], order: 1}]}",
            r"order must be 0 or an integer from 2 to 60, not 1",
        ),
        (
            "{mesh: box.stl, symmetry: [{axis: [0, 0, 1], point: [0, 0], order: 2}]}",
            r"symmetry\[0\]\.point must have the shape .*",
        ),
        (
            "{mesh: box.stl, symmetry: [{axis: [0, 0, 1], point: [0, 0, 0], order: 2.5}]}",
            r"order must be 0 or an integer .*, not 2\.5",
        ),
    ],
)
def test_a_bad_entry_is_left_out(folder: Path, entry: str, reason: str) -> None:
    (folder / "library.yaml").write_text(f"rod: {{mesh: rod.obj}}\nother: {entry}\n")
    with pytest.warns(LibraryWarning, match=reason):
        library = ObjectLibrary.open(folder)
    assert names(library) == ["rod"]


def test_a_name_that_comes_twice_in_a_manifest_is_an_error(folder: Path) -> None:
    (folder / "library.yaml").write_text("a: {mesh: rod.obj}\nb: {mesh: box.stl}\na: {mesh: box.stl}\n")
    with pytest.raises(InvalidFileError, match=r"library.yaml: line 3: the key 'a' must be given once, not twice"):
        ObjectLibrary.open(folder)


@pytest.mark.parametrize("order", ["100000000", "61", "1", "-1", "yes", "2.5"])
def test_an_order_of_symmetry_beyond_all_reason_is_refused_at_once(folder: Path, order: str) -> None:
    axis = f"[{{axis: [0, 0, 1], point: [0, 0, 0], order: {order}}}]"
    (folder / "library.yaml").write_text(f"a: {{mesh: rod.obj}}\nb: {{mesh: rod.obj, symmetry: {axis}}}\n")
    entries, skipped = read_library(folder)
    assert [entry.name for entry in entries] == ["a"]
    assert "symmetry[0].order must be 0 or an integer from 2 to 60, not " in str(skipped[0])


@pytest.mark.parametrize("text", ["- a\n- b\n", "", "a: [", "plain"])
def test_a_manifest_that_is_none_is_an_error(tmp_path: Path, text: str) -> None:
    (tmp_path / "library.yaml").write_text(text)
    with pytest.raises(InvalidFileError, match=r"library\.yaml(: the content is not YAML| must be a mapping)"):
        ObjectLibrary.open(tmp_path)


def test_of_a_library_an_object_that_is_larger_than_its_mesh_and_says_so_is_looked_at(tmp_path: Path) -> None:
    extents = {"scan": [0.06, 0.04, 0.03], "other": [0.075, 0.04, 0.03], "third": [0.05, 0.05, 0.05]}
    for name, lengths in extents.items():
        trimesh.creation.box(lengths).export(tmp_path / f"{name}.stl")
    manifest = {name: {"mesh": f"{name}.stl"} for name in extents} | {"scan": {"mesh": "scan.stl", "scale_sigma": 0.1}}
    (tmp_path / "library.yaml").write_text(yaml.safe_dump(manifest))
    library, larger = ObjectLibrary.open(tmp_path), ObjectModel.from_box([0.066, 0.044, 0.033])
    for seed in range(3):
        generator = np.random.default_rng(seed)
        noise = {"sigma_position": 0.0005, "sigma_normal": np.radians(3.0)}
        touch = touch_surface(larger, np.eye(3, 4), 8, generator, spread=True, **noise)
        found = identify(library, touch, candidates=1, unknown_prior=0.0)
        assert [identity.name for identity in found.identities if identity.estimate is not None] == ["scan"]
