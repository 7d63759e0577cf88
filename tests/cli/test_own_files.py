"""The command line with a hand and an object that the package has never seen."""

import json
import logging
import re
import warnings
from pathlib import Path

import click
import pytest
import trimesh

from tactopose_drake.cli.consoles import OnceFilter, tell_warnings
from tactopose_drake.hand.tactile_pads import load_tactile_pad
from tactopose_drake.resources import model_path
from tests.cli.test_cli import run
from tests.hand.grippers import YAML, write_gripper


def test_check_hand_shows_a_usable_hand(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    hand = write_gripper(tmp_path)
    assert run("check-hand", hand, "--html", tmp_path / "hand.html") == 0
    printed = capsys.readouterr()
    assert "region where it holds things" in " ".join(printed.out.split())
    assert "error" not in printed.err
    page = (tmp_path / "hand.html").read_text()
    assert page.lower().startswith("<!doctype html>")
    assert len(page) > 1_000_000


def test_check_hand_shows_the_cells_of_a_hand_that_has_some(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("check-hand", "barrett_like", "--cells", tmp_path / "cells.png") == 0
    assert (tmp_path / "cells.png").read_bytes().startswith(b"\x89PNG")
    assert run("check-hand", write_gripper(tmp_path), "--cells", tmp_path / "none.png") == 0
    assert "not written, since the hand has no tactile pads" in capsys.readouterr().out
    assert not (tmp_path / "none.png").exists()


def test_check_hand_says_which_files_it_does_not_write(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    hand, page, picture = (
        write_gripper(tmp_path, yaml="model: none.sdf\n"),
        tmp_path / "hand.html",
        tmp_path / "cells.png",
    )
    page.write_text("an earlier page")
    assert run("check-hand", hand, "--html", page, "--cells", picture) == 2
    printed = capsys.readouterr()
    assert "Written" not in printed.out
    for path in (page, picture):
        assert f"{path} is not written, since the hand cannot be read." in printed.out
    assert page.read_text() == "an earlier page"
    assert "error: " in printed.err


def test_what_an_input_leads_to_is_never_replaced(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    hand = write_gripper(tmp_path)
    for name in ("cube.obj", "cube.sdf"):
        (tmp_path / name).write_bytes(model_path("objects", name).read_bytes())
    (tmp_path / "pad.yaml").write_bytes(model_path("sensors", "bh280_finger.yaml").read_bytes())
    (tmp_path / "prior.yaml").write_text("X_PO: {translation: [0, 0, 0], quaternion_wxyz: [1, 0, 0, 0]}")
    pressures = [0.0] * len(load_tactile_pad("bh280_finger").layout)
    (tmp_path / "contacts.yaml").write_text(f"patches: [{{array: pad.yaml, alpha: 1e-8, pressures: {pressures}}}]")
    (tmp_path / "volume.yaml").write_text(f"hand: {hand.name}\njoints: {{left_slide: 0.0, right_slide: 0.0}}")
    (tmp_path / "joints.yaml").write_text("joints: {left_slide: 0.0, right_slide: 0.0}")
    scenario = tmp_path / "own.scenario.yaml"
    scenario.write_text(f"hand: {hand.name}\nobject: cube.sdf")
    other = tmp_path / "other.scenario.yaml"
    other.write_text("object: cube.sdf")
    (tmp_path / "grasps").mkdir()
    (tmp_path / "library").mkdir()
    (tmp_path / "library.yaml").write_text("cube: {mesh: cube.obj}")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()}
    touch = ["--contacts", tmp_path / "contacts.yaml"]
    estimate = ["estimate", "--object", tmp_path / "cube.sdf", *touch, "--hand-volume", tmp_path / "volume.yaml"]
    of_hand = [*estimate[:-1], tmp_path / "joints.yaml", "--hand", hand]
    identify = ["identify", "--library", tmp_path / "library.yaml", *touch]
    calibrate = ["calibrate", "--hand", hand, "--object", tmp_path / "cube.sdf", "--grasps", tmp_path / "grasps"]
    replay = ["replay", tmp_path / "recording", "--scenario", scenario]
    for arguments, output in (
        (["check-hand", hand, "--html"], "two_finger.urdf"),
        (["run", scenario, "--html"], "two_finger.urdf"),
        (["run", scenario, "--picture"], "cube.obj"),
        (["run", other, "--hand", hand, "--html"], "two_finger.urdf"),
        ([*replay, "--out"], "two_finger.hand.yaml"),
        ([*replay, "--html"], "cube.obj"),
        ([*estimate, "--out"], "cube.obj"),
        ([*estimate, "--out"], "pad.yaml"),
        ([*estimate, "--html"], "two_finger.urdf"),
        ([*of_hand, "--out"], "two_finger.urdf"),
        ([*identify, "--out"], "cube.obj"),
        ([*identify, "--out"], "pad.yaml"),
        ([*calibrate, "--out"], "cube.obj"),
        ([*calibrate, "--html"], "two_finger.urdf"),
    ):
        assert run(*arguments, tmp_path / output) == 2
        errors = capsys.readouterr().err
        assert f"{output} must be another file than an input, and not in one, which {tmp_path}" in errors
        assert errors.count("\n") == 1
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()} == before


def test_check_hand_ends_with_a_line_for_each_fault(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    hand = write_gripper(tmp_path, yaml=YAML.replace("radius: 0.012", "radius: 0.03"))
    assert run("check-hand", hand) == 2
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("error: ")]
    assert len(lines) == 2
    assert all(re.search(r"two_finger\.hand\.yaml: fingertip (left|right): of its surface 0%", line) for line in lines)


def test_check_hand_of_a_file_that_is_not_there(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("check-hand", "no_such.hand.yaml") == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "there is no such file" in line
    assert line.count("no_such.hand.yaml") == 1


def test_a_folder_is_told_from_what_is_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "contacts.yaml").write_text("contacts: [{position: [0, 0, 0]}]")
    for arguments in (["estimate", "--contacts", tmp_path / "contacts.yaml", "--object"], ["check-hand"]):
        assert run(*arguments, tmp_path) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith(f"error: {tmp_path} must be ")
        assert line.rstrip().endswith("not a folder.")


def test_demo_with_an_own_hand_and_a_mesh_in_millimetres(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    hand = write_gripper(tmp_path)
    trimesh.creation.box((45.0, 55.0, 90.0)).export(tmp_path / "my block.stl")
    arguments = ["--hand", hand, "--object", tmp_path / "my block.stl", "--scale", 0.001, "--mass", 0.2]
    assert run("demo", *arguments, "--out", tmp_path / "out", "--no-open") == 0
    printed = capsys.readouterr().out
    assert "2 fingertips hold the my block" in printed
    assert json.loads((tmp_path / "out" / "result.json").read_text())["status"] in ("ok", "ambiguous")
    assert {"my_block.sdf", "my_block.obj", "picture.png", "scene.html"} <= {
        path.name for path in (tmp_path / "out").iterdir()
    }
    assert "<mass>0.2</mass>" in (tmp_path / "out" / "my_block.sdf").read_text()


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--hand", "no_such_hand"], "must be a YAML file, or one of the package's hands,"),
        (["--object", "no_such.stl"], "no_such.stl"),
        (
            ["--object", "mug", "--scale", "0.001"],
            "--scale and --mass must be left out unless --object is a file's path",
        ),
    ],
)
def test_demo_says_what_it_cannot_use(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], text: str
) -> None:
    assert run("demo", *arguments, "--out", tmp_path, "--no-open") == 2
    assert text in " ".join(capsys.readouterr().err.split())


