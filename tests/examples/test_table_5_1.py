import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from click.testing import CliRunner

from tactopose_drake.hand.pad_calibration import AlphaFit, find_alpha

SCRIPT = Path(__file__).parents[2] / "examples" / "thesis" / "table_5_1.py"


@pytest.fixture(scope="module")
def script() -> ModuleType:
    spec = importlib.util.spec_from_file_location("table_5_1", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["table_5_1"] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def fit(script: ModuleType) -> AlphaFit:
    return find_alpha(modulus=script.MODULUS, thickness=script.THICKNESS)


@pytest.fixture(scope="module")
def text(script: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("table_5_1") / "new"
    result = CliRunner().invoke(script.main, ["--out", str(folder)])
    assert result.exit_code == 0, result.output
    assert "Table 5.1" in result.output
    assert (folder / "figures_5_3_to_5_5.png").read_bytes().startswith(b"\x89PNG")
    return (folder / "table_5_1.md").read_text(encoding="utf-8")


def test_every_cell_stands_beside_the_thesis_number_and_within_a_degree(text: str) -> None:
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line[:1] == "|"]
    printed = {
        "cylinder": [0, 0.9, 0.14, 0.42],
        "L-shape": [0.19, 0.5, 0.81, 0.68],
        "flat, wide": [0, 0.4, 0.07, 0.5],
        "flat, thin": [0, 0.07, 0, 0.62],
    }
    table = {row[0]: row[1:] for row in cells[2:]}
    assert list(table) == [*printed, "cylinder, 10 mm"]
    numbers = {shape: [[float(x) for x in re.findall(r"[\d.]+", cell)] for cell in row] for shape, row in table.items()}
    for shape, thesis in printed.items():
        assert [cell[2] for cell in numbers[shape]] == thesis
        assert all(mean <= largest <= 1.0 for mean, largest, _ in numbers[shape])
    assert all(len(cell) == 2 for cell in numbers["cylinder, 10 mm"])


def test_the_verdict_is_that_of_the_numbers(script: ModuleType, fit: AlphaFit, text: str) -> None:
    assert "1 and 0.5 deg were asked for: held." in text
    errors = script.errors_by_shape(fit)
    errors["L-shape"] = errors["L-shape"] + np.eye(4, 12)
    assert "NOT held" in script.verdicts(fit, errors)[1]


def test_a_thin_cylinders_own_surface_is_flatter_than_its_axis(script: ModuleType, text: str) -> None:
    match = re.search(r"leaves a patch of ([\d.]+) deg, and the cylinder's own surface there is at ([\d.]+)\.\n", text)
    assert match is not None
    patch, own = float(match[1]), float(match[2])
    assert own < 5.5
    assert abs(patch - own) < 0.5


def test_a_press_is_found_by_its_numbers(script: ModuleType, fit: AlphaFit) -> None:
    press = script.find_press(fit, "flat, thin", 7.0, 1)
    assert press.shape == "flat, thin"
    assert np.degrees(press.tilt) == pytest.approx(7.0)
    assert press.depth == pytest.approx(script.THICKNESS / 3)
