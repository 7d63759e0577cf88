"""Kinds of the fuzzer: hostile frames on a bus, and devices whose bus and answers go wrong.

`can_frames` puts forty thousand frames through the decoders and both drivers, random ones and damaged ones;
`bus_faults` lets a board or Barrett's hand run for some seconds of virtual time. No number may be another than the true
one, and when the faults are over, all is well again.
"""

import contextlib

import numpy as np

from tactopose_drake.drivers.barrett_hand import BarrettHand
from tactopose_drake.drivers.barrett_protocol import Puck
from tactopose_drake.drivers.clock import VirtualClock
from tactopose_drake.drivers.device import Device
from tactopose_drake.drivers.device_bus import DeviceBus
from tactopose_drake.drivers.netcanoem import NetCanOemForceTorque
from tactopose_drake.drivers.simulation import faults
from tactopose_drake.drivers.simulation.simulated_device import SimulatedDevice
from tactopose_drake.drivers.simulation.virtual_time_bus import VirtualTimeBus
from tactopose_drake.errors import DeviceError
from tests.drivers import rigs
from tests.drivers.random_frames import shake
from tests.fuzz.touches import log_uniform

_FRAMES = 40_960  # so many that each driver has had samples, however it was disturbed
_RECOVERY, _STEP = 5.0, 0.25  # s of virtual time in which a device is well again, and between two looks at it


def can_frames(rng: np.random.Generator) -> None:
    """Hostile frames for every decoder and both drivers."""
    shake(_FRAMES, seed=int(rng.integers(2**32)))


def bus_faults(rng: np.random.Generator) -> None:
    """A device with faults of some kinds, each as often as it likes; it may reboot, and its adapter be pulled out."""
    is_board = bool(rng.random() < 0.7)
    device: SimulatedDevice = rigs.make_board() if is_board else rigs.make_hand(awake=bool(rng.random() < 0.5))
    clock, adapters = VirtualClock(rigs.START), []

    def open_bus() -> VirtualTimeBus:
        adapters.append(VirtualTimeBus([device], clock))
        return adapters[-1]

    with DeviceBus(open_bus, clock=clock, threaded=False) as bus:
        sensor = NetCanOemForceTorque(bus, calibration_slot=rigs.SLOT) if is_board else BarrettHand(bus)
        with sensor:
            for _ in range(rng.integers(1, 4)):
                device.faults = _some_faults(rng, is_board)
                if rng.random() < 0.3:
                    device.reboot(float(rng.uniform(0.02, 0.6)))
                if rng.random() < 0.2:
                    adapters[-1].unplugged = True
                _run(bus, sensor, is_board, float(rng.uniform(0.05, 1.0)))
            device.faults = []
            recovered = clock.time() + _RECOVERY
            while not _is_well(sensor, samples := _run(bus, sensor, is_board, _STEP), is_board):
                assert clock.time() < recovered, f"{sensor.status}, {len(samples)} samples"
                if isinstance(sensor, BarrettHand) and "restarted" in sensor.status:
                    with contextlib.suppress(DeviceError):  # if it is being greeted
                        for puck in Puck:
                            sensor.initialize(puck)


def _some_faults(rng: np.random.Generator, is_board: bool) -> list[faults.Fault]:
    harm = [faults.silence, faults.missing_frame, faults.out_of_order, faults.duplicates, faults.own_frame_echo]
    harm += [faults.error_frames, faults.bus_off, faults.wrong_length(int(rng.integers(9)))]
    harm += [faults.late(log_uniform(rng, 1e-4, 0.2))] + ([faults.extra_frames] if is_board else [])
    chosen = rng.permutation(len(harm))[: rng.integers(len(harm) + 1)]
    return [faults.sometimes(harm[i], log_uniform(rng, 1e-3, 0.1), rng) for i in chosen]


def _run(bus: DeviceBus, sensor: Device, is_board: bool, duration: float) -> list:
    """The samples of so many seconds; none holds a wrong number."""
    rigs.run(bus, duration)
    samples = rigs.unread(sensor)
    for sample in samples:
        if is_board:
            assert rigs.is_right(sample) or not np.isfinite(sample.F_S).any(), sample
        else:
            assert rigs.has_no_wrong_number(sample), sample
    return samples


def _is_well(sensor: Device, samples: list, is_board: bool) -> bool:
    if sensor.status != "ok" or not samples:
        return False
    return bool(np.isfinite(samples[-1].F_S).all()) if is_board else rigs.is_whole(samples[-1])
