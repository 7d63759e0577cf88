"""The belief over time in recordings, and in what is exported of them."""

from pathlib import Path

import numpy as np

from tactopose_drake.runs.estimate_writer import estimates_now
from tactopose_drake.runs.scenario_replay import replay
from tactopose_drake.runs.scenario_run import run_scenario
from tactopose_drake.runs.stepping import RunView
from tactopose_drake.station.scenario import Scenario, load_scenario
from tactopose_drake.systems.pose_tracking import PoseTrackingParams
from tests.cli.test_cli import run as tactopose
from tests.runs.test_export import messages, rows


def tracking_scenario(*, live: bool) -> Scenario:
    scenario = load_scenario("barrett_like")
    scenario.estimation.use_hand_volume = scenario.estimation.check_collisions = False
    scenario.estimation.estimator.period = 0.02
    scenario.tracking = PoseTrackingParams(use_hand_volume=False, check_collisions=False, live=live)
    return scenario


def test_replays_of_a_live_belief_give_the_same_bits(tmp_path: Path) -> None:
    folder = tmp_path / "tracked"
    scenario = tracking_scenario(live=True)
    run_scenario(scenario, duration=0.4, record=folder)
    lines = []
    for _ in range(2):
        beliefs: list[dict] = []
        replay(folder, scenario, observer=lambda view, to=beliefs: to.append(estimates_now(view.diagram, view.context)))
        lines.append(beliefs)
    assert lines[0] == lines[1]
    assert any(line["tracked_hypotheses"] for line in lines[0])
    assert not any("old" in line["tracked_status"] for line in lines[0])


def test_the_belief_over_time_is_recorded_and_exported(tmp_path: Path) -> None:
    folder = tmp_path / "tracked"
    scenario = tracking_scenario(live=False)
    beliefs = []

    def see(view: RunView) -> None:
        values = [view.diagram.GetOutputPort(f"tracked_{name}").Eval(view.context) for name in ("status", "hypotheses")]
        beliefs.append((values[0], None if values[1] is None else values[1].best.X_PO.translation()))

    run_scenario(scenario, duration=0.4, record=folder, observer=see)
    with_pose = [p_PO for _, p_PO in beliefs if p_PO is not None]
    assert with_pose
    for kind in ("mcap", "csv"):
        assert tactopose("export", folder, "--format", kind, "--out", tmp_path / f"run.{kind}") == 0
    found = messages(tmp_path / "run.mcap")
    assert [value.data for _, value in found["/tracked_status"]] == [status for status, _ in beliefs]
    places = [value.pose.pose.position for _, value in found["/tracked_object_pose"]]
    np.testing.assert_allclose([[place.x, place.y, place.z] for place in places], with_pose, atol=1e-12)
    assert "tracked_object" in {link.child_frame_id for _, value in found["/tf"] for link in value.transforms}
    table = [row for row in rows(tmp_path / "run.csv") if row["tracked_status"]]
    assert [row["tracked_status"] for row in table] == [status for status, _ in beliefs]
    written = [[float(row[f"tracked/p_{axis}_m"]) for axis in "xyz"] for row in table if row["tracked/p_x_m"]]
    np.testing.assert_allclose(written, with_pose, atol=1e-12)
