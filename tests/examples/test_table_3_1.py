import re
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from click.testing import CliRunner

from tests.examples.scripts import share_script

METHODS = ["Gradient descent", "Levenberg-Marquardt"]
THESIS_ROWS = [(method, uses) for method in METHODS for uses in ("w_n = 0", "w_n = 20")]
OUR_ROWS = [("tp.estimate_pose", "distance"), ("tp.estimate_pose", "distance, normals")]
SHAPES = ["cube", "cylinder"]
ITS, MDTS, MATN, RME, MAE, SPEED = range(6)


@pytest.fixture(scope="module")
def script() -> ModuleType:
    return share_script("thesis/table_3_1.py")


@pytest.fixture(scope="module")
def folder(script: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("table_3_1") / "new"
    result = CliRunner().invoke(script.main, ["--trials", "2", "--seed", "3", "--out", str(folder)])
    assert result.exit_code == 0, result.output
    assert "Table 3.1" in result.output
    return folder


@pytest.fixture(scope="module")
def rows(folder: Path) -> dict[tuple[str, str, str], list[str]]:
    """The cells of each row of the Markdown table."""
    lines = (folder / "table_3_1.md").read_text(encoding="utf-8").splitlines()
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if line.startswith("|")]
    assert [heading.split(",")[0] for heading in cells[0][3:]] == ["Its.", "MDTS", "MATN", "RME", "MAE", "Speed"]
    return {(row[0], row[1], row[2]): row[3:] for row in cells[2:]}


def means(row: list[str]) -> np.ndarray:
    return np.array([float(cell.split()[0]) for cell in row])


def test_the_table_has_every_cell_beside_the_thesis_number(rows: dict[tuple[str, str, str], list[str]]) -> None:
    initial = [("Initial", "")]
    assert list(rows) == [(*row, shape) for row in initial + THESIS_ROWS + OUR_ROWS for shape in SHAPES]
    for row, shape in ((row, shape) for row in THESIS_ROWS for shape in SHAPES):
        assert all(re.fullmatch(r"\d+\.\d+ \(\d+\.\d+\)", cell) for cell in rows[*row, shape])
    for shape in SHAPES:
        assert all(re.fullmatch(r"\d+\.\d+ \(\d+\.\d+\)", cell) for cell in rows["Initial", "", shape][MDTS:SPEED])
    # Table 3.1 of the thesis: Levenberg-Marquardt, w_n = 20, cylinder.
    printed = [re.search(r"\((.*)\)", cell) for cell in rows["Levenberg-Marquardt", "w_n = 20", "cylinder"]]
    assert [match and float(match[1]) for match in printed] == [18.4, 0.083, 2.67, 0.397, 4.92, 0.813]


def test_every_method_improves_and_ours_explains_the_touch_best(rows: dict[tuple[str, str, str], list[str]]) -> None:
    for shape in SHAPES:
        initial = float(rows["Initial", "", shape][MDTS].split()[0])
        ours = [means(rows[*row, shape]) for row in OUR_ROWS]
        for row in THESIS_ROWS:
            theirs = means(rows[*row, shape])
            assert theirs[MDTS] < initial
            assert theirs[ITS] <= 200
            for own in ours:
                assert own[MDTS] - 0.0005 < 0.1 * theirs[MDTS]  # Cells are rounded to thousandths.
            assert ours[1][MATN] < theirs[MATN]
    # Four touches of a cube from known sides leave no rotation open.
    assert means(rows["tp.estimate_pose", "distance, normals", "cube"])[MAE] < 1.0


def test_the_plots_are_drawn(folder: Path) -> None:
    assert (folder / "figures_3_12_to_3_19.png").read_bytes().startswith(b"\x89PNG")


def test_a_cell_that_is_not_beaten_is_named(script: ModuleType) -> None:
    worse, better = np.full((1, 6), 2.0), np.full((1, 6), 1.0)
    values = dict.fromkeys(script.ROWS, worse) | {script.OUR_ROWS[1]: better}
    values[script.THESIS_ROWS[2]] = np.array([[2.0, 2.0, 2.0, 0.5, 2.0, 2.0]])
    line = script.verdict({"cube": values}, script.OUR_ROWS[1], script.THESIS_ROWS, published=False)
    assert "below 23 of the 24 cells" in line
    assert line.endswith("not below Levenberg-Marquardt, w_n = 0, cube: RME, cm.")
