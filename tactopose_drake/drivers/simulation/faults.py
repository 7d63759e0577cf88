"""What can go wrong with the answers of a device.

A fault changes the answer to one request: it is a function of the request and of the frames, with their delays, that
would have been the answer.
"""

import copy
import dataclasses
from collections.abc import Callable

import can
import numpy as np

from tactopose_drake.drivers.frames import ERROR_BUS_OFF, ERROR_CONTROLLER, data_frame, error_frame


@dataclasses.dataclass(frozen=True, eq=False)
class Reply:
    """A frame that a device sends.

    Attributes:
        delay: after the request, s.
        frame: the frame.
    """

    delay: float
    frame: can.Message


Fault = Callable[[can.Message, list[Reply]], list[Reply]]


def silence(_: can.Message, replies: list[Reply]) -> list[Reply]:
    """Nothing is said."""
    return []


def missing_frame(_: can.Message, replies: list[Reply]) -> list[Reply]:
    """The last frame of each answer is lost."""
    return replies[:-1]


def out_of_order(_: can.Message, replies: list[Reply]) -> list[Reply]:
    """The frames of each answer come in the reverse order."""
    return replies[::-1]


def duplicates(_: can.Message, replies: list[Reply]) -> list[Reply]:
    """Each frame comes twice."""
    return [reply for reply in replies for _ in range(2)]


def extra_frames(_: can.Message, replies: list[Reply]) -> list[Reply]:
    """Each frame is preceded by one of the same identifier whose bits are all the other way round."""
    result = []
    for reply in replies:
        noise = bytes(0xFF ^ byte for byte in reply.frame.data)
        result += [Reply(reply.delay, data_frame(reply.frame.arbitration_id, noise)), reply]
    return result


def own_frame_echo(request: can.Message, replies: list[Reply]) -> list[Reply]:
    """The request itself comes back to who has sent it, before the answer."""
    return [Reply(0.0, copy.copy(request)), *replies]


def error_frames(_: can.Message, replies: list[Reply]) -> list[Reply]:
    """The controller reports an error before each frame."""
    return [part for reply in replies for part in (Reply(reply.delay, error_frame(ERROR_CONTROLLER)), reply)]


def bus_off(_: can.Message, replies: list[Reply]) -> list[Reply]:
    """The controller has left the bus, and says so."""
    return [Reply(0.0, error_frame(ERROR_BUS_OFF))]


def wrong_length(length: int) -> Fault:
    """Each frame has `length` bytes: it is cut off, or filled with zeros."""

    def fault(_: can.Message, replies: list[Reply]) -> list[Reply]:
        return [
            Reply(
                reply.delay,
                data_frame(reply.frame.arbitration_id, bytes(reply.frame.data[:length]).ljust(length, b"\0")),
            )
            for reply in replies
        ]

    return fault


def late(delay: float) -> Fault:
    """Each answer comes `delay` s late."""

    def fault(_: can.Message, replies: list[Reply]) -> list[Reply]:
        return [Reply(reply.delay + delay, reply.frame) for reply in replies]

    return fault


def sometimes(fault: Fault, probability: float, generator: np.random.Generator) -> Fault:
    """A fault of some of the answers, drawn at random."""

    def drawn(request: can.Message, replies: list[Reply]) -> list[Reply]:
        return fault(request, replies) if generator.random() < probability else replies

    return drawn
