import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactopose_drake.drivers import netcanoem_protocol as protocol
from tactopose_drake.drivers.netcanoem_protocol import Firmware, ForceUnit, Opcode, StatusBit, TorqueUnit
from tactopose_drake.errors import ProtocolError

int16 = st.integers(-(2**15), 2**15 - 1)
float32 = st.floats(width=32, allow_nan=False, allow_infinity=False)
frame = st.binary(max_size=8)


@given(st.integers(0, 2**16 - 1), st.lists(int16, min_size=6, max_size=6))
def test_samples_survive_the_wire(status: int, gauges: list[int]) -> None:
    assert protocol.decode_sample(*protocol.encode_sample(status, gauges)) == (status, gauges)


def test_a_sample_has_even_gauges_first_and_big_endian_words() -> None:
    first, second = protocol.encode_sample(0x8002, [1, 2, 3, 4, 5, -1])
    assert first.hex() == "8002000100030005"
    assert second.hex() == "00020004ffff"


@given(st.lists(float32, min_size=6, max_size=6))
def test_matrix_rows_survive_the_wire(row: list[float]) -> None:
    np.testing.assert_array_equal(protocol.decode_matrix_row(protocol.encode_matrix_row(np.array(row))), row)


@given(st.integers(0, 127), st.integers(0, 15))
def test_identifiers_have_eleven_bits_and_are_all_different(base: int, opcode: int) -> None:
    identifier = protocol.identifier(base, opcode)
    assert identifier < 2**11
    assert (identifier >> 4, identifier & 0xF) == (base, opcode)


def test_numbers_that_the_simulated_board_takes_from_here_are_those_of_the_wire() -> None:
    opcodes = {"SAMPLE": 0, "MATRIX": 2, "CALIBRATION": 6, "COUNTS": 7, "UNITS": 8, "FIRMWARE": 15}
    assert {opcode.name: int(opcode) for opcode in Opcode} == opcodes
    forces = ["POUND", "NEWTON", "KILOPOUND", "KILONEWTON", "KILOGRAM", "GRAM"]
    torques = ["POUND_INCH", "POUND_FOOT", "NEWTON_METER", "NEWTON_MILLIMETER", "KILOGRAM_CENTIMETER"]
    assert [(unit.name, int(unit)) for unit in ForceUnit] == [(name, k) for k, name in enumerate(forces, 1)]
    assert [unit.name for unit in TorqueUnit] == [*torques, "KILONEWTON_METER"]
    assert [int(unit) for unit in TorqueUnit] == [1, 2, 3, 4, 5, 6]
    assert protocol.GAUGE_LIMITS == (-(2**15), 2**15 - 1)
    bits = {
        "watchdog reset": 0x0001,
        "adc check high": 0x0002,
        "adc check low": 0x0004,
        "analog ground": 0x0008,
        "supply high": 0x0010,
        "supply low": 0x0020,
        "bad calibration": 0x0040,
        "eeprom": 0x0080,
        "configuration": 0x0100,
        "temperature high": 0x0800,
        "temperature low": 0x1000,
        "can error": 0x4000,
    }
    for name, word in bits.items():
        assert protocol.status_names(0x8000 | word) == [name]
        assert protocol.is_rejected(word) == (name not in ("watchdog reset", "configuration", "can error"))


@pytest.mark.parametrize(("version", "tells"), [((3, 6), False), ((3, 7), True), ((3, 10), True), ((2, 9), False)])
def test_which_boards_tell_their_units(version: tuple[int, int], tells: bool) -> None:
    assert Firmware(*version, 5).tells_units == tells
    assert Firmware(4, 0, 0).tells_units


@given(st.integers(1, 2**32 - 1), st.integers(1, 2**32 - 1))
def test_counts_survive_the_wire(force: int, torque: int) -> None:
    assert protocol.decode_counts(protocol.encode_counts(force, torque)) == (force, torque)


@given(st.sampled_from(ForceUnit), st.sampled_from(TorqueUnit))
def test_units_survive_the_wire(force: ForceUnit, torque: TorqueUnit) -> None:
    assert protocol.decode_units(protocol.encode_units(force, torque)) == (force, torque)


