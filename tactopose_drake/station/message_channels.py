"""Configuration of the messages that a run receives and sends over LCM and ROS 2; only data."""

import dataclasses
import re
from collections.abc import Mapping

from tactopose_drake.core.validation import known_name, positive_number, whole_number
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.hand_config import HandConfig


@dataclasses.dataclass(kw_only=True, slots=True)
class LcmSenses:
    """Senses from another process by LCM messages `lcmt_hand_senses`, `!LcmSenses` in YAML."""

    url: str = ""  # LCM's URL; has no default, because LCM's sockets are open to other machines, too
    channel: str = "HAND_SENSES"  # of `lcmt_hand_senses`
    vision: str = ""  # channel of `lcmt_object_pose`; empty: there is no vision
    max_age: float = 0.1  # age from which a message is stale, and after which the belief's status is "lost", s

    def validate(self) -> None:
        """Raises InvalidInputError if a value is out of its range."""
        _check_lcm("LcmSenses", self.url, self.channel)
        _check_different("channel", self.channels())
        positive_number("LcmSenses.max_age", self.max_age)

    def channels(self) -> dict[str, str]:
        """The channels that are received, by their keys."""
        return {"LcmSenses.channel": self.channel} | ({"LcmSenses.vision": self.vision} if self.vision else {})


@dataclasses.dataclass(kw_only=True, slots=True)
class LcmPublishing:
    """Publishing of the belief by LCM messages `lcmt_object_belief`, `!LcmPublishing` in YAML."""

    url: str = ""  # LCM's URL; has no default, because LCM's sockets are open to other machines, too
    channel: str = "OBJECT_BELIEF"  # of `lcmt_object_belief`
    max_modes: int = 8  # largest number of modes in a message, the most probable ones

    def validate(self) -> None:
        """Raises InvalidInputError if a value is out of its range."""
        _check_lcm("LcmPublishing", self.url, self.channel)
        whole_number("LcmPublishing.max_modes", self.max_modes, least=1)


@dataclasses.dataclass(kw_only=True, slots=True)
class Ros2Senses:
    """Senses by messages of ROS 2, `!Ros2Senses` in YAML; the belief is updated for each joint state."""

    domain: int = 0  # ROS_DOMAIN_ID
    config: str = ""  # path of an XML configuration of CycloneDDS; empty: this machine only
    joints: str = "/joint_states"  # topic of sensor_msgs/JointState, by the names in the hand's model, rad
    # Topics of geometry_msgs/WrenchStamped by the hand's fingers: F_S on the fingertip in its sensor's frame, N, N m.
    wrenches: dict[str, str] = dataclasses.field(default_factory=dict)
    # Topics of std_msgs/Float64MultiArray by the hand's pads: pressures of the cells in the layout's order, Pa.
    pressures: dict[str, str] = dataclasses.field(default_factory=dict)
    vision: str = ""  # topic of geometry_msgs/PoseWithCovarianceStamped, in the palm; empty: there is no vision
    # Age from which a wrench or pressure is stale; without joint states for longer, the belief's status is "lost", s.
    max_age: float = 0.1

    def validate(self, hand: HandConfig) -> None:
        """Raises InvalidInputError if a value is out of its range, or the hand lacks a finger or pad."""
        _check_domain("Ros2Senses.domain", self.domain)
        positive_number("Ros2Senses.max_age", self.max_age)
        pads = [pad.name for pad in hand.pads]
        for what, given, known in (("wrenches", self.wrenches, hand.sensing), ("pressures", self.pressures, pads)):
            for name in given:
                known_name(f"each name in Ros2Senses.{what}", name, known)
        for key, topic in self.topics().items():
            _check_topic(key, topic)
        _check_different("topic", self.topics())
        if not self.wrenches and not self.pressures:
            raise InvalidInputError("Ros2Senses must have wrenches, pressures or both, but has neither.")

    def topics(self) -> dict[str, str]:
        """The topics that are received, by their keys."""
        named = {"wrenches": self.wrenches, "pressures": self.pressures}
        topics = {"Ros2Senses.joints": self.joints} | ({"Ros2Senses.vision": self.vision} if self.vision else {})
        return topics | {
            f"Ros2Senses.{kind}[{name}]": topic for kind, each in named.items() for name, topic in each.items()
        }


@dataclasses.dataclass(kw_only=True, slots=True)
class Ros2Publishing:
    """Publishing of the belief by messages of ROS 2, `!Ros2Publishing` in YAML."""

    domain: int = 0  # ROS_DOMAIN_ID
    config: str = ""  # path of an XML configuration of CycloneDDS; empty: this machine only
    pose: str = "/object_pose"  # topic of geometry_msgs/PoseWithCovarianceStamped, of the best mode
    markers: str = "/object_markers"  # topic of visualization_msgs/MarkerArray: the mesh at each mode
    status: str = "/object_status"  # topic of std_msgs/String
    frame: str = "palm"  # name of the palm's frame P in the messages
    max_modes: int = 8  # largest number of modes that are shown, the most probable ones

    def validate(self) -> None:
        """Raises InvalidInputError if a value is out of its range."""
        _check_domain("Ros2Publishing.domain", self.domain)
        for key, topic in self.topics().items():
            _check_topic(key, topic)
        _check_different("topic", self.topics())
        whole_number("Ros2Publishing.max_modes", self.max_modes, least=1)

    def topics(self) -> dict[str, str]:
        """The topics that are published, by their keys."""
        return {f"Ros2Publishing.{key}": getattr(self, key) for key in ("pose", "markers", "status")}


def check_apart(senses: object, publish: object) -> None:
    """Raises InvalidInputError if the belief would be published on a channel or topic of the senses."""
    if isinstance(senses, LcmSenses) and isinstance(publish, LcmPublishing) and senses.url == publish.url:
        _check_different("channel", {**senses.channels(), "LcmPublishing.channel": publish.channel})
    if isinstance(senses, Ros2Senses) and isinstance(publish, Ros2Publishing) and senses.domain == publish.domain:
        _check_different("topic", senses.topics() | publish.topics())


def _check_domain(name: str, domain: int) -> None:
    whole_number(name, domain, least=0, most=232)


def _check_lcm(name: str, url: str, channel: str) -> None:
    if not url:
        raise InvalidInputError(
            f"{name}.url must be LCM's, such as udpm://239.255.76.67:7667?ttl=0, which accepts messages from any "
            "machine that can send to the group, not empty."
        )
    if not channel:
        raise InvalidInputError(f"{name}.channel must be a text, not empty.")


def _check_topic(name: str, topic: str) -> None:
    if not re.fullmatch(r"(/[A-Za-z_][A-Za-z0-9_]*)+", topic):
        raise InvalidInputError(f"{name} must be a topic such as /hand/joint_states, not {topic!r}.")


def _check_different(kind: str, names: Mapping[str, str]) -> None:
    """Raises InvalidInputError if a channel or topic is used twice."""
    keys: dict[str, str] = {}
    for key, name in names.items():
        if keys.setdefault(name, key) != key:
            raise InvalidInputError(f"{key} must be another {kind} than {keys[name]}, but both are {name!r}.")
