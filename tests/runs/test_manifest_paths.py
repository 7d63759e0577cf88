"""Paths in the manifest of a recording."""

from pathlib import Path

import pytest

from tactopose_drake.runs.manifest import load_manifest, save_manifest
from tactopose_drake.station.scenario import Scenario


def test_paths_in_a_manifest_are_from_its_folder_and_names_stay_names(tmp_path: Path) -> None:
    (tmp_path / "manifest.yaml").write_text(
        "format: 1\nscenario: {hand: ../own.hand.yaml, object: mug}\nversions: {python: unknown}\n"
    )
    scenario = load_manifest(tmp_path).scenario
    assert (scenario.hand, scenario.object) == (str(tmp_path.parent / "own.hand.yaml"), "mug")


def test_paths_from_the_folder_of_a_run_hold_for_its_recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run, elsewhere, recording = (tmp_path / name for name in ("run", "elsewhere", "run/recording"))
    for folder in (run, elsewhere, recording):
        folder.mkdir()
    monkeypatch.chdir(run)
    scenario = Scenario(hand="own.hand.yaml", object="cup.obj")
    save_manifest(recording, scenario, 0.0, {}, {})
    load_manifest(Path("recording")).check_scenario(scenario, recording)
    assert scenario.hand == "own.hand.yaml"
    monkeypatch.chdir(elsewhere)
    recorded = load_manifest(recording).scenario
    assert (recorded.hand, recorded.object) == (str(run / "own.hand.yaml"), str(run / "cup.obj"))
