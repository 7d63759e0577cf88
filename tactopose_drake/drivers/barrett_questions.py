"""Frames that ask for properties of the BH8-280's pucks, or write them, and the answers as they come in."""

import contextlib
from collections.abc import Iterable

import can

from tactopose_drake.drivers import barrett_protocol as protocol
from tactopose_drake.drivers.barrett_protocol import Property, ReplyGroup
from tactopose_drake.drivers.frames import data_frame
from tactopose_drake.errors import ProtocolError


class Answers:
    """Values of one property, by puck, as they come in.

    Attributes:
        values: so far.
        awaited: pucks without which they are not complete.
    """

    def __init__(self, name: Property, awaited: Iterable[int] = ()) -> None:
        self._name = name
        self.values: dict[int, int] = {}
        self.awaited = set(awaited)

    def collect(self, frame: can.Message) -> bool:
        """Takes a frame; True when the answers are complete."""
        puck, group = protocol.split_reply(frame.arbitration_id)
        if group is ReplyGroup.ORDINARY:
            # What another master has asked for, or what is damaged, is no answer.
            with contextlib.suppress(ProtocolError):
                name, value = protocol.decode_value(bytes(frame.data))
                if name == self._name:
                    self.values[puck] = value
        return self.awaited <= self.values.keys()

    def ignore_end(self, frame: can.Message) -> bool:
        """Takes a frame; more may come always."""
        self.collect(frame)
        return False


def get_frame(receiver: int, name: Property) -> can.Message:
    """The request for a property, to a puck or a group."""
    return data_frame(receiver, protocol.encode_get(name))


def set_frame(receiver: int, name: Property, value: int) -> can.Message:
    """The command that writes a property, to a puck or a group."""
    return data_frame(receiver, protocol.encode_set(name, value))
