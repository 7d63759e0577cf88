"""Export of a recording as MCAP with ROS 2 messages, which Foxglove, PlotJuggler and rosbag2 open without a plugin."""

import heapq
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.writer import Writer
from pydrake.math import RigidTransform

from tactopose_drake.core.poses import make_poses, matrix_from_quaternion
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.drivers.ros2_messages import TRIANGLE_LIST, definition, encode
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.estimation.output_files import written_beside
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.hand.hand_in_plant import make_hand_plant, make_hand_with_shapes
from tactopose_drake.hand.joint_matrices import reading_offsets
from tactopose_drake.resources import fixed_pose
from tactopose_drake.runs.recorded_senses import RecordedRun
from tactopose_drake.runs.ros2_poses import ros_covariance, ros_pose, ros_xyz
from tactopose_drake.systems.signals import UNKNOWN_POSE, Signal
from tactopose_drake.visualization.body_meshes import BodyMeshes, Triangles

_OBJECT_COLOUR = (0.85, 0.55, 0.25)
_POSES_IN = {"true_pose": "", "palm_pose": "world"}  # frames of these poses; empty: the palm's
_UNKNOWN_COVARIANCE = np.full(36, np.nan)
_DELETE = 2  # action of a marker
_END_OF_STAMPS = 2**31  # end of `builtin_interfaces/Time`, s since the epoch


class _Message(NamedTuple):
    """A message at a time of the run, s."""

    time: float
    topic: str
    kind: str
    value: dict[str, Any]


def write_mcap(run: RecordedRun, path: Path) -> None:
    """Writes all senses and estimates, with the times of the run since the epoch.

    | topic | type |
    | --- | --- |
    | /joint_states | sensor_msgs/JointState, with the joints' names |
    | /wrench/<finger> | geometry_msgs/WrenchStamped, in the sensor's frame |
    | /pressure/<pad> | std_msgs/Float64MultiArray, Pa |
    | /prior | geometry_msgs/PoseWithCovarianceStamped, in the palm |
    | /object_pose | geometry_msgs/PoseWithCovarianceStamped, in the palm, of the best hypothesis |
    | /hypotheses | geometry_msgs/PoseArray, all of them by falling probability |
    | /true_pose | geometry_msgs/PoseStamped, of a simulation |
    | /palm_pose | geometry_msgs/PoseStamped, of the palm in the world, where an arm carries the hand |
    | /status, /sense_status | std_msgs/String |
    | /tracked_object_pose, /tracked_hypotheses, /tracked_status | the same of the belief over time |
    | /tf | tf2_msgs/TFMessage: the hand's links and frames by the joints, and the object by the best hypothesis |
    | /scene | visualization_msgs/MarkerArray: the shapes of hand and object, in the frames of /tf |

    In /tf, the hand's base is at the scenario's pose, even if an arm moves it. If a calibration has corrected the pose
    of a sensor, /tf has the corrected frame, too, and wrenches are in it. A held pose is written only once, at the time
    at which it was found. A pose that becomes unknown is written as NaN; of the object's, /hypotheses is then empty,
    and it is taken from /scene. Covariances follow ROS's convention: position, then rotation about the palm's axes, m
    and rad.

    Args:
        run: the recording.
        path: path of the file, which is replaced.

    Raises:
        InvalidFileError: if the file cannot be written.
        InvalidInputError: if the recording's times are beyond the range of ROS 2's stamps.
    """
    last = run.manifest.start + run.end
    if last >= _END_OF_STAMPS:
        raise InvalidInputError(
            f"Manifest.start must be early enough that the recording ends before {_END_OF_STAMPS} s since the epoch, "
            f"in 2038, where ROS 2's stamps end, not {run.manifest.start:.10g} s, with which it ends at {last:.10g} s."
        )
    with written_beside(path) as beside, beside.open("wb") as file:
        out = Writer(file)
        out.start(profile="ros2", library="tactopose_drake")
        schemas: dict[str, int] = {}
        channels: dict[str, int] = {}
        for number, (time, topic, kind, value) in enumerate(_messages(run)):
            package, name = kind.split("/")
            if kind not in schemas:
                schemas[kind] = out.register_schema(f"{package}/msg/{name}", "ros2msg", definition(kind).encode())
            if topic not in channels:
                channels[topic] = out.register_channel(topic, "cdr", schemas[kind], {"offered_qos_profiles": ""})
            stamp = _nanoseconds(run, time)
            out.add_message(channels[topic], stamp, encode(kind, value), stamp, number)
        scenario = run.manifest.scenario
        about = {"hand": scenario.hand, "object": scenario.object, "versions": json.dumps(run.manifest.versions)}
        out.add_metadata("tactopose_drake", about)
        out.finish()  # type: ignore[no-untyped-call]


