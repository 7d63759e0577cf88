import dataclasses
import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from click.testing import CliRunner

SCRIPT = Path(__file__).parents[2] / "examples" / "thesis" / "table_3_1.py"
METHODS = ["Gradient descent", "Levenberg-Marquardt"]
THESIS_ROWS = [(method, uses) for method in METHODS for uses in ("w_n = 0", "w_n = 20")]
OUR_ROWS = [("tp.estimate_pose", "distance"), ("tp.estimate_pose", "distance, normals")]
SHAPES = ["cube", "cylinder"]
ITS, MDTS, MATN, RME, MAE, SPEED = range(6)


@pytest.fixture(scope="module")
def script() -> ModuleType:
    spec = importlib.util.spec_from_file_location("table_3_1", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["table_3_1"] = module  # Dataclasses look their module up.
    spec.loader.exec_module(module)
    return module


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
                assert own[MDTS] < 0.1 * theirs[MDTS]
                assert own[SPEED] < theirs[SPEED]
            assert ours[1][MATN] < theirs[MATN]
    # Four touches of a cube from known sides leave no rotation open.
    assert means(rows["tp.estimate_pose", "distance, normals", "cube"])[MAE] < 1.0


def test_the_plots_are_drawn(folder: Path) -> None:
    assert (folder / "figures_3_12_to_3_19.png").read_bytes().startswith(b"\x89PNG")


def test_a_trial_is_a_pure_function_of_its_seed(script: ModuleType) -> None:
    shape = script.make_shapes()["cylinder"]
    first, again, other = (script.make_trial(shape, np.random.default_rng(seed)) for seed in (5, 5, 6))
    np.testing.assert_array_equal(first.contacts.p_PC, again.contacts.p_PC)
    np.testing.assert_array_equal(first.prior.X_PO, again.prior.X_PO)
    assert not np.array_equal(first.prior.X_PO, other.prior.X_PO)


@pytest.mark.parametrize("row", [THESIS_ROWS[2], THESIS_ROWS[3], *OUR_ROWS])
def test_a_row_looks_at_normals_only_if_it_says_so(script: ModuleType, row: tuple[str, str]) -> None:
    shape = script.make_shapes()["cube"]
    trial = script.make_trial(shape, np.random.default_rng(0))
    other_normals = dataclasses.replace(trial.contacts, n_PC=np.roll(trial.contacts.n_PC, 1, axis=1))
    solve = script.make_solvers()[row]
    X_PO, X_PO_other = (
        solve(shape, script.Trial(contacts, trial.prior)).X_PO for contacts in (trial.contacts, other_normals)
    )
    assert np.array_equal(X_PO, X_PO_other) == (row[1] in ("w_n = 0", "distance"))


def test_contacts_are_exact_and_away_from_the_edges(script: ModuleType) -> None:
    cylinder = script.make_shapes()["cylinder"]
    points = cylinder.model.samples.points[cylinder.touchable]
    radius, height = np.linalg.norm(points[:, :2], axis=1), np.abs(points[:, 2])
    on_side, on_cap = np.isclose(radius, 0.035, atol=1e-5), np.isclose(height, 0.055, atol=1e-9)
    assert np.all(on_side ^ on_cap)
    assert height[on_side].max() < 0.055 - 0.014
    assert radius[on_cap].max() < 0.035 - 0.014


def test_a_cell_that_is_not_beaten_is_named(script: ModuleType) -> None:
    worse, better = np.full((1, 6), 2.0), np.full((1, 6), 1.0)
    values = dict.fromkeys(script.ROWS, worse) | {script.OUR_ROWS[1]: better}
    values[script.THESIS_ROWS[2]] = np.array([[2.0, 2.0, 2.0, 0.5, 2.0, 2.0]])
    line = script.verdict({"cube": values}, script.OUR_ROWS[1], script.THESIS_ROWS, published=False)
    assert "below 23 of the 24 cells" in line
    assert line.endswith("not below Levenberg-Marquardt, w_n = 0, cube: RME, cm.")
