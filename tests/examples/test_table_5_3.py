import dataclasses
import importlib
import math
import re
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from tactopose_drake.core.poses import retract
from tactopose_drake.core.shape.model_cache import FOLDER_VARIABLE

FOLDER = Path(__file__).parents[2] / "examples" / "thesis"
BOTTLE = "f) thermal bottle, lying"


def load(name: str) -> ModuleType:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(FOLDER))
        return importlib.import_module(name)


@pytest.fixture(scope="module")
def grasps() -> ModuleType:
    return load("pad_grasps")


@pytest.fixture(scope="module")
def script() -> ModuleType:
    return load("table_5_3")


@pytest.fixture(scope="module")
def corrections() -> ModuleType:
    return load("pad_corrections")


@pytest.fixture(scope="module")
def folder(script: ModuleType, corrections: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the script writes for one of the grips."""
    folder = tmp_path_factory.mktemp("table_5_3") / "new"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(FOLDER_VARIABLE, str(folder.parent / "cache"))
        patch.setattr(script, "GRIPS", {BOTTLE: script.GRIPS[BOTTLE]})
        patch.setattr(corrections, "DIRECT", dataclasses.replace(corrections.DIRECT, max_evaluations=500))
        result = CliRunner().invoke(script.main, ["--trials", "4", "--seed", "2", "--out", str(folder)])
    assert result.exit_code == 0, result.output
    assert "Table 5.3" in result.output
    return folder


@pytest.fixture
def grasp(grasps: ModuleType, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """The grip that the script left in the cache folder; nothing is simulated again."""
    monkeypatch.setenv(FOLDER_VARIABLE, str(folder.parent / "cache"))
    monkeypatch.delattr(grasps, "simulate_grasp")
    return grasps.load_pad_grasp(BOTTLE, grasps.GRIPS[BOTTLE])


def test_every_cell_stands_beside_the_thesis_number(folder: Path) -> None:
    text = (folder / "table_5_3.md").read_text(encoding="utf-8")
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line[:1] == "|"]
    table = {row[1]: row[2:] for row in cells[2:5]}
    assert list(table) == ["algorithm 5.2", "algorithm 5.3", "ours"]
    # [B16] table 5.3, f): mean error, error at the least cost, rho; each in mm, then deg.
    printed = {
        "algorithm 5.2": [7.8, 10.3, 3.7, 6.01, 0.56, 0.8],
        "algorithm 5.3": [22, 33.3, 20.7, 23, 0.74, -0.01],
    }
    for method, thesis in printed.items():
        assert [float(match) for match in re.findall(r"\((.*?)\)", " ".join(table[method]))] == thesis
    numbers = {method: [float(cell.split()[0]) for cell in row] for method, row in table.items()}
    assert all(len(row) == 8 and np.all(np.abs(row[4:]) <= 1.0) for row in numbers.values())
    assert numbers["ours"][1] < 4.0  # The bottle's direction is known, though not how far it has slid.
    assert (folder / "figure_5_12.png").read_bytes().startswith(b"\x89PNG")
    searches = {row[0]: [float(cell) for cell in row[1:]] for row in cells[7:]}
    assert list(searches) == ["descent alone", "ours", "ours, then to the minimum"]
    np.testing.assert_allclose(searches["ours"][1:5], np.take(numbers["ours"], [0, 1, 4, 5]), atol=1e-9)


def test_the_pads_lie_on_the_object_where_it_is(grasp: Any) -> None:
    for patch in grasp.patches:
        p_OC = (patch.centroid - grasp.X_PO[:, 3]) @ grasp.X_PO[:, :3]
        assert abs(grasp.model.grid.distance(p_OC[None])[0]) < 0.0015
    middle = grasp.model.vertices.max(axis=0) + grasp.model.vertices.min(axis=0)
    np.testing.assert_allclose(middle, 0.0, atol=1e-6)


def test_a_hand_that_loses_its_object_is_an_error(
    grasps: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    @dataclasses.dataclass
    class Lost:
        stable: bool = False
        reason: str = "the object slipped by 20.0 mm"

    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    monkeypatch.setattr(grasps, "simulate_grasp", lambda scenario: Lost())
    with pytest.raises(grasps.GripLostError, match=r"thermal bottle, lying: the object slipped by 20.0 mm\."):
        grasps.load_pad_grasp(BOTTLE, grasps.GRIPS[BOTTLE])
    assert not list((tmp_path / "pad_grips").iterdir())


def test_displacements_fill_the_box_and_come_from_the_seed(
    grasps: ModuleType, corrections: ModuleType, grasp: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    poses = grasps.displaced_poses(grasp.X_PO, 500, np.random.default_rng(0))
    shift = 1e3 * (poses[:, :, 3] - grasp.X_PO[:, 3])
    assert np.all(np.abs(shift) <= 10.0)
    assert np.all(np.ptp(shift, axis=0) > 19.0)
    monkeypatch.setattr(corrections, "DIRECT", dataclasses.replace(corrections.DIRECT, max_evaluations=100))
    again = corrections.run_trials(grasp, 3, (0, 0), "")
    other = corrections.run_trials(grasp, 3, (0, 0), "")
    for method in again:
        np.testing.assert_array_equal(again[method].error, other[method].error)
        # The same displaced poses for each.
        np.testing.assert_array_equal(again[method].way_error, again[corrections.OURS].way_error)


def test_a_spin_of_the_bottle_is_no_error_but_a_slide_is(corrections: ModuleType, grasp: Any) -> None:
    spun = retract(grasp.X_PO, np.array([0.0, 0.0, math.radians(15.0), 0.0, 0.0, 0.0]))
    slid = retract(grasp.X_PO, np.concatenate([np.zeros(3), 0.005 * grasp.X_PO[:, 2]]))
    leaned = retract(grasp.X_PO, np.array([math.radians(3.0), 0.0, 0.0, 0.0, 0.0, 0.0]))
    errors = corrections.errors_of(grasp, np.stack([spun, slid, leaned]))
    np.testing.assert_allclose(errors, [[0.0, 0.0], [5.0, 0.0], [0.0, 3.0]], atol=0.02)


def test_the_numbers_are_those_of_the_trials(script: ModuleType) -> None:
    error = np.array([[1.0, 9.0], [2.0, 8.0], [4.0, 1.0], [5.0, 0.0]])
    start = np.array([[1.0, 1.0], [2.0, 4.0], [3.0, 2.0], [4.0, 3.0]])
    trials = script.Trials(np.array([2.0, 3.0, 4.0, 90.0]), error, np.array([4.0, 3.0, 2.0, 1.0]), start, 0.1)
    # rho by [B16] eq. 5.12: of the last, ranks 4 3 2 1 against 1 4 2 3, 1 - 6 * 14 / 60.
    np.testing.assert_allclose(trials.numbers(), [3.0, 4.5, 1.0, 9.0, 1.0, -1.0, -1.0, -0.4], atol=1e-12)


def test_each_search_descends_our_objective(corrections: ModuleType, grasps: ModuleType, grasp: Any) -> None:
    starts = grasps.displaced_poses(grasp.X_PO, 3, np.random.default_rng(5))
    objective = grasp.objectives[corrections.OURS]
    for start in starts:
        found = {
            search: corrections.correct(grasp, search, start, np.random.default_rng(0))
            for search in corrections.SEARCHES
        }
        cost = {search: objective.cost(X_PO[None])[0] for search, X_PO in found.items()}
        assert cost[corrections.SETTLED] <= cost[corrections.OURS]
        assert cost[corrections.DESCENDED] < objective.cost(start[None])[0]


def test_the_verdicts_are_those_of_the_numbers(script: ModuleType) -> None:
    rising = np.arange(5.0)

    def trials(mm: float) -> Any:
        error = np.stack([mm + rising, 1.0 + rising], axis=1)
        return script.Trials(rising, error, rising, error, 0.1)

    good, bad = dict.fromkeys(script.METHODS, trials(1.0)), dict.fromkeys(script.METHODS, trials(12.0))
    names = list(script.GRIPS)
    mean, rho, way, *_ = script.verdicts(dict.fromkeys(names, good))
    assert mean.endswith("were asked of ours: held, by every grip.")
    assert "6 grips for mm and in 6 for deg; 5 of 6 were asked for: held. 20 % of ours end" in rho
    assert "off by 3.0 mm and 3.0 deg on average" in way
    assert "in 6 grips for mm and in 6 for deg (held), and above both others here in 0 and 0" in way
    mean = script.verdicts(dict.fromkeys(names, good) | {names[1]: bad})[0]
    assert (
        f"ours 4.8 mm, 3.0 deg (thesis 7.6 mm, 10.4 deg). At most 4 mm and 5 deg were asked of ours: NOT held; by "
        f"itself not held by {names[1]}." in mean
    )
    # The costs rise with the angle and fall with the distance.
    other = dict.fromkeys(
        script.METHODS, dataclasses.replace(trials(1.0), error=np.stack([5.0 - rising, rising], axis=1))
    )
    for count, verdict in (
        (1, "5 grips for mm and in 6 for deg; 5 of 6 were asked for: held."),
        (2, "5 of 6 were asked for: NOT held."),
    ):
        rho = script.verdicts(dict.fromkeys(names, good) | dict.fromkeys(names[:count], other))[1]
        assert verdict in rho.replace("5 of 6 grips", "5 grips")


def test_the_ideal_estimator_is_as_sure_as_the_touch_and_the_prior_let_it_be(
    corrections: ModuleType, grasp: Any
) -> None:
    ideal = load("ideal_corrections").ideal_trials(grasp, 200, 50, np.random.default_rng(3))
    assert ideal.error.shape == ideal.rho.shape == (50, 2)
    assert np.all(np.abs(ideal.rho) <= 1.0)
    # The mean squared error of a posterior's mean is the trace of its covariance; the touch does not tell the slide.
    H = grasp.objectives[corrections.OURS].normal_equations(grasp.X_PO[None]).hessian[0]
    sigma = np.repeat([corrections.SIGMA_TURN, corrections.SIGMA_SHIFT], 3)
    covariance = np.linalg.inv(H + np.diag(sigma**-2.0))
    rms = 1e3 * math.sqrt(np.trace(covariance[3:, 3:]))
    assert 0.7 * rms < ideal.error[:, 0].mean() < rms
    assert 5.0 < rms < 10.0  # the slide alone is 5.8 mm
