"""The page of a run, from what a station says; the station here says what it is told."""

import dataclasses
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.math import RigidTransform

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.sensing.intrinsic_contact import ContactSolution, solve_contacts
from tactopose_drake.core.sensing.patches import describe_patch
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.surfaces import Sphere
from tactopose_drake.estimation.pose_hypothesis import PoseHypothesis
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.hand.calibration_file import HandCalibration, MeasuredNumber, save_calibration
from tactopose_drake.hand.encoder_offsets import encoder_gains
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.hand.joint_matrices import reading_offsets
from tactopose_drake.resources import model_path
from tactopose_drake.runs.page_recorder import PageRecorder
from tactopose_drake.runs.stepping import RunView
from tactopose_drake.runs.timeline_recorder import TimelineRecorder
from tactopose_drake.station.scenario import Scenario, load_scenario
from tactopose_drake.station.simulated_errors import SimulatedErrors
from tests import held_cube
from tests.browser import CHROMIUM, Browser
from tests.recording_meshcat import RecordingMeshcat


class Station:
    """Ports that give what stands in a dictionary; it is its own diagram, context and ports."""

    def __init__(self, **values: Any) -> None:
        self.values, self.time, self.port = values, 0.0, ""

    def HasOutputPort(self, name: str) -> bool:
        return name in self.values

    def GetOutputPort(self, name: str) -> "Station":
        self.port = name
        return self

    def Eval(self, context: "Station") -> Any:
        return self.values[self.port]

    def get_time(self) -> float:
        return self.time


def estimate_at(height: float, sigma: float, free: int = 0) -> PoseEstimate:
    covariance = np.diag(np.square([0.01, 0.01, 0.01, sigma, sigma, sigma]))
    X_PO = RigidTransform([0.0, 0.0, height])
    return PoseEstimate((PoseHypothesis(X_PO, 1.0, 1.0, covariance, np.eye(6)[:free]),), "ok", 0.01)


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return load_scenario("shadow_like")


@pytest.fixture(scope="module")
def model(scenario: Scenario) -> ObjectModel:
    return ObjectModel.from_mesh(scenario.object_mesh())


@pytest.fixture
def station(scenario: Scenario) -> Station:
    plant, _ = make_hand_plant(load_hand_config(scenario.hand))
    return Station(
        joint_positions=np.zeros(plant.num_positions()),
        contacts=Contacts.empty(),
        fingers_in_contact=[],
        contact_solutions={finger.name: pressed(0.0) for finger in load_hand_config(scenario.hand).fingers},
        prior=PosePrior(RigidTransform([0.0, 0.0, 0.1])),
        hypotheses=None,
        status="held: no contact",
    )


def pressed(force: float) -> ContactSolution:
    """A fingertip's contact of such a force, N."""
    return solve_contacts([[0.0, 0.0, 0.0, 0.0, 0.0, -force]], Sphere(0.009))[0]


def touch(station: Station, force: float, estimate: PoseEstimate) -> None:
    station.values |= {
        "contacts": Contacts([[0.0, 0.0, 0.05]], [[0.0, 0.0, -1.0]], [[0.0, 0.0, -np.nan_to_num(force)]]),
        "fingers_in_contact": ["thumb"],
        "contact_solutions": station.values["contact_solutions"] | {"thumb": pressed(force)},
        "hypotheses": estimate,
        "status": "ok",
    }


def test_the_timeline_holds_states_forces_and_widths(scenario: Scenario, model: ObjectModel, station: Station) -> None:
    recorder = TimelineRecorder(load_hand_config(scenario.hand), model)
    recorder.show(RunView(station, station))
    assert recorder.timeline() is None
    for time, force, free in ((0.1, 2.0, 0), (0.2, np.nan, 6)):
        station.time = time
        touch(station, force, estimate_at(0.1, 0.001, free))
        recorder.show(RunView(station, station))
    timeline = recorder.timeline()
    assert timeline is not None
    assert timeline.pieces() == [(0.0, 0.1, "held: no contact"), (0.1, 0.2, "ok")]
    contacts = timeline.said[1].contacts
    assert (contacts.headings[0], contacts.rows[0].cells[0]) == ("contact", "1 thumb")
    forces, position, angle = timeline.plots
    curves = {curve.name: curve.values for curve in forces.curves}
    # Where a reading is none, no force is known.
    np.testing.assert_allclose(curves["thumb"], [0.0, 2.0, np.nan])
    np.testing.assert_allclose(curves["first"], 0.0)
    # Unknown before there is an estimate, and where nothing is determined.
    np.testing.assert_allclose(position.curves[0].values, [np.nan, np.sqrt(3.0), np.nan])
    np.testing.assert_allclose(angle.curves[0].values, [np.nan, np.degrees(0.01 * np.sqrt(3.0)), np.nan])


