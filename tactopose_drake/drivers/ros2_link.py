"""ROS 2 messages over DDS, with CycloneDDS and without an installation of ROS 2.

ROS 2's topic `/joint_states` is `rt/joint_states` in DDS, and its type `sensor_msgs/JointState` is
`sensor_msgs::msg::dds_::JointState_`. The package `cyclonedds` is needed only to open a link.
"""

import functools
import importlib
import math
import struct
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tactopose_drake.core.validation import whole_number
from tactopose_drake.drivers.ros2_messages import fields_of, is_message
from tactopose_drake.errors import BusError, InvalidFileError, InvalidInputError

_THIS_MACHINE = """<CycloneDDS><Domain><General>
<Interfaces><NetworkInterface address="127.0.0.1" multicast="false"/></Interfaces>
<AllowMulticast>false</AllowMulticast></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>30</MaxAutoParticipantIndex>
<Peers><Peer address="127.0.0.1"/></Peers></Discovery></Domain></CycloneDDS>"""
_DEPTH = 10  # number of messages that a topic keeps
_MOST_DOMAIN = 232  # larger domains have no valid UDP ports

# A process opens each domain once, with the first configuration.
_domains: dict[int, tuple[str, Any]] = {}


class Ros2Link:
    """A participant in a DDS domain, with its subscriptions and publishers.

    Attributes:
        damaged: topics of received messages that could not be decoded, in their order; the messages are ignored.
    """

    def __init__(self, domain: int = 0, config: str = "") -> None:
        """Joins the domain.

        Args:
            domain: ROS_DOMAIN_ID.
            config: path of a CycloneDDS XML file; if empty, all communication stays on this machine.

        Raises:
            InvalidInputError: if the package `cyclonedds` is not installed, the domain is out of range, or this process
                has opened it with another configuration.
            InvalidFileError: if the file cannot be read.
            BusError: if the domain cannot be joined, or other code in this process has opened it.
        """
        whole_number("ROS 2: domain", domain, least=0, most=_MOST_DOMAIN)
        self._dds = _import_dds()
        self._fault = self._dds["core"].DDSException
        _open_domain(self._dds, domain, config)
        try:
            self._participant = self._dds["domain"].DomainParticipant(domain)
            self._waiting = self._dds["core"].WaitSet(self._participant)
        except self._fault as error:
            raise BusError(f"ROS 2: the domain {domain} cannot be joined ({error}).") from None
        # Each reader, its condition, which must be kept alive, and its handler.
        self._heard: list[tuple[Any, Any, Callable[[Any], None]]] = []
        self.damaged: list[str] = []

    def subscribe(self, topic: str, kind: str, handler: Callable[[Any], None]) -> None:
        """Calls a handler with each message, whose fields are its attributes.

        Args:
            topic: the topic, such as /joint_states.
            kind: its type, such as "sensor_msgs/JointState".
            handler: the handler, which `wait` calls.

        Raises:
            InvalidInputError: if the topic is not a valid name.
        """
        dds, qos = self._dds, self._dds["qos"]
        # Best effort, as of most sensors; it also receives from reliable publishers.
        quality = qos.Qos(qos.Policy.Reliability.BestEffort, qos.Policy.History.KeepLast(_DEPTH))
        reader = self._made(lambda: dds["sub"].DataReader(self._participant, self._topic(topic, kind), qos=quality))
        any_new = dds["core"].InstanceState.Any | dds["core"].ViewState.Any | dds["core"].SampleState.NotRead
        condition = dds["core"].ReadCondition(reader, any_new)
        self._waiting.attach(condition)
        self._heard.append((reader, condition, handler))

    def publisher(self, topic: str, kind: str) -> Callable[[Mapping[str, Any]], None]:
        """A function that reliably sends messages, given as for `ros2_messages.encode`.

        Raises:
            InvalidInputError: if the topic is not a valid name.
        """
        qos = self._dds["qos"]
        quality = qos.Qos(
            qos.Policy.Reliability.Reliable(self._dds["util"].duration(milliseconds=100)),
            qos.Policy.History.KeepLast(_DEPTH),
        )
        writer = self._made(
            lambda: self._dds["pub"].DataWriter(self._participant, self._topic(topic, kind), qos=quality)
        )

        def send(value: Mapping[str, Any]) -> None:
            try:
                writer.write(message_of(kind, value))
            except self._fault as error:
                raise BusError(f"ROS 2: {topic} cannot be sent ({error}).") from None

        return send

    def wait(self, timeout: float) -> int:
        """Waits for a message for at most `timeout` s, handles all that have arrived, and returns their number.

        Raises:
            BusError: if reading fails.
        """
        count = 0
        try:
            self._waiting.wait(self._dds["util"].duration(nanoseconds=max(0, math.ceil(1e9 * timeout))))
            for reader, _, handler in self._heard:
                for sample in self._taken(reader):
                    handler(sample)
                    count += 1
        except self._fault as error:
            raise BusError(f"ROS 2 cannot be read ({error}).") from None
        return count

    def _taken(self, reader: Any) -> list[Any]:
        """The messages that have arrived, read one by one, so that a damaged one does not affect the others."""
        found: list[Any] = []
        for _ in range(_DEPTH):
            try:
                samples = reader.take(N=1)
            except (ValueError, IndexError, struct.error):  # such as text that is not UTF-8
                self.damaged.append(reader.topic.name.removeprefix("rt"))
                continue
            if not samples:
                break
            found += [sample for sample in samples if sample.sample_info.valid_data]
        return found

    def _topic(self, topic: str, kind: str) -> Any:
        if not topic.startswith("/") or topic.endswith("/"):
            raise InvalidInputError(
                f"ROS 2: a topic must be a name that begins with a slash and ends without, not {topic!r}."
            )
        return self._dds["topic"].Topic(self._participant, f"rt{topic}", message_type(kind))

    def _made(self, make: Callable[[], Any]) -> Any:
        try:
            return make()
        except self._fault as error:
            raise BusError(f"ROS 2: a topic cannot be opened ({error}).") from None


