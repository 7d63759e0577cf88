"""The simulated senses of a station's hand, and where its palm is, as named ports."""

from collections.abc import Mapping

from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import AddRandomInputs, Demultiplexer

from tactopose_drake.hand.hand_config import Hand
from tactopose_drake.hand.tactile_pads import load_tactile_pad
from tactopose_drake.station.scenario import Scenario
from tactopose_drake.systems.palm_pose import PalmPose
from tactopose_drake.systems.plant_senses import add_touch_sensors


def add_senses(
    builder: DiagramBuilder, scenario: Scenario, plant: MultibodyPlant, hand: Hand
) -> Mapping[str, OutputPort]:
    """Adds whatever the hand senses with; their noise is left to `add_noise`.

    Returns:
        The ports by the names of `AddPoseEstimation`'s inputs: `joint_positions`, `wrench_<finger>` of each finger with
        a force-torque sensor, and `pressures_<pad>` of each tactile pad.
    """
    sizes = [plant.num_positions(hand.model_instance), plant.num_velocities(hand.model_instance)]
    positions = builder.AddNamedSystem("joint_positions", Demultiplexer(sizes))
    builder.Connect(plant.get_state_output_port(hand.model_instance), positions.get_input_port())
    senses = {"joint_positions": positions.get_output_port(0)}

    return senses | add_touch_sensors(builder, plant, hand, scenario.sensor.model(), scenario.sensor.period)


def add_palm_pose(builder: DiagramBuilder, plant: MultibodyPlant, hand: Hand) -> OutputPort:
    """Adds what tells where the palm is in the world."""
    palm = builder.AddNamedSystem("palm_pose", PalmPose(hand.palm_frame))
    builder.Connect(plant.get_body_poses_output_port(), palm.GetInputPort("body_poses"))
    return palm.GetOutputPort("palm_pose")


def add_noise(builder: DiagramBuilder, scenario: Scenario, hand: Hand) -> None:
    """Connects all random inputs that are still open, of the senses and of whatever else there is."""
    periods = [scenario.sensor.period] if hand.sensor_frames else []
    periods += [load_tactile_pad(pad.array).period for pad in hand.config.pads]
    AddRandomInputs(min(periods, default=scenario.vision.period), builder)
