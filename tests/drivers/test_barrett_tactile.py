import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactopose_drake.drivers import barrett_tactile as tactile
from tactopose_drake.errors import ProtocolError

raw_cells = st.lists(st.integers(0, 4095), min_size=24, max_size=24)
frames = st.lists(st.binary(min_size=8, max_size=8), max_size=12)


@given(raw_cells)
def test_full_readings_survive_the_wire(raw: list[int]) -> None:
    reading = tactile.FullReading()
    *first, last = [reading.add(data) for data in tactile.encode_full(np.array(raw))]
    assert first == [None] * 4
    assert last == raw


def test_the_frames_of_a_known_full_reading() -> None:
    sent = tactile.encode_full(np.arange(1, 25))
    assert sent[0].hex() == "0001002003004005"
    assert sent[4].hex() == "4015016017018000"


@given(st.dictionaries(st.integers(0, 23), st.integers(0, 15), max_size=10))
def test_short_readings_survive_the_wire(levels: dict[int, int]) -> None:
    assert tactile.decode_top(tactile.encode_top(levels)) == levels


def test_a_known_short_reading() -> None:
    # Cells from 1, as public drivers print them.
    expected = {1: 6, 2: 4, 8: 5, 10: 14, 12: 7, 13: 7, 14: 11, 20: 6, 21: 9, 24: 3}
    levels = tactile.decode_top(bytes.fromhex("983A83645E77B693"))
    assert {cell + 1: level for cell, level in levels.items()} == expected
    pressures = tactile.top_pressures(levels)
    assert pressures[9] == 14e4  # N/cm^2 in Pa
    assert np.isnan(pressures[2])


def test_pressures_are_in_pascals() -> None:
    assert tactile.full_pressures([256] * 24)[0] == 1e4  # 1 N/cm^2


@pytest.mark.parametrize("order", [[1, 0, 2, 3, 4], [0, 2, 3, 4, 1], [0, 1, 1, 2, 3, 4], [0, 1, 2, 3, 3, 4], [4]])
def test_frames_out_of_order_make_no_reading(order: list[int]) -> None:
    sent = tactile.encode_full(np.arange(24))
    reading = tactile.FullReading()
    results = []
    for k in order:
        try:
            results.append(reading.add(sent[k]))
        except ProtocolError:
            results.append("error")
    assert "error" in results
    assert not any(isinstance(result, list) for result in results)


def test_a_reading_that_begins_anew_is_whole() -> None:
    old, new = tactile.encode_full(np.zeros(24, int)), tactile.encode_full(np.arange(24))
    reading = tactile.FullReading()
    reading.add(old[0])
    reading.add(old[1])
    with pytest.raises(ProtocolError, match="number 2, not 0"):
        reading.add(new[0])
    assert [reading.add(data) for data in new[1:]][-1] == list(range(24))


@given(frames)
def test_any_frames_are_readings_in_range_or_protocol_errors(received: list[bytes]) -> None:
    check_any(received)


def check_any(received: list[bytes]) -> None:
    """All decoders on arbitrary bytes; a reading only ever comes from frames 0 to 4 in a row."""
    reading = tactile.FullReading()
    for k, data in enumerate(received):
        try:
            raw = reading.add(data)
        except ProtocolError:
            raw = None
        if raw is not None:
            assert [part[0] >> 4 for part in received[k - 4 : k + 1]] == [0, 1, 2, 3, 4]
            assert len(raw) == 24
            assert all(0 <= cell <= 4095 for cell in raw)
        try:
            levels = tactile.decode_top(data)
        except ProtocolError:
            continue
        assert len(levels) <= 10
        assert all(0 <= cell < 24 and 0 <= level < 16 for cell, level in levels.items())


@given(st.binary(max_size=7))
def test_short_frames_are_refused(data: bytes) -> None:
    with pytest.raises(ProtocolError):
        tactile.decode_full_frame(data)
    with pytest.raises(ProtocolError):
        tactile.decode_top(data)
