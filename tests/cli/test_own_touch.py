"""The command line with all that may be known of a touch: patches, forces, the hand's volume, balance, friction."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

import tactopose_drake as tp
from tactopose_drake.estimation import ObjectLibrary, load_prior
from tactopose_drake.hand import load_hand_volume, load_touch
from tactopose_drake.resources import model_path
from tests.cli.test_cli import run

TOUCH = """
contacts:
- {position: [0.020, 0.0, 0.01], normal: [1.0, 0.0, 0.0], force: [2.0, 0.0, -0.3]}
- {position: [-0.020, 0.0, 0.01], normal: [-1.0, 0.0, 0.0], force: [-2.0, 0.0, -0.3]}
"""
PATCHES = """
patches:
- array: bh280_palm
  X_PT: {translation: [0.0, -0.03, 0.0775], quaternion_wxyz: [0.0, 1.0, 0.0, 0.0]}
  pressures: [0, 0, 0, 0, 0, 0, 0, 0, 1e4, 0, 0, 0, 0, 0, 0, 2e4, 0, 0, 0, 0, null, 0, 0, 0]
  alpha: 2.0e-8
"""
PLANES = """
planes:
- {point: [0.0, 0.0, -0.04], normal: [0.0, 0.0, 1.0]}
"""
VOLUME = """
spheres: [{center: [0.05, 0.0, 0.0], radius: 0.02}]
untouched: [{center: [0.0, 0.0, 0.06], radius: 0.01}]
"""
PRIOR = "X_PO: {translation: [0.002, 0.001, -0.003], quaternion_wxyz: [1, 0, 0, 0]}"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    trimesh.creation.box((0.04, 0.06, 0.09)).export(tmp_path / "box.obj")
    (tmp_path / "touch.yaml").write_text(TOUCH)
    (tmp_path / "patches.yaml").write_text(TOUCH + PATCHES)
    (tmp_path / "planes.yaml").write_text(TOUCH + PLANES)
    (tmp_path / "volume.yaml").write_text(VOLUME)
    (tmp_path / "prior.yaml").write_text(PRIOR)
    return tmp_path


def poses(estimate: tp.PoseEstimate) -> list[list[float]]:
    return [hypothesis.X_PO.translation().tolist() for hypothesis in estimate.hypotheses]


def test_all_that_is_known_reaches_the_estimate(folder: Path) -> None:
    common = ["--object", folder / "box.obj", "--prior", folder / "prior.yaml", "--out", folder / "out.json"]
    model, prior = tp.ObjectModel.from_mesh(folder / "box.obj", mass=0.06), load_prior(folder / "prior.yaml")
    touch, patched = load_touch(folder / "touch.yaml"), load_touch(folder / "patches.yaml")
    volumes, planes = load_hand_volume(folder / "volume.yaml"), load_touch(folder / "planes.yaml").planes
    gravity = np.array([0.0, 0.0, -9.81])
    by_touch, by_all = ["--contacts", folder / "touch.yaml"], ["--contacts", folder / "patches.yaml"]
    found = []
    for options, expected in (
        (by_touch, tp.estimate_pose(model, touch.contacts, prior=prior)),
        (by_all, tp.estimate_pose(model, patched.contacts, patches=patched.patches, prior=prior)),
        (
            ["--contacts", folder / "planes.yaml"],
            tp.estimate_pose(model, touch.contacts, planes=planes, prior=prior),
        ),
        (
            [*by_touch, "--hand-volume", folder / "volume.yaml"],
            tp.estimate_pose(model, touch.contacts, prior=prior, hand=volumes.hand, untouched=volumes.untouched),
        ),
        ([*by_touch, "--friction", 0.2], tp.estimate_pose(model, touch.contacts, prior=prior, friction=0.2)),
        (
            [*by_touch, "--outlier-probability", 0.3],
            tp.estimate_pose(model, touch.contacts, prior=prior, outlier_probability=0.3),
        ),
        (
            [*by_touch, "--gravity", 0, 0, -9.81, "--mass", 0.06],
            tp.estimate_pose(model, touch.contacts, prior=prior, balance=tp.ForceBalance(gravity)),
        ),
    ):
        assert run("estimate", *common, *options) == 0
        result = json.loads((folder / "out.json").read_text())
        found.append([hypothesis["translation"] for hypothesis in result["hypotheses"]])
        assert found[-1] == poses(expected)
    assert all(other != found[0] for other in found[1:])


def test_a_hand_is_named_on_the_command_line_or_in_its_volume_s_file(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    joints = "joints: {FFJ4: 0.0, FFJ3: 0.2, FFJ2: 0.3}\nuntouched: [first]\n"
    (folder / "named.yaml").write_text(f"hand: shadow_like\n{joints}")
    (folder / "bare.yaml").write_text(joints)
    common = ["estimate", "--object", folder / "box.obj", "--contacts", folder / "touch.yaml"]
    common += ["--prior", folder / "prior.yaml", "--out", folder / "out.json"]
    results = []
    for options in (
        [],
        ["--hand", "shadow"],
        ["--hand-volume", folder / "named.yaml"],
        ["--hand-volume", folder / "bare.yaml", "--hand", "shadow"],
        ["--hand-volume", folder / "bare.yaml", "--hand", model_path("hands", "shadow_like", "shadow_like.hand.yaml")],
    ):
        assert run(*common, *options) == 0
        results.append(json.loads((folder / "out.json").read_text())["hypotheses"])
        assert ("--hand is not used" in capsys.readouterr().err) == (options == ["--hand", "shadow"])
    assert results[0] == results[1]
    assert results[2] == results[3] == results[4] != results[0]
    for options, text in (
        (["--hand", "glove"], "glove must be a YAML file, or one of the package's hands,"),
        (["--hand-volume", folder / "bare.yaml", "--hand", "barrett"], "must be one of finger_1"),
        (["--hand-volume", folder / "bare.yaml"], "bare.yaml: the content must have the key 'hand', but lacks it"),
    ):
        assert run(*common, *options) == 2
        assert text in capsys.readouterr().err


def test_what_does_not_go_together_is_one_line(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bare = folder / "bare.yaml"
    bare.write_text("contacts: [{position: [0.02, 0, 0]}]")
    common = ["--object", folder / "box.obj"]
    for options, text in (
        (["--contacts", bare, "--friction", 0.5], "contacts must have forces f_PC for the friction, not None."),
        (["--contacts", folder / "touch.yaml", "--friction", -1], "friction must be a number >= 0, not -1"),
        (
            ["--contacts", folder / "touch.yaml", "--outlier-probability", 1],
            "outlier_probability must be a number from 0 to 0.99, not 1",
        ),
        (
            ["--contacts", folder / "touch.yaml", "--gravity", 0, 0, -9.81],
            "--gravity must come with a mass, but that of",
        ),
        (
            ["--contacts", folder / "touch.yaml", "--gravity", 0, 0, "nan"],
            "--gravity: gravity_P[2] must be a finite number, not nan",
        ),
        (["--contacts", folder / "touch.yaml", "--mass", -1], "mass must be a number > 0, not -1"),
        (["--contacts", folder / "touch.yaml", "--hand-volume", folder / "none.yaml"], "none.yaml cannot be read"),
    ):
        assert run("estimate", *common, *options) == 2
        (line,) = capsys.readouterr().err.strip().splitlines()
        assert text in line


def test_a_pad_that_feels_something_else_is_named(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    silent = PATCHES.replace("1e4", "0").replace("2e4", "0").replace("0.0775", "0.3")
    false = PATCHES.replace("patches:", "").replace("0.0775", "0.15")
    more = """
