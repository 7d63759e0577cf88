"""Hand over and place, without its long simulations: what is handed over, and the first moments of a trial."""

import csv
import dataclasses
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import trimesh
from pydrake.geometry import Meshcat, MeshcatParams

from tactopose_drake.core.grasping.grasp_plan import GraspPlan
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.resources import model_path
from tests.examples.scripts import share_script


@pytest.fixture(scope="module")
def example() -> ModuleType:
    return share_script("hand_over_and_place.py")


@pytest.fixture(scope="module")
def trials() -> ModuleType:
    return share_script("hand_over_trial.py")


@pytest.fixture(scope="module")
def pencil() -> ModuleType:
    return share_script("pencil_hand_over.py")


@pytest.fixture(scope="module")
def plan(pencil: ModuleType) -> GraspPlan:
    found: GraspPlan = pencil.plan_closing()
    return found


def test_the_hand_over_is_random_within_its_bounds(pencil: ModuleType, plan: GraspPlan) -> None:
    generator = np.random.default_rng(0)
    offered = [pencil.hand_over(plan, generator) for _ in range(200)]
    axes = np.array([grasp.X_PO[:, 2] for grasp in offered])
    cosine = axes @ plan.X_PO[:, 2]
    assert 60 < np.sum(cosine > 0.0) < 140  # either end up
    assert np.arccos(np.abs(cosine)).max() < np.sqrt(2.0) * pencil.TURN + 0.02
    assert np.degrees(np.arccos(np.abs(cosine))).max() > 8.0
    assert all(grasp.fingers is plan.fingers for grasp in offered)  # the hand knows nothing of it


def test_a_run_that_was_ended_keeps_its_trials(example: ModuleType, trials: ModuleType, tmp_path: Path) -> None:
    path = tmp_path / "trials.csv"
    assert example.read_trials(path) == []
    done = [trials.Trial(seed, seed == 3, outcome='failed, "as it is"', end_mm=0.1 * seed) for seed in (3, 4)]
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, [field.name for field in dataclasses.fields(trials.Trial)])
        writer.writeheader()
        writer.writerows(dataclasses.asdict(trial) for trial in done)
    read = example.read_trials(path)
    # Not a number is not equal to itself.
    assert [repr(trial) for trial in read] == [repr(trial) for trial in done]
    path.write_bytes(path.read_bytes()[:-3])  # killed as it wrote the second
    assert [trial.seed for trial in example.read_trials(path)] == [3]


def test_the_simulators_pencil_is_the_packages_pencil(pencil: ModuleType, tmp_path: Path) -> None:
    sdf = pencil.write_collision_pencil(tmp_path)
    assert sdf.is_file()
    mesh = trimesh.load_mesh(tmp_path / "pencil.obj")
    assert mesh.is_watertight
    assert len(mesh.faces) < 400
    model = ObjectModel.from_mesh(model_path("objects", "pencil.obj"))
    points = mesh.sample(2000, seed=0)
    distance = np.abs(model.grid.distance(points))
    assert np.quantile(distance[(points[:, 2] > 0.005) & (points[:, 2] < 0.145)], 0.9) < 3e-5
    assert distance.max() < 4e-4  # where the sharpening begins


def test_a_trial_begins_is_judged_and_shown(
    example: ModuleType, trials: ModuleType, pencil: ModuleType, plan: GraspPlan, tmp_path: Path
) -> None:
    page = tmp_path / "scene.html"
    trial = example.save_scene(plan, pencil.write_collision_pencil(tmp_path), 0, page, longest=0.06)
    empty = Meshcat(MeshcatParams(host="localhost")).StaticHtml()
    assert page.stat().st_size > len(empty) + 100_000  # with the shapes of arm and hand
    assert not trial.success
    assert trial.outcome == "not finished: receive"
    assert trial.simulated == pytest.approx(0.06)
    other = trials.Trial(1, success=True, outcome="in the hole", angle_deg=1.0, end_mm=1.0, sigma_mm=3.0, hole_mm=2.0)
    example.print_table([trial, other])
    example.save_plot([trial, other], tmp_path / "plot.png")
    assert (tmp_path / "plot.png").stat().st_size > 10_000


def test_failures_are_explained(trials: ModuleType) -> None:
    Trial = trials.Trial
    assert trials.explain(Trial(3, outcome="no firm grip")) == "no firm grip; the pencil was not let go"
    dropped = Trial(4, outcome="it moved", end_mm=1.2, sigma_mm=3.4, turned_deg=61.0, moved_mm=40.0)
    assert trials.explain(dropped) == (
        "it moved; touch was 1.2 mm off at the lower end when the arm set off for the hole (3.4 stated); since the "
        "pencil was let go, it turned by 61° in the hand and its lower end moved by 40 mm"
    )
    assert "the arm did not set off" in trials.explain(Trial(5, outcome="ambiguous", turned_deg=0.0, moved_mm=0.0))


def test_motion_in_the_hand_is_that_of_the_lower_end(trials: ModuleType) -> None:
    trial, before = trials.Trial(0), np.array([[0.0, 0.0, 0.0], [-0.0875, 0.0, 0.0]])
    trials._note_motion(trial, before, 0.0875 * np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))
    assert trial.turned_deg == pytest.approx(90.0)
    assert trial.moved_mm == pytest.approx(87.5 * np.sqrt(2.0))
