"""Latency from a frame on the bus to a contact, and whether the estimate keeps up with five boards in real time.

Five simulated NETCANOEM boards run in their own process at the other end of a pipe, with the wrenches of a simulated
grasp of the scenario `shadow_like_can`. The whole chain runs on one core: decoding, and 20 estimates per second; then
once more with contacts at every poll of the sensors, 200 times per second, to measure their latency.

    python examples/can_latency.py --duration 20
"""

import argparse
import dataclasses
import math
import multiprocessing
import os
import time
from multiprocessing.connection import Connection

import can
import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, EventStatus

from tactopose_drake.drivers import DeviceBus, DeviceServer, NetCanOemForceTorque, data_frame
from tactopose_drake.runs import Loads, SimulatedRig, rehearse, simulated_loads, warm_up
from tactopose_drake.station import (
    CanDevices,
    HardwareStation,
    Scenario,
    load_scenario,
    make_hardware_station,
)


@dataclasses.dataclass(frozen=True)
class Report:
    """The measurements.

    Attributes:
        real_time_factor: the diagram's time divided by real time.
        samples_per_second: sample rate of all boards together.
        core: share of a core that this process used, including the bus.
        latency: of each sample, the time from its last frame to the contact, s; empty if only the estimate used
            contacts.
        estimates: number of estimates.
    """

    real_time_factor: float
    samples_per_second: float
    core: float
    latency: np.ndarray
    estimates: int


class PipeBus(can.BusABC):
    """One end of a CAN bus between two processes, implemented by a pipe, which no other machine can reach."""

    def __init__(self, pipe: Connection) -> None:
        """Keeps its argument."""
        super().__init__(channel="pipe")
        self.channel_info = "a pipe"
        self._pipe = pipe

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Sends a frame."""
        self._pipe.send((time.time(), msg.arbitration_id, bytes(msg.data)))

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        try:
            if not self._pipe.poll(timeout):
                return None, True
            sent, identifier, data = self._pipe.recv()
        except EOFError:
            raise can.CanOperationError("the other process has ended") from None
        frame = data_frame(identifier, data)
        frame.timestamp = sent
        return frame, True


def make_scenario() -> Scenario:
    """A scenario with five boards at 200 samples/s."""
    scenario = load_scenario("shadow_like_can").without_errors()
    scenario.estimation.estimator.period = 0.05
    return scenario


def serve(wire: Connection, loads: Loads, core: int | None, pipe: Connection) -> None:
    """Runs the boards in their own process: reports when they are ready, receives the origin, then a message to end."""
    if core is not None:
        os.sched_setaffinity(0, {core})
    scenario = make_scenario()
    rig, (name,) = SimulatedRig(scenario, loads), scenario.senses.buses
    with DeviceServer(PipeBus(wire), rig.on_bus(name)):
        pipe.send("ready")
        rig.origin = pipe.recv()
        pipe.recv()


def measure(duration: float, pinned: bool) -> tuple[Report, Report]:
    """Runs the chain twice for `duration` s of the diagram's time; if `pinned`, it and the boards have a core each.

    Returns:
        The reports with the estimate alone, and with contacts at every poll.
    """
    scenario = make_scenario()
    model = scenario.object_model()
    felt = rehearse(scenario, model)
    loads = simulated_loads(scenario, felt)
    cores = sorted(os.sched_getaffinity(0))
    pinned = pinned and len(cores) > 1
    here, there = multiprocessing.Pipe()
    wire, other_end = multiprocessing.Pipe()
    arguments = (other_end, loads, cores[-1] if pinned else None, there)
    boards = multiprocessing.get_context("spawn").Process(target=serve, args=arguments)
    boards.start()
    try:
        here.recv()
        if pinned:
            os.sched_setaffinity(0, {cores[0]})
        devices = CanDevices(
            scenario.senses, {name: DeviceBus(lambda: PipeBus(wire)) for name in scenario.senses.buses}
        )
        known = {name: felt[name] for name in ("joint_positions", "prior")}
        station = make_hardware_station(scenario, devices, known, model=model)
        warm_up(station)
        with devices:
            devices.tare(scenario.senses.tare_samples)
            here.send(devices.start())
            return run(station, devices, duration, False), run(station, devices, duration, True)
    finally:
        os.sched_setaffinity(0, set(cores))
        here.send("end")
        boards.join()


def run(station: HardwareStation, devices: CanDevices, duration: float, with_contacts: bool) -> Report:
    """Runs a station whose devices are running, and measures the times."""
    devices.start()
    simulator = Simulator(station.diagram)
    simulator.set_target_realtime_rate(1.0)
    contacts = station.diagram.GetOutputPort("contacts")
    observed = {finger: note_samples(board) for finger, board in devices.boards.items()}
    latency: list[float] = []
    clock = next(iter(devices.buses.values())).clock

    def monitor(context: Context) -> EventStatus:
        contacts.Eval(context)
        now = clock.time()
        for samples in observed.values():
            latency.extend(now - sample.time for sample in samples)
            samples.clear()
        return EventStatus.Succeeded()

    if with_contacts:
        simulator.set_monitor(monitor)
    before = sum(board.samples for board in devices.boards.values())
    began, cpu = time.perf_counter(), time.process_time()
    simulator.AdvanceTo(duration)
    took, cpu = time.perf_counter() - began, time.process_time() - cpu
    samples = sum(board.samples for board in devices.boards.values()) - before
    period = station.scenario.estimation.estimator.period
    return Report(duration / took, samples / took, cpu / took, np.array(latency), math.floor(duration / period))


def note_samples(board: NetCanOemForceTorque) -> list:
    """A list to which each sample is appended when the diagram first uses it."""
    observe, noted, last = type(board).observe.__get__(board), [], [None]

    def noting(max_age: float, now: float | None = None):
        found = observe(max_age, now)
        if found[0] is not None and found[0] is not last[0]:
            last[0] = found[0]
            noted.append(found[0])
        return found

    board.observe = noting
    return noted


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--duration", type=float, default=20.0, help="s")
    parser.add_argument("--anywhere", action="store_true", help="does not pin the processes to a core each")
    options = parser.parse_args()
    for report in measure(options.duration, not options.anywhere):
        print(
            f"real-time factor {report.real_time_factor:.3f}, {report.core:.0%} of a core, "
            f"{report.samples_per_second:.0f} samples/s, {report.estimates} estimates"
        )
        if len(report.latency):
            median, high = 1e3 * np.percentile(report.latency, [50, 99])
            print(f"frame to contact: median {median:.1f} ms, 99 % {high:.1f} ms ({len(report.latency)} samples)")
