"""The simulation of a scenario's grasp, and the recording of the hand's senses."""

import dataclasses

from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram, EventStatus, OutputPort

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.station.scenario import Scenario
from tactopose_drake.station.senses import SimulatedSenses
from tactopose_drake.station.simulated import Station, make_station
from tactopose_drake.systems.signals import Signal, SignalRecorder, Write

TRUE_POSE = "true_pose"  # the signal of the true X_PO in the simulator
BESIDE_DEVICES = ("joint_positions", "palm_pose", "prior")  # signals that do not come from devices on a bus


def start_simulation(station: Station, write: Write | None) -> Simulator:
    """Initializes a simulator for a grasp, with a monitor that releases the object once it is held.

    Args:
        station: the station.
        write: called with every sense and with `true_pose` after each step; None: they are not recorded.
    """
    simulator = Simulator(station.diagram)
    station.start(simulator.get_mutable_context())
    ports = sense_ports(station.diagram)

    def monitor(context: Context) -> EventStatus:
        if write is not None:
            for port in ports:
                write(port.get_name(), context.get_time(), port.Eval(context))
            write(TRUE_POSE, context.get_time(), station.object_pose(context))
        return station.release_when_held(context)

    simulator.set_monitor(monitor)
    simulator.Initialize()
    return simulator


def sense_ports(diagram: Diagram) -> list[OutputPort]:
    """The ports of a station that carry the inputs of the estimation."""
    ports = [diagram.get_output_port(index) for index in range(diagram.num_output_ports())]
    measured = ("wrench_", "pressures_")
    return [port for port in ports if port.get_name() in BESIDE_DEVICES or port.get_name().startswith(measured)]


def rehearse(scenario: Scenario, model: ObjectModel) -> dict[str, Signal]:
    """Simulates the scenario's best planned grasp for its duration, for a later real-time run on simulated devices.

    Returns:
        The signals of the simulated sensors by name: `joint_positions`, `prior`, `wrench_<finger>`, `pressures_<pad>`,
        and `true_pose`, the true X_PO.

    Raises:
        InvalidInputError: if the scenario cannot be built.
    """
    # No estimates are needed.
    estimator = dataclasses.replace(scenario.estimation.estimator, period=2 * scenario.duration)
    estimation = dataclasses.replace(scenario.estimation, estimator=estimator)
    scenario = dataclasses.replace(scenario, senses=SimulatedSenses(), estimation=estimation)
    with SignalRecorder() as recorder:
        start_simulation(make_station(scenario, model=model), recorder.write).AdvanceTo(scenario.duration)
        return recorder.signals
