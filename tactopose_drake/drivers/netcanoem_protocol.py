"""The protocol of ATI's NETCANOEM force-torque board: encoding and decoding of frames, as pure functions.

An identifier is `base << 4 | opcode`; replies use the identifiers of the requests. Numbers are big-endian. Every
decoder takes the data of its frames and raises `ProtocolError` if their length or a value is invalid.

Source: [A] ATI Industrial Automation, NETCANOEM manual 9610-05-1030. Written from that and from what public drivers
agree on; not tested on hardware.
"""

import dataclasses
import enum
import math
import struct

import numpy as np

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.errors import ProtocolError

# A strain gauge at either end of its range is saturated or broken. [A]
GAUGE_LIMITS = (-32768, 32767)
CALIBRATIONS = 16  # slots on the board
BASES = 128  # of 7 bits


class Opcode(enum.IntEnum):
    """The requests, the low four bits of an identifier. Long replies continue under the next opcodes."""

    SAMPLE = 0x0  # replies 0 and 1
    MATRIX = 0x2  # replies 2, 3 and 4
    CALIBRATION = 0x6
    COUNTS = 0x7
    UNITS = 0x8
    FIRMWARE = 0xF


class ForceUnit(enum.IntEnum):
    """The board's codes of force units."""

    POUND = 1
    NEWTON = 2
    KILOPOUND = 3
    KILONEWTON = 4
    KILOGRAM = 5
    GRAM = 6

    @property
    def newtons(self) -> float:
        """One of this unit, in N."""
        return _NEWTONS[self]


class TorqueUnit(enum.IntEnum):
    """The board's codes of torque units."""

    POUND_INCH = 1
    POUND_FOOT = 2
    NEWTON_METER = 3
    NEWTON_MILLIMETER = 4
    KILOGRAM_CENTIMETER = 5
    KILONEWTON_METER = 6

    @property
    def newton_meters(self) -> float:
        """One of this unit, in N m."""
        return _NEWTON_METERS[self]


_GRAVITY, _POUND, _INCH = 9.80665, 0.45359237, 0.0254  # m/s^2, kg, m; exact by definition
_NEWTONS = {
    ForceUnit.POUND: _POUND * _GRAVITY,
    ForceUnit.NEWTON: 1.0,
    ForceUnit.KILOPOUND: 1e3 * _POUND * _GRAVITY,
    ForceUnit.KILONEWTON: 1e3,
    ForceUnit.KILOGRAM: _GRAVITY,
    ForceUnit.GRAM: 1e-3 * _GRAVITY,
}
_NEWTON_METERS = {
    TorqueUnit.POUND_INCH: _POUND * _GRAVITY * _INCH,
    TorqueUnit.POUND_FOOT: 12 * _POUND * _GRAVITY * _INCH,
    TorqueUnit.NEWTON_METER: 1.0,
    TorqueUnit.NEWTON_MILLIMETER: 1e-3,
    TorqueUnit.KILOGRAM_CENTIMETER: 1e-2 * _GRAVITY,
    TorqueUnit.KILONEWTON_METER: 1e3,
}


class StatusBit(enum.IntFlag):
    """The board's status word."""

    WATCHDOG_RESET = 1 << 0
    ADC_CHECK_HIGH = 1 << 1
    ADC_CHECK_LOW = 1 << 2
    ANALOG_GROUND = 1 << 3
    SUPPLY_HIGH = 1 << 4
    SUPPLY_LOW = 1 << 5
    BAD_CALIBRATION = 1 << 6
    EEPROM = 1 << 7
    CONFIGURATION = 1 << 8
    TEMPERATURE_HIGH = 1 << 11
    TEMPERATURE_LOW = 1 << 12
    CAN_ERROR = 1 << 14
    ANY_ERROR = 1 << 15


# The board sends data whatever its status, so the host must reject invalid ones. They are valid under these bits. [A]
HARMLESS = StatusBit.WATCHDOG_RESET | StatusBit.CONFIGURATION | StatusBit.CAN_ERROR


def status_names(word: int) -> list[str]:
    """The names of the bits of a status word; bit 15 is named only if no other bit is set."""
    names = []
    for bit in range(15):
        if word >> bit & 1:
            known = StatusBit(1 << bit).name
            names.append(known.lower().replace("_", " ") if known else f"status bit {bit}")
    return names or (["unnamed error"] if word else [])


