import io
import json
import math
import subprocess
import sys
from pathlib import Path

import click
import numpy as np
import pytest
import trimesh
import yaml
from pydrake.math import RigidTransform
from rich.console import Console

from tactopose_drake.cli import main as cli
from tactopose_drake.cli.estimate_tables import hypotheses_table
from tactopose_drake.core.poses import increments_between, make_poses, quaternion_from_matrix, retract
from tactopose_drake.core.poses import matrix_from_quaternion as rotation
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface
from tactopose_drake.estimation.pose_hypothesis import PoseHypothesis
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.resources import model_path
from tactopose_drake.visualization import remote_meshcat
from tactopose_drake.visualization.presentation import notebook_html
from tests.listening import Watch

X_PO = make_poses(rotation(np.array([0.8, 0.2, -0.4, 0.4])), np.array([0.01, -0.03, 0.09]))


def run(*arguments: object) -> int:
    """Runs the command line in this process, which opens no door to other machines, and returns its exit status."""
    status = 0
    with pytest.MonkeyPatch.context() as patch, Watch() as watch:
        patch.setattr("sys.argv", ["tactopose", *map(str, arguments)])
        try:
            cli.main()
        except SystemExit as stop:
            status = int(stop.code or 0)
    assert not watch.foreign
    return status


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A mesh, contacts sampled on it, with and without normals, and a doubtful prior."""
    folder = tmp_path_factory.mktemp("estimate")
    mesh = model_path("objects", "spray_bottle.obj")
    (folder / "bottle.obj").write_bytes(mesh.read_bytes())
    contacts = touch_surface(ObjectModel.from_mesh(mesh), X_PO, 6, np.random.default_rng(0))
    assert contacts.n_PC is not None
    touches = [
        {"position": p.tolist(), "normal": n.tolist()} for p, n in zip(contacts.p_PC, contacts.n_PC, strict=True)
    ]
    (folder / "contacts.yaml").write_text(yaml.safe_dump({"contacts": touches, "sigma_position": 0.0009}))
    points = [{"position": touch["position"]} for touch in touches]
    (folder / "points.yaml").write_text(yaml.safe_dump({"contacts": points}))
    X_prior = retract(X_PO, np.array([0.15, -0.1, 0.2, 0.02, -0.02, 0.015]))
    pose = {"translation": X_prior[:, 3].tolist(), "quaternion_wxyz": quaternion_from_matrix(X_prior[:, :3]).tolist()}
    (folder / "prior.yaml").write_text(yaml.safe_dump({"X_PO": pose}))
    near = retract(X_PO, np.array([0.05, -0.03, 0.03, 0.004, -0.004, 0.003]))
    pose = {"translation": near[:, 3].tolist(), "quaternion_wxyz": quaternion_from_matrix(near[:, :3]).tolist()}
    (folder / "near.yaml").write_text(
        yaml.safe_dump({"X_PO": pose, "sigma_translation": 0.005, "sigma_rotation_deg": 4.0})
    )
    return folder


def test_estimate_finds_the_pose(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--object", folder / "bottle.obj", "--contacts", folder / "contacts.yaml"]
    status = run("estimate", *arguments, "--prior", folder / "prior.yaml", "--out", folder / "result.json")
    assert status == 0
    result = json.loads((folder / "result.json").read_text())
    assert result["status"] in ("ok", "ambiguous")
    best = result["hypotheses"][0]
    found = make_poses(rotation(np.array(best["quaternion_wxyz"])), np.array(best["translation"]))
    off = increments_between(found, X_PO)
    assert np.linalg.norm(off[3:]) < 0.01
    assert np.linalg.norm(off[:3]) < math.radians(10)
    printed = capsys.readouterr().out
    assert "Pose of bottle in the palm frame" in printed
    assert "Not determined by the touch" in printed


def test_estimate_needs_no_prior(folder: Path) -> None:
    arguments = ["--object", folder / "bottle.obj", "--contacts", folder / "contacts.yaml"]
    assert run("estimate", *arguments, "--out", folder / "global.json") == 0
    result = json.loads((folder / "global.json").read_text())
    assert result["status"] in ("ok", "ambiguous")
    found = [
        increments_between(make_poses(rotation(np.array(h["quaternion_wxyz"])), np.array(h["translation"])), X_PO)
        for h in result["hypotheses"]
    ]
    assert min(np.linalg.norm(off[3:]) for off in found) < 0.01
    assert run("estimate", *arguments, "--method", "levenberg_marquardt") == 2


def test_estimate_works_without_normals(folder: Path) -> None:
    arguments = ["--object", folder / "bottle.obj", "--contacts", folder / "points.yaml"]
    status = run("estimate", *arguments, "--prior", folder / "near.yaml", "--out", folder / "points.json")
    assert status == 0
    best = json.loads((folder / "points.json").read_text())["hypotheses"][0]
    assert np.linalg.norm(np.array(best["translation"]) - X_PO[:, 3]) < 0.01


def test_estimate_writes_a_page_that_shows_the_scene(folder: Path) -> None:
    arguments = ["--object", folder / "bottle.obj", "--contacts", folder / "contacts.yaml"]
    assert run("estimate", *arguments, "--prior", folder / "prior.yaml", "--html", folder / "scene.html") == 0
    page = (folder / "scene.html").read_text()
    assert page.lower().startswith("<!doctype html>")
    assert "<title>Bottle in the hand: pose by touch</title>" in page
    assert 1e6 < len(page) < 6e6


def test_what_is_replaced_is_told(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = [
        "--object",
        folder / "bottle.obj",
        "--contacts",
        folder / "contacts.yaml",
        "--out",
        folder / "twice.json",
    ]
    assert run("estimate", *arguments) == 0
    assert "Replaced" not in capsys.readouterr().out
    assert run("estimate", *arguments) == 0
    assert f"Replaced: {folder / 'twice.json'}" in capsys.readouterr().out


def test_tables_fit_a_terminal_of_80_columns() -> None:
    model = ObjectModel.from_mesh(model_path("objects", "cube.obj"))
    pose = RigidTransform(
        make_poses(rotation(np.array([0.5, -0.5, -0.5, -0.5])), np.array([-0.1234, -0.2345, -0.3456]))
    )
    hypothesis = PoseHypothesis(pose, -1234.5, 0.0526, 1e-4 * np.eye(6), np.zeros((0, 6)))
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(hypotheses_table(PoseEstimate((hypothesis,) * 19, "ambiguous", 0.01), model))
    printed = console.export_text()
    assert "\u2026" not in printed  # the ellipsis of a cell that was cut
    assert "-123.4 -234.5 -345.6" in printed
    assert "0.500 -0.500 -0.500 -0.500" in printed
    assert "and 11 less probable" in printed
    assert max(map(len, printed.splitlines())) <= 80


def test_no_zero_of_a_table_is_negative() -> None:
    model = ObjectModel.from_mesh(model_path("objects", "cube.obj"))
    pose = RigidTransform(make_poses(rotation(np.array([1.0, -1e-5, 0.0, 0.0])), np.array([-1e-6, 0.0, 0.1])))
    hypothesis = PoseHypothesis(pose, 1.0, 1.0, 1e-4 * np.eye(6), np.zeros((0, 6)))
    estimate = PoseEstimate((hypothesis,), "ok", 0.01)
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(hypotheses_table(estimate, model))
    for printed in (console.export_text(), notebook_html(estimate)):
        assert "0.0 0.0 100.0" in printed
        assert "-0." not in printed


def write_mesh(path: Path, mesh: trimesh.Trimesh) -> Path:
    mesh.export(path)
    return path


def non_manifold() -> trimesh.Trimesh:
    vertices = [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1], [0, -0.1, 0.02]]
    return trimesh.Trimesh(vertices, [[0, 1, 2], [0, 1, 3], [0, 1, 4]], process=False)


BAD_CONTACTS = {
    "nan": ("contacts: [{position: [.nan, 0, 0]}]", "contacts[0].position[0] must be a finite number, not nan"),
    "infinite": ("contacts: [{position: [0, .inf, 0]}]", "contacts[0].position[1] must be a finite number, not inf"),
    "normal": (
        "contacts: [{position: [0, 0, 0], normal: [0, 0, 1.01]}]",
        "contacts[0].normal must have the length 1 within 0.001, not 1.01",
    ),
    "none": ("contacts: []", "contacts must be a list of at least one contact, not []"),
}


@pytest.mark.parametrize("name", BAD_CONTACTS)
def test_bad_contacts_end_with_status_2(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    text, message = BAD_CONTACTS[name]
    (tmp_path / "bad.yaml").write_text(text)
    arguments = ["--object", folder / "bottle.obj", "--contacts", tmp_path / "bad.yaml"]
    assert run("estimate", *arguments, "--prior", folder / "prior.yaml") == 2
    errors = capsys.readouterr().err
    assert message in errors
    assert errors.startswith(f"error: {tmp_path / 'bad.yaml'}: ")
    assert errors.count("\n") == 1


def test_objects_of_the_package_have_names(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--contacts", folder / "contacts.yaml", "--prior", folder / "near.yaml", "--out"]
    assert run("estimate", "--object", "spray_bottle", *arguments, folder / "named.json") == 0
    assert run("estimate", "--object", folder / "bottle.obj", *arguments, folder / "by_path.json") == 0
    named, by_path = (json.loads((folder / file).read_text()) for file in ("named.json", "by_path.json"))
    assert named["hypotheses"] == by_path["hypotheses"]
    capsys.readouterr()
    assert run("estimate", "--object", "bottle", *arguments, folder / "none.json") == 2
    errors = capsys.readouterr().err
    assert errors.startswith("error: --object must be one of the package's objects, bust, cube, ")
    assert errors.count("\n") == 1
    assert not (folder / "none.json").exists()


def bad_meshes(folder: Path) -> dict[str, tuple[Path, str]]:
    empty = folder / "empty.obj"
    empty.write_text("")
    text = folder / "text.xyzzy"
    text.write_text("no mesh")
    box = trimesh.creation.box((60, 90, 140))
    flat = trimesh.Trimesh([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]], [[0, 1, 2]], process=False)
    return {
        "absent": (folder / "absent.obj", "absent.obj: "),
        "empty": (empty, "empty.obj must have faces"),
        "format": (text, "text.xyzzy: "),
        "millimetres": (write_mesh(folder / "mm.stl", box), "0.001"),
        "non-manifold": (write_mesh(folder / "fan.obj", non_manifold()), "fan"),
        "flat": (write_mesh(folder / "flat.stl", flat), "flat"),
    }


@pytest.mark.parametrize("name", ["absent", "empty", "format", "millimetres", "non-manifold", "flat"])
def test_bad_meshes_end_with_status_2(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    mesh, message = bad_meshes(tmp_path)[name]
    arguments = ["--object", mesh, "--contacts", folder / "contacts.yaml", "--prior", folder / "prior.yaml"]
    assert run("estimate", *arguments) == 2
    errors = capsys.readouterr().err
    assert message in errors
    assert errors.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["estimate"], "Missing option '--object'"),
        (
            ["estimate", "--object", "x.obj", "--contacts", "y", "--method", "guess"],
            "'guess' is not one of 'pair_search'",
        ),
        (["estimate", "--object", "x.obj", "--contacts", "absent.yaml"], "absent.yaml cannot be read"),
        (["think"], "No such command 'think'"),
    ],
)
def test_a_wrong_call_ends_with_status_2(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(*arguments) == 2
    errors = capsys.readouterr().err
    assert message in errors
    assert errors.count("\n") == 1


@pytest.mark.parametrize("command", ["estimate", "identify"])
def test_contacts_that_are_too_far_apart_are_those_of_their_file(
    folder: Path, tmp_path: Path, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    touches = [{"position": [x, 0.0, 0.0]} for x in (0.0, 0.1, 9.0)]
    (tmp_path / "far.yaml").write_text(yaml.safe_dump({"contacts": touches}))
    (tmp_path / "library").mkdir()
    (tmp_path / "library" / "bottle.obj").write_bytes((folder / "bottle.obj").read_bytes())
    known = {"estimate": ["--object", folder / "bottle.obj"], "identify": ["--library", tmp_path / "library"]}[command]
    assert run(command, *known, "--contacts", tmp_path / "far.yaml") == 2
    errors = capsys.readouterr().err
    assert f"{tmp_path / 'far.yaml'}: contacts must be at most " in errors
    assert ", not 9 m." in errors


def test_an_output_that_cannot_be_written_is_found_before_the_work(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--object", "absent.obj", "--contacts", folder / "contacts.yaml"]
    assert run("estimate", *arguments, "--out", folder / "absent" / "result.json") == 2
    assert "does not exist" in capsys.readouterr().err
    assert run("estimate", *arguments, "--html", folder) == 2
    assert "must be a file, which may be new, not a folder" in capsys.readouterr().err


def test_a_wrong_command_line_says_where_the_right_one_stands(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("estimate", "--object", "mug.obj") == 2
    assert capsys.readouterr().err.endswith(
        "Missing option '--contacts'. `tactopose estimate --help` says what is allowed.\n"
    )
    assert run("estimate", "--seed", -1) == 2
    assert "-1 is not in the range x>=0" in capsys.readouterr().err


def test_no_command_shows_the_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert run() == 2
    printed = capsys.readouterr().err
    assert printed.startswith("Usage: tactopose")
    assert {"demo", "estimate", "identify"} <= {line.split()[0] for line in printed.splitlines() if line.strip()}


def test_the_list_of_commands_loads_none_of_them() -> None:
    lists = "from click.testing import CliRunner; from tactopose_drake.cli.main import cli; import sys; "
    asks = "print(CliRunner().invoke(cli, ['--help']).output, 'pydrake' in sys.modules)"
    printed = subprocess.run([sys.executable, "-c", lists + asks], capture_output=True, text=True, check=True).stdout
    named = {line.split()[0] for line in printed.splitlines() if line.strip()}
    assert set(cli.cli.list_commands(click.Context(cli.cli))) <= named
    assert printed.split()[-1] == "False"


def test_a_meshcat_server_that_is_not_there_is_told_before_any_work(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(remote_meshcat, "_ANSWER_TIME", 50)
    files = ["--object", folder / "no.obj", "--contacts", folder / "contacts.yaml"]
    assert run("estimate", *files, "--meshcat-url", "tcp://127.0.0.1:1") == 2
    assert "no meshcat-server answers at tcp://127.0.0.1:1" in capsys.readouterr().err
