"""Vision of a carried object, without the long way through all places."""

import importlib
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

import tactopose_drake as tp
from tactopose_drake.core.grasping.grasp_plan import GraspPlan
from tactopose_drake.resources import model_path

FOLDER = Path(__file__).parents[2] / "examples" / "thesis"


@pytest.fixture(scope="module")
def example() -> ModuleType:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(FOLDER))
        return importlib.import_module("figure_3_24")


def test_the_camera_looks_where_it_should(example: ModuleType) -> None:
    p_CQ = example.camera_pose().inverse() @ example.LOOKS_AT
    np.testing.assert_allclose(p_CQ[:2], 0.0, atol=1e-12)
    assert p_CQ[2] > 0.5
    assert (example.camera_pose().rotation().inverse() @ np.array([0.0, 0.0, 1.0]))[1] < 0.0  # up is -y


def test_a_box_end_for_end_is_the_same_box(example: ModuleType) -> None:
    model = tp.ObjectModel.from_mesh(model_path("objects", "tea_box.obj"))
    truth = RigidTransform(RollPitchYaw(0.3, 0.2, 0.1), [0.5, 0.1, 0.4])
    turned = truth @ RigidTransform(RotationMatrix.MakeXRotation(np.pi), [0.0, 0.0, 0.135])
    assert np.linalg.norm(turned.translation() - truth.translation()) > 0.1
    np.testing.assert_allclose(example._base(turned, truth, model), truth.translation(), atol=2e-3)
    assert np.isnan(example._base(None, truth, model)).all()


def test_the_errors_are_those_at_the_places(example: ModuleType, tmp_path: Path) -> None:
    truth = np.zeros((4, 3))
    vision = np.array([[9.0, 0.0, 0.0], [0.02, 0.0, 0.0], [np.nan] * 3, [0.04, 0.0, 0.0]])
    at_place = np.array([False, True, True, True])
    track = example.Track(np.arange(4.0), truth, vision, 0.1 * vision, ["ok"] * 4, np.zeros(4), at_place, 0.0)
    np.testing.assert_allclose(track.errors(track.vision), [20.0, 40.0])
    example.save_plot({("soda_can", tracker): track for tracker in example.TRACKERS}, tmp_path / "plot.png")
    assert (tmp_path / "plot.png").stat().st_size > 10_000


def test_the_errors_stand_beside_those_of_the_thesis(example: ModuleType) -> None:
    truth = np.zeros((2, 3))
    seen, lost = np.array([[0.02, 0.0, 0.0], [0.04, 0.0, 0.0]]), np.full((2, 3), np.nan)
    track = example.Track(
        np.arange(2.0), truth, seen, lost, ["ok"] * 2, np.array([0.1, 0.3]), np.ones(2, dtype=np.bool_), 7.0
    )
    (row,) = [
        line for line in example.markdown({("tea_box", "knows"): track}, 1, 5).splitlines() if line.startswith("| tea")
    ]
    assert row == "| tea_box | knows | 10 to 30 | 30.0 (40.0) | no pose | 80.2 | 20.0 | 7 |"


def test_the_station_has_the_tracker_and_a_belief_over_time(
    example: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(example, "plan_scenario", lambda scenario, model: [GraspPlan(np.eye(3, 4), {}, 0.0)])
    station, route = example.make_carrying_station("soda_can", True, 0, example.PLACES[:1])
    assert route.duration > 0.0
    assert station.diagram.HasSubsystemNamed("pose_tracking")
    assert station.diagram.HasSubsystemNamed("depth_tracker")
