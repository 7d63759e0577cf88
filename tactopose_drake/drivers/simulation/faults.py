"""Faults of a device's answers.

A fault is a function from a request and the frames of its answer, with their delays, to the frames that are sent
instead.
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
        delay: time after the request, s.
        frame: the frame.
    """

    delay: float
    frame: can.Message


Fault = Callable[[can.Message, list[Reply]], list[Reply]]


def silence(_: can.Message, replies: list[Reply]) -> list[Reply]:
    """The device does not answer."""
    return []


def missing_frame(_: can.Message, replies: list[Reply]) -> list[Reply]:
    """The last frame of each answer is lost."""
    return replies[:-1]


def out_of_order(_: can.Message, replies: list[Reply]) -> list[Reply]:
    """The frames of each answer come in reverse order."""
    return replies[::-1]


def duplicates(_: can.Message, replies: list[Reply]) -> list[Reply]:
    """Each frame comes twice."""
    return [reply for reply in replies for _ in range(2)]


def extra_frames(_: can.Message, replies: list[Reply]) -> list[Reply]:
    """Each frame is preceded by one with the same identifier and inverted data bits."""
    result = []
    for reply in replies:
        noise = bytes(0xFF ^ byte for byte in reply.frame.data)
        result += [Reply(reply.delay, data_frame(reply.frame.arbitration_id, noise)), reply]
    return result


def own_frame_echo(request: can.Message, replies: list[Reply]) -> list[Reply]:
    """The request itself comes back to its sender before the answer."""
    return [Reply(0.0, copy.copy(request)), *replies]


def error_frames(_: can.Message, replies: list[Reply]) -> list[Reply]:
    """The controller reports an error before each frame."""
    return [part for reply in replies for part in (Reply(reply.delay, error_frame(ERROR_CONTROLLER)), reply)]


def bus_off(_: can.Message, replies: list[Reply]) -> list[Reply]:
    """The controller reports that it has left the bus, and nothing else comes."""
    return [Reply(0.0, error_frame(ERROR_BUS_OFF))]


def wrong_length(length: int) -> Fault:
    """Each frame has `length` bytes: it is truncated, or padded with zeros."""

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
    """A fault that affects each answer with some probability."""

    def drawn(request: can.Message, replies: list[Reply]) -> list[Reply]:
        return fault(request, replies) if generator.random() < probability else replies

    return drawn
