import dataclasses
import gc

import numpy as np
import pytest
from pydrake.geometry import Meshcat, MeshcatParams
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.analysis import Simulator

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.errors import InvalidFileError, InvalidInputError
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_reach import make_hand_reach
from tactopose_drake.resources import resource_root
from tactopose_drake.runs.grasp_simulation import run_grasp, simulate_grasp
from tactopose_drake.station.grasp_planning import plan_scenario
from tactopose_drake.station.object_sdf import write_simulated_object
from tactopose_drake.station.scenario import Scenario, load_scenario
from tactopose_drake.station.simulated import make_station
from tactopose_drake.systems.pose_tracking import PoseTrackingParams

SCENARIOS = sorted((resource_root() / "diagrams").glob("*.scenario.yaml"))


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    scenario = load_scenario("shadow_like").without_errors()
    scenario.object = "cube"
    scenario.planner.grasps = 2
    return scenario


@pytest.fixture(scope="module")
def result(scenario):
    return simulate_grasp(scenario)


@pytest.fixture(scope="module")
def plan(result):
    return result.station.plan


def test_object_stays_in_the_hand(result, scenario):
    assert result.stable, (result.reason, result.failed_attempts)
    assert result.reason == "ok"
    assert result.slip < 0.005
    assert result.speed < 0.001
    # Let go early enough for the judgement at the end.
    assert result.release_time < scenario.duration - scenario.check.hold_time


def test_fingertips_alone_carry_the_object(result):
    assert result.truth.other_contacts == ()
    carrying = [finger for finger, tip in result.truth.tips.items() if np.linalg.norm(tip.f_PC) > 1.0]
    assert len(carrying) >= 4


def test_contact_forces_balance_the_weight(result):
    station = result.station
    plant_context = station.plant.GetMyContextFromRoot(result.context)
    mass = station.plant.CalcTotalMass(plant_context, [station.object_body.model_instance()])
    R_PW = station.hand.palm_frame.CalcPoseInWorld(plant_context).rotation().inverse()
    weight_P = R_PW @ (mass * station.plant.gravity_field().gravity_vector())
    force_on_object = -sum(tip.f_PC for tip in result.truth.tips.values())
    np.testing.assert_allclose(force_on_object, -weight_P, atol=0.03)


def test_true_contacts_lie_on_the_object_with_its_normals(result):
    R_PO, p_PO = result.X_PO.rotation().matrix(), result.X_PO.translation()
    for tip in result.truth.tips.values():
        distance, normal = result.station.model.grid.distance_and_normal((tip.p_PC - p_PO) @ R_PO)
        assert abs(distance) < 5e-4
        assert (R_PO @ normal) @ tip.n_PC > np.cos(np.radians(5))
        assert tip.f_PC @ tip.n_PC > 0


def test_measured_contacts_agree_with_the_simulators(result):
    diagram, context = result.station.diagram, result.context
    contacts = diagram.GetOutputPort("contacts").Eval(context)
    fingers = diagram.GetOutputPort("fingers_in_contact").Eval(context)
    true_points = np.array([result.truth.tips[finger].p_PC for finger in fingers])
    true_forces = np.array([result.truth.tips[finger].f_PC for finger in fingers])
    assert len(fingers) >= 4
    assert np.median(np.linalg.norm(contacts.p_PC - true_points, axis=1)) < 4e-4
    np.testing.assert_allclose(contacts.f_PC, true_forces, atol=0.05)


def test_ports_carry_what_they_say(result):
    diagram, context = result.station.diagram, result.context
    kinds = {
        "object_pose": RigidTransform, "prior": PosePrior, "contacts": Contacts, "status": str, "grasp_status": str,
        "contact_status": str, "sense_status": str, "fingers_in_contact": tuple,
    }  # fmt: skip
    for name, kind in kinds.items():
        assert isinstance(diagram.GetOutputPort(name).Eval(context), kind), name
    sizes = {"hand_state": 48, "actuation": 20, "holding": 1, "wrench_thumb": 6, "hidden_share": 1}
    for name, size in sizes.items():
        assert diagram.GetOutputPort(name).Eval(context).shape == (size,), name


