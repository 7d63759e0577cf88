"""The simulator of a scenario's grasp, and the recording of its senses."""

from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram, EventStatus, OutputPort

from tactopose_drake.station.simulated import Station
from tactopose_drake.systems.signals import Write

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