def _nanoseconds(run: RecordedRun, time: float) -> int:
    """Time of the run in ns since the epoch; times before the run's start are moved to it."""
    return round(1e9 * run.manifest.start) + round(1e9 * max(time, 0.0))


def _messages(run: RecordedRun) -> Iterator[_Message]:
    """All messages in order of time, one by one: those of an hour would not fit in memory."""
    hand = _Hand(run)
    markers = _scene(run, hand, _header(run, 0.0, ""))
    parts = [
        iter([_marked(0.0, *markers)]),
        *(_of_signal(run, hand, name, signal) for name, signal in run.signals.items()),
        _of_estimates(run, hand.palm, markers[-1]),
    ]
    return heapq.merge(*parts, key=lambda message: message.time)


def _header(run: RecordedRun, time: float, frame: str) -> dict[str, Any]:
    seconds, rest = divmod(_nanoseconds(run, time), 10**9)
    return {"stamp": {"sec": seconds, "nanosec": rest}, "frame_id": frame}


def _of_signal(run: RecordedRun, hand: "_Hand", name: str, signal: Signal) -> Iterator[_Message]:
    """The messages of a signal, in order of time."""
    was_known = False
    for time, value in zip(signal.times, signal.values, strict=True):
        if value is None:
            if name == "prior" and was_known:
                yield _located(time, "/prior", _header(run, time, hand.palm))
            continue
        was_known = True
        if name == "joint_positions":
            state = {"header": _header(run, time, ""), "name": run.joints, "position": value}
            yield _Message(time, "/joint_states", "sensor_msgs/JointState", state)
            yield _tf(time, [_transform(_header(run, time, parent), *link) for parent, *link in hand.links(value)])
        elif name.startswith("wrench_"):
            finger = name.removeprefix("wrench_")
            wrench = {"torque": ros_xyz(value[:3]), "force": ros_xyz(value[3:])}
            stamped = {"header": _header(run, time, hand.sensor_frames[finger]), "wrench": wrench}
            yield _Message(time, f"/wrench/{finger}", "geometry_msgs/WrenchStamped", stamped)
        elif name.startswith("pressures_"):
            layout = {"dim": [{"label": "cell", "size": len(value), "stride": len(value)}]}
            array = {"layout": layout, "data": value}
            yield _Message(time, f"/pressure/{name.removeprefix('pressures_')}", "std_msgs/Float64MultiArray", array)
        elif isinstance(value, PosePrior):
            covariance = ros_covariance(np.diag(value.sigmas**2), value.mean[:, :3])
            yield _located(time, "/prior", _header(run, time, hand.palm), value.X_PO, covariance)
        elif name in _POSES_IN:
            stamped = {"header": _header(run, time, _POSES_IN[name] or hand.palm), "pose": ros_pose(value)}
            yield _Message(time, f"/{name}", "geometry_msgs/PoseStamped", stamped)


def _of_estimates(run: RecordedRun, palm: str, marker: dict[str, Any]) -> Iterator[_Message]:
    """The messages of the estimates, in order of time; `palm` is the name of P, `marker` is the object's."""
    said: dict[str, Any] = {}  # the last written hypotheses, by prefix
    gone = {"header": marker["header"], "ns": marker["ns"], "id": marker["id"], "action": _DELETE}
    is_shown = True
    for line in run.estimates:
        time = float(line["time"])
        for text in ("status", "sense_status", "tracked_status"):
            if text in line:
                yield _Message(time, f"/{text}", "std_msgs/String", {"data": str(line[text])})
        for prefix in ("", "tracked_"):
            hypotheses = line.get(f"{prefix}hypotheses")
            is_held = str(line.get(f"{prefix}status")).startswith("held") and hypotheses == said.get(prefix)
            is_lost = not hypotheses and bool(said.get(prefix))
            if hypotheses and not is_held:
                yield from _belief(time, prefix, _header(run, time, palm), hypotheses)
            elif is_lost:
                none = {"header": _header(run, time, palm)}
                yield _located(time, f"/{prefix}object_pose", none["header"])
                yield _Message(time, f"/{prefix}hypotheses", "geometry_msgs/PoseArray", none)
            if not prefix and (is_lost if is_shown else hypotheses):
                yield _marked(time, gone if is_shown else marker)
                is_shown = not is_shown
            said[prefix] = hypotheses