def test_run_says_how_the_grasp_went(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    hand = write_gripper(tmp_path)
    scenario = tmp_path / "grip.scenario.yaml"
    scenario.write_text(f"hand: {hand}\nobject: cube\nX_WBase: {{rotation: !Rpy {{deg: [90, 0, 90]}}}}\n")
    page, picture = tmp_path / "grip.html", tmp_path / "grip.png"
    assert run("run", scenario, "--duration", 1.8, "--html", page, "--picture", picture) == 0
    assert "hand: grip.scenario.yaml</title>" in page.read_text()
    assert "/tactopose/truth" in page.read_text()
    assert picture.read_bytes().startswith(b"\x89PNG")
    last = capsys.readouterr().out.strip().splitlines()[-1]
    assert re.fullmatch(
        r"The grasp is stable; since its release, the object has slipped by [\d.]+ mm and turned by [\d.]+ deg; "
        r"the estimate is off the truth by [\d.]+ mm and [\d.]+ deg, "
        r"where the touch determines it by [\d.]+ mm and [\d.]+ deg\.",
        last,
    )


def test_run_says_what_it_cannot_draw(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scenario = tmp_path / "live.scenario.yaml"
    scenario.write_text("object: cube\nsenses: !LcmSenses {url: 'memq://'}\ntracking: {use_joint_velocities: false}\n")
    assert run("run", scenario, "--html", tmp_path / "live.html") == 2
    assert "--html and --picture must be left out if the senses are messages." in capsys.readouterr().err
    scenario.write_text("object: cube\n")
    assert run("run", scenario, "--picture", scenario) == 2
    assert "must be another file than an input, and not in one" in capsys.readouterr().err


def test_a_scenario_runs_with_another_hand(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scenario, own = tmp_path / "mine.scenario.yaml", tmp_path / "own.hand.yaml"
    own.write_text(model_path("hands", "shadow_like", "shadow_like.hand.yaml").read_text())
    scenario.write_text("hand: allegro\nduration: 0.1\nplanner: {grasps: 1}\n")
    capsys.readouterr()
    for hand in ("shadow", own):
        run("run", scenario, "--hand", hand)
        assert "0.10 s: " in capsys.readouterr().out
    assert run("run", scenario, "--hand", "glove") == 2
    assert "error: --hand: glove must be a YAML file, or one of the package's hands," in capsys.readouterr().err


def test_estimate_takes_a_scale_and_known_symmetries(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    # A tin that is 4 % off round: that it is nearly symmetric is said, and a symmetry may be declared.
    tin = trimesh.creation.cylinder(radius=30.0, height=120.0, sections=96)
    tin.apply_scale([1.0, 1.04, 1.0])
    tin.export(tmp_path / "tin.stl")
    contacts = [
        "{position: [0.030, 0.0, 0.02], normal: [1.0, 0.0, 0.0]}",
        "{position: [0.0, 0.0312, -0.01], normal: [0.0, 1.0, 0.0]}",
        "{position: [-0.030, 0.0, 0.03], normal: [-1.0, 0.0, 0.0]}",
        "{position: [0.0, 0.01, 0.06], normal: [0.0, 0.0, 1.0]}",
    ]
    (tmp_path / "contacts.yaml").write_text("contacts:\n" + "\n".join(f"- {contact}" for contact in contacts))
    arguments = ["--object", tmp_path / "tin.stl", "--scale", 0.001, "--contacts", tmp_path / "contacts.yaml"]
    assert run("estimate", *arguments) == 0
    assert "tin: is nearly unchanged by turns about its z axis" in caplog.text
    assert "turn about the object's z" in " ".join(capsys.readouterr().out.split())
    caplog.clear()
    assert run("estimate", *arguments, "--symmetry", "z") == 0
    assert not caplog.records
    assert "turn about the object's z" in " ".join(capsys.readouterr().out.split())
    assert run("estimate", *arguments, "--symmetry", "z:2", "--symmetry", "x:2") == 0
    capsys.readouterr()
    for wrong in ("w", "z:1", "0,0,0"):
        assert run("estimate", *arguments, "--symmetry", wrong) == 2
        assert (
            f"--symmetry must be auto, none, or axes such as z, z:4 or 0,0.6,0.8:2, not '{wrong}'"
            in capsys.readouterr().err
        )
    for wrong in (("none", "z"), ("z", "auto"), ("none", "none")):
        assert run("estimate", *arguments, *(part for text in wrong for part in ("--symmetry", text))) == 2
        assert re.search(
            "--symmetry must be (none|auto) alone, or axes .*, not (none|auto) and 1 more", capsys.readouterr().err
        )


def test_a_message_of_drake_is_shown_once() -> None:
    once = OnceFilter()
    records = [logging.makeLogRecord({"msg": "no %s", "args": (what,)}) for what in ("mesh", "mesh", "mass")]
    assert [once.filter(record) for record in records] == [True, False, True]


def test_what_drake_says_of_many_lines_of_a_model_is_shown_of_the_first() -> None:
    once = OnceFilter()
    said = "{}: warning: {}\n[1 2]"
    messages = [
        said.format(*message) for message in (("a.urdf:6", "no mass"), ("a.urdf:8", "no mass"), ("a.urdf:8", "no axis"))
    ]
    messages += [said.format("b.urdf:6", "no mass")]
    records = [logging.makeLogRecord({"msg": message}) for message in messages]
    assert [once.filter(record) for record in records] == [True, False, True, True]


def test_a_repair_is_told_without_a_line_of_the_code(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    box = trimesh.creation.box((0.05, 0.04, 0.08))
    trimesh.util.concatenate([box, box.copy().apply_translation([0.06, 0.0, 0.0])]).export(tmp_path / "two.obj")
    (tmp_path / "grasps").mkdir()
    assert (
        run("calibrate", "--hand", "shadow_like", "--object", tmp_path / "two.obj", "--grasps", tmp_path / "grasps")
        == 2
    )
    first, second = capsys.readouterr().err.splitlines()
    assert first == "warning: two: kept 2 separate bodies as one rigid object."
    assert second.startswith("error: ")


def test_a_warning_of_several_places_is_told_once_and_others_are_left_to_python(
    capsys: pytest.CaptureFixture[str],
) -> None:
    def warn() -> None:
        with click.Context(click.Command("any")):
            tell_warnings(UserWarning)
            warnings.warn("open", UserWarning, stacklevel=1)
            warnings.warn("open", UserWarning, stacklevel=2)
            warnings.warn("old", DeprecationWarning, stacklevel=1)

    with pytest.warns(DeprecationWarning, match="old"):
        warn()
    assert capsys.readouterr().err == "warning: open\n"
