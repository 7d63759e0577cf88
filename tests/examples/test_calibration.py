import re
import runpy
from pathlib import Path

import numpy as np
import pytest

import tactopose_drake as tp
from tactopose_drake.core.poses import compose, exp_so3, make_poses, random_rotations, retract
from tactopose_drake.resources import model_path

SCRIPT = Path(__file__).parents[2] / "examples" / "calibration.py"


def test_a_few_trials_are_run_and_drawn(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    arguments = ["calibration.py", "--trials", "40", "--objects", "cube", "bust", "--out", str(tmp_path)]
    monkeypatch.setattr("sys.argv", arguments)
    runpy.run_path(str(SCRIPT), run_name="__main__")
    printed = capsys.readouterr().out
    shares = [float(share) for share in re.findall(r"holds 95 %: ([0-9.]+)%", printed)]
    assert len(shares) == 2
    assert min(shares) > 80.0
    squares = [float(square) for square in re.findall(r"mean squared Mahalanobis error ([0-9.]+)", printed)]
    assert len(squares) == 2
    assert all(3.0 < square < 10.0 for square in squares)
    assert (tmp_path / "calibration.txt").read_text(encoding="utf-8").strip() in printed
    assert (tmp_path / "calibration.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("name", ["wine_glass", "pencil", "bust"])
def test_the_distance_is_to_the_nearest_image(name: str) -> None:
    script = runpy.run_path(str(SCRIPT))
    model = tp.ObjectModel.from_mesh(model_path("objects", f"{name}.obj"))
    generator = np.random.default_rng(0)
    X_PO = make_poses(random_rotations(generator, 1), np.zeros((1, 3)))[0]
    root = generator.normal(size=(6, 6)) / np.repeat([0.1, 0.01], 3)[:, None]
    information = root.T @ root
    near = retract(X_PO, 0.02 * generator.normal(size=6) * [1, 1, 1, 0.1, 0.1, 0.1])
    turns = model.symmetry_poses
    for symmetry in model.symmetries:
        if symmetry.is_continuous:
            R = exp_so3(np.linspace(0, 2 * np.pi, 3000)[:, None] * symmetry.axis)
            turns = make_poses(R, symmetry.point - R @ symmetry.point)
    images = compose(near, turns)
    u = script["increments_between"](X_PO, images)
    least = np.einsum("bi,ij,bj->b", u, information, u).min()
    for truth in images[:: max(1, len(images) // 5)]:
        found = script["nearest_increments"](model, X_PO, information, truth[None])[0]
        assert found @ information @ found == pytest.approx(least, rel=0.02)
