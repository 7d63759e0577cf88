"""Random frames through every decoder and both drivers: `python -m tests.drivers.random_frames --count 10000000`.

Half of the frames are random bytes, half are valid ones with a few bits and perhaps their length changed, so that they
get far. Nothing may be raised but `ProtocolError`, and no value be accepted that cannot be.
"""

import argparse
import sys
import time
from collections.abc import Callable

import can
import numpy as np

from tactopose_drake.drivers import barrett_joints as joints
from tactopose_drake.drivers import barrett_protocol as barrett
from tactopose_drake.drivers import barrett_tactile as tactile
from tactopose_drake.drivers import netcanoem_protocol as board
from tactopose_drake.drivers.barrett_hand import BarrettHand
from tactopose_drake.drivers.clock import VirtualClock
from tactopose_drake.drivers.device import Device
from tactopose_drake.drivers.frames import data_frame
from tactopose_drake.drivers.netcanoem import NetCanOemForceTorque
from tactopose_drake.errors import ProtocolError
from tests.drivers.rigs import START, make_board, make_hand

_BATCH = 2048
_PRESSURE_MAX = tactile.RAW_MAX * tactile.PASCALS_PER_RAW
_ANGLE_MAX = 20.0  # rad, beyond any that the joints' limits on counts let pass


def _check(fits: bool, what: str, data: object) -> None:
    if not fits:
        raise AssertionError(f"{what}: accepted {data!r}")


def _decode_sample(data: bytes) -> None:
    word, gauges = board.decode_sample(data, data[2:])
    _check(0 <= word <= 0xFFFF and all(-32768 <= gauge <= 32767 for gauge in gauges), "sample", (word, gauges))


def _decode_row(data: bytes) -> None:
    _check(bool(np.isfinite(board.decode_matrix_row([data] * 3)).all()), "matrix", data)


def _decode_counts(data: bytes) -> None:
    _check(min(board.decode_counts(data)) > 0, "counts", data)


def _decode_units(data: bytes) -> None:
    force, torque = board.decode_units(data)
    _check(force.newtons > 0 and torque.newton_meters > 0, "units", data)


def _decode_calibration(data: bytes) -> None:
    _check(0 <= board.decode_calibration(data) < 16, "calibration", data)


def _decode_firmware(data: bytes) -> None:
    firmware = board.decode_firmware(data)
    _check(max(firmware.major, firmware.minor) < 256 and firmware.build < 65536, "firmware", data)


def _decode_value(data: bytes) -> None:
    name, value = barrett.decode_value(data)
    _check(0 <= name < 128 and -(2**31) <= value < 2**31, "value", data)
    _check(np.isfinite(joints.fingertip_torque(value)), "torque", data)


def _decode_position(data: bytes) -> None:
    motor, joint = barrett.decode_position(data)
    inner, outer = joints.finger_angles(motor, joint)
    _check(abs(inner) < _ANGLE_MAX and abs(outer) < _ANGLE_MAX, "finger", data)
    _check(abs(joints.spread_angle(motor)) < _ANGLE_MAX, "spread", data)


def _decode_full(data: bytes) -> None:
    sequence, cells = tactile.decode_full_frame(data)
    _check(0 <= sequence < 5 and all(0 <= cell <= tactile.RAW_MAX for cell in cells), "full reading", data)
    _check(len(cells) == (4 if sequence == 4 else 5), "full reading", data)


def _decode_top(data: bytes) -> None:
    levels = tactile.decode_top(data)
    _check(len(levels) <= 10 and all(0 <= cell < 24 and 0 <= n <= 15 for cell, n in levels.items()), "top", data)


DECODERS: tuple[Callable[[bytes], None], ...] = (
    _decode_sample,
    _decode_row,
    _decode_counts,
    _decode_units,
    _decode_calibration,
    _decode_firmware,
    _decode_value,
    _decode_position,
    _decode_full,
    _decode_top,
)


class _Wire:
    """What a driver needs of a bus: it keeps what is sent, and has a simulated device answer it."""

    follows_log = False
    problem = ""
    quiet_until = 0.0

    def __init__(self, simulated) -> None:
        self.clock = VirtualClock(START)
        self.answers: list[can.Message] = []
        self._simulated = simulated

    def send(self, frame: can.Message, time: float) -> None:
        self.answers += [reply.frame for reply in self._simulated.handle(frame, time)]

    def hush(self, speaker: object, until: float) -> None: ...

    def is_hushed(self, device: object, now: float) -> bool:
        return False


