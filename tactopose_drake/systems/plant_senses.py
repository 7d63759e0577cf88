"""Connects an estimation to a plant that holds its hand: joints, palm pose, and simulated touch sensors."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort
from pydrake.systems.primitives import MatrixGain

from tactopose_drake.core.sensing.force_torque import ForceTorqueModel
from tactopose_drake.core.validation import flag, instance_of
from tactopose_drake.errors import InvalidInputError, UnknownNameError
from tactopose_drake.hand.fingertip_weights import check_sensor_frame
from tactopose_drake.hand.hand_config import HandConfig
from tactopose_drake.hand.hand_in_plant import Hand, find_hand, make_hand_plant
from tactopose_drake.hand.hand_likeness import check_likeness
from tactopose_drake.hand.tactile_pads import load_tactile_pad
from tactopose_drake.systems.force_torque_sensor import ForceTorqueSensor, load_force_torque_model
from tactopose_drake.systems.palm_pose import PalmPose
from tactopose_drake.systems.ports import check_name_is_free, connect_known
from tactopose_drake.systems.simulated_array import TactileArray

_SENSOR_PERIOD = 0.008  # s, of the simulated force-torque sensors, unless the plant's step is longer


def add_touch_sensors(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    hand: Hand,
    models: Mapping[str, ForceTorqueModel],
    period: float,
    prefix: str = "",
) -> dict[str, OutputPort]:
    """Adds a force-torque sensor for each finger that has one, and an array for each tactile pad.

    Args:
        builder: of the plant's diagram.
        plant: finalized plant.
        hand: the hand in it.
        models: noise, range and quantisation of the force-torque sensors, by finger; `AddRandomInputs` connects the
            noise.
        period: sampling period of the force-torque sensors, s.
        prefix: prefix of the systems' names.

    Returns:
        The sensors' output ports, by name: `wrench_<finger>` and `pressures_<pad>`.
    """
    ports = {}
    for finger, frame in hand.sensor_frames.items():
        sensor = builder.AddNamedSystem(
            f"{prefix}sensor_{finger}", ForceTorqueSensor(plant, hand.welds[finger], frame, models[finger], period)
        )
        builder.Connect(plant.get_reaction_forces_output_port(), sensor.GetInputPort("reaction_forces"))
        builder.Connect(plant.get_body_poses_output_port(), sensor.GetInputPort("body_poses"))
        ports[f"wrench_{finger}"] = sensor.GetOutputPort("wrench")
    for pad in hand.config.pads:
        array = builder.AddNamedSystem(
            f"{prefix}tactile_array_{pad.name}",
            TactileArray(plant, hand.pad_frames[pad.name], load_tactile_pad(pad.array)),
        )
        builder.Connect(plant.get_contact_results_output_port(), array.GetInputPort("contact_results"))
        builder.Connect(plant.get_body_poses_output_port(), array.GetInputPort("body_poses"))
        ports[f"pressures_{pad.name}"] = array.GetOutputPort("pressures")
    return ports


def told_hand(config: HandConfig, plant: MultibodyPlant | Hand | None, simulated_senses: bool) -> HandConfig:
    """The hand as an estimation is to know it: without its calibration if a plant simulates its senses.

    A calibration is of a real hand, while a simulated hand conforms to its model.
    """
    is_simulated = plant is not None and simulated_senses is True and isinstance(config, HandConfig)
    return dataclasses.replace(config, calibration="") if is_simulated else config


def add_with_plant(
    builder: DiagramBuilder,
    name: str,
    estimation: Diagram,
    config: HandConfig,
    plant: MultibodyPlant | Hand | None,
    simulated_senses: bool,
) -> Diagram:
    """Adds an estimation or a tracking, and connects it to the plant that holds its hand.

    Joint positions and, where the diagram has such inputs, joint velocities and the palm's pose come from the plant's
    state. With `simulated_senses`, wrenches and pressures come from its reaction forces and contacts.

    Args:
        builder: builder of the plant's diagram; unchanged if an error is raised.
        name: name of the system that is added.
        estimation: the diagram of `AddPoseEstimation` or `AddPoseTracking`.
        config: the hand.
        plant: finalized plant, or the hand in it; None: the caller connects all ports.
        simulated_senses: whether to simulate the touch sensors, too.

    Raises:
        InvalidInputError: if the name, or one of those of the systems that are added with it, is taken; if the plant is
            not finalized or not in the builder; if none or several of its models are the hand; or if that model has
            another geometry; or if a simulated sensor's frame is not fixed to its fingertip or finger.
    """
    check_name_is_free(builder, name)
    felt = flag("simulated_senses", simulated_senses)
    if plant is None:
        return builder.AddNamedSystem(name, estimation)
    hand = _find_in(plant, config)
    plant = hand.palm_frame.GetParentPlant()
    if not any(system is plant for system in builder.GetSystems()):
        raise InvalidInputError("plant must be one that was added to the same builder, but is not among its systems.")
    alone, hand_alone = make_hand_plant(dataclasses.replace(config, calibration=""))
    check_likeness(plant, hand, alone, hand_alone)
    for finger, weld in hand.welds.items() if felt else ():
        check_sensor_frame(plant, weld, hand.sensor_frames[finger])
    check_name_is_free(builder, name, _parts(estimation, hand, felt))
    added: Diagram = builder.AddNamedSystem(name, estimation)
    _connect(builder, added, plant, hand, _selectors(plant, hand, alone, hand_alone), felt)
    return added


def _parts(estimation: Diagram, hand: Hand, simulated_senses: bool) -> list[str]:
    """The names of the systems that `_connect` adds, without the estimation's name."""
    parts = [port for port in ("joint_positions", "joint_velocities", "palm_pose") if estimation.HasInputPort(port)]
    if simulated_senses:
        parts += [f"sensor_{finger}" for finger in hand.sensor_frames]
        parts += [f"tactile_array_{pad}" for pad in hand.pad_frames]
    return parts


