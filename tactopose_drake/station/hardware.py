"""Builds the diagram of a scenario with real senses: devices on CAN buses, or recorded signals."""

from collections.abc import Mapping
from dataclasses import dataclass

from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort, System
from pydrake.systems.primitives import PassThrough

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import instance_of, known_name
from tactopose_drake.drivers.barrett_hand import BarrettHand
from tactopose_drake.drivers.netcanoem import NetCanOemForceTorque
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.fingertip_weights import FingertipWeights
from tactopose_drake.hand.hand_config import HandConfig
from tactopose_drake.hand.hand_in_plant import Hand, make_hand_plant
from tactopose_drake.hand.joint_matrices import joint_matrix, joint_offsets
from tactopose_drake.hand.tactile_pads import load_tactile_pad
from tactopose_drake.resources import fixed_pose
from tactopose_drake.station.can_devices import CanDevices
from tactopose_drake.station.can_senses import CanSenses
from tactopose_drake.station.scenario import Scenario
from tactopose_drake.station.tracking import add_tracking
from tactopose_drake.systems.can_barrett_hand import PADS, CanBarrettHand
from tactopose_drake.systems.can_force_torque import CanForceTorque
from tactopose_drake.systems.fingertip_weight import FingertipWeight
from tactopose_drake.systems.measured_joints import MeasuredJoints
from tactopose_drake.systems.palm_on_base import PalmOnBase
from tactopose_drake.systems.played_signal import PlayedValue, PlayedVector
from tactopose_drake.systems.ports import connect_known, export_outputs
from tactopose_drake.systems.pose_estimation import AddPoseEstimation
from tactopose_drake.systems.pose_tracking import PoseTrackingParams
from tactopose_drake.systems.sense_status import export_sense_statuses
from tactopose_drake.systems.signals import Signal
from tactopose_drake.systems.touch_sensing import corrected_joints

_POSES = ("prior", "palm_pose")  # signals that are not vectors


@dataclass(frozen=True, eq=False)
class HardwareStation:
    """The diagram of a scenario with real or recorded senses.

    Attributes:
        diagram: The diagram. Its outputs are `wrench_<finger>`, `pressures_<pad>`, `joint_positions`, `prior` and all
            outputs of `AddPoseEstimation`, as in a simulated `Station`; `fingertip_torques` of Barrett's hand;
            `status_<sense>` and `age_<sense>` of each device, where a sense is a finger's name or "hand", and
            `sense_status`; with tracking, also `tracked_object_pose` and so on. Its inputs are `joint_positions` and
            `prior`, unless something else gives them; `joint_velocities`, which may stay unconnected, if the tracking
            uses them; and `palm_pose`, X_WP of a hand that an arm moves, if weight compensation, the balance of forces
            or the tracking uses it and no signal gives it. If that stays unconnected, the base is fixed at the
            scenario's `X_WBase`. If a signal gives it, `palm_pose` is an output instead, and with tracking there is
            `tracked_object_pose_in_world`.
        model: the object's model.
        scenario: the scenario.
    """

    diagram: Diagram
    model: ObjectModel
    scenario: Scenario