def test_a_run_that_starts_anew_is_noted_anew(scenario: Scenario, model: ObjectModel, station: Station) -> None:
    recorder = TimelineRecorder(load_hand_config(scenario.hand), model)
    for time in (0.5, 0.6, 0.1, 0.2, 0.3):
        station.time = time
        recorder.show(RunView(station, station))
    timeline = recorder.timeline()
    assert timeline is not None
    np.testing.assert_allclose(timeline.times, [0.1, 0.2, 0.3])


def test_where_there_is_tracking_its_belief_is_noted(scenario: Scenario, model: ObjectModel, station: Station) -> None:
    station.values |= {"tracked_hypotheses": estimate_at(0.1, 0.002), "tracked_status": "slipping: first"}
    recorder = TimelineRecorder(load_hand_config(scenario.hand), model)
    for station.time in (0.0, 0.1):
        recorder.show(RunView(station, station))
    timeline = recorder.timeline()
    assert timeline is not None
    assert timeline.pieces() == [(0.0, 0.1, "slipping: first")]
    np.testing.assert_allclose(timeline.plots[1].curves[0].values, 2.0 * np.sqrt(3.0))


def test_a_long_run_makes_a_page_that_is_not_large(
    scenario: Scenario, model: ObjectModel, station: Station, tmp_path: Path
) -> None:
    recorder = PageRecorder(scenario, model)
    recorder.show(RunView(station, station))
    assert not recorder.save(tmp_path / "page.html", "nothing yet")
    for step in range(1, 1500):
        station.time = 0.04 * step
        touch(station, 1.0, estimate_at(0.1 + 1e-5 * step, 0.001))
        recorder.show(RunView(station, station))
    assert recorder.save(tmp_path / "page.html", "A long run")
    page = (tmp_path / "page.html").read_text()
    assert len(page) < 6e6
    assert "<title>A long run</title>" in page
    found = re.search(r'id="tp-data">(.*?)</script>', page)
    assert found is not None
    timeline = json.loads(found[1])["timeline"]
    assert 59.0 < timeline["end"] < 60.0
    assert [piece["text"] for piece in timeline["strip"]] == ["no new estimate: no contact", "ok"]
    points = re.search(r'<polyline points="([^"]*)"', page)
    assert points is not None
    assert 60 < len(points[1].split()) <= 130


def test_the_page_switches_the_hypotheses_that_it_draws(
    scenario: Scenario, model: ObjectModel, station: Station, tmp_path: Path
) -> None:
    hypotheses = tuple(
        PoseHypothesis(RigidTransform([0.01 * row, 0.0, 0.1]), 1.0, 0.2, 1e-6 * np.eye(6), np.zeros((0, 6)))
        for row in range(5)
    )
    recorder = PageRecorder(scenario, model)
    for station.time in (0.0, 0.1):
        touch(station, 1.0, PoseEstimate(hypotheses, "ambiguous", 0.01))
        recorder.show(RunView(station, station))
    assert recorder.save(tmp_path / "page.html", "Five hypotheses")
    page = (tmp_path / "page.html").read_text()
    assert re.findall(r'data-hides="\^/tactopose/alternatives/(\d+)', page) == ["0", "1"]
    assert "and 2 less probable" in page