def is_rejected(word: int) -> bool:
    """Whether a sample under this status word must not be used: any critical or unknown bit is set."""
    return bool(word & ~(HARMLESS | StatusBit.ANY_ERROR)) or word == StatusBit.ANY_ERROR


@dataclasses.dataclass(frozen=True, order=True)
class Firmware:
    """The board's firmware version."""

    major: int
    minor: int
    build: int

    @property
    def tells_units(self) -> bool:
        """Whether the board answers `COUNTS` and `UNITS`. [A]"""
        return (self.major, self.minor) >= (3, 7)


def identifier(base: int, opcode: int) -> int:
    """The identifier of an opcode on the board with this base."""
    return base << 4 | opcode


def encode_sample(status: int, gauges: list[int]) -> tuple[bytes, bytes]:
    """The two replies of a sample.

    Args:
        status: 16 bits.
        gauges: six, 16 bits each.
    """
    return struct.pack(">H3h", status, *gauges[0::2]), struct.pack(">3h", *gauges[1::2])


def decode_sample(first: bytes, second: bytes) -> tuple[int, list[int]]:
    """The status word and the six strain gauges from the two replies of a sample."""
    status, even0, even2, even4 = _unpack(">H3h", first, "first half of a sample")
    odd1, odd3, odd5 = _unpack(">3h", second, "second half of a sample")
    return status, [even0, odd1, even2, odd3, even4, odd5]


def encode_matrix_row(row: FloatArray) -> list[bytes]:
    """The three replies that hold one axis of the calibration matrix, shape (6,)."""
    return [struct.pack(">2f", *row[k : k + 2]) for k in (0, 2, 4)]


def decode_matrix_row(replies: list[bytes]) -> FloatArray:
    """One axis of the calibration matrix from its three replies, shape (6,); finite."""
    if len(replies) != 3:
        raise ProtocolError(f"matrix row must have 3 frames, not {len(replies)}.")
    row = [number for data in replies for number in _unpack(">2f", data, "part of the matrix")]
    if not all(math.isfinite(number) for number in row):
        raise ProtocolError(f"matrix row must hold finite numbers, not {row}.")
    return np.array(row, dtype=np.float64)


def encode_counts(per_force: int, per_torque: int) -> bytes:
    """The reply to `COUNTS`."""
    return struct.pack(">2L", per_force, per_torque)


def decode_counts(data: bytes) -> tuple[int, int]:
    """Counts per unit of force and per unit of torque, each > 0."""
    per_force, per_torque = _unpack(">2L", data, "counts per unit")
    if per_force == 0 or per_torque == 0:
        raise ProtocolError(f"counts per unit must be numbers > 0, not {per_force} and {per_torque}.")
    return per_force, per_torque


def encode_units(force: ForceUnit, torque: TorqueUnit) -> bytes:
    """The reply to `UNITS`."""
    return struct.pack(">2B", force, torque)


def decode_units(data: bytes) -> tuple[ForceUnit, TorqueUnit]:
    """The units of force and of torque."""
    force, torque = _unpack(">2B", data, "units")
    if not (1 <= force <= 6 and 1 <= torque <= 6):
        raise ProtocolError(f"units must have codes from 1 to 6, not {force} and {torque}.")
    return ForceUnit(force), TorqueUnit(torque)


def encode_calibration(slot: int) -> bytes:
    """The request that activates a calibration, and its reply."""
    return struct.pack(">B", slot)


def decode_calibration(data: bytes) -> int:
    """The slot of the active calibration, 0 to 15."""
    (slot,) = _unpack(">B", data, "active calibration")
    if slot >= CALIBRATIONS:
        raise ProtocolError(f"active calibration must be from 0 to {CALIBRATIONS - 1}, not {slot}.")
    return int(slot)


def encode_firmware(firmware: Firmware) -> bytes:
    """The reply to `FIRMWARE`."""
    return struct.pack(">2BH", firmware.major, firmware.minor, firmware.build)


def decode_firmware(data: bytes) -> Firmware:
    """The firmware's version."""
    return Firmware(*_unpack(">2BH", data, "firmware version"))


def _unpack(layout: str, data: bytes, what: str) -> tuple[int, ...]:
    if len(data) != struct.calcsize(layout):
        raise ProtocolError(f"{what} must have {struct.calcsize(layout)} bytes, not {len(data)}.")
    return struct.unpack(layout, data)