def make_hardware_station(
    scenario: Scenario,
    devices: CanDevices | None = None,
    signals: Mapping[str, Signal] | None = None,
    *,
    model: ObjectModel | None = None,
) -> HardwareStation:
    """Builds the diagram.

    Args:
        scenario: the hand, the object, and the parameters of the estimation.
        devices: the devices; the diagram neither opens nor closes them.
        signals: recorded signals by the names of the ports that they replace: `joint_positions`, `prior`, `palm_pose`,
            `wrench_<finger>`, `pressures_<pad>`.
        model: the object's model; None: it is loaded.

    Raises:
        InvalidInputError: if the scenario cannot be built, or a signal does not fit the hand.
    """
    instance_of("scenario", scenario, Scenario)
    instance_of("model", model, ObjectModel, type(None))
    scenario.validate()
    model = scenario.object_model() if model is None else model
    config = scenario.hand_config()
    plant, hand = make_hand_plant(config)
    builder = DiagramBuilder()
    signals = signals or {}
    check_signals(config, plant, signals)
    known = _add_signals(builder, signals)
    senses, ages = dict[str, System](), dict[str, OutputPort]()
    if devices is not None and devices.hand is not None:
        known |= _add_barrett_hand(builder, scenario, devices.hand, plant, hand)
        senses["hand"] = builder.GetSubsystemByName("barrett_hand")
        ages = {f"age_{pad}": senses["hand"].GetOutputPort("age") for pad in PADS}
    if "joint_positions" not in known:
        joints = builder.AddNamedSystem("joint_positions", PassThrough(plant.num_positions()))
        builder.ExportInput(joints.get_input_port(), "joint_positions")
        known["joint_positions"] = joints.get_output_port()
    corrected = known["joint_positions"]
    if hand.calibration is not None:
        joints = builder.AddNamedSystem("corrected_joints", corrected_joints(plant, hand))
        builder.Connect(corrected, joints.GetInputPort("measured"))
        corrected = joints.GetOutputPort("joint_positions")
    if devices is not None and devices.boards:
        known |= _add_boards(builder, scenario, devices.boards, plant, hand, corrected)
        senses |= {finger: builder.GetSubsystemByName(f"sensor_{finger}") for finger in devices.boards}
    for name, port in known.items():
        builder.ExportOutput(port, name)
    export_sense_statuses(builder, {sense: system.GetOutputPort("status") for sense, system in senses.items()})
    for sense, system in senses.items():
        builder.ExportOutput(system.GetOutputPort("age"), f"age_{sense}")

    estimation = AddPoseEstimation(builder, config, model, scenario.estimation)
    felt = {name: port for name, port in known.items() if name != "palm_pose"}
    connect_known(builder, felt | ages, estimation)
    if "prior" not in known:
        builder.ExportInput(estimation.GetInputPort("prior"), "prior")
    if scenario.estimation.estimator.balance:
        X_WBase = fixed_pose("Scenario.X_WBase", scenario.X_WBase)
        palm = builder.AddNamedSystem("palm_pose", PalmOnBase(plant, hand, X_WBase))
        builder.Connect(corrected, palm.GetInputPort("joint_positions"))
        builder.Connect(palm.get_output_port(), estimation.GetInputPort("palm_pose"))
    export_outputs(builder, estimation)
    if scenario.tracking is not None:
        _add_tracking(builder, scenario.tracking, config, model, {**known, **ages})
    _connect_palm_pose(builder, known.get("palm_pose"))
    diagram = builder.Build()
    diagram.set_name("hardware_station")
    return HardwareStation(diagram, model, scenario)


def check_signals(config: HandConfig, plant: MultibodyPlant, signals: Mapping[str, Signal]) -> None:
    """Raises InvalidInputError if a signal's name is not one of the hand's, or its vectors have another length."""
    sizes = {f"wrench_{finger}": 6 for finger in config.sensing}
    sizes |= {f"pressures_{pad.name}": len(load_tactile_pad(pad.array).layout) for pad in config.pads}
    sizes["joint_positions"] = plant.num_positions()
    for name, signal in signals.items():
        known_name("each name in signals", name, [*sizes, *_POSES])
        if name in sizes and signal.size != sizes[name]:
            raise InvalidInputError(f"signal {name!r} must have {sizes[name]} numbers, not {signal.size}.")


def _add_signals(builder: DiagramBuilder, signals: Mapping[str, Signal]) -> dict[str, OutputPort]:
    """Adds systems that play the signals; returns their ports by name."""
    ports = {}
    for name, signal in signals.items():
        player = PlayedValue(signal) if name in _POSES else PlayedVector(signal)
        ports[name] = builder.AddNamedSystem(f"played_{name}", player).get_output_port()
    return ports


def check_barrett_pads(scenario: Scenario, hand: Hand) -> None:
    """Checks that a scenario's hand has all pads of Barrett's hand.

    Raises:
        InvalidInputError: if it lacks one.
    """
    if lacking := [pad for pad in PADS if pad not in hand.pad_frames]:
        raise InvalidInputError(
            f"Scenario.hand must have the pads of Barrett's hand, {', '.join(PADS)}, but {scenario.hand!r} lacks "
            f"{', '.join(lacking)}."
        )


