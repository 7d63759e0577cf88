"""Recordings that were made from a real hand's data without a run, whose manifest does not say where they came from."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

from tactopose_drake.cli import replay_command
from tactopose_drake.hand.calibration_file import HandCalibration, MeasuredNumber, save_calibration
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.resources import model_path
from tactopose_drake.runs.manifest import MANIFEST, SIGNALS
from tactopose_drake.runs.scenario_replay import replay
from tactopose_drake.station.scenario import Scenario
from tactopose_drake.systems.signals import SignalRecorder

OFFSET_DEG = 4.0  # of a knuckle's encoder


def touched(folder: Path, hand: Path, read_too_much: float, senses: str) -> np.ndarray:
    """Where the middle finger touches by the replay of a recording, (1, 3); its knuckle's readings are off, rad."""
    folder.mkdir()
    plant, parts = make_hand_plant(load_hand_config("shadow_like"))
    q = np.full(plant.num_positions(), 0.1)
    q[plant.GetJointByName("MFJ3", parts.model_instance).position_start()] += read_too_much
    (folder / MANIFEST).write_text(
        f"format: 1\nscenario: {{hand: {hand}, object: mug{senses}}}\nversions: {{python: unknown}}\nstart: 1.0e9\n"
    )
    with SignalRecorder(folder / SIGNALS) as signals:
        signals.write("prior", 0.0, None)
        for time in (0.0, 0.1, 0.2):
            signals.write("joint_positions", time, q + 1e-6 * time)
            for finger in ("first", "middle", "ring", "little", "thumb"):
                wrench = np.array([0.0, 0.01, 0.0, 1.5, 0.0, -3.0 - time])
                signals.write(f"wrench_{finger}", time, wrench if finger == "middle" else np.full(6, np.nan))
    p_PC: np.ndarray = replay(folder, Scenario(hand=str(hand), object="mug")).view.value("contacts").p_PC
    return p_PC


def never_shown() -> SimpleNamespace:
    """A recorder of pages that writes none."""
    return SimpleNamespace(show=lambda view: None, save=lambda path, title: False)


@pytest.mark.parametrize(("senses", "holds"), [("", True), (", senses: !SimulatedSenses {}", False)])
def test_a_real_hands_calibration_holds_for_its_data(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, senses: str, holds: bool
) -> None:
    text = model_path("hands", "shadow_like", "shadow_like.hand.yaml").read_text()
    hand, calibrated = tmp_path / "own.hand.yaml", tmp_path / "calibrated.hand.yaml"
    hand.write_text(text)
    calibrated.write_text(f"{text}\ncalibration: calibration.yaml\n")
    offset = MeasuredNumber(value=OFFSET_DEG)
    save_calibration(tmp_path / "calibration.yaml", HandCalibration(joint_offsets={"MFJ3": offset}))
    exact = touched(tmp_path / "exact", hand, 0.0, senses)
    found = touched(tmp_path / "found", calibrated, np.radians(OFFSET_DEG), senses)
    assert len(exact) == 1
    # The page draws the same hand.
    drawn: list[Scenario] = []
    monkeypatch.setattr(replay_command, "PageRecorder", lambda scenario, model: drawn.append(scenario) or never_shown())
    (tmp_path / "own.scenario.yaml").write_text(f"hand: {calibrated}\nobject: mug\n")
    words = [
        str(tmp_path / "found"),
        "--scenario",
        str(tmp_path / "own.scenario.yaml"),
        "--html",
        str(tmp_path / "x.html"),
    ]
    CliRunner().invoke(replay_command.replay, words)  # There is no estimate from a single contact.
    assert bool(drawn[0].hand_config().calibration) == holds
    assert (np.linalg.norm(found - exact) < 1e-6) == holds
