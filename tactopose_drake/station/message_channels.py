"""What a run hears from other processes and sends them, over LCM and ROS 2; only data."""

import dataclasses
import re
from collections.abc import Mapping

from tactopose_drake.core.validation import positive_number, whole_number
from tactopose_drake.errors import InvalidInputError, UnknownNameError
from tactopose_drake.hand.hand_config import HandConfig


@dataclasses.dataclass(kw_only=True, slots=True)
class LcmSenses:
    """Another process, which sends messages `lcmt_hand_senses` over LCM, `!LcmSenses` in YAML."""

    url: str = ""  # LCM's, to be named: its sockets are open to other machines, too
    channel: str = "HAND_SENSES"  # of `lcmt_hand_senses`
    vision: str = ""  # channel of `lcmt_object_pose`; empty: there is no vision
    max_age: float = 0.1  # of a message; after a longer silence the belief is called lost, s

    def validate(self) -> None:
        """Raises InvalidInputError if a value is out of its range."""
        _check_lcm("LcmSenses", self.url, self.channel)
        _check_different("channel", self.channels())
        positive_number("LcmSenses.max_age", self.max_age)

    def channels(self) -> dict[str, str]:
        """The channels that are heard, by their keys."""
        return {"LcmSenses.channel": self.channel} | ({"LcmSenses.vision": self.vision} if self.vision else {})


@dataclasses.dataclass(kw_only=True, slots=True)
class LcmPublishing:
    """Where a run sends what is believed, as messages `lcmt_object_belief` over LCM, `!LcmPublishing` in YAML."""

    url: str = ""  # LCM's, to be named: its sockets are open to other machines, too
    channel: str = "OBJECT_BELIEF"  # of `lcmt_object_belief`
    max_modes: int = 8  # that a message has, the most probable ones

    def validate(self) -> None:
        """Raises InvalidInputError if a value is out of its range."""
        _check_lcm("LcmPublishing", self.url, self.channel)
        whole_number("LcmPublishing.max_modes", self.max_modes, least=1)


@dataclasses.dataclass(kw_only=True, slots=True)
class Ros2Senses:
    """Messages of ROS 2, `!Ros2Senses` in YAML; a belief is made for each joint state."""

    domain: int = 0  # ROS_DOMAIN_ID
    config: str = ""  # path of CycloneDDS' own XML file; empty: for this machine alone
    joints: str = "/joint_states"  # topic of sensor_msgs/JointState, by the names in the hand's model, rad
    # Topics of geometry_msgs/WrenchStamped by the hand's fingers: F_S on the fingertip in its sensor's frame, N, N m.
    wrenches: dict[str, str] = dataclasses.field(default_factory=dict)
    # Topics of std_msgs/Float64MultiArray by the hand's pads: of the cells in the layout's order, Pa.
    pressures: dict[str, str] = dataclasses.field(default_factory=dict)
    vision: str = ""  # topic of geometry_msgs/PoseWithCovarianceStamped, in the palm; empty: there is no vision
    max_age: float = 0.1  # of a wrench or pressure; after a longer silence of the joints the belief is called lost, s

    def validate(self, hand: HandConfig) -> None:
        """Raises InvalidInputError if a value is out of its range, or a finger or pad is not of the hand."""
        _check_domain("Ros2Senses.domain", self.domain)
        positive_number("Ros2Senses.max_age", self.max_age)
        sensing = [finger.name for finger in hand.fingers if finger.sensor_frame]
        pads = [pad.name for pad in hand.pads]
        for what, given, known in (("wrenches", self.wrenches, sensing), ("pressures", self.pressures, pads)):
            for name in given:
                if name not in known:
                    raise UnknownNameError(f"Ros2Senses.{what}", name, known)
        for key, topic in self.topics().items():
            _check_topic(key, topic)
        _check_different("topic", self.topics())
        if not self.wrenches and not self.pressures:
            raise InvalidInputError("Ros2Senses: has neither wrenches nor pressures; allowed are one or both.")

    def topics(self) -> dict[str, str]:
        """The topics that are heard, by their keys."""
        named = {"wrenches": self.wrenches, "pressures": self.pressures}
        topics = {"Ros2Senses.joints": self.joints} | ({"Ros2Senses.vision": self.vision} if self.vision else {})
        return topics | {
            f"Ros2Senses.{kind}[{name}]": topic for kind, each in named.items() for name, topic in each.items()
        }


@dataclasses.dataclass(kw_only=True, slots=True)
class Ros2Publishing:
    """Where a run sends what is believed, as messages of ROS 2, `!Ros2Publishing` in YAML."""

    domain: int = 0  # ROS_DOMAIN_ID
    config: str = ""  # path of CycloneDDS' own XML file; empty: for this machine alone
    pose: str = "/object_pose"  # topic of geometry_msgs/PoseWithCovarianceStamped, of the best mode
    markers: str = "/object_markers"  # topic of visualization_msgs/MarkerArray: the mesh at each mode
    status: str = "/object_status"  # topic of std_msgs/String
    frame: str = "palm"  # what the palm's frame P is called there
    max_modes: int = 8  # that are shown, the most probable ones

    def validate(self) -> None:
        """Raises InvalidInputError if a value is out of its range."""
        _check_domain("Ros2Publishing.domain", self.domain)
        for key, topic in self.topics().items():
            _check_topic(key, topic)
        _check_different("topic", self.topics())
        whole_number("Ros2Publishing.max_modes", self.max_modes, least=1)

    def topics(self) -> dict[str, str]:
        """The topics that are sent to, by their keys."""
        return {f"Ros2Publishing.{key}": getattr(self, key) for key in ("pose", "markers", "status")}


def check_apart(senses: object, publish: object) -> None:
    """Raises InvalidInputError if what is believed were sent where the senses are heard."""
    if isinstance(senses, LcmSenses) and isinstance(publish, LcmPublishing) and senses.url == publish.url:
        _check_different("channel", {**senses.channels(), "LcmPublishing.channel": publish.channel})
    if isinstance(senses, Ros2Senses) and isinstance(publish, Ros2Publishing) and senses.domain == publish.domain:
        _check_different("topic", senses.topics() | publish.topics())


def _check_domain(name: str, domain: int) -> None:
    whole_number(name, domain, least=0, most=232)


def _check_lcm(name: str, url: str, channel: str) -> None:
    if not url:
        raise InvalidInputError(
            f"{name}.url: is not given; allowed is LCM's, such as udpm://239.255.76.67:7667?ttl=0, on which this "
            "machine hears any that can send to the group."
        )
    if not channel:
        raise InvalidInputError(f"{name}.channel: is empty; allowed is a text.")


def _check_topic(name: str, topic: str) -> None:
    if not re.fullmatch(r"(/[A-Za-z_][A-Za-z0-9_]*)+", topic):
        raise InvalidInputError(f"{name}: the topic is {topic!r}; allowed are names such as /hand/joint_states.")


def _check_different(kind: str, names: Mapping[str, str]) -> None:
    """What comes by one name could not be told apart."""
    keys: dict[str, str] = {}
    for key, name in names.items():
        if keys.setdefault(name, key) != key:
            raise InvalidInputError(f"{key}: is the {kind} {name!r}, as is {keys[name]}; allowed are different ones.")
