"""Publishes beliefs over ROS 2: the best pose with its covariance, all poses as markers, and the status."""

from pathlib import Path
from typing import Any

import numpy as np
from pydrake.math import RigidTransform

from tactopose_drake.core.poses import make_poses, matrix_from_quaternion
from tactopose_drake.drivers.lcm_messages import ObjectBeliefMessage
from tactopose_drake.drivers.ros2_link import Ros2Link, stamp_of
from tactopose_drake.runs.ros2_poses import ros_covariance, ros_pose, ros_xyz
from tactopose_drake.station.message_channels import Ros2Publishing

_MESH_RESOURCE, _ADD, _DELETE = 10, 0, 2  # of visualization_msgs/Marker
_COLOUR = {"r": 0.85, "g": 0.55, "b": 0.25}
_FAINTEST = 0.1


class Ros2Publisher:
    """Publishes beliefs on the topics of a scenario."""

    def __init__(self, params: Ros2Publishing, mesh: Path) -> None:
        """Joins the domain.

        Args:
            params: the topics.
            mesh: path of the object's mesh, for the markers.

        Raises:
            InvalidInputError: if the package `cyclonedds` is not installed.
            BusError: if the domain cannot be joined.
        """
        link = Ros2Link(params.domain, params.config)
        self.max_modes, self._frame = params.max_modes, params.frame
        self._mesh = mesh.absolute().as_uri()
        self._pose = link.publisher(params.pose, "geometry_msgs/PoseWithCovarianceStamped")
        self._markers = link.publisher(params.markers, "visualization_msgs/MarkerArray")
        self._status = link.publisher(params.status, "std_msgs/String")
        self._link = link  # Kept alive as long as its writers.

    def send(self, message: ObjectBeliefMessage) -> None:
        """Publishes a message; the pose only if there is one."""
        header = {"stamp": stamp_of(1e-6 * message.utime), "frame_id": self._frame}
        rotations = [matrix_from_quaternion(wxyz) for wxyz in message.quaternion_wxyz]
        poses = [
            ros_pose(RigidTransform(pose=make_poses(R, p))) for R, p in zip(rotations, message.position, strict=True)
        ]
        self._status({"data": message.status})
        if poses:
            covariance = ros_covariance(message.covariance[0], rotations[0])
            self._pose({"header": header, "pose": {"pose": poses[0], "covariance": covariance}})
        shown: list[dict[str, Any]] = [
            {
                "action": _ADD,
                "type": _MESH_RESOURCE,
                "pose": pose,
                "scale": ros_xyz(np.ones(3)),
                "color": {**_COLOUR, "a": max(float(probability), _FAINTEST)},
                "mesh_resource": self._mesh,
            }
            for pose, probability in zip(poses, message.probability, strict=True)
        ]
        gone: list[dict[str, Any]] = [{"action": _DELETE} for _ in range(self.max_modes - len(shown))]
        markers = [
            {"header": header, "ns": "object", "id": number, **marker} for number, marker in enumerate([*shown, *gone])
        ]
        self._markers({"markers": markers})
