import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactopose_drake.drivers import barrett_protocol as protocol
from tactopose_drake.drivers.barrett_protocol import Property, Puck, PuckStatus, ReplyGroup, TactileMode
from tactopose_drake.errors import ProtocolError

int22 = st.integers(-(2**21), 2**21 - 1)


@pytest.mark.parametrize(
    ("puck", "group", "identifier"),
    [
        (Puck.F1, ReplyGroup.ORDINARY, 0x566),
        (Puck.F1, ReplyGroup.POSITION, 0x563),
        (Puck.F1, ReplyGroup.TACTILE_TOP, 0x568),
        (Puck.F1, ReplyGroup.TACTILE_FULL, 0x569),
        (Puck.F2, ReplyGroup.TACTILE_FULL, 0x589),
        (Puck.SPREAD, ReplyGroup.TACTILE_FULL, 0x5C9),
    ],
)
def test_identifiers_of_replies(puck: Puck, group: ReplyGroup, identifier: int) -> None:
    assert protocol.reply_identifier(puck, group) == identifier
    assert protocol.split_reply(identifier) == (puck, group)


@given(st.integers(0, 2**11 - 1))
def test_any_identifier_is_a_reply_or_an_error(identifier: int) -> None:
    try:
        puck, group = protocol.split_reply(identifier)
    except ProtocolError:
        return
    assert protocol.reply_identifier(puck, group) == identifier


@given(st.sampled_from(Property), st.integers(-(2**15), 2**15 - 1))
def test_values_survive_the_wire(name: Property, value: int) -> None:
    assert protocol.decode_value(protocol.encode_value(name, value)) == (name, value)
    assert protocol.decode_request(protocol.encode_set(name, value)) == (name, value)
    assert protocol.decode_request(protocol.encode_get(name)) == (name, None)


def test_a_set_is_little_endian() -> None:
    assert protocol.encode_set(Property.STATUS, 2).hex() == "85000200"
    assert protocol.encode_set(Property.POSITION, -2).hex() == "b000feffffff"
    assert protocol.encode_get(Property.TACTILE).hex() == "6a"


def test_numbers_that_the_simulated_hand_takes_from_here_are_those_of_the_wire() -> None:
    assert protocol.HAND_GROUP == 0x405
    assert (protocol.ROLE_HAND, protocol.ROLE_MASK) == (5, 0b11111)
    assert (protocol.ROLE_STRAIN, protocol.ROLE_TACTILE) == (1 << 11, 1 << 12)
    assert protocol.TACTILE_FAILED == -2
    assert {name.name: int(name) for name in Property} == {
        "ROLE": 1,
        "STATUS": 5,
        "STRAIN": 25,
        "COMMAND": 29,
        "POSITION": 48,
        "TACTILE": 106,
        "TACTILE_ID": 107,
    }
    assert [(mode.name, int(mode)) for mode in TactileMode] == [("OFF", 0), ("TOP", 1), ("FULL", 2), ("TARE", 3)]
    assert [(status.name, int(status)) for status in PuckStatus] == [("MONITOR", 0), ("ERROR", 1), ("READY", 2)]
    assert protocol.INITIALIZE == 13  # Another command may move the hand elsewhere.


@given(int22, st.none() | int22)
def test_positions_survive_the_wire(motor: int, joint: int | None) -> None:
    assert protocol.decode_position(protocol.encode_position(motor, joint)) == (motor, joint)


def test_a_position_is_big_endian_under_a_flag() -> None:
    assert protocol.encode_position(199_111, -1).hex() == "8309c7bfffff"


@given(st.binary(max_size=8))
def test_any_bytes_are_a_value_in_range_or_a_protocol_error(data: bytes) -> None:
    check_any(data)


def check_any(data: bytes) -> None:
    """Every decoder on arbitrary bytes."""
    for decode, valid in (
        (protocol.decode_position, lambda v: all(-(2**21) <= count < 2**21 for count in v if count is not None)),
        (protocol.decode_value, lambda v: 0 <= v[0] < 128 and -(2**31) <= v[1] < 2**31),
        (protocol.decode_request, lambda v: 0 <= v[0] < 128),
    ):
        try:
            value = decode(data)
        except ProtocolError:
            continue
        assert valid(value)