class _Listener:
    """A driver that hears random frames between the answers of its device."""

    def __init__(self, driver: Device, wire: _Wire, check: Callable[[Device], None]) -> None:
        self._driver, self._wire, self._check = driver, wire, check
        driver.restart(wire.clock.time())

    def hear(self, identifier: int, data: bytes) -> None:
        """A random frame, if it is one of the device's; and some of the device's own."""
        wire, driver = self._wire, self._driver
        if identifier in driver.replies:
            wire.clock.sleep(1e-4)
            frame = data_frame(identifier, data)
            frame.timestamp = wire.clock.time()
            driver.handle(frame, wire.clock.time())
        answers, wire.answers = wire.answers, []
        for frame in answers:
            wire.clock.sleep(1e-4)
            frame.timestamp = wire.clock.time()
            driver.handle(frame, wire.clock.time())
        if not answers:
            wire.clock.sleep_until(driver.due)
            driver.poll(wire.clock.time())
        while driver._unread:
            self._check(driver._unread.popleft())


def _check_wrench(sample) -> None:
    whole, valid = np.isfinite(sample.F_S), sample.status.startswith("ok")
    _check(bool(whole.all()) if valid else not whole.any(), "wrench", sample)


def _check_hand(sample) -> None:
    pressures, positions = np.nan_to_num(sample.pressures), np.nan_to_num(sample.joint_positions)
    _check(bool((pressures >= 0).all() and (pressures <= _PRESSURE_MAX).all()), "pressures", sample)
    _check(bool((np.abs(positions) < _ANGLE_MAX).all()), "positions", sample)
    _check(not np.isinf(sample.fingertip_torques).any(), "torques", sample)


def _valid_data(generator: np.random.Generator) -> list[bytes]:
    """Data of valid frames of every kind."""
    raw = generator.integers(0, 4096, 24)
    return [
        *board.encode_sample(0, generator.integers(-999, 999, 6).tolist()),
        *board.encode_matrix_row(generator.normal(size=6)),
        board.encode_counts(1_000_000, 1_000_000),
        board.encode_units(board.ForceUnit.NEWTON, board.TorqueUnit.NEWTON_METER),
        board.encode_calibration(3),
        board.encode_firmware(board.Firmware(3, 8, 1)),
        barrett.encode_value(barrett.Property.STRAIN, 2000),
        barrett.encode_position(100_000, 30_000),
        barrett.encode_position(20_000),
        *tactile.encode_full(raw),
        tactile.encode_top({1: 6, 2: 4, 8: 5}),
    ]


def shake(count: int, seed: int = 0) -> int:
    """Puts random frames through all decoders, one after the other, and both drivers.

    Args:
        count: of frames; each goes through one decoder, and one in eight to a driver too.
        seed: of the random numbers.

    Returns:
        How many frames a decoder accepted.
    """
    generator = np.random.default_rng(seed)
    wires = _Wire(make_board()), _Wire(make_hand())
    listeners = (
        _Listener(NetCanOemForceTorque(wires[0]), wires[0], _check_wrench),  # type: ignore[arg-type]
        _Listener(BarrettHand(wires[1]), wires[1], _check_hand),  # type: ignore[arg-type]
    )
    replies = [sorted(listener._driver.replies) for listener in listeners]
    accepted = 0
    for first in range(0, count, _BATCH):
        size = min(_BATCH, count - first)
        valid = _valid_data(generator)
        noise = generator.integers(0, 256, (size, 8), dtype=np.uint8).tobytes()
        length, flip = generator.integers(0, 9, size).tolist(), generator.integers(0, 64, (size, 2)).tolist()
        pick, decoder = (generator.integers(0, len(choices), size).tolist() for choices in (valid, DECODERS))
        kind, who = generator.random(size).tolist(), generator.integers(0, 16, size).tolist()
        which = generator.integers(0, 1 << 30, size).tolist()
        for k in range(size):
            if kind[k] < 0.5:
                data = noise[8 * k : 8 * k + length[k]]
            else:
                changed = bytearray(valid[pick[k]])
                for bit in flip[k][: 1 + (kind[k] > 0.75)]:
                    if bit // 8 < len(changed):
                        changed[bit // 8] ^= 1 << bit % 8
                data = bytes(changed[: length[k]]) if kind[k] > 0.95 else bytes(changed)
            try:
                DECODERS[decoder[k]](data)
                accepted += 1
            except ProtocolError:
                pass
            if who[k] < 2:
                known = replies[who[k]]
                listeners[who[k]].hear(known[which[k] % len(known)], data)
    _check(all(listener._driver.samples > 0 for listener in listeners), "drivers", "no sample at all")
    return accepted


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=10_000_000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    began = time.process_time()
    found = shake(options.count, options.seed)
    sys.stdout.write(f"{options.count} frames, {found} accepted, {time.process_time() - began:.0f} s\n")
