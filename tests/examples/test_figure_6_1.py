import importlib
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib.image import imread

import tactopose_drake as tp
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface
from tactopose_drake.resources import model_path
from tests.core.meshes import random_pose

FOLDER = Path(__file__).parents[2] / "examples" / "thesis"
NAMES = ("mug", "tea_box")


@pytest.fixture(scope="module")
def script() -> ModuleType:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(FOLDER))
        return importlib.import_module("figure_6_1")


def made_up_grasps(name: str, count: int) -> list[SimpleNamespace]:
    """Five points on the object, in place of a simulation."""
    model, generator = tp.ObjectModel.from_mesh(model_path("objects", f"{name}.obj")), np.random.default_rng(0)
    touches = [touch_surface(model, random_pose(generator)[:3], 5, generator, sigma_position=0.0) for _ in range(count)]
    return [SimpleNamespace(p_PC=touch.p_PC, n_PC=touch.n_PC) for touch in touches]


def test_the_figure_has_numbers_and_a_picture(
    script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(script, "OBJECTS", NAMES)
    monkeypatch.setattr(script, "make_library", made_up_grasps)
    result = CliRunner().invoke(script.main, ["--grasps", "2", "--out", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    rows = {
        line.split()[1]: line.split()[2:] for line in result.output.splitlines() if line.strip()[:2] in ("1 ", "2 ")
    }
    assert list(rows) == list(NAMES)
    costs, by_cost, _, by_evidence = np.array([[float(cell) for cell in row] for row in rows.values()]).T
    # [B16] section 6.2.1, to the digits that are printed.
    np.testing.assert_allclose(by_cost, 100.0 / costs / np.sum(1.0 / costs), atol=1.0)
    assert by_evidence.sum() == pytest.approx(100.0, abs=0.11)
    assert by_evidence[0] > 99.0
    assert imread(tmp_path / "out" / "figure_6_1.png").shape[:2] == (640, 1300)


def test_noise_is_as_large_as_it_is_said_to_be(script: ModuleType) -> None:
    p_PC, n_PC = np.zeros((4000, 3)), np.tile([0.0, 0.0, 1.0], (4000, 1))
    contacts = script.make_contacts(p_PC, n_PC, (1, 2))
    assert np.std(contacts.p_PC) == pytest.approx(0.0009, rel=0.05)
    assert np.std(contacts.n_PC[:, :2]) == pytest.approx(np.radians(5.0), rel=0.05)
    assert "grasp_library" in sys.modules
