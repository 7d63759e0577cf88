"""ROS 2's messages over DDS: their bytes, and two participants on this machine."""

import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tactopose_drake.drivers.ros2_link import Ros2Link, message_of, message_type, seconds_of, stamp_of
from tactopose_drake.drivers.ros2_messages import encode
from tactopose_drake.errors import InvalidFileError, InvalidInputError
from tests.drivers.test_ros2_messages import MESSAGES, STORE

pytest.importorskip("cyclonedds")
DOMAIN = 100 + os.getpid() % 100  # of this test alone


@pytest.mark.parametrize("kind", MESSAGES)
def test_messages_have_the_bytes_of_ros_2(kind: str) -> None:
    name = kind.replace("/", "/msg/")
    data = bytes(message_of(kind, MESSAGES[kind]).serialize())
    assert data.rstrip(b"\0") == encode(kind, MESSAGES[kind]).rstrip(b"\0")
    message = STORE.deserialize_cdr(data, name)
    assert bytes(message_type(kind).deserialize(bytes(STORE.serialize_cdr(message, name))).serialize()) == data


def test_topics_and_types_are_called_as_ros_2_calls_them() -> None:
    """As any participant that knows nothing of this package sees them."""
    from cyclonedds.domain import DomainParticipant
    from cyclonedds.sub import DataReader
    from cyclonedds.topic import Topic

    link = Ros2Link(DOMAIN)
    topic = Topic(DomainParticipant(DOMAIN), "rt/hand/status", message_type("std_msgs/String"))
    assert topic.typename == "std_msgs::msg::dds_::String_"
    reader = DataReader(topic.participant, topic)
    heard: list[Any] = []
    end = time.monotonic() + 20.0
    send = link.publisher("/hand/status", "std_msgs/String")
    while not heard and time.monotonic() < end:
        send({"data": "ok"})
        time.sleep(0.05)
        heard = reader.take(1)
    assert heard[0].data == "ok"


def sent(link: Ros2Link, send: Any, value: Mapping[str, Any], heard: list[Any]) -> Any:
    """Sends until it is heard: participants find each other meanwhile."""
    end = time.monotonic() + 20.0
    while not heard and time.monotonic() < end:
        send(value)
        link.wait(0.1)
    return heard[0]


def test_what_one_participant_says_another_hears() -> None:
    speaker, listener = Ros2Link(DOMAIN), Ros2Link(DOMAIN)
    heard: list[Any] = []
    listener.subscribe("/hand/joint_states", "sensor_msgs/JointState", heard.append)
    send = speaker.publisher("/hand/joint_states", "sensor_msgs/JointState")
    header = {"stamp": stamp_of(12.25), "frame_id": "palm ä"}
    state = {"header": header, "name": ["a", "bc"], "position": np.array([0.1, np.nan])}
    said = sent(listener, send, state, heard)
    assert (seconds_of(said.header.stamp), said.header.frame_id) == (12.25, "palm ä")
    assert said.name == ["a", "bc"]
    np.testing.assert_array_equal(said.position, [0.1, np.nan])
    assert any(not listener.wait(0.05) for _ in range(100))  # once all is read


def test_a_damaged_message_is_left_out_and_the_next_is_heard() -> None:
    from cyclonedds.domain import DomainParticipant
    from cyclonedds.pub import DataWriter
    from cyclonedds.topic import Topic

    listener = Ros2Link(DOMAIN)  # first: it keeps the domain on this machine
    kind, participant = message_type("std_msgs/String"), DomainParticipant(DOMAIN)
    writer = DataWriter(participant, Topic(participant, "rt/hand/text", kind))
    heard: list[Any] = []
    listener.subscribe("/hand/text", "std_msgs/String", lambda said: heard.append(said.data))
    damaged = kind(data="x")
    damaged.serialize = lambda *_, **__: b"\x00\x01\x00\x00\x04\x00\x00\x00\xff\xfe\xfd\x00"
    end = time.monotonic() + 20.0
    while not (heard and listener.damaged) and time.monotonic() < end:
        writer.write(damaged)
        writer.write(kind(data="sound"))
        listener.wait(0.1)
    assert set(heard) == {"sound"}
    assert set(listener.damaged) == {"/hand/text"}


def test_what_cannot_be_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="domain must be an integer from 0 to 232, not 300"):
        Ros2Link(300)
    link = Ros2Link(DOMAIN)
    with pytest.raises(InvalidInputError, match=r"a topic must be a name that begins with a slash .*, not 'joints'"):
        link.subscribe("joints", "sensor_msgs/JointState", print)
    with pytest.raises(InvalidInputError, match=r"config must be that with which the domain .* is open already"):
        Ros2Link(DOMAIN, str(tmp_path / "cyclone.xml"))
    with pytest.raises(InvalidFileError, match=r"none.xml cannot be read \(No such file"):
        Ros2Link(DOMAIN + 1, str(tmp_path / "none.xml"))


def test_without_the_package_it_says_what_brings_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "cyclonedds.core", None)
    with pytest.raises(InvalidInputError, match=r"pip install tactopose_drake\[ros2\]"):
        Ros2Link(DOMAIN)
