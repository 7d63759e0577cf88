import re
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib.image import imread

import tactopose_drake as tp
from tactopose_drake.core.poses import make_poses, random_rotations
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface
from tactopose_drake.resources import model_path
from tests.examples.scripts import load_script


@pytest.fixture(scope="module")
def script() -> ModuleType:
    return load_script("thesis/figures_4_7_and_4_11.py")


def made_up_grasps(name: str, count: int) -> list[SimpleNamespace]:
    """Five points on the object and a ball before each, in place of a simulation."""
    model, generator = tp.ObjectModel.from_mesh(model_path("objects", f"{name}.obj")), np.random.default_rng(1)
    X_PO = make_poses(random_rotations(generator, 1), np.array([[0.02, 0.0, 0.1]]))[0]
    touches = [touch_surface(model, X_PO, 5, generator, sigma_position=0, sigma_normal=0) for _ in range(count)]
    return [
        SimpleNamespace(
            X_PO=X_PO,
            p_PC=touch.p_PC,
            n_PC=touch.n_PC,
            f_PC=2.0 * touch.n_PC,
            p_PH=touch.p_PC + 0.01 * touch.n_PC,
            radius=np.full(5, 0.01),
        )
        for touch in touches
    ]


def test_draws_both_and_says_how_far_off_the_poses_are(
    script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(script, "make_library", made_up_grasps)
    result = CliRunner().invoke(script.main, ["--trial", "1", "--out", str(tmp_path)])
    assert result.exit_code == 0, result.output
    assert (tmp_path / "figures_4_7_and_4_11.md").read_text(encoding="utf-8") == result.output
    lines = [line for line in result.output.splitlines() if line.startswith("- Figure")]
    assert [line.split(",")[0] for line in lines] == ["- Figure 4.7", "- Figure 4.11"]
    for line, name, thesis in zip(lines, ("4_7", "4_11"), ("4.05 mm and 5°", "7.1 mm and 3.72°"), strict=True):
        before, after = (float(mm) for mm in re.findall(r"([\d.]+) mm and [\d.]+° off", line))
        assert after < before
        assert thesis in line
        assert imread(tmp_path / f"figure_{name}.png").shape[0] > 500


def test_the_initial_pose_of_the_global_search_is_far_away(script: ModuleType) -> None:
    generator = np.random.default_rng(0)
    poses = np.array([script.far_pose(generator) for _ in range(50)])
    np.testing.assert_allclose(np.linalg.norm(poses[:, :, 3], axis=1), script.FAR)
    np.testing.assert_allclose(
        poses[:, :, :3] @ poses[:, :, :3].swapaxes(1, 2), np.tile(np.eye(3), (50, 1, 1)), atol=1e-9
    )
    assert np.ptp(poses[:, 0, 3]) > script.FAR
