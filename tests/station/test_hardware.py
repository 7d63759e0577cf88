"""The diagram of real or recorded senses: the simulated one's ports, and errors before anything is opened."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.errors import BusError, InvalidInputError, UnknownNameError
from tactopose_drake.hand.calibration_file import (
    FingerCalibration,
    HandCalibration,
    MeasuredNumber,
    MeasuredVector,
    save_calibration,
)
from tactopose_drake.hand.encoder_offsets import encoder_gains
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.hand.joint_matrices import reading_offsets
from tactopose_drake.resources import model_path
from tactopose_drake.runs.device_run import warm_up
from tactopose_drake.runs.estimate_writer import EstimateWriter
from tactopose_drake.runs.known_signals import known_signals
from tactopose_drake.runs.manifest import Manifest
from tactopose_drake.runs.scenario_replay import as_recorded, replay
from tactopose_drake.runs.scenario_run import run_scenario
from tactopose_drake.station.can_devices import CanDevices, live_buses
from tactopose_drake.station.can_senses import CanBus, FixedJoints, JointFile, SimulatedDevices
from tactopose_drake.station.hardware import make_hardware_station
from tactopose_drake.station.scenario import Scenario, load_scenario
from tactopose_drake.station.senses import SimulatedSenses
from tactopose_drake.station.simulated import make_station
from tactopose_drake.systems.pose_tracking import PoseTrackingParams
from tactopose_drake.systems.signals import Signal
from tests import held_cube

# What only a simulator can say.
OF_THE_SIMULATOR = {
    "hand_state", "actuation", "holding", "grasp_status", "hidden_share", "contact_results", "body_poses", "query"
}  # fmt: skip


@pytest.fixture(scope="module")
def cube() -> ObjectModel:
    return ObjectModel.from_mesh(model_path("objects", "cube.obj"))


def outputs(diagram: Diagram) -> set[str]:
    return {diagram.get_output_port(index).get_name() for index in range(diagram.num_output_ports())}


def inputs(diagram: Diagram) -> set[str]:
    return {diagram.get_input_port(index).get_name() for index in range(diagram.num_input_ports())}


def assert_same_ports(simulated: Diagram, scenario: Scenario, model: ObjectModel) -> None:
    devices = CanDevices(scenario.senses, live_buses(scenario.senses))
    diagram = make_hardware_station(scenario, devices, model=model).diagram
    # No camera is part of the hardware: the prior comes in.
    assert outputs(simulated) - OF_THE_SIMULATOR - outputs(diagram) == {"prior"}
    senses = {"hand"} if devices.hand else set(held_cube.WRENCHES)
    assert outputs(diagram) >= {f"{what}_{sense}" for what in ("status", "age") for sense in senses}
    assert inputs(diagram) == ({"prior"} if devices.hand else {"prior", "joint_positions", "palm_pose"})


def test_the_ports_are_those_of_the_simulated_station() -> None:
    scenario = load_scenario("barrett_like_can")
    scenario.planner.grasps = 1
    model = ObjectModel.from_mesh(scenario.object_mesh())
    assert_same_ports(make_station(scenario, model=model).diagram, scenario, model)


def test_joints_and_prior_come_through_ports_of_your_own_diagram(cube: ObjectModel) -> None:
    scenario = held_cube.scenario()
    wrenches = {f"wrench_{finger}": Signal.constant(F_S) for finger, F_S in held_cube.WRENCHES.items()}
    diagram = make_hardware_station(scenario, None, wrenches, model=cube).diagram
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    diagram.GetInputPort("joint_positions").FixValue(context, held_cube.Q)
    diagram.GetInputPort("prior").FixValue(context, AbstractValue.Make(held_cube.prior()))
    simulator.AdvanceTo(0.01)
    off = diagram.GetOutputPort("object_pose").Eval(context).translation() - held_cube.X_PO[:, 3]
    assert np.linalg.norm(off) < 0.004
    np.testing.assert_array_equal(diagram.GetOutputPort("joint_positions").Eval(context), held_cube.Q)


def test_where_an_arm_moves_the_hand_its_pose_comes_in_for_weight_and_balance(cube: ObjectModel) -> None:
    scenario = held_cube.scenario()
    devices = CanDevices(scenario.senses, live_buses(scenario.senses))
    assert "palm_pose" in inputs(make_hardware_station(scenario, devices, model=cube).diagram)
    scenario.estimation.estimator.balance = True
    diagram = make_hardware_station(scenario, devices, model=scenario.object_model()).diagram
    consumers = [diagram.GetSubsystemByName(name) for name in ("fingertip_weight", "pose_estimation")]
    context = diagram.CreateDefaultContext()
    diagram.GetInputPort("joint_positions").FixValue(context, held_cube.Q)
    ports = [(each.GetInputPort("palm_pose"), each.GetMyContextFromRoot(context)) for each in consumers]
    assert not ports[0][0].HasValue(ports[0][1])  # The base stands still.
    X_WP = RigidTransform(RollPitchYaw(0.3, -0.8, 1.9), [0.4, 0.1, 0.7])
    assert not ports[1][0].Eval(ports[1][1]).IsNearlyEqualTo(X_WP, 0.1)
    diagram.GetInputPort("palm_pose").FixValue(context, AbstractValue.Make(X_WP))
    assert all(port.Eval(own).IsExactlyEqualTo(X_WP) for port, own in ports)


def test_a_belief_too_is_told_where_an_arm_holds_the_palm(cube: ObjectModel) -> None:
    scenario = held_cube.scenario()
    scenario.tracking = PoseTrackingParams(use_joint_velocities=False)
    X_WP = RigidTransform(RollPitchYaw(0.3, -0.8, 1.9), [0.4, 0.1, 0.7])
    wrenches = {f"wrench_{finger}": Signal.constant(F_S) for finger, F_S in held_cube.WRENCHES.items()}
    for signals in (wrenches, {**wrenches, "palm_pose": Signal.constant(X_WP)}):
        diagram = make_hardware_station(scenario, None, signals, model=cube).diagram
        assert inputs(diagram) == {"joint_positions", "prior"} | ({"palm_pose"} - signals.keys())
        context = diagram.CreateDefaultContext()
        belief = diagram.GetSubsystemByName("pose_tracking")
        port, own = belief.GetInputPort("palm_pose"), belief.GetMyContextFromRoot(context)
        if "palm_pose" not in signals:
            assert not port.HasValue(own)
            diagram.GetInputPort("palm_pose").FixValue(context, AbstractValue.Make(X_WP))
        assert port.Eval(own).IsExactlyEqualTo(X_WP)


def test_a_station_warms_up_by_the_touch_alone_whatever_else_it_may_be_told(cube: ObjectModel) -> None:
    scenario = held_cube.scenario()
    scenario.estimation.estimator.balance = True
    wrenches = {f"wrench_{finger}": Signal.constant(F_S) for finger, F_S in held_cube.WRENCHES.items()}
    station = make_hardware_station(scenario, None, wrenches, model=scenario.object_model())
    estimation = station.diagram.GetSubsystemByName("pose_estimation")
    assert {"planes", "palm_pose", "prior"} < inputs(estimation)
    warm_up(station)


def test_boards_that_are_tared_lose_the_biases_of_a_calibration_and_simulated_ones_all_of_it(tmp_path: Path) -> None:
    bias = MeasuredVector(value=[0.1, 0.2, 0.3], sigma=[0.001] * 3)
    found = {finger: FingerCalibration(force_bias=bias) for finger in held_cube.WRENCHES}
    save_calibration(tmp_path / "calibration.yaml", HandCalibration(grasps=5, fingers=found))
    text = model_path("hands", "shadow_like", "shadow_like.hand.yaml").read_text()
    (tmp_path / "mine.hand.yaml").write_text(f"{text}calibration: calibration.yaml\n")
    scenario = dataclasses.replace(held_cube.scenario(), hand=str(tmp_path / "mine.hand.yaml"))
    tared = next(iter(scenario.senses.fingers))
    scenario.senses.fingers = {tared: scenario.senses.fingers[tared]}
    biases = make_hand_plant(scenario.hand_config())[1].calibration.fingers
    assert biases[tared].force_bias.value == [0.0, 0.0, 0.0]
    assert biases[tared].force_bias.sigma[0] > 0.001
    assert all(biases[finger].force_bias == bias for finger in found if finger != tared)
    scenario.senses.tare_samples = 0
    assert make_hand_plant(scenario.hand_config())[1].calibration.fingers[tared].force_bias == bias
    scenario.senses.simulated = SimulatedDevices()
    assert make_hand_plant(scenario.hand_config())[1].calibration is None
    replayed = as_recorded(scenario, Manifest(scenario=scenario))
    assert make_hand_plant(replayed.hand_config())[1].calibration is None
    scenario.senses.simulated.folder = "recorded"  # of a real hand
    assert make_hand_plant(scenario.hand_config())[1].calibration is not None


def test_fingertips_weigh_as_the_calibrated_joints_hold_them(cube: ObjectModel, tmp_path: Path) -> None:
    names = encoder_gains(*make_hand_plant(load_hand_config("shadow_like"))).joints
    offsets = {name: MeasuredNumber(value=5.0, sigma=0.1) for name in names}
    save_calibration(tmp_path / "calibration.yaml", HandCalibration(grasps=5, joint_offsets=offsets))
    text = model_path("hands", "shadow_like", "shadow_like.hand.yaml").read_text()
    (tmp_path / "mine.hand.yaml").write_text(f"{text}calibration: calibration.yaml\n")
    positions = []
    for hand, q in (
        ("shadow_like", held_cube.Q),
        (
            str(tmp_path / "mine.hand.yaml"),
            held_cube.Q + reading_offsets(*make_hand_plant(load_hand_config(tmp_path / "mine.hand.yaml"))),
        ),
    ):
        scenario = dataclasses.replace(held_cube.scenario(), hand=hand)
        scenario.estimation.estimator.balance = True
        devices = CanDevices(scenario.senses, live_buses(scenario.senses))
        diagram = make_hardware_station(scenario, devices, model=scenario.object_model()).diagram
        context = diagram.CreateDefaultContext()
        diagram.GetInputPort("joint_positions").FixValue(context, q)
        for name in ("fingertip_weight", "palm_pose"):
            system = diagram.GetSubsystemByName(name)
            positions.append(system.GetInputPort("joint_positions").Eval(system.GetMyContextFromRoot(context)))
    np.testing.assert_allclose(positions[2:], positions[:2], atol=1e-12)


def test_signals_that_do_not_fit_are_named(cube: ObjectModel) -> None:
    scenario = held_cube.scenario()
    with pytest.raises(UnknownNameError, match=r"each name in signals must be one of wrench_first.*, not 'wrench_toe'"):
        make_hardware_station(scenario, None, {"wrench_toe": Signal.constant(np.zeros(6))}, model=cube)
    with pytest.raises(InvalidInputError, match="signal 'joint_positions' must have 24 numbers, not 7"):
        make_hardware_station(scenario, None, {"joint_positions": Signal.constant(np.zeros(7))}, model=cube)
    devices = CanDevices(scenario.senses, live_buses(scenario.senses))
    scenario.senses = SimulatedSenses()
    with pytest.raises(InvalidInputError, match=r"Scenario.senses must be !CanSenses with devices"):
        make_hardware_station(scenario, devices, model=cube)


def positions_of(scenario: Scenario) -> dict[str, float]:
    plant, _ = make_hand_plant(load_hand_config(scenario.hand))
    q = known_signals(scenario)["joint_positions"].at(0.0)
    joints = (plant.get_joint(index) for index in plant.GetJointIndices())
    return {joint.name(): q[joint.position_start()] for joint in joints if joint.num_positions() == 1}


def test_joints_that_are_not_given_follow_or_rest(tmp_path: Path) -> None:
    scenario = held_cube.scenario(joints=FixedJoints(positions={"FFJ2": 0.7, "THJ4": 0.5}))
    q = positions_of(scenario)
    assert {name: position for name, position in q.items() if position} == {"FFJ2": 0.7, "FFJ1": 0.7, "THJ4": 0.5}
    path = tmp_path / "joints.csv"
    path.write_text("time, FFJ2, THJ4\n0.0, 0.7, 0.5\n1.0, 0.8, 0.6\n")
    scenario.senses.joints = JointFile(path=str(path))
    assert positions_of(scenario) == q
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", b"\r\n"))  # as spreadsheets write it
    assert positions_of(scenario) == q
    assert known_signals(scenario)["joint_positions"].at(1.5).max() == 0.8


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time, FFJ2\n0.0\n", "row 2 must have 2 columns, not 1"),
        ("time, FFJ2\n", "must have at least one row below its header, not none"),
        ("", "must have a header and rows of numbers, but is empty"),
        ("0.0, 0.1\n1.0, 0.1\n", "row 1 must be a header, the columns' names, not numbers"),
        ("FFJ2, time\n0.0, 1.0\n", "must have the columns time, time, not FFJ2, time"),
        ("time, FFJ2\n0.0, 0.1\n\n1.0, nan\n", "row 4: FFJ2 must be a finite number, not 'nan'"),
        ("time, FFJ2\n1.0, 0.0\n1.0, 0.1\n", "row 3: time must rise, not be 1 after 1"),
        ("time, FFJ2\n0.0, a\n", "row 2: FFJ2 must be a finite number, not 'a'"),
        ("time, FFJ2, FFJ2\n0.0, 0.1, 0.1\n", "row 1 must name 'FFJ2' once, not twice"),
        ("time, elbow\n0.0, 0.1\n", "positions: each name in measured must be one of FFJ1.*, not 'elbow'"),
    ],
)
def test_joint_files_that_do_not_fit_are_named(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "joints.csv"
    path.write_text(text)
    with pytest.raises(InvalidInputError, match=rf"joints\.csv:? {message}"):
        known_signals(held_cube.scenario(joints=JointFile(path=str(path))))


def test_joints_are_not_known_in_a_long_gap_of_their_file(cube: ObjectModel, tmp_path: Path) -> None:
    plant, _ = make_hand_plant(load_hand_config("shadow_like"))
    names = [
        plant.get_joint(index).name() for index in plant.GetJointIndices() if plant.get_joint(index).num_positions()
    ]
    order = [plant.GetJointByName(name).position_start() for name in names]
    times = np.array([0.0, 0.01, 0.02, 0.03, 0.04, 0.9, 0.91, 0.92, 1.2])
    path = tmp_path / "joints.csv"
    rows = np.column_stack([times, np.tile(held_cube.Q[order], (len(times), 1))])
    header = ", ".join(["time", *names])
    np.savetxt(path, rows, delimiter=",", header=header, comments="")
    scenario = held_cube.scenario(joints=JointFile(path=str(path)))
    played = known_signals(scenario)["joint_positions"]
    is_known = {time: not np.isnan(played.at(time)).any() for time in (0.0, 0.03, 0.18, 0.2, 0.89, 0.9, 1.0, 1.1, 1.5)}
    assert [time for time, known in is_known.items() if not known] == [0.2, 0.89, 1.1]
    wrenches = {f"wrench_{finger}": Signal.constant(F_S) for finger, F_S in held_cube.WRENCHES.items()}
    known = {**wrenches, "joint_positions": played, "prior": Signal.constant(held_cube.prior())}
    simulator = Simulator(make_hardware_station(scenario, None, known, model=cube).diagram)
    said = {}
    for time in (0.11, 0.61, 1.01):
        simulator.AdvanceTo(time)
        said[time] = simulator.get_system().GetOutputPort("status").Eval(simulator.get_context())
    assert (said[0.11], said[1.01]) == ("ok", "ok")
    assert said[0.61].startswith("held: 0 touches;")
    assert "first: a joint position is not known" in said[0.61]
    # Rows that are rare all along count until the next.
    rows[:, 0] = 5.0 * np.arange(len(rows))
    np.savetxt(path, rows, delimiter=",", header=header, comments="")
    assert np.isfinite(known_signals(scenario)["joint_positions"].at(4.9)).all()


def test_degrees_are_not_taken_for_radians(tmp_path: Path) -> None:
    fixed = held_cube.scenario(joints=FixedJoints(positions={"FFJ2": 45.0}))
    with pytest.raises(
        InvalidInputError,
        match=r"^CanSenses\.joints\.positions\[FFJ2\] must be from .* rad, near the joint's limits, .*, not 45\.",
    ):
        known_signals(fixed)
    path = tmp_path / "joints.csv"
    path.write_text("time, FFJ2\n0.0, 0.0\n1.0, -40.0\n2.0, 0.0\n")
    with pytest.raises(
        InvalidInputError,
        match=r"joints\.csv: positions\[FFJ2\] must be from .* rad, near the joint's limits, .*, not -40\.",
    ):
        known_signals(held_cube.scenario(joints=JointFile(path=str(path))))


def test_unknown_joints_are_named() -> None:
    with pytest.raises(
        InvalidInputError, match=r"joints\.positions: each name in measured must be one of .*, not 'elbow'"
    ):
        known_signals(held_cube.scenario(joints=FixedJoints(positions={"elbow": 0.1})))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda senses: senses.fingers.clear(), "CanSenses must have fingers, barrett_hand or both, but has neither"),
        (lambda senses: setattr(senses, "tare_samples", -1), "tare_samples must be .*, not -1"),
        (lambda senses: setattr(senses.fingers["thumb"], "period", 0.0), r"fingers\[thumb\].period must be .*, not 0"),
        (
            lambda senses: setattr(senses.fingers["thumb"], "period", 0.2),
            r"fingers\[thumb\]\.max_age must be at least its period, 0\.2 s, not 0\.05 s\.",
        ),
        (lambda senses: setattr(senses, "prior", "absent.yaml"), r"CanSenses\.prior: there is no file absent\.yaml"),
        (lambda senses: setattr(senses, "palm", "absent.csv"), r"CanSenses\.palm: there is no file absent\.csv"),
        (
            lambda senses: setattr(senses, "simulated", SimulatedDevices(folder="absent")),
            r"CanSenses\.simulated\.folder: there is no folder absent",
        ),
        (
            lambda senses: setattr(senses, "joints", JointFile(path="absent.csv")),
            r"CanSenses\.joints\.path: there is no file absent\.csv",
        ),
        (
            lambda senses: setattr(senses.fingers["thumb"], "base", 200),
            r"fingers\[thumb\].base must be an integer from 0 to .*, not 200",
        ),
        (
            lambda senses: setattr(senses.fingers["thumb"], "force_unit", "STONE"),
            r"fingers\[thumb\].force_unit must be one of .*, not 'STONE'",
        ),
        (
            lambda senses: setattr(senses.fingers["thumb"], "base", 0x20),
            r"buses\[main\]: thumb must have other identifiers than first ",
        ),
        (
            lambda senses: senses.buses.update(other=CanBus(interface="virtual", channel="held cube")),
            r"CanSenses\.buses\[other\] must have a channel of its own, not 'held cube' of virtual, which main is on\.",
        ),
        (
            lambda senses: setattr(senses.buses["main"], "interface", "string"),
            r"buses\[main\].interface must be one of .*, not 'string'",
        ),
        *(
            (
                lambda senses, name=name: senses.buses.update({name: CanBus(interface="virtual", channel="other")}),
                r"CanSenses\.buses must have names that can name a log, of up to 60 letters, .*, not",
            )
            for name in ("../evil", "a/b", "a\\b", "/", "..", "", "a\n", "a\0", "b" * 61)
        ),
        *(
            (
                lambda senses, option=option: senses.buses["main"].options.update({option: "x"}),
                rf"buses\[main\].options must be the interface's own, such as bitrate, not '{option}'\.",
            )
            for option in ("interface", "channel", "ignore_config", "can_filters", "cls", "self")
        ),
    ],
)
def test_senses_that_cannot_be_are_refused(change, message: str) -> None:
    scenario = held_cube.scenario()
    change(scenario.senses)
    with pytest.raises(InvalidInputError, match=message):
        scenario.validate()


def test_a_bus_that_cannot_be_opened_is_named_as_in_the_scenario() -> None:
    senses = held_cube.scenario().senses
    senses.buses["main"] = CanBus(interface="slcan", channel="/dev/nothing0")
    message = r"^bus 'main', '/dev/nothing0' of slcan cannot be opened \("
    with pytest.raises(BusError, match=message), CanDevices(senses, live_buses(senses)):
        pass


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda board: setattr(board, "base", 200), "base must be an integer from 0 to 127, not 200"),
        (
            lambda board: setattr(board, "calibration", 16),
            r"^CanSenses\.fingers\[thumb\]\.calibration must be an integer from 0 to 15, not 16",
        ),
        (lambda board: setattr(board, "base", 0x20), "on the same bus, but both have"),
        (
            lambda board: setattr(board, "force_unit", "STONE"),
            r"fingers\[thumb\].force_unit must be one of .*, not 'STONE'",
        ),
    ],
)
def test_boards_that_cannot_be_are_refused(change, message: str) -> None:
    senses = held_cube.scenario().senses
    change(senses.fingers["thumb"])
    with pytest.raises(InvalidInputError, match=message), CanDevices(senses, live_buses(senses)):
        pass


def test_a_recorded_simulation_replays_to_what_the_run_said(cube: ObjectModel, tmp_path: Path) -> None:
    scenario = load_scenario("shadow_like")
    scenario.object, scenario.planner.grasps = "cube", 1
    scenario.estimation.use_hand_volume = scenario.estimation.check_collisions = False
    scenario.estimation.estimator.balance = True  # The weight's direction is known by the joints as they are measured.
    assert scenario.errors is not None
    scenario.errors.encoder_noise_deg = 0.1
    simulated = run_scenario(scenario, duration=1.3, record=tmp_path / "run").diagram
    assert_same_ports(simulated, held_cube.scenario(), cube)
    with EstimateWriter(tmp_path / "replayed.jsonl") as writer:
        played = replay(tmp_path / "run", scenario, observer=lambda view: writer.write(view.diagram, view.context))
    assert played.whole
    ran, replayed = (
        [json.loads(line) for line in path.read_text().splitlines()]
        for path in (tmp_path / "run" / "estimates.jsonl", tmp_path / "replayed.jsonl")
    )
    assert {line["sense_status"] for line in ran} == {"ok"}
    assert sum(line["hypotheses"] is not None for line in ran) >= 3
    assert replayed == ran[: len(replayed)]
    assert len(replayed) >= len(ran) - 1