def test_the_truth_is_drawn_where_it_is_known(
    scenario: Scenario, model: ObjectModel, station: Station, tmp_path: Path
) -> None:
    del station.values["prior"]  # as of a run on devices
    pages, pictures = [], []
    for true_pose in (None, RigidTransform([0.01, 0.0, 0.1])):
        recorder = PageRecorder(scenario, model)
        assert not recorder.save_picture(tmp_path / "picture.png")
        for time in (0.1, 0.2):
            station.time = time
            touch(station, 1.0, estimate_at(0.1, 0.001))
            recorder.show(RunView(station, station, true_pose=true_pose))
        assert recorder.save(tmp_path / "page.html", "Truth")
        assert recorder.save_picture(tmp_path / "picture.png")
        pages.append("/tactopose/truth" in (tmp_path / "page.html").read_text())
        pictures.append((tmp_path / "picture.png").read_bytes())
    assert pages == [False, True]
    assert pictures[0] != pictures[1]


def test_a_felt_pad_after_a_silent_one_is_drawn_as_false_if_it_is(
    scenario: Scenario, model: ObjectModel, station: Station
) -> None:
    n_PT = np.tile([0.0, 0.0, 1.0], (3, 1))
    silent, felt = (describe_patch(0.01 * np.eye(3), np.full(3, p), alpha=1e-7, n_PT=n_PT) for p in (0.0, 1e4))
    best = dataclasses.replace(estimate_at(0.1, 0.001).best, inlier_probability=np.array([0.9, 1.0, 0.1]))
    touch(station, 1.0, PoseEstimate((best,), "ok", 0.01))
    station.values |= {"pads": ("finger", "palm"), "patches": (silent, felt)}
    recorder, meshcat = PageRecorder(scenario, model), RecordingMeshcat()
    recorder.show(RunView(station, station))
    recorder._draw(meshcat, recorder._moments[0])  # type: ignore[arg-type]
    assert [meshcat.visible(f"/tactopose/touch/{row}/false") for row in range(2)] == [False, True]


def test_a_joint_that_is_not_known_at_times_costs_no_page(
    scenario: Scenario, model: ObjectModel, station: Station, tmp_path: Path
) -> None:
    recorder = PageRecorder(scenario, model)
    known = station.values["joint_positions"]
    for step in range(6):
        station.time = 0.1 * step
        touch(station, 2.0, estimate_at(0.1, 0.001))
        station.values["joint_positions"] = np.full_like(known, np.nan) if step in (3, 5) else known
        recorder.show(RunView(station, station))
    assert recorder.save(tmp_path / "page.html", "a gap")
    assert (tmp_path / "page.html").stat().st_size > 100_000


def test_a_calibrated_hand_is_drawn_where_it_is(scenario: Scenario, model: ObjectModel, tmp_path: Path) -> None:
    plant, hand = make_hand_plant(load_hand_config(scenario.hand))
    names, path = encoder_gains(plant, hand).joints, tmp_path / "mine.hand.yaml"
    offsets = {name: MeasuredNumber(value=3.0, sigma=0.1) for name in names}
    save_calibration(tmp_path / "calibration.yaml", HandCalibration(grasps=5, joint_offsets=offsets))
    text = model_path("hands", "shadow_like", "shadow_like.hand.yaml").read_text()
    path.write_text(f"{text}calibration: calibration.yaml\n")
    devices = dataclasses.replace(scenario, hand=str(path), senses=held_cube.scenario().senses)
    q = np.full(plant.num_positions(), 0.3)
    as_read = PageRecorder(scenario, model)._body_poses(q - reading_offsets(*make_hand_plant(load_hand_config(path))))
    corrected = PageRecorder(devices, model)._body_poses(q)
    assert all(a.IsNearlyEqualTo(b, 1e-9) for a, b in zip(as_read, corrected, strict=True))
    # A simulated hand is as its model, unless its errors are told.
    simulated = dataclasses.replace(scenario, hand=str(path))
    assert simulated.hand_config().calibration == ""
    told = dataclasses.replace(simulated, errors=SimulatedErrors(joint_offsets_deg={names[2]: 3.0}))
    assert told.hand_config().calibration != ""


@pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium")
def test_the_slider_shows_each_moment_at_its_time(
    scenario: Scenario, model: ObjectModel, station: Station, tmp_path: Path
) -> None:
    recorder = PageRecorder(scenario, model)
    for step in range(201):  # 10 s, so that moments are dropped; the rest are not a multiple of a period apart
        station.time = 0.05 * step
        touch(station, 1.0, estimate_at(0.01 * station.time, 0.001))
        recorder.show(RunView(station, station))
    assert recorder.save(tmp_path / "page.html", "An object that rises")
    with Browser() as browser:
        browser.open(tmp_path / "page.html")
        for moment in recorder._moments[:-1:7]:
            # The pose stays until the next moment.
            for time in (moment.time, moment.time + 0.04):
                browser.evaluate(
                    "(() => { const at = document.getElementById('tp-time'); at.step = 'any';"
                    f"at.value = {time}; at.dispatchEvent(new Event('input')); }})()"
                )
                height = browser.evaluate("viewer.scene_tree.find(['tactopose', 'estimate']).object.position.z")
                assert height == pytest.approx(0.01 * moment.time, abs=1e-5)


def test_the_page_ends_with_the_last_instant(
    scenario: Scenario, model: ObjectModel, station: Station, tmp_path: Path
) -> None:
    recorder = PageRecorder(scenario, model)
    for step in range(268):
        station.time = 0.03 * step
        touch(station, 1.0, estimate_at(0.01 * station.time, 0.001))
        recorder.show(RunView(station, station))
        assert recorder._moments[-1].time == station.time
    times = [moment.time for moment in recorder._moments]
    assert np.diff(times)[:-1].min() > 0.07  # dropped evenly, but for the last
    timeline = recorder._timeline.timeline()
    assert timeline is not None
    np.testing.assert_array_equal(timeline.times, times)
    assert recorder.save(tmp_path / "page.html", "To the end")
    assert f"At {station.time:.2f} s" in (tmp_path / "page.html").read_text()


@pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium")
def test_legend_and_names_are_of_all_times_and_not_only_of_the_end(
    scenario: Scenario, model: ObjectModel, station: Station, tmp_path: Path
) -> None:
    def turning(about: int) -> PoseEstimate:
        best = estimate_at(0.1, 0.001).best
        free = np.eye(6)[about : about + 1]
        held = dataclasses.replace(best, probability=0.6, free_directions=free, inlier_probability=np.array([0.1, 0.9]))
        other = dataclasses.replace(held, probability=0.4, X_PO=RigidTransform([0.0, 0.02, 0.1]))
        return PoseEstimate((held, other), "ambiguous", 0.01)

    recorder = PageRecorder(scenario, model)
    for step, about in enumerate((0, 2)):
        station.time = 0.5 * step
        touch(station, 1.0, turning(about))
        two = Contacts([[0.0, 0.0, 0.05], [0.0, 0.0, 0.15]], [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]], np.eye(3)[:2])
        station.values |= {"contacts": two, "fingers_in_contact": ["thumb", "first"]}
        recorder.show(RunView(station, station))
    station.time = 1.0  # The hand has let go, and the last estimate is certain.
    station.values |= {"contacts": Contacts.empty(), "fingers_in_contact": [], "hypotheses": estimate_at(0.1, 0.001)}
    recorder.show(RunView(station, station))
    assert recorder.save(tmp_path / "page.html", "Let go")
    labels = "[...document.querySelectorAll('.tp-label')].filter((text) => text.style.display !== 'none')"
    with Browser() as browser:
        browser.open(tmp_path / "page.html")
        legend = browser.evaluate("document.querySelector('.tp-legend').innerText")
        for name in ("another hypothesis", "not determined", "contact", "false contact", "contact force"):
            assert f"{name}\n" in legend
        for time, expected in (
            (0.0, ["1", "2", "turn about the object's x"]),
            (0.5, ["1", "2", "turn about the object's z"]),
            (1.0, []),
        ):
            browser.evaluate(
                f"(() => {{ const at = document.getElementById('tp-time'); at.value = {time};"
                "at.dispatchEvent(new Event('input')); })()"
            )
            browser.screenshot()  # texts are placed where the scene is drawn
            assert browser.evaluate(f"{labels}.map((text) => text.innerText)") == expected
        assert browser.errors == []
