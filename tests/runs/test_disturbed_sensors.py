"""What sensors read beside the object's touch is told."""

from pathlib import Path
from types import SimpleNamespace
from typing import cast

from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from tactopose_drake.hand.contact_properties import make_compliant
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import add_hand
from tactopose_drake.runs.disturbed_sensors import disturbed_sensors
from tactopose_drake.station.scenario import SensorConfig
from tactopose_drake.station.simulated import Station
from tactopose_drake.systems.plant_senses import add_touch_sensors
from tests.hand.grippers import write_gripper


def said(folder: Path, slide: float, most: float = 12.0) -> tuple[str, ...]:
    """Of a gripper whose fingers have slid so far, m; at 0.048 m the balls at their ends begin to touch each other.

    Its sensors measure forces up to `most`, N.
    """
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlant(MultibodyPlantConfig(time_step=1e-3, contact_model="hydroelastic"), builder)
    path, model = write_gripper(folder), folder / "two_finger.urdf"
    model.write_text(model.read_text().replace('upper="0.045"', 'upper="0.06"'))
    hand = add_hand(plant, load_hand_config(path), RigidTransform())
    make_compliant(plant, scene_graph, hand.model_instance)
    plant.Finalize()
    (folder / "sensor.yaml").write_text(
        f"calibrations: {{only: {{range: [0.12, 0.12, 0.12, {most}, {most}, {most}]}}}}\n"
    )
    sensor = SensorConfig(file=str(folder / "sensor.yaml"), calibration="only", period=0.001)
    add_touch_sensors(builder, plant, hand, dict.fromkeys(hand.sensor_frames, sensor.model()), sensor.period)
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    plant.get_actuation_input_port().FixValue(plant.GetMyMutableContextFromRoot(context), [0.0, 0.0])
    plant.SetPositions(plant.GetMyMutableContextFromRoot(context), [slide, slide])
    simulator.AdvanceTo(0.0015)
    station = SimpleNamespace(diagram=diagram, plant=plant, hand=hand, scenario=SimpleNamespace(sensor=sensor))
    return disturbed_sensors(cast(Station, station), context)


def test_fingertips_that_touch_each_other_are_named(tmp_path: Path) -> None:
    touching = said(tmp_path, 0.0482)
    assert len(touching) == 2
    assert touching[0].startswith("The fingertip of left also touches right_tip, which its sensor feels")


def test_a_saturated_sensor_is_named_with_its_range(tmp_path: Path) -> None:
    saturated = said(tmp_path, 0.0482, 0.01)
    assert len(saturated) == 4  # each also touches the other
    assert saturated[0].startswith("The sensor of left is saturated in f_x, f_z, so that its contact is off")
    assert "up to 0.01 N and 0.12 N m" in saturated[0]


def test_nothing_is_said_of_sensors_that_feel_nothing_else(tmp_path: Path) -> None:
    assert said(tmp_path, 0.04) == ()