def _import_dds() -> dict[str, Any]:
    """The modules of `cyclonedds`, by name."""
    try:
        return {
            name: importlib.import_module(f"cyclonedds.{name}")
            for name in ("core", "domain", "idl", "pub", "qos", "sub", "topic", "util")
        }
    except ModuleNotFoundError:
        raise InvalidInputError(
            "ROS 2: the package cyclonedds is not installed; `pip install tactopose_drake[ros2]` installs it."
        ) from None


def _open_domain(dds: dict[str, Any], number: int, config: str) -> None:
    """Opens a domain in this process, unless it is open already."""
    if number in _domains:
        if _domains[number][0] != config:
            raise InvalidInputError(f"ROS 2: config must be that with which the domain {number} is open already.")
        return
    try:
        text = Path(config).read_text(encoding="ascii") if config else _THIS_MACHINE
    except (OSError, UnicodeError, ValueError) as error:
        raise InvalidFileError(f"{config} cannot be read ({getattr(error, 'strerror', None) or error}).") from None
    try:
        _domains[number] = config, dds["domain"].Domain(number, text)
    except dds["core"].DDSException as error:
        raise BusError(f"ROS 2: the domain {number} cannot be opened ({error}).") from None


@functools.cache
def message_type(kind: str) -> Any:
    """The DDS class of a message type such as "sensor_msgs/JointState"."""
    idl, types = (importlib.import_module(f"cyclonedds.idl{part}") for part in ("", ".types"))
    final = importlib.import_module("cyclonedds.idl.annotations").final
    numbers = {"bool": bool, "uint8": types.uint8, "int32": types.int32, "uint32": types.uint32, "string": str}
    numbers |= {"float32": types.float32, "float64": types.float64}
    fields: dict[str, Any] = {}
    for part, length, name in fields_of(kind):
        one = message_type(part) if is_message(part) else numbers[part]
        fields[name] = one if length is None else types.sequence[one] if length == "" else types.array[one, int(length)]
    package, name = kind.split("/")
    return final(idl.make_idl_struct(f"{name}_", f"{package}::msg::dds_::{name}_", fields))


def message_of(kind: str, value: Mapping[str, Any]) -> Any:
    """A message of that class; missing fields are zero or empty.

    Args:
        kind: its type.
        value: its fields by name; lists of points may be arrays (n, 3).
    """
    return message_type(kind)(**{name: _part(part, length, value.get(name)) for part, length, name in fields_of(kind)})


def _part(part: str, length: str | None, given: Any) -> Any:
    if length is None:
        if is_message(part):
            return message_of(part, {} if given is None else given)
        return {"string": "", "bool": False}.get(part, 0) if given is None else given
    if given is None:
        return [] if length == "" else [0.0] * int(length)
    if not is_message(part):
        return np.asarray(given).tolist() if isinstance(given, np.ndarray) else list(given)
    names = [name for _, _, name in fields_of(part)]
    return [
        message_of(part, item if isinstance(item, Mapping) else dict(zip(names, item.tolist(), strict=True)))
        for item in given
    ]


def stamp_of(seconds: float) -> dict[str, int]:
    """The stamp of a message's header, for a time in s."""
    whole, rest = divmod(round(1e9 * seconds), 10**9)
    return {"sec": whole, "nanosec": rest}


def seconds_of(stamp: Any) -> float:
    """The time, s, of the stamp of a message's header."""
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)