def _belief(time: float, prefix: str, header: dict[str, Any], hypotheses: list[dict[str, Any]]) -> Iterator[_Message]:
    """Messages of hypotheses; `prefix` is that of their topics and of the object's frame."""
    poses, covariance = [_recorded_pose(hypothesis) for hypothesis in hypotheses], np.array(hypotheses[0]["covariance"])
    of_ros = ros_covariance(covariance, poses[0].rotation().matrix())
    yield _located(time, f"/{prefix}object_pose", header, poses[0], of_ros)
    array = {"header": header, "poses": [ros_pose(X_PO) for X_PO in poses]}
    yield _Message(time, f"/{prefix}hypotheses", "geometry_msgs/PoseArray", array)
    yield _tf(time, [_transform(header, f"{prefix}object", poses[0])])


class _Hand:
    """Frames and shapes of the recording's hand.

    Attributes:
        palm, sensor_frames: name of P, and names of the sensors' frames by finger.
        shapes: names of links with their triangles.
    """

    def __init__(self, run: RecordedRun) -> None:
        scenario = run.manifest.scenario
        config = scenario.hand_config()
        self._known_plant, known = make_hand_plant(config)
        self._offsets = reading_offsets(self._known_plant, known)
        X_WBase = fixed_pose("Scenario.X_WBase", scenario.X_WBase)
        self._plant, inspector, hand = make_hand_with_shapes(config, X_WBase)
        meshes = BodyMeshes.from_inspector(self._plant, inspector, hand.model_instance)
        self._context = self._plant.CreateDefaultContext()
        self._bodies = [self._plant.get_body(index) for index in self._plant.GetBodyIndices(hand.model_instance)]
        names = {int(body.index()): body.name() for body in self._bodies}
        self.shapes = [(names[body], mesh) for body, mesh in zip(meshes.body, meshes.meshes, strict=True)]
        links = set(names.values())
        told = (hand.palm_frame, *hand.sensor_frames.values(), *known.sensor_frames.values())
        self._frames = {frame.name(): frame for frame in told if frame.name() not in links}
        self.palm = hand.palm_frame.name()
        self.sensor_frames = {finger: frame.name() for finger, frame in known.sensor_frames.items()}

    def links(self, q: FloatArray) -> Iterator[tuple[str, str, RigidTransform]]:
        """Yields parent, child, and pose of each link in the world and of each further frame in its link.

        Joint readings are corrected by the hand's calibration; unknown ones count as 0.
        """
        self._plant.SetPositions(self._context, np.nan_to_num(q - self._offsets))
        for body in self._bodies:
            yield "world", body.name(), body.EvalPoseInWorld(self._context)
        for name, frame in self._frames.items():
            yield frame.body().name(), name, frame.GetFixedPoseInBodyFrame()


def _scene(run: RecordedRun, hand: _Hand, header: dict[str, Any]) -> list[dict[str, Any]]:
    """Markers of the hand's links and of the object."""
    model = run.manifest.scenario.object_model()
    colour = np.tile(_OBJECT_COLOUR, (len(model.vertices), 1))
    shapes = [*hand.shapes, ("object", Triangles(model.vertices, model.faces, colour))]
    return [
        {
            "header": {**header, "frame_id": link},
            "ns": "object" if link == "object" else "hand",
            "id": number,
            "type": TRIANGLE_LIST,
            "pose": ros_pose(RigidTransform()),
            "scale": ros_xyz(np.ones(3)),
            "color": dict(zip("rgba", (*mesh.colour[0].tolist(), 1.0), strict=True)),
            "frame_locked": True,
            "points": np.asarray(mesh.vertices[mesh.faces].reshape(-1, 3)),
        }
        for number, (link, mesh) in enumerate(shapes)
    ]


def _marked(time: float, *markers: dict[str, Any]) -> _Message:
    return _Message(time, "/scene", "visualization_msgs/MarkerArray", {"markers": markers})


def _located(
    time: float,
    topic: str,
    header: dict[str, Any],
    X: RigidTransform = UNKNOWN_POSE,
    covariance: FloatArray = _UNKNOWN_COVARIANCE,
) -> _Message:
    """A message of a pose with its covariance by ROS's convention; without them it says that they are unknown."""
    pose = {"pose": ros_pose(X), "covariance": covariance}
    return _Message(time, topic, "geometry_msgs/PoseWithCovarianceStamped", {"header": header, "pose": pose})


def _tf(time: float, transforms: list[dict[str, Any]]) -> _Message:
    return _Message(time, "/tf", "tf2_msgs/TFMessage", {"transforms": transforms})


def _transform(header: dict[str, Any], child: str, X: RigidTransform) -> dict[str, Any]:
    pose = ros_pose(X)
    return {
        "header": header,
        "child_frame_id": child,
        "transform": {"translation": pose["position"], "rotation": pose["orientation"]},
    }


def _recorded_pose(hypothesis: dict[str, Any]) -> RigidTransform:
    R_PO = matrix_from_quaternion(np.array(hypothesis["quaternion_wxyz"]))
    return RigidTransform(make_poses(R_PO, np.array(hypothesis["translation"])))
