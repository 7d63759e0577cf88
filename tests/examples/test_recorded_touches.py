"""Made-up touches of a mesh of the package are read as they were written, and its pose is found by them."""

from pathlib import Path

import numpy as np
import pytest

import tactopose_drake as tp
from tactopose_drake.core.poses import make_poses, random_rotations
from tactopose_drake.core.synthetic import touch_surface
from tactopose_drake.resources import model_path
from tests.examples.scripts import load_script

MESH = model_path("objects", "spray_bottle.obj")


def written(points: np.ndarray, path: Path) -> Path:
    lines = ["OFF", f"{len(points)} 0 0", *(" ".join(map(str, point)) for point in points)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def test_the_pose_by_all_points_is_found_by_some(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    generator, model = np.random.default_rng(0), tp.ObjectModel.from_mesh(MESH)
    X_PO = make_poses(random_rotations(generator, 1)[0], np.array([0.1, -0.2, 0.3]))
    points = touch_surface(model, X_PO, 40, generator, sigma_position=0.001).p_PC
    path = written(points, tmp_path / "touches.off")
    study = load_script("recorded_touches.py")
    np.testing.assert_array_equal(study.read_points(path), points)
    options = ["--sigma", "0.001", "--counts", "20", "--draws", "5"]
    monkeypatch.setattr("sys.argv", ["recorded_touches.py", str(MESH), str(path), *options])
    study.main()
    printed = capsys.readouterr().out
    assert "40 points: ok" in printed
    (distance,) = (float(line.split("│")[2]) for line in printed.splitlines() if line.startswith("│ 1.000"))
    assert 0.7 < distance < 1.1
    some, every = (line.split("│")[1:-1] for line in printed.splitlines() if " of 5 " in line)
    assert (some[0].strip(), every[0].strip()) == ("20", "40")
    for row in (some, every):
        assert row[1].strip() == row[4].strip() == "5 of 5"


@pytest.mark.parametrize(
    "text", ["", "OFF\n2 0 0\n1 2 3\n", "OFF\nx\n", "OFF\n1 0 0\n1 2 nan\n", "PLY\n1 0 0\n1 2 3\n"]
)
def test_what_is_no_list_of_points_is_said(text: str, tmp_path: Path) -> None:
    path = tmp_path / "touches.off"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SystemExit, match="must be a list of points: a line OFF"):
        load_script("recorded_touches.py").read_points(path)