def test_the_object_is_held_until_the_fingers_close(scenario, plan, result):
    station = make_station(scenario, plan, model=result.station.model)
    simulator = Simulator(station.diagram)
    context = simulator.get_mutable_context()
    station.start(context)
    simulator.set_monitor(station.release_when_held)
    before = station.object_pose(context)
    assert before.IsNearlyEqualTo(RigidTransform(RotationMatrix(plan.X_PO[:, :3]), plan.X_PO[:, 3]), 1e-9)
    simulator.AdvanceTo(0.3)
    # The wrist gives a little under the hand's weight; the object does not move.
    assert np.linalg.norm(station.object_pose(context).translation() - before.translation()) < 2e-3
    assert station.diagram.GetOutputPort("holding").Eval(context)[0] == 0.0
    assert station.diagram.GetOutputPort("grasp_status").Eval(context) == "closing"


def test_a_grasp_that_cannot_hold_says_why(scenario, plan, result):
    weak = {
        name: dataclasses.replace(finger, motion=dataclasses.replace(finger.motion, set_force=0.05))
        for name, finger in plan.fingers.items()
    }
    outcome = run_grasp(make_station(scenario, dataclasses.replace(plan, fingers=weak), model=result.station.model))
    assert not outcome.stable
    assert "slipped" in outcome.reason or "carry" in outcome.reason


def test_same_seed_same_plan_other_seed_other_plan(scenario, result):
    scenario = dataclasses.replace(scenario, planner=dataclasses.replace(scenario.planner, grasps=1))
    first, again = (plan_scenario(scenario, result.station.model)[0] for _ in range(2))
    np.testing.assert_array_equal(first.X_PO, again.X_PO)
    other = plan_scenario(dataclasses.replace(scenario, seed=1), result.station.model)[0]
    assert not np.allclose(first.X_PO, other.X_PO)


def test_planned_touches_lie_on_the_object_and_balance(plan, result):
    for finger in plan.fingers.values():
        p_OC = (finger.p_PC - plan.X_PO[:, 3]) @ plan.X_PO[:, :3]
        assert abs(result.station.model.grid.distance(p_OC)) < 2e-4
        assert finger.motion.set_force >= 1.8
    assert len(plan.fingers) >= 4


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.name)
def test_every_scenario_runs_a_moment(path):
    scenario = load_scenario(path)
    scenario.planner.grasps = 1
    station = make_station(scenario)
    simulator = Simulator(station.diagram)
    station.start(simulator.get_mutable_context())
    simulator.AdvanceTo(0.05)
    hand = station.hand
    senses = [f"wrench_{finger}" for finger in hand.sensor_frames] + [f"pressures_{pad}" for pad in hand.pad_frames]
    assert senses
    for name in ("joint_positions", *senses):
        assert np.all(np.isfinite(station.diagram.GetOutputPort(name).Eval(simulator.get_context()))), name


def test_a_simulated_sensor_s_status_says_why_it_gives_no_wrench(scenario, plan, result, tmp_path):
    """As on devices: the sensors have a range here that their own fingertips' weight exceeds along one axis."""
    zeros = [0.0] * 6
    limits = f"{{range: [1, 1, 1, 17, 17, 0.001], resolution: {zeros}, noise: {zeros}}}"
    (tmp_path / "weak.yaml").write_text(f"calibrations: {{limits: {limits}}}\n")
    sensor = dataclasses.replace(scenario.sensor, file=str(tmp_path / "weak.yaml"), calibration="limits")
    station = make_station(dataclasses.replace(scenario, sensor=sensor), plan, model=result.station.model)
    context = station.diagram.CreateDefaultContext()
    station.start(context)

    def value(name):
        return station.diagram.GetOutputPort(name).Eval(context)

    assert value("status_thumb") == "no sample yet"
    simulator = Simulator(station.diagram, context)
    simulator.AdvanceTo(0.05)
    assert np.isnan(value("wrench_thumb")).all()
    assert value("status_thumb") == "saturated: f_z"
    assert value("sense_status") == "; ".join(f"{finger}: saturated: f_z" for finger in station.hand.sensor_frames)