def _add_barrett_hand(
    builder: DiagramBuilder, scenario: Scenario, driver: BarrettHand, plant: MultibodyPlant, hand: Hand
) -> dict[str, OutputPort]:
    """Adds Barrett's hand; returns the ports of joint positions, pressures and fingertip torques, by name."""
    pucks = _senses(scenario).barrett_hand
    assert pucks is not None
    check_barrett_pads(scenario, hand)
    system = builder.AddNamedSystem("barrett_hand", CanBarrettHand(driver, pucks.period, pucks.max_age))
    matrix, offsets = joint_matrix(plant, hand, pucks.joints), joint_offsets(plant, hand, pucks.joints)
    joints = builder.AddNamedSystem("joint_positions", MeasuredJoints(matrix, offsets))
    builder.Connect(system.GetOutputPort("joint_positions"), joints.get_input_port())
    ports = {"joint_positions": joints.get_output_port()}
    for name in (*(f"pressures_{pad}" for pad in PADS), "fingertip_torques"):
        ports[name] = system.GetOutputPort(name)
    return ports


def _add_boards(
    builder: DiagramBuilder,
    scenario: Scenario,
    boards: Mapping[str, NetCanOemForceTorque],
    plant: MultibodyPlant,
    hand: Hand,
    joint_positions: OutputPort,
) -> dict[str, OutputPort]:
    """Adds the force-torque sensors; returns the ports of their wrenches, by name."""
    senses, ports = _senses(scenario), dict[str, OutputPort]()
    for finger, board in boards.items():
        config = senses.fingers[finger]
        sensor = builder.AddNamedSystem(f"sensor_{finger}", CanForceTorque(board, config.period, config.max_age))
        ports[f"wrench_{finger}"] = sensor.GetOutputPort("wrench")
    if not senses.compensate_weight:
        return ports
    weights = FingertipWeights(plant, hand, fixed_pose("Scenario.X_WBase", scenario.X_WBase).rotation())
    weight = builder.AddNamedSystem("fingertip_weight", FingertipWeight(weights, tuple(boards), plant.num_positions()))
    builder.Connect(joint_positions, weight.GetInputPort("joint_positions"))
    for name, port in ports.items():
        builder.Connect(port, weight.GetInputPort(name))
    return {name: weight.GetOutputPort(name) for name in ports}


def _connect_palm_pose(builder: DiagramBuilder, known: OutputPort | None) -> None:
    """Connects all inputs `palm_pose` to the known pose, or else to one input port of the diagram."""
    consumers = ["fingertip_weight", "palm_pose", *(["pose_tracking"] if known is None else [])]
    systems = [builder.GetSubsystemByName(name) for name in consumers if builder.HasSubsystemNamed(name)]
    for i, port in enumerate(system.GetInputPort("palm_pose") for system in systems):
        if known is not None:
            builder.Connect(known, port)
        elif i == 0:
            builder.ExportInput(port, "palm_pose")
        else:
            builder.ConnectInput("palm_pose", port)


def _add_tracking(
    builder: DiagramBuilder,
    params: PoseTrackingParams,
    config: HandConfig,
    model: ObjectModel,
    known: Mapping[str, OutputPort],
) -> None:
    """Adds the tracking, and exports its inputs that nothing else gives."""
    known = {"vision" if name == "prior" else name: port for name, port in known.items()}
    tracking = add_tracking(builder, params, config, model, known)
    if "vision" not in known:
        builder.ConnectInput("prior", tracking.GetInputPort("vision"))
    if params.use_joint_velocities:
        builder.ExportInput(tracking.GetInputPort("joint_velocities"), "joint_velocities")


def _senses(scenario: Scenario) -> CanSenses:
    if not isinstance(scenario.senses, CanSenses):
        raise InvalidInputError("Scenario.senses must be !CanSenses with devices.")
    return scenario.senses