- {position: [0.005, 0.03, 0.02], normal: [0.0, 1.0, 0.0], force: [0.0, 2.0, 0.0]}
- {position: [-0.005, -0.03, -0.02], normal: [0.0, -1.0, 0.0], force: [0.0, -2.0, 0.0]}
- {position: [-0.005, -0.01, -0.045], normal: [0.0, 0.0, -1.0], force: [0.0, 0.0, -2.0]}
"""
    (folder / "false.yaml").write_text(TOUCH.rstrip() + more.rstrip() + silent.rstrip() + false)
    options = ["--prior", folder / "prior.yaml", "--html", folder / "false.html"]
    assert run("estimate", "--object", folder / "box.obj", "--contacts", folder / "false.yaml", *options) == 0
    line = "Probably not of this object: contact 6 (patch 2)."
    assert line in capsys.readouterr().out
    assert line in (folder / "false.html").read_text()


def test_an_object_is_identified_by_patches_too(folder: Path) -> None:
    library = folder / "library"
    library.mkdir()
    trimesh.creation.box((0.04, 0.06, 0.09)).export(library / "box.obj")
    trimesh.creation.icosphere(radius=0.02).export(library / "ball.obj")
    options = ["--library", library, "--contacts", folder / "patches.yaml", "--jobs", 1, "--out", folder / "found.json"]
    assert run("identify", *options) == 0
    found = json.loads((folder / "found.json").read_text())
    touch = load_touch(folder / "patches.yaml")
    known = ObjectLibrary.open(library)
    with_patches, without = (tp.identify(known, touch.contacts, patches) for patches in (touch.patches, ()))
    evidence = {each["name"]: each["log_evidence"] for each in found["objects"]}
    assert evidence == pytest.approx({each.name: each.log_evidence for each in with_patches.identities}, abs=1e-6)
    assert evidence != pytest.approx({each.name: each.log_evidence for each in without.identities}, abs=0.1)
