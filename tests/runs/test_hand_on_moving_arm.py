"""A run on devices whose hand an arm turns over: the fingertips' weight is taken off wherever the palm is."""

from pathlib import Path

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from tactopose_drake.core.poses import quaternion_from_matrix
from tactopose_drake.errors import InvalidFileError, InvalidInputError
from tactopose_drake.hand.fingertip_weights import FingertipWeights
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.runs.csv_export import write_csv
from tactopose_drake.runs.known_signals import known_signals
from tactopose_drake.runs.mcap_export import write_mcap
from tactopose_drake.runs.recorded_senses import read_recording
from tactopose_drake.runs.scenario_replay import replay
from tactopose_drake.runs.scenario_run import run_scenario
from tactopose_drake.station.can_senses import SimulatedDevices
from tactopose_drake.station.scenario import Scenario, load_scenario
from tests import held_cube
from tests.runs.cube_grasp import write_grasp
from tests.runs.test_export import messages

TURNED, DURATION = 0.4, 0.9  # s, when the arm has turned the hand over, and how long the run is
PALMS = [
    RigidTransform(RollPitchYaw(0.0, 0.0, 0.0), [0.4, 0.0, 0.6]),
    RigidTransform(RollPitchYaw(np.pi, 0.3, 0.5), [0.4, 0.2, 0.5]),
]
HEADER = "time, x, y, z, qw, qx, qy, qz"


def write_palm(path: Path) -> None:
    rows = [
        [time, *palm.translation(), *quaternion_from_matrix(palm.rotation().matrix())]
        for time, palm in zip((0.0, TURNED), PALMS, strict=True)
    ]
    np.savetxt(path, rows, delimiter=",", header=HEADER, comments="")


def weights_at(palm: RigidTransform) -> dict[str, np.ndarray]:
    plant, hand = make_hand_plant(load_hand_config("shadow_like"))
    weights = FingertipWeights(plant, hand, RigidTransform().rotation())
    return weights.wrenches(held_cube.Q, palm.rotation())


@pytest.fixture
def scenario(tmp_path: Path) -> Scenario:
    """Devices that weigh the fingertips as the palm turns, and feel the cube from then on."""
    write_grasp(tmp_path)
    for finger, F_S in held_cube.WRENCHES.items():
        before, after = (weights_at(palm)[finger] for palm in PALMS)
        rows = [np.append(0.0, before), np.append(TURNED, after + F_S)]
        np.savetxt(tmp_path / f"{finger}.csv", rows, delimiter=",", header="time, m_x, m_y, m_z, f_x, f_y, f_z")
    write_palm(tmp_path / "palm.csv")
    text = (tmp_path / "cube.scenario.yaml").read_text()
    (tmp_path / "cube.scenario.yaml").write_text(text.replace("tare_samples", "palm: palm.csv\n  tare_samples"))
    return load_scenario(str(tmp_path / "cube.scenario.yaml"))


def test_what_is_felt_does_not_see_the_fingertips_weight_as_the_hand_turns(scenario: Scenario, tmp_path: Path) -> None:
    view = run_scenario(scenario, duration=DURATION, record=tmp_path / "run")
    heaviest = max(
        np.linalg.norm(np.subtract(*(weights_at(p)[finger][3:] for p in PALMS))) for finger in held_cube.WRENCHES
    )
    assert heaviest > 0.1
    for finger, F_S in held_cube.WRENCHES.items():
        felt = view.diagram.GetOutputPort(f"wrench_{finger}").Eval(view.context)
        assert np.abs(felt[3:] - F_S[3:]).max() < 0.05
    played = replay(tmp_path / "run", scenario)
    assert played.whole
    recorded = read_recording(tmp_path / "run")
    for finger, F_S in held_cube.WRENCHES.items():
        assert np.abs(recorded.signals[f"wrench_{finger}"].values[-1][3:] - F_S[3:]).max() < 0.05
    write_mcap(recorded, tmp_path / "run.mcap")
    _, last = messages(tmp_path / "run.mcap")["/palm_pose"][-1]
    position = last.pose.position
    assert last.header.frame_id == "world"
    np.testing.assert_allclose([position.x, position.y, position.z], PALMS[1].translation(), atol=0.02)
    for finger, F_S in held_cube.WRENCHES.items():
        felt = played.view.diagram.GetOutputPort(f"wrench_{finger}").Eval(played.view.context)
        assert np.abs(felt[3:] - F_S[3:]).max() < 0.05


