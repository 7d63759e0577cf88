"""Frames that read or write properties of the BH8-280's pucks, and the collection of the replies."""

import contextlib
from collections.abc import Iterable

import can

from tactopose_drake.drivers import barrett_protocol as protocol
from tactopose_drake.drivers.barrett_protocol import Property, ReplyGroup
from tactopose_drake.drivers.frames import data_frame
from tactopose_drake.errors import ProtocolError


class Answers:
    """Collects the values of one property, by puck.

    Attributes:
        values: the values so far.
        awaited: pucks whose values are required for completeness.
    """

    def __init__(self, name: Property, awaited: Iterable[int] = ()) -> None:
        self._name = name
        self.values: dict[int, int] = {}
        self.awaited = set(awaited)

    def collect(self, frame: can.Message) -> bool:
        """Takes a frame; returns whether the answers are complete."""
        puck, group = protocol.split_reply(frame.arbitration_id)
        if group is ReplyGroup.ORDINARY:
            # Damaged frames, and replies to other masters, are ignored.
            with contextlib.suppress(ProtocolError):
                name, value = protocol.decode_value(bytes(frame.data))
                if name == self._name:
                    self.values[puck] = value
        return self.awaited <= self.values.keys()

    def ignore_end(self, frame: can.Message) -> bool:
        """Takes a frame; always returns False, so that more frames are accepted."""
        self.collect(frame)
        return False


def get_frame(receiver: int, name: Property) -> can.Message:
    """The request for a property, to a puck or a group."""
    return data_frame(receiver, protocol.encode_get(name))


def set_frame(receiver: int, name: Property, value: int) -> can.Message:
    """The command that writes a property, to a puck or a group."""
    return data_frame(receiver, protocol.encode_set(name, value))
