"""Messages and definitions against those of rosbags, which knows ROS 2's own."""

import numpy as np
import pytest

from tactopose_drake.drivers import ros2_messages
from tactopose_drake.drivers.ros2_messages import definition, encode

rosbags_types = pytest.importorskip("rosbags.typesys")
STORE = rosbags_types.get_typestore(rosbags_types.Stores.ROS2_HUMBLE)

HEADER = {"stamp": {"sec": 5, "nanosec": 7}, "frame_id": "palm ä"}
POSE = {"position": {"x": 1.0, "y": 2.0, "z": 3.0}, "orientation": {"w": 1.0}}
MESSAGES = {
    "std_msgs/String": {"data": "lost: nothing"},
    "std_msgs/Float64MultiArray": {"layout": {"dim": [{"label": "cell", "size": 2}]}, "data": np.array([1.0, np.nan])},
    "geometry_msgs/PoseStamped": {"header": HEADER, "pose": POSE},
    "geometry_msgs/PoseArray": {"header": HEADER, "poses": [POSE, POSE]},
    "geometry_msgs/PoseWithCovarianceStamped": {
        "header": HEADER,
        "pose": {"pose": POSE, "covariance": np.arange(36.0)},
    },
    "geometry_msgs/WrenchStamped": {"header": HEADER, "wrench": {"force": {"z": -2.0}}},
    "sensor_msgs/JointState": {"header": HEADER, "name": ("a", "bc"), "position": np.array([0.1, 0.2])},
    "tf2_msgs/TFMessage": {"transforms": [{"header": HEADER, "child_frame_id": "x"}, {"header": HEADER}]},
    "visualization_msgs/MarkerArray": {
        "markers": [
            {"header": HEADER, "ns": "hand", "type": 11, "color": {"a": 1.0}, "points": np.arange(9.0).reshape(3, 3)},
            {"ns": "", "frame_locked": True},
        ]
    },
}


@pytest.mark.parametrize("kind", MESSAGES)
def test_what_is_written_is_what_ros_2_writes(kind: str) -> None:
    data, name = encode(kind, MESSAGES[kind]), kind.replace("/", "/msg/")
    message = STORE.deserialize_cdr(data, name)
    # Past the last member some pad to four bytes, and some do not.
    assert bytes(STORE.serialize_cdr(message, name)).rstrip(b"\0") == data.rstrip(b"\0")


def test_fields_are_where_they_belong() -> None:
    kind = "geometry_msgs/PoseWithCovarianceStamped"
    message = STORE.deserialize_cdr(encode(kind, MESSAGES[kind]), kind.replace("/", "/msg/"))
    assert (message.header.stamp.sec, message.header.stamp.nanosec, message.header.frame_id) == (5, 7, "palm ä")
    assert (message.pose.pose.position.y, message.pose.pose.orientation.w) == (2.0, 1.0)
    np.testing.assert_array_equal(message.pose.covariance, np.arange(36.0))
    markers = STORE.deserialize_cdr(
        encode("visualization_msgs/MarkerArray", MESSAGES["visualization_msgs/MarkerArray"]),
        "visualization_msgs/msg/MarkerArray",
    ).markers
    assert [point.z for point in markers[0].points] == [2.0, 5.0, 8.0]
    assert markers[1].frame_locked


@pytest.mark.parametrize("kind", ros2_messages._DEFINITIONS)
def test_definitions_are_those_of_ros_2(kind: str) -> None:
    theirs, _ = STORE.generate_msgdef(kind.replace("/", "/msg/"), ros_version=2)

    def parts(text: str) -> set[str]:
        fields = [line for line in text.splitlines() if "=0" not in line and not _is_constant(line)]
        return {part.strip() for part in "\n".join(fields).split("=" * 80)}

    assert parts(definition(kind)) == parts(theirs)


def _is_constant(line: str) -> bool:
    return "=" in line and not line.startswith("=")
