from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from click.testing import CliRunner

from tests.examples.scripts import share_script


@pytest.fixture(scope="module")
def example() -> ModuleType:
    return share_script("pencil_on_table.py")


def test_the_table_tells_what_the_fingers_do_not(example: ModuleType, tmp_path: Path) -> None:
    arguments = ["--trials", "4", "--first-seed", "2000", "--out", str(tmp_path / "new")]
    result = CliRunner().invoke(example.main, arguments, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    rows = {
        row.split("|")[1].strip(): [cell.strip() for cell in row.split("|")[2:-1]]
        for row in (tmp_path / "new" / "pencil_on_table.md").read_text().splitlines()
        if row.startswith("| ") and "felt" not in row
    }
    assert list(rows) == list(example.WAYS)
    alone, *_, whole = rows.values()
    assert float(alone[2]) > 3.0, "the fingers alone leave the slide open"
    assert float(whole[2]) < 1.5
    assert int(whole[4]) >= 3
    assert (tmp_path / "new" / "pencil_on_table.png").read_bytes().startswith(b"\x89PNG")


def test_the_table_is_where_the_pencil_stands(example: ModuleType) -> None:
    closing = example.plan_closing()
    model = example.tp.ObjectModel.from_mesh(example.model_path("objects", "pencil.obj"))
    plan = example.hand_over(closing, np.random.default_rng(3))
    planes = example.table_touches(model, plan.X_PO, closing, np.random.default_rng(4))
    p_PV = model.vertices @ plan.X_PO[:, :3].T + plan.X_PO[:, 3]
    for plane in planes.values():
        assert abs(((p_PV - plane.p_PQ) @ plane.n_P).min()) < 4 * example.SIGMA_TABLE
    upright = -closing.X_PO[:, 2]
    cosines = [-plane.n_P @ upright for plane in planes.values()]
    np.testing.assert_allclose(cosines, np.cos([0.0, example.LEAN, example.LEAN]), atol=1e-9)
