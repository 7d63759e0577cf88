import json
from pathlib import Path

import numpy as np
import pytest
from rich.table import Table

from tactopose_drake.demo import GraspFailedError, run_demo
from tactopose_drake.scenario import load_scenario
from tests.test_cli import run


@pytest.fixture(scope="module")
def demonstrated(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The folder that one run of the command leaves, and what it prints."""
    folder = tmp_path_factory.mktemp("demo") / "out"
    with pytest.MonkeyPatch.context() as patch:
        printed: list[str] = []
        patch.setattr("tactopose_drake.cli._console.print", lambda *parts: printed.extend(map(_text, parts)))
        assert run("demo", "--object", "tea_box", "--seed", 1, "--out", folder, "--no-open") == 0
    return folder, "\n".join(printed)


def _text(part: object) -> str:
    if not isinstance(part, Table):
        return str(part)
    cells = zip(*(column.cells for column in part.columns), strict=True)
    return "\n".join("|".join(map(str, row)) for row in cells)


def rows(printed: str) -> dict[str, list[str]]:
    return {line.split("|")[0]: line.split("|")[1:] for line in printed.splitlines() if "|" in line}


def test_the_pose_error_falls_and_is_printed(demonstrated: tuple[Path, str]) -> None:
    table = rows(demonstrated[1])
    before, after = (float(x) for x in table["position where determined, mm"])
    assert before > 20.0
    assert after < 0.5 * before
    before, after = (float(x) for x in table["angle where determined, deg"])
    assert before > 10.0
    assert after < 0.5 * before
    _, distance = table["contacts to surface (MDTS), mm"]
    assert float(distance) < 1.0


def test_each_finger_in_contact_is_printed_with_its_error(demonstrated: tuple[Path, str]) -> None:
    table = rows(demonstrated[1])
    fingers = [table[name] for name in ("thumb", "first", "middle", "ring", "little") if name in table]
    assert len(fingers) >= 3
    assert np.median([float(point_error) for _, point_error, _ in fingers]) < 0.5


def test_the_files_are_written(demonstrated: tuple[Path, str]) -> None:
    folder, printed = demonstrated
    result = json.loads((folder / "result.json").read_text())
    assert result["hypotheses"]
    assert (folder / "picture.png").read_bytes().startswith(b"\x89PNG")
    page = (folder / "scene.html").read_text()
    assert page.lower().startswith("<!doctype html>")
    for name in ("result.json", "picture.png", "scene.html"):
        assert str(folder / name) in printed


def test_a_grasp_that_fails_says_why() -> None:
    scenario = load_scenario("shadow_like")
    scenario.object = "tea_box"
    scenario.duration = 0.1
    scenario.check.attempts = 1
    with pytest.raises(GraspFailedError, match="with seed 0 held it: the fingers did not close in time"):
        run_demo(scenario)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--object", "unicorn"], "unicorn.sdf does not exist; the package's objects are bust, cube"),
        (["--seed", "-1"], "-1 is not in the range x>=0"),
        (
            ["--hand", "barrett", "--object", "pencil"],
            "is 'pencil', for which Scenario.grip.X_PO has no place in the hand",
        ),
        (["--hand", "claw"], "'claw' is not one of 'shadow', 'barrett'"),
    ],
)
def test_a_wrong_call_ends_with_status_2(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("demo", *arguments) == 2
    assert message in " ".join(capsys.readouterr().err.split())
