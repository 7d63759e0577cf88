"""The protocol of the motor controllers ("pucks") of Barrett's BH8-280 hand: encoding and decoding of frames.

A puck has properties, which are read (GET) and written (SET, not acknowledged). An identifier is
`group << 10 | sender << 5 | receiver`; the host is 0, so that the identifier of a request to a puck is the puck's
number. Replies go to a group, which identifies their kind. Property values are little-endian, positions big-endian.
Every decoder raises `ProtocolError` for data that the protocol does not allow.

Sources: [L] libbarrett, [O] owd, [R] Robotnik's and [W] WUT's drivers of the hand, where they agree; firmware 145 and
later. Not tested on hardware.
"""

import enum

from tactopose_drake.errors import ProtocolError

GROUP = 0x400
HAND_GROUP = GROUP | 5  # identifier that all four pucks of the hand receive


class Puck(enum.IntEnum):
    """The hand's pucks; that of the spread also has the palm's tactile array."""

    F1 = 11
    F2 = 12
    F3 = 13
    SPREAD = 14


class Property(enum.IntEnum):
    """The properties that the driver uses. Writing `COMMAND` may move the hand; no other property does."""

    ROLE = 1
    STATUS = 5
    STRAIN = 25  # of the fingertip torque's gauge
    COMMAND = 29
    POSITION = 48
    TACTILE = 106
    TACTILE_ID = 107


class ReplyGroup(enum.IntEnum):
    """The groups to which replies are sent."""

    POSITION = 3
    ORDINARY = 6
    TACTILE_TOP = 8
    TACTILE_FULL = 9


class PuckStatus(enum.IntEnum):
    """Values of `Property.STATUS`."""

    MONITOR = 0  # asleep after power-up
    ERROR = 1
    READY = 2


class TactileMode(enum.IntEnum):
    """Values of `Property.TACTILE`; `TARE` is known from [L] alone."""

    OFF = 0
    TOP = 1
    FULL = 2
    TARE = 3


INITIALIZE = 13  # value of `Property.COMMAND`: the joint moves to its stops
ROLE_HAND, ROLE_MASK, ROLE_STRAIN, ROLE_TACTILE = 5, 0x1F, 0x0800, 0x1000  # [L]
TACTILE_FAILED = -2  # value of `Property.TACTILE_ID` [L]
_WIDE = {Property.POSITION}  # properties of 32 bits; the others have 16


def encode_get(name: Property) -> bytes:
    """The request for a property."""
    return bytes([name])


def encode_set(name: Property, value: int) -> bytes:
    """The command that writes a property."""
    size = 4 if name in _WIDE else 2
    return bytes([0x80 | name, 0]) + value.to_bytes(size, "little", signed=True)


def decode_request(data: bytes) -> tuple[int, int | None]:
    """The number of a request's property, and the value to write; None if the property is read."""
    if len(data) == 1 and data[0] < 0x80:
        return data[0], None
    return decode_value(data)


def reply_identifier(puck: int, group: ReplyGroup) -> int:
    """The identifier of a puck's reply."""
    return GROUP | puck << 5 | group


def split_reply(arbitration_id: int) -> tuple[int, ReplyGroup]:
    """The sender and the kind of a reply."""
    if not GROUP < arbitration_id < 2 * GROUP or arbitration_id & 0x1F not in {*ReplyGroup}:
        raise ProtocolError(f"identifier must be that of a reply to the host's groups, not {arbitration_id:#x}.")
    return arbitration_id >> 5 & 0x1F, ReplyGroup(arbitration_id & 0x1F)


def encode_value(name: Property, value: int) -> bytes:
    """An ordinary reply; its data equals that of the command that writes the value."""
    return encode_set(name, value)


def decode_value(data: bytes) -> tuple[int, int]:
    """The number of the property of an ordinary reply, which may be missing in `Property`, and its value."""
    if len(data) not in (4, 6) or not data[0] & 0x80 or data[1] != 0:
        raise ProtocolError(f"property value must be 80|property, 00, and 2 or 4 bytes, not {data.hex()}.")
    return data[0] & 0x7F, int.from_bytes(data[2:], "little", signed=True)


def encode_position(motor: int, joint: int | None = None) -> bytes:
    """A reply to the request for a position.

    Args:
        motor: encoder counts, 22 bits.
        joint: counts of the inner link's own encoder, which fingers have.
    """
    counts = [motor] if joint is None else [motor, joint]
    return b"".join((0x800000 | count & 0x3FFFFF).to_bytes(3, "big") for count in counts)


def decode_position(data: bytes) -> tuple[int, int | None]:
    """Encoder counts of the motor, and of the joint if the puck has that encoder."""
    if len(data) not in (3, 6):
        raise ProtocolError(f"position must have 3 or 6 bytes, not {len(data)}.")
    motor, *joint = (_signed22(int.from_bytes(data[k : k + 3], "big")) for k in range(0, len(data), 3))
    return motor, joint[0] if joint else None


def _signed22(word: int) -> int:
    count = word & 0x3FFFFF
    return count - 0x400000 if count & 0x200000 else count