def test_an_object_too_large_for_the_hand_is_refused_by_its_name_wherever_its_files_are(scenario, result, tmp_path):
    planner = dataclasses.replace(scenario.planner, palm_clearance=0.2, most_poses=3)
    elsewhere = str(write_simulated_object(result.station.model, tmp_path))
    for object_named in ("cube", elsewhere):
        narrow = dataclasses.replace(scenario, object=object_named, planner=planner)
        with pytest.raises(InvalidInputError, match="finds no way to hold 'cube'"):
            plan_scenario(narrow, result.station.model)


def test_a_hand_without_grip_region_gets_one_between_its_fingers(scenario):
    config = load_hand_config("shadow_like")
    low, high = np.array(config.grip_low), np.array(config.grip_high)
    config.grip_low, config.grip_high = [], []
    found = make_hand_reach(config, scenario.reach)
    middle = 0.5 * (found.grip_low + found.grip_high)
    assert np.all(middle > low - 0.02)
    assert np.all(middle < high + 0.02)


@pytest.mark.parametrize(
    ("line", "error", "text"),
    [
        ("seed: -1", InvalidInputError, r"Scenario\.seed must be .*, not -1"),
        (
            "object: teapot",
            InvalidInputError,
            r"object must be one of the package's objects, .*wine_glass.*, not 'teapot'",
        ),
        ("object: tin.stl", InvalidInputError, r"must be an SDF with an OBJ .*, not .*tin\.stl, a mesh alone"),
        ("duration: 0", InvalidInputError, r"Scenario\.duration must be .*, not 0"),
        ("check: {attempts: 0}", InvalidInputError, r"Scenario\.check\.attempts must be .*, not 0"),
        ("planner: {least_fingers: 1}", InvalidInputError, r"least_fingers must be .*, not 1"),
        ("colour: red", InvalidFileError, "colour"),
    ],
)
def test_bad_scenarios_are_refused(tmp_path, line, error, text):
    path = tmp_path / "bad.scenario.yaml"
    path.write_text(f"hand: shadow_like\n{line}\n")
    with pytest.raises(error, match=text):
        load_scenario(path)


def test_a_scenario_that_is_not_there_is_told_with_those_that_are() -> None:
    with pytest.raises(
        InvalidFileError, match=r"nosuch must be .* barrett_like, .*shadow_like.*, but there is no such file"
    ):
        load_scenario("nosuch")


@pytest.fixture
def frees_its_meshcat():
    """A Meshcat aborts the process if it ends on another thread, such as a bus's that happens to collect garbage."""
    yield
    gc.collect()


@pytest.mark.usefixtures("frees_its_meshcat")
@pytest.mark.parametrize("tracks", [False, True])
def test_meshcat_shows_the_belief_over_time_where_there_is_one(scenario, plan, tracks):
    tracking = PoseTrackingParams() if tracks else None
    station = make_station(
        dataclasses.replace(scenario, tracking=tracking), plan, meshcat=Meshcat(MeshcatParams(host="localhost"))
    )
    display = station.diagram.GetSubsystemByName("pose_display")
    shown = {}
    for (system, port), (source, _) in station.diagram.connection_map().items():
        if system is display:
            shown[system.get_input_port(port).get_name()] = source.get_name()
    believed = "pose_tracking" if tracks else "pose_estimation"
    assert (shown["object_pose"], shown["hypotheses"]) == (believed, believed)
    assert shown["contacts"] == "pose_estimation"
