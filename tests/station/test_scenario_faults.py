import re
from pathlib import Path
from typing import Any

import pytest
from pydrake.common.yaml import yaml_dump_typed
from pydrake.geometry import Box, Role

from tactopose_drake.core.calibration.offset_refinement import OffsetRefinementParams
from tactopose_drake.errors import InvalidFileError, InvalidInputError
from tactopose_drake.resources import model_path, resource_root
from tactopose_drake.runs.scenario_run import run_scenario
from tactopose_drake.station.grasp_planning import plan_scenario
from tactopose_drake.station.hardware import make_hardware_station
from tactopose_drake.station.scenario import Scenario, load_scenario
from tactopose_drake.station.simulated import make_station
from tactopose_drake.station.simulated_errors import SimulatedErrors
from tactopose_drake.systems.pose_tracking import PoseTrackingParams
from tactopose_drake.systems.touch_exploration import TouchExplorationParams
from tests.cli.test_cli import run as tactopose

FAULTS = {
    "plant: {contact_model: soft}": "Scenario.plant.contact_model must be one of point ... , not 'soft'",
    "plant: {discrete_contact_approximation: x}": "discrete_contact_approximation must be one of tamsi ... , not 'x'",
    "plant: {contact_surface_representation: x}": "surface_representation must be one of triangle ... , not 'x'",
    "plant: {time_step: 0}": "Scenario.plant.time_step must be a number > 0, not 0",
    "plant: {time_step: 1.0e-9}": "Scenario.plant.time_step must be a number from 1e-05 to 0.1, not 1e-09",
    "plant: {time_step: 1.0e+9}": "Scenario.plant.time_step must be a number from 1e-05 to 0.1, not 1e+09",
    "plant: {time_step: [1]}": "line 1: plant must fit Drake's MultibodyPlantConfig, whose keys may be time_step",
    "plant: {time_step: .nan}": "line 1: plant.time_step must be a finite number, not '.nan'",
    "plant: {stiction_tolerance: 0}": "Scenario.plant.stiction_tolerance must be a number > 0, not 0",
    "X_WBase: {translation: [.nan, 0, 0]}": "line 1: X_WBase.translation[0] must be a finite number, not '.nan'",
    "X_WBase: {translation: [1e300, 0, 0]}": "translation[0] must be a number from -1e+15 to 1e+15, not '1e300'",
    "X_WBase: {translation: [yes, 0, 0]}": "line 1: X_WBase.translation[0] must be a number, not 'yes'",
    "X_WBase: {rotation: !Rpy {deg: [0, .inf, 0]}}": "X_WBase.rotation.deg[1] must be a finite number, not '.inf'",
    "X_WBase: {rotation: !AngleAxis {angle_deg: 3, axis: [0, 0, 0]}}": "Scenario.X_WBase must be a pose of a",
    "X_WBase: {translation: [1.0e+9, 0, 0]}": "Scenario.X_WBase must be a pose of a rotation and at most 1000 m",
    "X_WBase: {rotation: !Uniform {}}": "Scenario.X_WBase must be a fixed pose, not a random one",
    "X_WC: {base_frame: camera}": "Scenario.X_WC.base_frame must be left out, not 'camera'",
    "seed: 1.5": "line 1: seed must be an integer, not '1.5'",
    "seed: yes": "line 1: seed must be a number, not 'yes', a yes or no",
    'seed: "0x20"': "line 1: seed must be a number without quotes, not '0x20'",
    "seed: -1": "Scenario.seed must be an integer from 0 to 9223372036854775807, not -1",
    "seed: 9" + "9" * 400: "line 1: seed must be an integer of 64 bits, not '9999",
    "duration: .inf": "line 1: duration must be a finite number, not '.inf'",
    "duration: [1, 2]": "line 1: duration must be a number, not a list or mapping",
    "sensor: {file: bh280_palm}": "bh280_palm must be one of the package's sensors of this kind, nano17",
    "sensor: {file: nope}": "Scenario.sensor: nope must be ... sensors of this kind, nano17, but there is no such",
    "sensor: {calibration: SI-1}": "calibration must be one of SI-12-0.12 ... , not 'SI-1'",
    "sensor: {period: 1.0e-12}": "Scenario.sensor.period must be a number from 1e-05 to 1e+12, not 1e-12",
    "estimation: {estimator: {method: guess}}": "PoseEstimatorParams.method must be one of pair ... , not 'guess'",
    "estimation: {estimator: {seed: -3}}": "Scenario.estimation.estimator.seed must be an integer from 0 ... , not -3",
    "estimation: {contacts: {sigma_position: .inf}}": "contacts.sigma_position must be a finite number, not '.inf'",
    "planner: {most_poses: 100000000000}": "most_poses must be an integer from -1000000 to 1000000, not 1000",
    "controller: {finger_stiffness: 1.0e+300}": "stiffness must be a number from -1e+15 to 1e+15, not '1.0e+300'",
    "controller: {finger_stiffness: 1.0e+14}": "finger_stiffness must be a number from -1e+12 to 1e+12, not 1e+14",
    "grip: {X_PO: {mug: {translation: !UniformVector {min: [0, 0, 1], max: [0, 0, 0]}}}}": "X_PO[mug] must be a pose",
    'hand: "a\\0b"': "must be in one line, and without control characters",
    "hand: " + "h" * 300: "must be a YAML file, or one of the package's hands, ... , but there is no such file",
    "object: mug\nobject: cube": "line 2: the key 'object' must be given once, not twice",
    "a: &a [*a]": "*a stands for nothing",
    "senses: !RecordedSenses {}": "RecordedSenses.folder must be one that `run --record` made, not empty",
    "senses: !SimulatedSenses": "line 1: senses must be a mapping",
    "senses: !Nonsense {}": "line 1: senses must have one of the tags !SimulatedSenses, ... , not !Nonsense",
    "senses: {buses: {}}": "senses must have no keys (or, with a tag, !CanSenses, !Lcm ... , its own), not 'buses'",
    "publish: {pose: /a}": "only the keys url, channel, max_modes (or, with a tag, !Ros2 ... , its own), not 'pose'",
    "seed: !Seed 3": "line 1: seed must have no tag, not !Seed",
    "grip: !Grip {}": "line 1: grip must have no tag, not !Grip",
    "errors: {joint_offsets_deg: {J9: 1.0}}": "SimulatedErrors.joint_offsets_deg must be one of FFJ2 ... , not 'J9'",
    "vision: !DepthTrackerParams {}\nerrors: {vision_degrees_of_freedom: 4.0}": "must be null with a depth tracker",
    "errors: {object_scale: 9.0}": "SimulatedErrors.object_scale must be a number from 0.5 to 2, not 9",
    "errors: {fingers: {toe: {radius: 0.1}}}": "SimulatedErrors.fingers must be one of first ... , not 'toe'",
    "errors: {drawing: true}": "line 1: errors must have only the keys drawn, seed ... , not 'drawing'",
    "errors: {drawn: 2}": "line 1: errors.drawn must be true or false, not '2'",
    "hand: barrett_like\nerrors: {drawn: true}": "SimulatedErrors.drawn must be false, not true, as the hand's file",
    "scale_sigma: -0.1": "Scenario.scale_sigma must be a number >= 0, not -0.1",
    "object: 3": "line 1: object must be text, in quotes if need be, not '3'",
    "object: 2026-11-22": "line 1: object must be text, in quotes if need be, not '2026-11-22'",
}


