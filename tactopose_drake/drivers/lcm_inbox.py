"""Messages that come over LCM: all of them are taken in, the newest is used, and what is missing is counted."""

import importlib
from typing import Any, Protocol

from tactopose_drake.drivers.lcm_messages import HandSensesMessage, ObjectPoseMessage
from tactopose_drake.drivers.waiting_pictures import WaitingPictures
from tactopose_drake.errors import BusError, InvalidInputError, ProtocolError

_BACK = 1_000_000  # microseconds that a message may be older than the one before; beyond, its sender began anew
_MOST_MISSED = 10**6  # a gap beyond is another counter, and not that many messages


class LcmConnection(Protocol):
    """What the package `lcm` calls LCM."""

    def subscribe(self, channel: str, handler: Any) -> Any:
        """Has a handler called with channel and data."""

    def publish(self, channel: str, data: bytes) -> Any:
        """Sends a message."""

    def handle_timeout(self, timeout: int, /) -> int:
        """Handles messages for as long as that at most, ms."""


def open_lcm(url: str) -> LcmConnection:
    """Opens LCM at a URL, such as `udpm://239.255.76.67:7667?ttl=0`: with ttl=0 nothing leaves this machine.

    Raises:
        InvalidInputError: if the package `lcm` is not installed.
        BusError: if there is no such network, or the URL is invalid.
    """
    try:
        lcm = importlib.import_module("lcm")
    except ModuleNotFoundError:
        raise InvalidInputError(
            "LCM: the package lcm is not installed; `pip install tactopose_drake[lcm]` brings it."
        ) from None
    try:
        connection: LcmConnection = lcm.LCM(url)
    except (OSError, RuntimeError) as error:
        raise BusError(f"LCM: {url!r} cannot be opened ({error}).") from None
    return connection


class LcmInbox:
    """What a hand senses and what vision says, as it comes in.

    Attributes:
        received: messages of senses so far.
        lost: how many had not come when a later one did, by their sequence.
        passed_over: how many were received and not taken, since a newer one was there or had been.
        remarks: what is to be said of what came since the last was taken.
    """

    def __init__(self, connection: LcmConnection, senses_channel: str, vision_channel: str = "") -> None:
        """Subscribes.

        Args:
            connection: an open one.
            senses_channel: of `lcmt_hand_senses`.
            vision_channel: of `lcmt_object_pose`; empty: there is no vision.
        """
        self.received = self.lost = self.passed_over = 0
        self.remarks: list[str] = []
        self._connection = connection
        self._last: HandSensesMessage | None = None
        self._newest: HandSensesMessage | None = None
        self._pictures = WaitingPictures[ObjectPoseMessage]()
        connection.subscribe(senses_channel, self._on_senses).set_queue_capacity(0)  # no limit: none is lost here
        if vision_channel:
            connection.subscribe(vision_channel, self._on_vision)

    def wait(self, timeout: float) -> None:
        """Takes in all that is there; waits for a first message for as long as that, s.

        Raises:
            BusError: if the network can no longer be read.
        """
        try:
            if self._connection.handle_timeout(max(0, round(1e3 * timeout))) > 0:
                while self._connection.handle_timeout(0) > 0:
                    pass
        except OSError as error:
            # Where a signal ended the wait, its handler runs with the next call, which is this one.
            fault = BusError(f"LCM: cannot be read ({error}).")
            raise fault from None

    def take(self) -> HandSensesMessage | None:
        """The newest message of senses, once; None where there is no new one."""
        newest, self._newest = self._newest, None
        return newest

    def take_vision(self, utime: int) -> ObjectPoseMessage | None:
        """The newest message of vision, once.

        Args:
            utime: of the senses that it goes with. A picture that is newer by less than half a second waits for them.
        """
        return self._pictures.take(utime)

    def take_remarks(self) -> tuple[str, ...]:
        """The remarks, once."""
        remarks, self.remarks = tuple(dict.fromkeys(self.remarks)), []
        return remarks

    def _on_senses(self, channel: str, data: bytes) -> None:
        try:
            message = HandSensesMessage.decode(data)
        except ProtocolError as error:
            self.remarks.append(str(error).removesuffix("."))
            return
        self.received += 1
        if self._last is not None:
            step, back = message.sequence - self._last.sequence, self._last.utime - message.utime
            if step <= 0 < message.sequence and 0 <= back < _BACK:  # It was overtaken, or came twice; 0 is a first one.
                self.passed_over += 1
                return
            self._count(step)
        if self._newest is not None:
            self.passed_over += 1
        self._last = self._newest = message

    def _count(self, step: int) -> None:
        """Counts what is missing between two messages that came one after the other."""
        if 1 < step <= _MOST_MISSED:
            self.lost += step - 1
            lost = "1 message of the senses was" if step == 2 else f"{step - 1} messages of the senses were"
            self.remarks.append(f"{lost} lost")
        elif step != 1:
            self.remarks.append("the senses' sender began anew")

    def _on_vision(self, channel: str, data: bytes) -> None:
        try:
            message = ObjectPoseMessage.decode(data)
        except ProtocolError as error:
            self.remarks.append(str(error).removesuffix("."))
            return
        self._pictures.add(message.utime, message)
