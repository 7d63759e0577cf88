"""A made-up recording is read as it was written, and followed."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.examples.scripts import load_script


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    path = tmp_path / "motion.csv"
    rows = [",ts,tx,ty,tz,rx,ry,rz"]
    for i in range(80):
        roll = (3.1 + 2e-3 * i + np.pi) % (2.0 * np.pi) - np.pi
        rows.append(f"{i},{5.0 + 0.01 * i},{0.1 + 1e-4 * i},0.2,-0.1,{roll},0.3,-0.4")
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


def test_angles_are_roll_elevation_and_azimuth_also_where_they_wrap(recording: Path) -> None:
    R, p = load_script("recorded_motions.py").read_motion(recording, 0.7)
    assert len(R) == len(p) == 70
    expected = Rotation.from_euler("ZYX", [[-0.4, 0.3, 3.1 + 2e-3 * i] for i in range(70)]).as_matrix()
    np.testing.assert_allclose(R, expected, atol=1e-6)
    np.testing.assert_allclose(p[:, 0], 0.1 + 1e-4 * np.arange(70), atol=1e-6)


def test_the_belief_follows_it(recording: Path) -> None:
    study = load_script("recorded_motions.py")
    rows = study.follow("tea_box", *study.read_motion(recording, 0.8), 0)
    assert rows.shape == (28, 6)
    assert rows[:, 1].mean() > 0.9
    assert np.all(np.isfinite(rows))


def test_it_is_drawn_and_where_there_is_nothing_that_is_said(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    study, options = load_script("recorded_motions.py"), ["--objects", "tea_box", "--seconds", "0.8"]
    given = [str(recording.parent), *options, "--out", str(tmp_path / "new")]
    monkeypatch.setattr("sys.argv", ["recorded_motions.py", *given])
    study.main()
    assert "tea_box" in capsys.readouterr().out
    assert (tmp_path / "new" / "recorded_motions.png").read_bytes().startswith(b"\x89PNG")
    monkeypatch.delenv(study.FOLDER_VARIABLE, raising=False)
    monkeypatch.setattr("sys.argv", ["recorded_motions.py", *options])
    study.main()
    assert "No recordings: skipped. TACTOPOSE_MOTIONS names a folder of them." in capsys.readouterr().out