@given(st.builds(Firmware, st.integers(0, 255), st.integers(0, 255), st.integers(0, 65535)))
def test_firmware_versions_survive_the_wire(firmware: Firmware) -> None:
    assert protocol.decode_firmware(protocol.encode_firmware(firmware)) == firmware


@given(st.integers(0, 15))
def test_calibrations_survive_the_wire(slot: int) -> None:
    assert protocol.decode_calibration(protocol.encode_calibration(slot)) == slot


@pytest.mark.parametrize(
    ("decode", "data"),
    [
        (protocol.decode_counts, struct.pack(">2L", 0, 1)),
        (protocol.decode_counts, struct.pack(">2L", 1, 0)),
        (protocol.decode_units, bytes([0, 1])),
        (protocol.decode_units, bytes([1, 7])),
        (protocol.decode_calibration, bytes([16])),
        (lambda data: protocol.decode_matrix_row([data] * 3), struct.pack(">2f", np.nan, 1.0)),
        (lambda data: protocol.decode_matrix_row([data] * 3), struct.pack(">2f", 1.0, np.inf)),
        (lambda data: protocol.decode_matrix_row([data] * 2), struct.pack(">2f", 1.0, 1.0)),
    ],
)
def test_values_out_of_range_are_refused(decode, data: bytes) -> None:
    with pytest.raises(ProtocolError):
        decode(data)


@given(st.lists(frame, min_size=3, max_size=3))
def test_any_bytes_are_a_value_in_range_or_a_protocol_error(frames: list[bytes]) -> None:
    check_any(frames)


def check_any(frames: list[bytes]) -> None:
    """Every decoder on arbitrary bytes."""
    one, two, _ = frames
    for decode, valid in (
        (lambda: protocol.decode_sample(one, two), lambda v: 0 <= v[0] < 2**16 and all(abs(g) <= 2**15 for g in v[1])),
        (lambda: protocol.decode_matrix_row(frames), lambda v: np.isfinite(v).all() and v.shape == (6,)),
        (lambda: protocol.decode_counts(one), lambda v: min(v) > 0),
        (lambda: protocol.decode_units(one), lambda v: v[0].newtons > 0 and v[1].newton_meters > 0),
        (lambda: protocol.decode_calibration(one), lambda v: 0 <= v < 16),
        (lambda: protocol.decode_firmware(one), lambda v: v.build < 2**16),
    ):
        try:
            value = decode()
        except ProtocolError:
            continue
        assert valid(value)


@pytest.mark.parametrize("bit", range(16))
def test_what_a_status_bit_does(bit: int) -> None:
    harmless = {0, 8, 14}  # watchdog, configuration, CAN error: the manual does not call them critical
    word = 1 << bit | 1 << 15
    assert protocol.is_rejected(word) is (bit not in harmless)
    assert len(protocol.status_names(word)) == 1


def test_a_good_status_has_nothing_to_say() -> None:
    assert not protocol.is_rejected(0)
    assert protocol.status_names(0) == []
    assert protocol.status_names(StatusBit.SUPPLY_LOW | StatusBit.CAN_ERROR) == ["supply low", "can error"]


def test_units_are_those_of_the_si() -> None:
    assert {unit.name: unit.newtons for unit in ForceUnit} == pytest.approx(
        {
            "POUND": 4.4482216,
            "NEWTON": 1.0,
            "KILOPOUND": 4448.2216,
            "KILONEWTON": 1000.0,
            "KILOGRAM": 9.80665,
            "GRAM": 0.00980665,
        },
        rel=1e-7,
    )
    assert {unit.name: unit.newton_meters for unit in TorqueUnit} == pytest.approx(
        {
            "POUND_INCH": 0.11298483,
            "POUND_FOOT": 1.3558179,
            "NEWTON_METER": 1.0,
            "NEWTON_MILLIMETER": 0.001,
            "KILOGRAM_CENTIMETER": 0.0980665,
            "KILONEWTON_METER": 1000.0,
        },
        rel=1e-7,
    )
