"""Figures 6.2 to 6.4, each at its smallest."""

import importlib
import re
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import tactopose_drake as tp
from tactopose_drake.core.grasping.quality import grasp_quality
from tactopose_drake.core.poses import exp_so3, make_poses
from tactopose_drake.resources import model_path

FOLDER = Path(__file__).parents[2] / "examples" / "thesis"


@pytest.fixture(scope="module", autouse=True)
def examples() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(FOLDER))
        yield


def run(name: str, *arguments: str) -> str:
    result = CliRunner().invoke(importlib.import_module(name).main, arguments, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return " ".join(result.output.split())


def is_picture(path: Path) -> bool:
    return path.read_bytes().startswith(b"\x89PNG")


def test_a_light_bulb_is_held_and_its_wrenches_are_drawn(tmp_path: Path) -> None:
    printed = run("figure_6_2", "--out", str(tmp_path / "new"))
    rows = {
        f"{pose}, {norm}": [float(x) for x in re.findall(r"\d+\.\d+", line)]
        for pose, norm, line in re.findall(r"(estimate|truth), (L1|Linf) True ([\d. ]+)", printed)
    }
    assert list(rows) == ["estimate, L1", "estimate, Linf", "truth, L1", "truth, Linf"]
    for pose in ("estimate", "truth"):
        radius, volume, weight = rows[f"{pose}, L1"]
        assert 0.0 < radius < weight < 2.0
        assert volume > radius**6 * np.pi**3 / 6, "a ball of the radius has less content"
        assert rows[f"{pose}, Linf"][0] >= radius
    assert rows["estimate, L1"][0] == pytest.approx(rows["truth, L1"][0], rel=0.3)
    assert re.search(r"Force closure with probability (0\.[5-9]\d+|1\.000) ", printed)
    for name in ("figure_6_2", "figure_6_2_wrenches"):
        assert is_picture(tmp_path / "new" / f"{name}.png")
    assert (tmp_path / "new" / "figure_6_2.html").stat().st_size > 1e5


def test_a_glass_is_coloured_by_where_a_finger_should_go(tmp_path: Path) -> None:
    printed = run("figure_6_3", "--points", "150", "--out", str(tmp_path / "new"))
    current, best = (float(x) for x in re.findall(r"(?:as it is:|to) ([\d.]+) N", printed)[:2])
    assert 0.0 < current < best
    reached = re.search(r"The finger reaches (\d+) of the points\. Best of these: ([\d.]+) N", printed)
    assert reached is not None
    assert int(reached[1]) > 0
    assert 0.0 <= float(reached[2]) <= best
    for name in ("figure_6_3", "figure_6_3_unrolled"):
        assert is_picture(tmp_path / "new" / f"{name}.png")
    assert (tmp_path / "new" / "figure_6_3.html").stat().st_size > 1e5


@pytest.fixture(scope="module")
def study() -> Iterator[ModuleType]:
    """Of few moves."""
    module = importlib.import_module("touch_study")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "MOVES", 60)
        yield module


@pytest.fixture(scope="module")
def ambiguous(study: ModuleType) -> tuple[Any, tp.PoseEstimate]:
    """A grasp and what is estimated from it."""
    return next(study.ambiguous_grasps("bust"))


