import importlib
import re
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from click.testing import CliRunner

from tactopose_drake.core.poses import exp_so3, inverse, make_poses, transform_points

FOLDER = Path(__file__).parents[2] / "examples" / "thesis"


@pytest.fixture(scope="module")
def script() -> ModuleType:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(FOLDER))
        return importlib.import_module("figure_5_14")


def test_the_costs_stand_beside_the_thesis_numbers(script: ModuleType, tmp_path: Path) -> None:
    result = CliRunner().invoke(script.main, ["--seed", "1", "--out", str(tmp_path / "new")])
    assert result.exit_code == 0, result.output
    rows = [line.split() for line in result.output.splitlines() if re.match(r" +(line|plane) ", line)]
    assert [row[:2] for row in rows] == [[a, b] for b in ("plane", "ridge") for a in ("line", "plane")]
    # [B16] section 5.4.
    assert [float(row[3]) for row in rows[:2]] == [0.0408, 0.0747]
    assert (tmp_path / "new" / "figure_5_14.png").read_bytes().startswith(b"\x89PNG")


def test_distances_take_a_line_for_a_plane_and_covariances_do_not(script: ModuleType) -> None:
    for seed in range(3):
        fits = {(a, b): script.fit(a, b, seed) for a in script.CELLS for b in script.POINTS}
        line, plane = fits["line", "plane"], fits["plane", "plane"]
        assert line.distance < plane.distance
        assert line.covariance > 3.0 * plane.covariance
        # A line that is pressed fits a ridge better than a plane.
        assert fits["line", "ridge"].covariance < line.covariance


def test_verdicts_follow_the_costs(script: ModuleType) -> None:
    def found(cost: float) -> object:
        return script.Fit(np.zeros((1, 3)), np.zeros((1, 3)), cost, 10.0 - cost)

    thesis, by_distance, by_covariance = script.verdicts(
        {("line", "plane"): found(2.0), ("plane", "plane"): found(8.0)}
    )
    assert "0.55 of the plane on the plane: cheaper" in thesis
    assert "algorithm 5.3 the line on the plane costs 0.25 of the plane on the plane: cheaper" in by_distance
    assert "algorithm 5.2 the line on the plane costs 4.00 of the plane on the plane: dearer" in by_covariance


def test_icp_lays_points_on_the_cells_that_are_theirs(script: ModuleType) -> None:
    points = np.random.default_rng(0).normal(size=(300, 3)) * 0.02
    X = make_poses(exp_so3(np.array([0.02, -0.01, 0.03])), np.array([0.001, -0.0005, 0.0005]))
    found = script.icp(transform_points(X, points[:60]), points, np.eye(3, 4))
    np.testing.assert_allclose(found, X, atol=1e-9)
    np.testing.assert_allclose(transform_points(inverse(found), transform_points(X, points)), points, atol=1e-9)
