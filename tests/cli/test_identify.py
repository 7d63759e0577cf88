import json
import re
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml

from tactopose_drake.cli.identify_command import identification_line
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.statuses import Status
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface
from tactopose_drake.estimation.identities import Identification, Identity
from tests.cli.test_cli import run as tactopose
from tests.core.meshes import random_pose, shape_poor_in_symmetry


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A library, and contacts on one of its objects."""
    folder = tmp_path_factory.mktemp("identify")
    (folder / "library").mkdir()
    trimesh.creation.box((0.1, 0.06, 0.04)).export(folder / "library" / "box.stl")
    shape_poor_in_symmetry().export(folder / "library" / "block.stl")
    model = ObjectModel.from_mesh(shape_poor_in_symmetry(), spacing=0.002, cache=False)
    generator = np.random.default_rng(0)
    contacts = touch_surface(model, random_pose(generator)[:3], 6, generator)
    assert contacts.n_PC is not None
    touches = [
        {"position": p.tolist(), "normal": n.tolist()} for p, n in zip(contacts.p_PC, contacts.n_PC, strict=True)
    ]
    (folder / "contacts.yaml").write_text(yaml.safe_dump({"contacts": touches}))
    return folder


@pytest.fixture(autouse=True, scope="module")
def _cache(tmp_path_factory: pytest.TempPathFactory) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TACTOPOSE_CACHE_DIR", str(tmp_path_factory.mktemp("cache")))
        yield


def run(library: Path, contacts: Path, *options: str) -> int:
    return tactopose("identify", "--library", library, "--contacts", contacts, "--jobs", 1, *options)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ([], "ok: It is block."),
        # By the thesis' measure the other object has more than a tenth.
        (["--likelihood", "inverse_cost"], "ambiguous: That is not certain; the most probable is block."),
    ],
)
def test_the_touched_object_is_named(
    folder: Path, options: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(folder / "library", folder / "contacts.yaml", *options) == 0
    out, err = capsys.readouterr()
    assert said in out
    lines = [line.split() for line in out.splitlines()]
    assert [line[:2] for line in lines if line[:1] in (["1"], ["2"])] == [["1", "block"], ["2", "box"]]
    assert ["none", "of", "these"] in [line[:3] for line in lines]
    assert "warning" not in err


def test_what_is_found_is_written(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "result.json"
    assert run(folder / "library", folder / "contacts.yaml", "--out", str(out)) == 0
    assert "Replaced" not in capsys.readouterr().out
    found = json.loads(out.read_text())
    assert set(found) == {"status", "unknown", "duration", "objects"}
    assert [known["name"] for known in found["objects"]] == ["block", "box"]
    assert sum(known["probability"] for known in found["objects"]) + found["unknown"] == pytest.approx(1.0)
    assert found["objects"][0]["hypotheses"][0]["probability"] > 0.0
    assert found["unknown"] < 0.1
    assert run(folder / "library", folder / "contacts.yaml", "--unknown-prior", "0", "--out", str(out)) == 0
    assert json.loads(out.read_text())["unknown"] == 0.0
    assert f"Replaced: {out}" in capsys.readouterr().out


def test_what_is_none_of_the_objects_is_said(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    library = folder / "other"
    library.mkdir()
    trimesh.creation.icosphere(3, 0.05).export(library / "ball.stl")
    trimesh.creation.cylinder(0.005, 0.2).export(library / "rod.stl")
    assert run(library, folder / "contacts.yaml") == 0
    assert re.search(r"no_solution: It is probably none of these \(\d+%\); the nearest is", capsys.readouterr().out)


def test_what_is_left_out_is_said_and_the_rest_used(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    library = folder / "damaged"
    library.mkdir()
    for mesh in (folder / "library").iterdir():
        (library / mesh.name).write_bytes(mesh.read_bytes())
    (library / "torn.stl").write_bytes(b"torn")
    shape_poor_in_symmetry().export(library / "block.ply")
    assert run(library, folder / "contacts.yaml") == 0
    out, err = capsys.readouterr()
    assert "ok: It is block." in out
    said = [line for line in err.splitlines() if line.startswith("warning: ")]
    assert len(said) == 2
    assert "block.stl is left out: the name 'block' is that of block.ply" in said[0]
    assert "torn is left out: " in said[1]


def test_equal_shapes_are_named_together(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    library = folder / "twins"
    library.mkdir()
    for name in ("block", "brick"):
        (library / f"{name}.stl").write_bytes((folder / "library" / "block.stl").read_bytes())
    assert run(library, folder / "contacts.yaml") == 0
    assert "ok: It is block or brick, which have the same shape." in capsys.readouterr().out


@pytest.mark.parametrize(
    ("probability", "unknown", "status", "said"),
    [
        # Of each of two objects of one shape.
        (0.29, 0.40, "ambiguous", "That is not certain; the most probable is cup or mug, which have the same shape."),
        # The box, which is less probable, may explain it.
        (
            0.40,
            0.05,
            "no_solution",
            "Not even the most probable explains the touch within its noise: cup or mug, which",
        ),
        (0.47, 0.05, "ok", "It is cup or mug, which have the same shape."),
        (
            0.22,
            0.44,
            "ambiguous",
            "That is not certain; it may be none of these (44%), or cup or mug, which have the same",
        ),
        (
            0.20,
            0.50,
            "ambiguous",
            "It is probably none of these (50%); the nearest is cup or mug, which have the same shape.",
        ),
    ],
)
def test_what_is_said_counts_objects_of_one_shape_together(
    probability: float, unknown: float, status: Status, said: str
) -> None:
    known, rest = 1.0 - unknown, 1.0 - unknown - 2.0 * probability
    objects = [
        Identity(name, index, rank, share / known, share, -3.0, None)
        for index, (name, rank, share) in enumerate(
            [("cup", 1, probability), ("mug", 1, probability), ("box", 3, rest)]
        )
    ]
    assert said in identification_line(Identification(tuple(objects), status, 0.1, unknown))


def test_unusable_input_has_status_two_and_one_line(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    empty = folder / "empty"
    empty.mkdir()
    (folder / "none.yaml").write_text("contacts: []\n")
    mesh = folder / "library" / "box.stl"
    planes = "planes: [{point: [0, 0, 0], normal: [0, 0, 1]}]\n"
    (folder / "planes.yaml").write_text((folder / "contacts.yaml").read_text() + planes)
    for library, contacts, said in [
        (empty, folder / "contacts.yaml", "must hold at least one object that can be used, but holds none"),
        (folder / "missing", folder / "contacts.yaml", "there is no such folder or manifest"),
        (mesh, folder / "contacts.yaml", f"{mesh} must be a folder of meshes, or a YAML file that lists some, not a"),
        (folder / "library", folder / "none.yaml", "contacts must be a list of at least one contact, not"),
        (folder / "library", folder / "missing.yaml", "cannot be read"),
        (
            folder / "library",
            folder / "planes.yaml",
            "planes must be left out, as they are not used to identify objects",
        ),
    ]:
        assert run(library, contacts) == 2
        out, err = capsys.readouterr()
        assert out == ""
        errors = err.splitlines()
        assert len(errors) == 1
        assert errors[0].startswith("error: ")
        assert said in errors[0]


def test_a_prior_that_is_none_has_status_two(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(folder / "library", folder / "contacts.yaml", "--unknown-prior", "1") == 2
    assert "error: --unknown-prior must be a number >= 0 and < 1, not 1." in capsys.readouterr().err
