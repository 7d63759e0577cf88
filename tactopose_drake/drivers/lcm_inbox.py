"""Received LCM messages: all are decoded, the newest is used, and lost ones are counted."""

import importlib
import select
import weakref
from collections.abc import Callable
from typing import Any, Protocol

from tactopose_drake.drivers.lcm_messages import HandSensesMessage, ObjectPoseMessage
from tactopose_drake.drivers.waiting_pictures import WaitingPictures
from tactopose_drake.errors import BusError, InvalidInputError, ProtocolError

_MOST_MISSED = 10**6  # a larger gap in the sequence is taken for a restarted sender, not for lost messages


class LcmConnection(Protocol):
    """The class `LCM` of the package `lcm`."""

    def subscribe(self, channel: str, handler: Any) -> Any:
        """Calls a handler with the channel and the data of each message."""

    def publish(self, channel: str, data: bytes) -> Any:
        """Sends a message."""

    def fileno(self) -> int:
        """The descriptor that can be read while a message waits."""

    def handle(self) -> None:
        """Waits for a message, and handles it."""


def open_lcm(url: str) -> LcmConnection:
    """Opens LCM at a URL, such as `udpm://239.255.76.67:7667?ttl=0`; with ttl=0, nothing leaves this machine.

    Raises:
        InvalidInputError: if the package `lcm` is not installed.
        BusError: if the network is not available, or the URL is invalid.
    """
    try:
        lcm = importlib.import_module("lcm")
    except ModuleNotFoundError:
        raise InvalidInputError(
            "LCM: the package lcm is not installed; `pip install tactopose_drake[lcm]` installs it."
        ) from None
    try:
        connection: LcmConnection = lcm.LCM(url)
    except (OSError, RuntimeError) as error:
        raise BusError(f"LCM: {url!r} cannot be opened ({error}).") from None
    return connection


class LcmInbox:
    """Receives the messages of a hand's senses and of vision.

    Attributes:
        received: number of received messages of the senses.
        lost: number of messages that are missing in the sequence of received ones.
        passed_over: number of received messages that were not used, because a newer one had been received.
        remarks: remarks on the messages that were received since the last call of `take_remarks`.
    """

    def __init__(self, connection: LcmConnection, senses_channel: str, vision_channel: str = "") -> None:
        """Subscribes.

        Args:
            connection: an open connection.
            senses_channel: channel of `lcmt_hand_senses`.
            vision_channel: channel of `lcmt_object_pose`; empty if there is no vision.
        """
        self.received = self.lost = self.passed_over = 0
        self.remarks: list[str] = []
        self._connection = connection
        self._waiting = select.poll()  # LCM's own wait is for descriptors below 1024 only.
        self._waiting.register(connection.fileno(), select.POLLIN)
        self._last: HandSensesMessage | None = None
        self._newest: HandSensesMessage | None = None
        self._pictures = WaitingPictures[ObjectPoseMessage]()
        connection.subscribe(senses_channel, _weak(self._on_senses)).set_queue_capacity(0)  # unlimited
        if vision_channel:
            connection.subscribe(vision_channel, _weak(self._on_vision))

    def wait(self, timeout: float) -> None:
        """Handles all received messages; waits for the first for at most `timeout` s.

        Raises:
            BusError: if reading fails.
        """
        remaining = max(0.0, 1e3 * timeout)
        try:
            while self._waiting.poll(remaining):
                self._connection.handle()
                remaining = 0.0
        except OSError as error:
            raise BusError(f"LCM cannot be read ({error}).") from None

    def take(self) -> HandSensesMessage | None:
        """Takes the newest message of the senses; None if there is no new one."""
        newest, self._newest = self._newest, None
        return newest

    def take_vision(self, utime: int) -> ObjectPoseMessage | None:
        """Takes the newest message of vision; None if there is no new one.

        Args:
            utime: time of the senses that it is used with. A message that is newer than they are, by up to half a
                second, is kept for later senses.
        """
        return self._pictures.take(utime)

    def take_remarks(self) -> tuple[str, ...]:
        """Takes the remarks."""
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
            if message.is_late_after(self._last.utime, self._last.sequence):
                self.passed_over += 1
                return
            self._count(message.sequence - self._last.sequence)
        if self._newest is not None:
            self.passed_over += 1
        self._last = self._newest = message

    def _count(self, step: int) -> None:
        """Counts the messages that are missing between two consecutive ones."""
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


def _weak(method: Callable[[str, bytes], None]) -> Callable[[str, bytes], None]:
    """A handler that does not keep the method's inbox.

    The garbage collector does not see the handlers that a connection keeps. If they kept the inbox, which keeps the
    connection, its sockets and threads would stay for as long as the process lives.
    """
    weak_method = weakref.WeakMethod(method)

    def handle(channel: str, data: bytes) -> None:
        if (known := weak_method()) is not None:
            known(channel, data)

    return handle
