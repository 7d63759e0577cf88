"""The simulated senses of a station's hand, and its palm's pose, as named ports."""

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame, ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import AddRandomInputs, Demultiplexer

from tactopose_drake.hand.encoder_offsets import encoder_gains
from tactopose_drake.hand.hand_in_plant import Hand, make_hand_plant
from tactopose_drake.hand.simulated_fingertip_errors import change_fingertips, check_mounting, move_pads
from tactopose_drake.hand.tactile_pads import load_tactile_pad
from tactopose_drake.resources import fixed_pose
from tactopose_drake.station.scenario import Scenario
from tactopose_drake.station.simulated_errors import DrawnErrors, SimulatedErrors, hand_errors
from tactopose_drake.station.simulated_shape_errors import change_object
from tactopose_drake.systems.joint_encoders import JointEncoders
from tactopose_drake.systems.palm_on_base import PalmOnBase
from tactopose_drake.systems.palm_pose import PalmPose
from tactopose_drake.systems.plant_senses import add_touch_sensors

_SENSOR, _ARRAY = "sensor of {} as mounted", "array of {} as mounted"  # names of the true frames


def add_senses(
    builder: DiagramBuilder, scenario: Scenario, plant: MultibodyPlant, hand: Hand
) -> Mapping[str, OutputPort]:
    """Adds the hand's sensors; `add_noise` connects their noise.

    Returns:
        The ports by the names of `AddPoseEstimation`'s inputs: `joint_positions`, `wrench_<finger>` of each finger with
        a force-torque sensor, and `pressures_<pad>` of each tactile pad.
    """
    sizes = [plant.num_positions(hand.model_instance), plant.num_velocities(hand.model_instance)]
    positions = builder.AddNamedSystem("joint_positions", Demultiplexer(sizes))
    builder.Connect(plant.get_state_output_port(hand.model_instance), positions.get_input_port())
    senses = {"joint_positions": positions.get_output_port(0)}
    models = dict.fromkeys(hand.sensor_frames, scenario.sensor.model())
    if scenario.errors is not None:
        errors = hand_errors(scenario.errors, hand.config)
        senses["joint_positions"] = _add_encoders(builder, scenario.errors, errors, hand, senses["joint_positions"])
        for finger, model in models.items():
            models[finger] = dataclasses.replace(
                model,
                bias=(np.asarray(model.bias) + errors.bias[finger]).tolist(),
                drift=(np.asarray(model.drift) + errors.drift[finger]).tolist(),
            )
    return senses | add_touch_sensors(builder, plant, _as_mounted(plant, hand), models, scenario.sensor.period)


def _as_mounted(plant: MultibodyPlant, hand: Hand) -> Hand:
    """The hand with the true frames of its sensors and arrays, which `simulate_errors` has added."""
    names = {plant.get_frame(index).name() for index in plant.GetFrameIndices(hand.model_instance)}
    sensors, arrays = (
        {
            sense: plant.GetFrameByName(name.format(sense), hand.model_instance)
            if name.format(sense) in names
            else frame
            for sense, frame in frames.items()
        }
        for name, frames in ((_SENSOR, hand.sensor_frames), (_ARRAY, hand.pad_frames))
    )
    return dataclasses.replace(hand, sensor_frames=sensors, pad_frames=arrays)


def _add_encoders(
    builder: DiagramBuilder, errors: SimulatedErrors, drawn: DrawnErrors, hand: Hand, positions: OutputPort
) -> OutputPort:
    """Adds the joint encoders; returns the port of the measured positions."""
    joints, gains = encoder_gains(*make_hand_plant(hand.config))
    offsets = np.array([drawn.offsets.get(joint, 0.0) for joint in joints])
    noise = (math.radians(errors.encoder_noise_deg), math.radians(errors.encoder_step_deg))
    encoders = builder.AddNamedSystem("joint_encoders", JointEncoders(gains, offsets, *noise))
    builder.Connect(positions, encoders.GetInputPort("joint_positions"))
    return encoders.GetOutputPort("measured")


def simulate_errors(
    scenario: Scenario,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    hand: Hand,
    object_instance: ModelInstanceIndex,
) -> None:
    """Applies the scenario's errors to the shapes and mountings of the simulator's hand and object.

    Args:
        scenario: the scenario.
        plant: the simulator's plant, not finalized yet.
        scene_graph: its SceneGraph.
        hand: the hand in it.
        object_instance: the object in it.

    Raises:
        InvalidInputError: if the object has shape errors but its collision shapes are not meshes of OBJ files, or if
            one of two sensors on the same link has a mounting error.
    """
    errors = scenario.errors
    if errors is None:
        return
    drawn = hand_errors(errors, hand.config)
    mounted = [
        *((_SENSOR.format(finger), hand.sensor_frames[finger], X_SM) for finger, X_SM in drawn.X_SM.items()),
        *((_ARRAY.format(pad), hand.pad_frames[pad], X_TM) for pad, X_TM in drawn.X_TM.items()),
    ]
    if any(drawn.radius.values()) or not all(X.IsExactlyIdentity() for _, _, X in mounted):
        check_mounting(hand, drawn.X_SM, drawn.X_TM)
        change_fingertips(plant, scene_graph, hand, drawn.radius, drawn.X_SM)
        move_pads(plant, scene_graph, hand, drawn.X_TM)
        for name, frame, X in mounted:
            plant.AddFrame(FixedOffsetFrame(name, frame, X, hand.model_instance))
    if errors.object_scale != 1.0 or errors.object_surface_sigma > 0.0:
        change = (errors.object_scale, errors.object_surface_sigma, np.random.default_rng(errors.seed))
        change_object(plant, scene_graph, object_instance, *change)


def add_palm_pose(builder: DiagramBuilder, plant: MultibodyPlant, hand: Hand) -> OutputPort:
    """Adds a system that gives the palm's true pose in the world."""
    palm = builder.AddNamedSystem("palm_pose", PalmPose(hand.palm_frame))
    builder.Connect(plant.get_body_poses_output_port(), palm.GetInputPort("body_poses"))
    return palm.GetOutputPort("palm_pose")


def add_measured_palm_pose(
    builder: DiagramBuilder, scenario: Scenario, hand: Hand, joint_positions: OutputPort
) -> OutputPort:
    """Adds a system that computes the palm's pose from the measured joints, as for a hand on devices."""
    X_WBase = fixed_pose("Scenario.X_WBase", scenario.X_WBase)
    palm = builder.AddNamedSystem("measured_palm_pose", PalmOnBase(*make_hand_plant(hand.config), X_WBase))
    builder.Connect(joint_positions, palm.GetInputPort("joint_positions"))
    return palm.GetOutputPort("palm_pose")


def add_noise(builder: DiagramBuilder, scenario: Scenario, hand: Hand) -> None:
    """Connects all random inputs that are still unconnected, of the senses and of all other systems."""
    periods = [scenario.vision.period, *(load_tactile_pad(pad.array).period for pad in hand.config.pads)]
    periods += [scenario.sensor.period] if hand.sensor_frames else []
    AddRandomInputs(min(periods), builder)
