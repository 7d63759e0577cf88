"""The ROS 2 messages that are sent, received and exported: their definitions, and their encoding in CDR.

Sources: the interface definitions of ROS 2 (common_interfaces, rcl_interfaces, geometry2), which are the same from
Galactic on; OMG, Common Object Request Broker Architecture, part 2, 9.3 (CDR), little-endian.
"""

import functools
import re
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np

_DEFINITIONS = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "builtin_interfaces/Duration": "int32 sec\nuint32 nanosec",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "std_msgs/String": "string data",
    "std_msgs/ColorRGBA": "float32 r\nfloat32 g\nfloat32 b\nfloat32 a",
    "std_msgs/MultiArrayDimension": "string label\nuint32 size\nuint32 stride",
    "std_msgs/MultiArrayLayout": "std_msgs/MultiArrayDimension[] dim\nuint32 data_offset",
    "std_msgs/Float64MultiArray": "std_msgs/MultiArrayLayout layout\nfloat64[] data",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    "geometry_msgs/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
    "geometry_msgs/PoseStamped": "std_msgs/Header header\ngeometry_msgs/Pose pose",
    "geometry_msgs/PoseArray": "std_msgs/Header header\ngeometry_msgs/Pose[] poses",
    "geometry_msgs/PoseWithCovariance": "geometry_msgs/Pose pose\nfloat64[36] covariance",
    "geometry_msgs/PoseWithCovarianceStamped": "std_msgs/Header header\ngeometry_msgs/PoseWithCovariance pose",
    "geometry_msgs/Wrench": "geometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque",
    "geometry_msgs/WrenchStamped": "std_msgs/Header header\ngeometry_msgs/Wrench wrench",
    "geometry_msgs/Transform": "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation",
    "geometry_msgs/TransformStamped": (
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform"
    ),
    "sensor_msgs/JointState": (
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort"
    ),
    "sensor_msgs/CompressedImage": "std_msgs/Header header\nstring format\nuint8[] data",
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "visualization_msgs/UVCoordinate": "float32 u\nfloat32 v",
    "visualization_msgs/MeshFile": "string filename\nuint8[] data",
    "visualization_msgs/Marker": (
        "std_msgs/Header header\nstring ns\nint32 id\nint32 type\nint32 action\ngeometry_msgs/Pose pose\n"
        "geometry_msgs/Vector3 scale\nstd_msgs/ColorRGBA color\nbuiltin_interfaces/Duration lifetime\n"
        "bool frame_locked\ngeometry_msgs/Point[] points\nstd_msgs/ColorRGBA[] colors\nstring texture_resource\n"
        "sensor_msgs/CompressedImage texture\nvisualization_msgs/UVCoordinate[] uv_coordinates\nstring text\n"
        "string mesh_resource\nvisualization_msgs/MeshFile mesh_file\nbool mesh_use_embedded_materials"
    ),
    "visualization_msgs/MarkerArray": "visualization_msgs/Marker[] markers",
}
_FORMATS = {"bool": "?", "uint8": "B", "int32": "i", "uint32": "I", "float32": "f", "float64": "d"}
_FIELD = re.compile(r"([\w/]+?)(\[(\d*)\])? (\w+)")
_LITTLE_ENDIAN = b"\x00\x01\x00\x00"

TRIANGLE_LIST = 11
"""The type of a triangle list marker."""


def definition(kind: str) -> str:
    """The definition of a type in MCAP's `ros2msg` encoding: its own fields, then those of the nested types.

    Args:
        kind: the type, such as "geometry_msgs/Pose".
    """
    parts: dict[str, None] = {}

    def collect(of: str) -> None:
        for part, _, _ in fields_of(of):
            if part in _DEFINITIONS and part not in parts:
                parts[part] = None
                collect(part)

    collect(kind)
    texts = [_DEFINITIONS[kind], *(f"MSG: {part}\n{_DEFINITIONS[part]}" for part in parts)]
    return f"\n{80 * '='}\n".join(texts) + "\n"


def encode(kind: str, value: Mapping[str, Any]) -> bytes:
    """Encodes a message as ROS 2 does on the wire and in bags.

    Args:
        kind: its type, such as "geometry_msgs/Pose".
        value: its fields by name; lists of points may be arrays (n, 3), and missing fields are zero or empty.
    """
    out = bytearray()
    _write(out, kind, value)
    return _LITTLE_ENDIAN + bytes(out)


def is_message(part: str) -> bool:
    """Whether the type of a field is a message rather than a number or a string."""
    return part in _DEFINITIONS


@functools.cache
def fields_of(kind: str) -> tuple[tuple[str, str | None, str], ...]:
    """Type, length and name of each field; a length of None is a single value, and an empty one a sequence."""
    fields = []
    for line in _DEFINITIONS[kind].splitlines():
        match = _FIELD.fullmatch(line)
        assert match is not None
        part, is_list, length, name = match.groups()
        fields.append((part, length if is_list else None, name))
    return tuple(fields)


def _write(out: bytearray, kind: str, value: Mapping[str, Any]) -> None:
    for part, length, name in fields_of(kind):
        given = value.get(name)
        if length is None:
            _write_one(out, part, given)
            continue
        items = () if given is None else given
        if length == "":
            _write_one(out, "uint32", len(items))
        elif given is None:
            items = np.zeros(int(length))
        _write_items(out, part, items)


def _write_items(out: bytearray, part: str, items: Any) -> None:
    """Writes the elements of a list."""
    if isinstance(items, np.ndarray):  # of doubles, or of messages that consist of doubles
        if items.size:
            _align(out, 8)
            out.extend(items.astype("<f8").tobytes())
        return
    for item in items:
        _write_one(out, part, item)


def _write_one(out: bytearray, part: str, value: Any) -> None:
    if part == "string":
        data = ("" if value is None else value).encode() + b"\0"
        _write_one(out, "uint32", len(data))
        out.extend(data)
    elif part in _FORMATS:
        form = struct.Struct("<" + _FORMATS[part])
        _align(out, form.size)
        out.extend(form.pack(0 if value is None else value))
    else:
        _write(out, part, {} if value is None else value)


def _align(out: bytearray, size: int) -> None:
    out.extend(bytes(-len(out) % size))