def test_ambiguous_grasps_are_explored_to_the_end(
    study: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    figure = importlib.import_module("figure_6_4")
    monkeypatch.setattr(figure, "ABOUT_AS_WELL", 0.01)  # The first ambiguous grasp is shown.
    for module in (study, figure):
        monkeypatch.setattr(module, "MOST_TOUCHES", 6)
    printed = run("figure_6_4", "--grasps", "1", "--out", str(tmp_path / "new"))
    assert re.search(r"the two most probable poses carry \d+% and \d+%\. The \w+ finger tells most", printed)
    entropy, expected = (float(x) for x in re.findall(r"entropy ([\d.]+) to ([\d.]+) nats", printed)[0])
    assert 0.0 <= expected < entropy
    assert re.search(r"1 ambiguous grasps: [\d.]+ touches by information, [\d.]+ at random", printed)
    for name in ("figure_6_4", "figure_6_4_touches"):
        assert is_picture(tmp_path / "new" / f"{name}.png")
    table = (tmp_path / "new" / "figure_6_4.md").read_text()
    assert table.count("| bust | 1 |") == 2


def test_an_ambiguous_grasp_holds_in_force_closure_and_is_ambiguous(
    study: ModuleType, ambiguous: tuple[Any, tp.PoseEstimate]
) -> None:
    grasp, estimate = ambiguous
    assert grasp_quality(grasp.model, grasp.contacts, grasp.X_PO, friction=study.FRICTION).force_closure
    assert study.share_of(grasp.model, estimate) < study.AMBIGUOUS
    belief = study.merged_modes(grasp.model, estimate.modes)
    for i in range(len(belief)):
        others = np.delete(belief.X_PO, i, axis=0)
        assert not study.same_pose(grasp.model, others[:1], belief.X_PO[i]).any()
    assert all(len(h.free_directions) == 0 for h in estimate.hypotheses if h.probability > study.LEAST_PROBABILITY)


def test_a_touch_adds_a_contact_and_a_miss_adds_where_nothing_is(
    study: ModuleType, ambiguous: tuple[Any, tp.PoseEstimate]
) -> None:
    grasp, _ = ambiguous
    noise = np.random.default_rng(0)
    of_fingers = study.sample_moves(grasp, np.random.default_rng(0)).values()
    hits = [moves.feel(grasp.model, grasp.X_PO[None]).is_hit[0] for moves in of_fingers]
    moves, is_hit = max(zip(of_fingers, hits, strict=True), key=lambda both: min(both[1].sum(), (~both[1]).sum()))
    hit, miss = int(np.argmax(is_hit)), int(np.argmin(is_hit))
    assert is_hit[hit]
    assert not is_hit[miss]
    free = np.zeros((0, 4))
    contacts, left = study.touch(grasp, moves.take(np.array([hit])), grasp.contacts, free, noise)
    assert len(contacts) == len(grasp.contacts) + 1
    assert len(left) == 0
    off = grasp.model.grid.distance((contacts.p_PC[-1] - grasp.X_PO[:, 3]) @ grasp.X_PO[:, :3])
    assert abs(off) < 5 * study.SIGMA_POSITION
    contacts, swept = study.touch(grasp, moves.take(np.array([miss])), grasp.contacts, free, noise)
    assert contacts is grasp.contacts
    gaps = grasp.model.grid.distance((swept[:, :3] - grasp.X_PO[:, 3]) @ grasp.X_PO[:, :3])
    assert np.all(gaps > swept[:, 3])


def test_poses_are_the_same_up_to_symmetry_and_a_small_way(study: ModuleType) -> None:
    screwdriver = tp.ObjectModel.from_mesh(model_path("objects", "screwdriver.obj"))
    turns = exp_so3(np.array([[0.0, 0, 0], [0, 0, np.pi], [0, 0, 0.5], [0, 0, np.pi + 0.2]]))
    X = make_poses(turns, np.zeros((4, 3)))
    assert list(study.same_pose(screwdriver, X, np.eye(3, 4))) == [True, True, False, True]
    X[0, 0, 3] = 0.011
    assert not study.same_pose(screwdriver, X[:1], np.eye(3, 4))[0]


@pytest.mark.usefixtures("study")
def test_a_grasp_is_touched_until_the_object_has_its_name(tmp_path: Path) -> None:
    run("section_6_2_1", "--grasps", "1", "--out", str(tmp_path / "new"))
    table = (tmp_path / "new" / "section_6_2_1.md").read_text()
    rows = re.findall(r"\| (by information|at random) \| 1 \| ([\d.]+) \| (\d) \| (\d) \|", table)
    assert [name for name, *_ in rows] == ["by information", "at random"]
    assert all(1.0 <= float(mean) <= 20.0 for _, mean, *_ in rows)
    assert is_picture(tmp_path / "new" / "section_6_2_1.png")


def test_what_the_simulator_told_is_summed_up(tmp_path: Path) -> None:
    physics, parts = (importlib.import_module(name) for name in ("figure_6_4_in_physics", "physical_touches"))
    unique, slipped = (float(parts.OUTCOMES.index(name)) for name in ("unique", "the object slipped"))
    runs = {
        "information": [parts.PhysicalExploration(unique, 2, 1, 0.4, 0.97, 0.001)] * 2,
        "chance": [
            parts.PhysicalExploration(unique, 5, 0, 0.4, 0.96, 0.001),
            parts.PhysicalExploration(slipped, 1, 0, 0.4, 0.5, 0.006),
        ],
    }
    assert physics.rows(runs) == [
        ("by information", "2", "2", "2", "2.00", "0", "1.0"),
        ("at random", "2", "1", "0", f"{(5 + parts.MOST_TOUCHES) / 2:.2f}", "1", "3.5"),
    ]
    physics.plot(runs, tmp_path / "new.png")
    assert is_picture(tmp_path / "new.png")
