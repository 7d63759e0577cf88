import importlib
import re
from pathlib import Path
from types import ModuleType

import pytest
from click.testing import CliRunner

FOLDER = Path(__file__).parents[2] / "examples" / "thesis"
BOTTLE = "f) thermal bottle, lying"
SEARCHES = ["Monte Carlo", "DIRECT", "annealing", "ours"]


@pytest.fixture(scope="module")
def script() -> ModuleType:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(FOLDER))
        return importlib.import_module("table_5_2")


@pytest.fixture(scope="module")
def text(script: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("table_5_2") / "new"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(script, "GRIPS", {BOTTLE: script.GRIPS[BOTTLE]})
        patch.setattr(script, "POSES", 1000)
        result = CliRunner().invoke(script.main, ["--trials", "2", "--seed", "1", "--out", str(folder)])
    assert result.exit_code == 0, result.output
    assert "Table 5.2" in result.output
    return (folder / "table_5_2.md").read_text(encoding="utf-8")


def test_every_cell_stands_beside_the_thesis_number(text: str) -> None:
    assert text.startswith("# Table 5.2, 1 grips, 2 trials each, seed 1")
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line[:1] == "|"]
    assert cells[0][2:] == SEARCHES
    # [B16] table 5.2.
    printed = {
        ("algorithm 5.2", "average cost"): [0.1343, 0.1058, 0.1308],
        ("algorithm 5.2", "average duration, s"): [16.4901, 10.7876, 38.6335],
        ("algorithm 5.3", "average cost"): [1.2877, 1.1102, 1.1513],
        ("algorithm 5.3", "average duration, s"): [20.7059, 9.2987, 30.7758],
    }
    table = {(row[0], row[1]): row[2:] for row in cells[2:]}
    assert list(table) == list(printed)
    for key, thesis in printed.items():
        for own, other in zip(table[key][:3], thesis, strict=True):
            match = re.fullmatch(r"([\d.e-]+) \(([\d.]+)\)", own)
            assert match is not None
            assert float(match[1]) > 0.0
            assert float(match[2]) == other
        assert float(table[key][3]) > 0.0
    # A corrected bottle is within 2.5 mm of the cells of each of the four pads.
    assert all(float(cell.split()[0]) < 4 * 0.0025**2 for cell in table["algorithm 5.3", "average cost"])


def test_averages_are_over_the_grips(script: ModuleType) -> None:
    keys = [(objective, name) for objective in script.THESIS for name in SEARCHES]
    grips = {
        f"{i}": {key: script.Outcome(i * (1.0 + keys.index(key)), 10.0 - keys.index(key)) for key in keys}
        for i in (1, 3)
    }
    means = script.averages(grips)
    assert [means[key] for key in keys] == [(2.0 * (1.0 + k), 10.0 - k) for k in range(len(keys))]
    first, second = script.verdicts(grips)
    assert first.startswith("algorithm 5.2: least average cost by Monte Carlo, quickest ours ")
    assert first.endswith("is 4.00 of the best other's.")
    assert second.endswith("is 1.60 of the best other's.")
