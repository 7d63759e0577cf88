import dataclasses
import importlib
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from tactopose_drake.core.shape.model_cache import FOLDER_VARIABLE

FOLDER = Path(__file__).parents[2] / "examples" / "thesis"


@pytest.fixture(scope="module")
def script() -> ModuleType:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(FOLDER))
        return importlib.import_module("figure_5_11")


@pytest.fixture(scope="module")
def folder(script: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("figure_5_11") / "new"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(FOLDER_VARIABLE, str(folder.parent / "cache"))
        result = CliRunner().invoke(script.main, ["--out", str(folder)])
    assert result.exit_code == 0, result.output
    text = " ".join(result.output.split())
    assert "algorithm 5.2: least at" in text
    assert "deg (thesis: about 0 deg)" in text
    assert "deg (thesis: about 20 deg)" in text
    return folder


@pytest.fixture
def grasp(script: ModuleType, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setenv(FOLDER_VARIABLE, str(folder.parent / "cache"))
    return script.load_pad_grasp(script.GRIP, script.GRIPS[script.GRIP])


def test_the_figure_is_drawn(folder: Path) -> None:
    assert (folder / "figure_5_11.png").read_bytes().startswith(b"\x89PNG")


def test_the_bottle_fits_where_it_is(script: ModuleType, grasp: Any) -> None:
    costs = script.turned_costs(grasp)
    middle = len(script.TURNS_DEG) // 2
    for method in (script.PCA, script.OURS):
        assert abs(script.TURNS_DEG[costs[method].argmin()]) < 3.0
    for method in script.METHODS:
        assert costs[method][middle] == pytest.approx(grasp.objectives[method].cost(grasp.X_PO[None])[0])


def test_the_turn_is_about_the_vertical(script: ModuleType, grasp: Any) -> None:
    class Height:
        def cost(self, X_PO: np.ndarray) -> np.ndarray:
            return X_PO[:, 2, :] @ np.array([1.0, 2.0, 3.0, 4.0])

    lifted = dataclasses.replace(grasp, objectives=dict.fromkeys(script.METHODS, Height()))
    for cost in script.turned_costs(lifted).values():
        np.testing.assert_allclose(cost, Height().cost(grasp.X_PO[None])[0], atol=1e-12)


def test_verdicts_say_where_the_least_is(script: ModuleType) -> None:
    least = zip(script.METHODS, (5.0, -20.0, 0.5), strict=True)
    assert script.verdicts({method: (script.TURNS_DEG - at) ** 2 for method, at in least}) == [
        "algorithm 5.2: least at 5.0 deg (thesis: about 0 deg).",
        "algorithm 5.3: least at -20.0 deg (thesis: about 20 deg).",
        "ours: least at 0.5 deg.",
    ]