@pytest.mark.parametrize("text", FAULTS)
def test_a_fault_is_one_line_with_the_file_and_what_is_allowed(tmp_path: Path, text: str) -> None:
    path = tmp_path / "bad.scenario.yaml"
    path.write_text(text)
    with pytest.raises(InvalidFileError) as caught:
        load_scenario(path)
    message = str(caught.value)
    assert all(part in message for part in FAULTS[text].split(" ... "))
    assert "\n" not in message
    if "hand: h" not in text:  # the hand's own file is named
        assert message.startswith(f"{path}: ")


@pytest.mark.parametrize(("name", "value"), [("seed", 1.5), ("seed", 2**63), ("duration", float("inf"))])
def test_a_scenario_made_in_python_is_checked_too(name: str, value: float) -> None:
    with pytest.raises(InvalidInputError, match=f"Scenario.{name} must be .*, not {value}"):
        Scenario(**{name: value}).validate()


def test_what_is_no_scenario_plan_or_model_is_named() -> None:
    wrong: Any = "shadow_like"
    for call, message in (
        (lambda: make_station(wrong), "scenario must be a Scenario, not"),
        (lambda: run_scenario(wrong), "scenario must be a Scenario, not"),
        (lambda: plan_scenario(wrong), "scenario must be a Scenario, not"),
        (lambda: make_hardware_station(Scenario(), model=wrong), "model must be an ObjectModel or None, not"),
        (lambda: make_station(Scenario(), wrong), "plan must be a GraspPlan or None, not"),
    ):
        with pytest.raises(InvalidInputError, match=message):
            call()