def test_where_the_palm_is_is_not_known_in_a_gap_of_its_file(scenario: Scenario, tmp_path: Path) -> None:
    """The arm's controller says nothing from 0.2 to 0.7 s; the last row holds for as long as rows usually may."""
    pose = [*PALMS[0].translation(), *quaternion_from_matrix(PALMS[0].rotation().matrix())]
    rows = [[0.01 * k, *pose] for k in (*range(21), *range(70, 100))]
    np.savetxt(tmp_path / "palm.csv", rows, delimiter=",", header=HEADER, comments="")
    palm = known_signals(scenario)["palm_pose"]
    for time, is_known in ((0.0, True), (0.34, True), (0.36, False), (0.69, False), (0.71, True), (9.0, True)):
        assert np.isfinite(palm.at(time).GetAsMatrix34()).all() == is_known
    view = run_scenario(scenario, duration=0.4, record=tmp_path / "run")
    played = replay(tmp_path / "run", scenario)
    assert played.whole  # A run that lags behind its devices has newer readings than its replay: estimates may differ.
    for now in (view, played.view):
        assert np.isnan(now.diagram.GetOutputPort("wrench_thumb").Eval(now.context)).all()
        assert "thumb: the wrench is not finite" in now.diagram.GetOutputPort("contact_status").Eval(now.context)
    recorded = read_recording(tmp_path / "run")
    write_csv(recorded, tmp_path / "run.csv")
    assert ",nan,nan,nan,nan,nan,nan,nan" in (tmp_path / "run.csv").read_text()
    write_mcap(recorded, tmp_path / "run.mcap")
    places = [said.pose.position.x for _, said in messages(tmp_path / "run.mcap")["/palm_pose"]]
    np.testing.assert_array_equal(np.isnan(places), [False, True])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time, x, y, z\n0.0, 1.0, 2.0, 3.0\n", "must have the columns time, x, y, z, qw.*, not time, x, y, z"),
        (f"{HEADER}\n0.0, 0, 0, 0, 2.0, 0, 0, 0\n", "the quaternion at 0 s must have the length 1, not 2"),
        (
            f"{HEADER}, qv\n0.0, 0, 0, 0, 1.0, 0, 0, 0, 0\n",
            "must have the columns .*, not time, x, y, z, qw, qx, qy, qz, qv",
        ),
        (
            f"{HEADER}\n0.0, 400, 0, 0, 1, 0, 0, 0\n0.1, 400, 250, 0, 1, 0, 0, 0\n",
            r"x, y, z, must be within 100 m of each other, not 250 m apart\. Multiply by 0\.001 what is in millimetres",
        ),
        (f"{HEADER}\n0.0, 0, 0\n", "row 2 must have 8 columns, not 3"),
    ],
)
def test_files_of_the_palm_that_do_not_fit_are_named(
    scenario: Scenario, tmp_path: Path, text: str, message: str
) -> None:
    (tmp_path / "palm.csv").write_text(text)
    with pytest.raises(InvalidFileError, match=message):
        known_signals(scenario)


def test_a_hand_that_is_simulated_on_a_base_has_no_arm(scenario: Scenario) -> None:
    scenario.senses.simulated = SimulatedDevices()
    with pytest.raises(InvalidInputError, match=r"CanSenses\.palm must be left out, as the simulated devices"):
        scenario.validate()