def _connect(
    builder: DiagramBuilder,
    estimation: Diagram,
    plant: MultibodyPlant,
    hand: Hand,
    selectors: Mapping[str, np.ndarray],
    simulated_senses: bool,
) -> None:
    name = estimation.get_name()
    for port, matrix in selectors.items():
        if estimation.HasInputPort(port):
            selector = builder.AddNamedSystem(f"{name}_{port}", MatrixGain(matrix))
            builder.Connect(plant.get_state_output_port(), selector.get_input_port())
            builder.Connect(selector.get_output_port(), estimation.GetInputPort(port))
    if estimation.HasInputPort("palm_pose"):
        palm = builder.AddNamedSystem(f"{name}_palm_pose", PalmPose(hand.palm_frame))
        builder.Connect(plant.get_body_poses_output_port(), palm.get_input_port())
        builder.Connect(palm.get_output_port(), estimation.GetInputPort("palm_pose"))
    if simulated_senses:
        period = max(plant.time_step(), _SENSOR_PERIOD)
        models = dict.fromkeys(hand.sensor_frames, load_force_torque_model())
        sensors = add_touch_sensors(builder, plant, hand, models, period, f"{name}_")
        connect_known(builder, sensors, estimation)


def _find_in(place: MultibodyPlant | Hand, config: HandConfig) -> Hand:
    """The hand in a plant, whatever its model instance is called; if there are several, `place` must be the hand."""
    plant = place.palm_frame.GetParentPlant() if isinstance(place, Hand) else place
    instance_of("plant", plant, MultibodyPlant)
    if not plant.is_finalized():
        raise InvalidInputError("plant must be finalized, but is not.")
    if isinstance(place, Hand):
        return find_hand(plant, config, place.model_instance)
    every = [ModelInstanceIndex(index) for index in range(plant.num_model_instances())]
    instances = [index for index in every if plant.GetJointIndices(index)]
    hands, reasons = [], []
    for instance in instances:
        try:
            hands.append(find_hand(plant, config, instance))
        except UnknownNameError as error:
            reasons.append(f"{plant.GetModelInstanceName(instance)}: {error}")
    if not hands:
        reasons = reasons or ["None of them has a joint."]
        raise InvalidInputError(f"plant must have a model that is the hand, but none is. {' '.join(reasons)}")
    if len(hands) > 1:
        names = ", ".join(plant.GetModelInstanceName(hand.model_instance) for hand in hands)
        raise InvalidInputError(
            f"plant must have one model that is the hand, not several, {names}. Pass the hand itself, as `add_hand` "
            "returns it."
        )
    return hands[0]


def _selectors(plant: MultibodyPlant, hand: Hand, alone: MultibodyPlant, hand_alone: Hand) -> dict[str, np.ndarray]:
    """Matrices that select the hand's joints from the plant's state, in the order of a plant of the hand alone."""
    positions = np.zeros((alone.num_positions(), plant.num_multibody_states()))
    velocities = np.zeros((alone.num_velocities(), plant.num_multibody_states()))
    for index in alone.GetJointIndices(hand_alone.model_instance):
        joint = alone.get_joint(index)
        if joint.num_positions() == 0:
            continue
        there = plant.GetJointByName(joint.name(), hand.model_instance)
        for k in range(joint.num_positions()):
            positions[joint.position_start() + k, there.position_start() + k] = 1.0
        for k in range(joint.num_velocities()):
            velocities[joint.velocity_start() + k, plant.num_positions() + there.velocity_start() + k] = 1.0
    return {"joint_positions": positions, "joint_velocities": velocities}