def test_shapes_that_say_nothing_of_their_contact_are_compliant(tmp_path: Path) -> None:
    model = model_path("hands", "barrett_like", "barrett_like.sdf").read_text()
    hand = model_path("hands", "barrett_like", "barrett_like.hand.yaml").read_text()
    box = "<box>.*?</geometry>)<drake:proximity_properties>.*?</drake:proximity_properties>"
    (tmp_path / "model.sdf").write_text(re.sub(f"({box}", r"\1", model))
    for part in model_path("hands", "barrett_like").glob("finger_pad.*"):
        (tmp_path / part.name).write_bytes(part.read_bytes())
    (tmp_path / "own.hand.yaml").write_text(re.sub("(?m)^model: .*", "model: model.sdf", hand))
    scenario = load_scenario("barrett_like")
    scenario.hand = str(tmp_path / "own.hand.yaml")
    station = make_station(scenario)
    context = station.diagram.CreateDefaultContext()
    plant_context = station.plant.GetMyContextFromRoot(context)
    inspector = station.plant.get_geometry_query_input_port().Eval(plant_context).inspector()
    boxes = 0
    for index in station.plant.GetBodyIndices(station.hand.model_instance):
        for geometry in inspector.GetGeometries(station.plant.GetBodyFrameIdOrThrow(index), Role.kProximity):
            properties = inspector.GetProximityProperties(geometry)
            assert properties.HasProperty("hydroelastic", "compliance_type")
            boxes += isinstance(inspector.GetShape(geometry), Box)
    assert boxes > 3


def copy_hand(folder: Path, old: str, new: str) -> Path:
    """A scenario with the Shadow-like hand, whose model is changed."""
    model = model_path("hands", "shadow_like", "shadow_like.sdf").read_text()
    hand = model_path("hands", "shadow_like", "shadow_like.hand.yaml").read_text()
    assert re.search(old, model)
    (folder / "model.sdf").write_text(re.sub(old, new, model))
    (folder / "own.hand.yaml").write_text(re.sub("(?m)^model: .*", "model: model.sdf", hand))
    (folder / "own.scenario.yaml").write_text(f"hand: {folder}/own.hand.yaml\nobject: cube\n")
    return folder / "own.scenario.yaml"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("<sdf", "<nonsense", "must be a model that Drake can read"),
        ('<joint name="FFJ1"', '<joint name="FFJX"', "not 'FFJ1'"),
    ],
)
def test_a_hand_that_cannot_be_simulated_is_told_before_any_work(
    tmp_path: Path, old: str, new: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    told: list[str] = []
    scenario = load_scenario(copy_hand(tmp_path, old, new))
    with pytest.raises(InvalidInputError, match=message):
        run_scenario(scenario, tell=told.append)
    assert told == []
    assert tactopose("run", tmp_path / "own.scenario.yaml") == 2
    errors = capsys.readouterr().err
    assert message in errors
    assert errors.count("\n") == 1


def test_a_grip_of_joints_that_are_not_there_is_told_before_any_work(tmp_path: Path) -> None:
    text = (resource_root() / "diagrams" / "barrett_like.scenario.yaml").read_text()
    assert "finger_1_spread_joint" in text
    (tmp_path / "own.scenario.yaml").write_text(text.replace("finger_1_spread_joint", "toe"))
    told: list[str] = []
    with pytest.raises(InvalidInputError, match=r"must be one of .*, not 'toe'"):
        run_scenario(load_scenario(tmp_path / "own.scenario.yaml"), tell=told.append)
    assert told == []


def test_an_object_with_joints_is_told_before_any_work(tmp_path: Path) -> None:
    (tmp_path / "pair.sdf").write_text(
        """<sdf version="1.7"><model name="pair"><link name="a"/><link name="b"/></model></sdf>"""
    )
    (tmp_path / "pair.obj").write_bytes(model_path("objects", "cube.obj").read_bytes())
    (tmp_path / "pair.scenario.yaml").write_text(f"object: {tmp_path}/pair.sdf")
    told: list[str] = []
    with pytest.raises(InvalidInputError, match=r"pair.sdf must be one free body, without joints"):
        run_scenario(load_scenario(tmp_path / "pair.scenario.yaml"), tell=told.append)
    assert told == []


def test_every_key_of_every_part_can_be_given(tmp_path: Path) -> None:
    scenario = Scenario(
        errors=SimulatedErrors(),
        tracking=PoseTrackingParams(refinement=OffsetRefinementParams(period=0.1)),
        exploration=TouchExplorationParams(),
    )
    text = yaml_dump_typed(scenario)
    assert "least_noise_share" in text
    path = tmp_path / "all.scenario.yaml"
    path.write_text(text)
    assert yaml_dump_typed(load_scenario(path)) == text
