"""Simulated devices whose every number is known, and buses in virtual time."""

import contextlib
from collections.abc import Iterator

import numpy as np

from tactopose_drake.drivers.barrett_cycle import HandSample
from tactopose_drake.drivers.barrett_tactile import PASCALS_PER_RAW
from tactopose_drake.drivers.clock import VirtualClock
from tactopose_drake.drivers.device_bus import DeviceBus
from tactopose_drake.drivers.netcanoem import ForceTorqueSample
from tactopose_drake.drivers.simulation.simulated_barrett_hand import HandState, SimulatedBarrettHand
from tactopose_drake.drivers.simulation.simulated_device import SimulatedDevice
from tactopose_drake.drivers.simulation.simulated_netcanoem import SimulatedNetCanOem, nano17_like_calibration
from tactopose_drake.drivers.simulation.virtual_time_bus import VirtualTimeBus

START = 1.7e9  # s since the epoch
SLOT = 3
WRENCH = np.array([0.010, -0.020, 0.030, 1.0, 2.0, -3.0])
# Half a step of each gauge, through the calibration.
WRENCH_TOLERANCE = np.array([5e-5, 5e-5, 5e-5, 4e-3, 4e-3, 4e-3])
CALIBRATIONS = {slot: nano17_like_calibration(np.random.default_rng(slot)) for slot in (0, SLOT)}
HAND_STATE = HandState(
    joint_positions=np.array([0.4, 0.8, 1.2, 0.2, 0.3, 0.5, 0.7]),
    pressures=1e3 * np.random.default_rng(7).uniform(5.0, 90.0, (4, 24)),
    fingertip_torques=np.array([0.1, 0.2, 0.3]),
)


def make_board(base: int = 0x20, **options) -> SimulatedNetCanOem:
    return SimulatedNetCanOem(lambda time: WRENCH, CALIBRATIONS, base, **options)


def make_hand(*, awake: bool = True) -> SimulatedBarrettHand:
    return SimulatedBarrettHand(lambda time: HAND_STATE, awake=awake)


@contextlib.contextmanager
def virtual_bus(*devices: SimulatedDevice) -> Iterator[DeviceBus]:
    clock = VirtualClock(START)
    with DeviceBus(lambda: VirtualTimeBus(devices, clock), clock=clock, threaded=False) as bus:
        yield bus


def run(bus: DeviceBus, duration: float) -> None:
    bus.run_until(bus.clock.time() + duration)


def unread(device) -> list:
    """All samples that wait to be read."""
    samples = list(device._unread)
    device._unread.clear()
    return samples


def is_right(sample: ForceTorqueSample) -> bool:
    return bool(np.all(np.abs(sample.F_S - WRENCH) < WRENCH_TOLERANCE))


def has_no_wrong_number(sample: HandSample) -> bool:
    """Every number is the true one, or NaN."""
    wrong = [
        np.abs(sample.joint_positions - HAND_STATE.joint_positions) > 1e-4,
        np.abs(sample.pressures - HAND_STATE.pressures) > 0.51 * PASCALS_PER_RAW,
        np.abs(sample.fingertip_torques - HAND_STATE.fingertip_torques) > 2e-3,
    ]
    return not any(part.any() for part in wrong)


def is_whole(sample: HandSample) -> bool:
    parts = [sample.joint_positions, sample.pressures, sample.fingertip_torques]
    return has_no_wrong_number(sample) and all(np.isfinite(part).all() for part in parts)
