"""Receives senses and vision as messages of ROS 2: each joint state is combined with the newest other messages.

A robot may publish a hand's joints in parts, such as by finger or driver. Joints that a joint state leaves out are
taken from the newest other ones.
"""

import functools
import math
from collections.abc import Collection
from typing import Any

import numpy as np

from tactopose_drake.core.poses import matrix_from_quaternion
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.drivers.lcm_messages import HandSensesMessage, ObjectPoseMessage
from tactopose_drake.drivers.ros2_link import Ros2Link, seconds_of
from tactopose_drake.drivers.waiting_pictures import WaitingPictures
from tactopose_drake.runs.ros2_poses import increment_covariance
from tactopose_drake.station.message_channels import Ros2Senses

_BACK = 1.0  # s by which a stamp may be older than the previous one; beyond, the sender's clock has restarted


class Ros2Inbox:
    """Receives messages like an `LcmInbox`; the belief is updated for each joint state.

    Attributes:
        received: number of joint states so far.
        lost: 0; messages of ROS 2 have no sequence numbers.
        passed_over: number of received joint states that were not used, because newer ones of all their joints existed.
    """

    def __init__(self, link: Ros2Link, senses: Ros2Senses, joints: Collection[str] | None = None) -> None:
        """Subscribes.

        Args:
            link: the DDS participant.
            senses: the topics, and the largest age of wrenches, pressures, and joints of other joint states.
            joints: names of the hand's joints; others, such as an arm's, are ignored. None: all are used.
        """
        self._joints = joints
        self.received = self.lost = self.passed_over = 0
        self._link, self._max_age = link, senses.max_age
        self._remarks: list[str] = []
        self._untaken: list[frozenset[str]] = []  # the joints of each joint state since the last that was taken
        self._pictures = WaitingPictures[Any]()
        self._time = -math.inf  # of the newest joint state, s
        self._positions: dict[str, float] = {}
        self._stamps: dict[str, float] = {}  # of each joint's newest position, even if that was too old, s
        self._wrenches: dict[str, tuple[float, FloatArray]] = {}
        self._pressures: dict[str, tuple[float, FloatArray]] = {}
        link.subscribe(senses.joints, "sensor_msgs/JointState", self._on_joints)
        for finger, topic in senses.wrenches.items():
            link.subscribe(topic, "geometry_msgs/WrenchStamped", functools.partial(self._on_wrench, finger))
        for pad, topic in senses.pressures.items():
            link.subscribe(topic, "std_msgs/Float64MultiArray", functools.partial(self._on_pad, pad))
        if senses.vision:
            link.subscribe(senses.vision, "geometry_msgs/PoseWithCovarianceStamped", self._on_vision)

    def wait(self, timeout: float) -> None:
        """Receives all messages that have arrived; waits up to `timeout`, s, for a first one.

        Raises:
            BusError: if messages can no longer be read.
        """
        if self._link.wait(timeout) > 0:
            while self._link.wait(0.0) > 0:
                pass

    def take(self) -> HandSensesMessage | None:
        """The newest joint state with all other data that is not too old; None if there is no new one."""
        if not self._untaken:
            return None
        self._untaken.clear()
        late = {name: age for name in self._positions if (age := self._time - self._stamps[name]) > self._max_age}
        for name in late:
            del self._positions[name]
        if late:
            self._remarks.append(
                f"{', '.join(late)}: of a joint state {max(late.values()):.2f} s older than the newest"
            )

        def fresh(what: str, values: dict[str, tuple[float, FloatArray]]) -> dict[str, FloatArray]:
            ages = {name: self._time - then for name, (then, _) in values.items()}
            # Data from the future, by another clock, is stale, too.
            stale = {name: age for name, age in ages.items() if abs(age) > self._max_age}
            self._remarks += [
                f"{name}: {what} {abs(age):.2f} s {'older' if age > 0.0 else 'newer'} than the joint state"
                for name, age in stale.items()
            ]
            return {name: value for name, (_, value) in values.items() if name not in stale}

        return HandSensesMessage(
            utime=round(1e6 * self._time),
            sequence=self.received - 1,
            joints=dict(self._positions),
            wrenches=fresh("the wrench is", self._wrenches),
            pressures=fresh("the pressures are", self._pressures),
        )

    def take_vision(self, utime: int) -> ObjectPoseMessage | None:
        """The newest pose from vision, once; a pose up to half a second newer than the senses waits."""
        said = self._pictures.take(utime)
        if said is None:
            return None
        orientation, place = said.pose.pose.orientation, said.pose.pose.position
        wxyz = np.array([orientation.w, orientation.x, orientation.y, orientation.z])
        if not np.linalg.norm(wxyz) > 0.0:
            self._remarks.append("vision: its quaternion is 0")
            return None
        covariance = increment_covariance(np.array(said.pose.covariance), matrix_from_quaternion(wxyz))
        return ObjectPoseMessage(
            utime=round(1e6 * seconds_of(said.header.stamp)),
            position=np.array([place.x, place.y, place.z]),
            quaternion_wxyz=wxyz,
            covariance=covariance,
        )

    def take_remarks(self) -> tuple[str, ...]:
        """Remarks on the received messages, each only once."""
        damaged, self._link.damaged = self._link.damaged, []
        said = [*self._remarks, *(f"a message on {topic} is damaged" for topic in damaged)]
        self._remarks = []
        return tuple(dict.fromkeys(said))

    def _on_joints(self, said: Any) -> None:
        time = seconds_of(said.header.stamp)
        if len(said.name) != len(said.position):
            self._remarks.append(f"a joint state has {len(said.name)} names and {len(said.position)} positions")
            return
        twice = {name for name in said.name if said.name.count(name) > 1 and self._is_ours(name)}
        if twice:
            self._remarks.append(f"a joint state names {', '.join(sorted(twice))} twice")
            return
        ours = {
            name: float(position)
            for name, position in zip(said.name, said.position, strict=True)
            if self._is_ours(name)
        }
        if not ours:
            return  # The message is of another part of the robot.
        before = max((self._stamps[name] for name in ours if name in self._stamps), default=-math.inf)
        if before - _BACK <= time < before:  # A newer message has overtaken it.
            self.received += 1
            self.passed_over += 1
            return
        if time < before:
            self._remarks.append("the senses' sender began anew")
            for values in (self._positions, self._stamps, self._wrenches, self._pressures):
                values.clear()
            self._time = -math.inf
        self.received += 1
        waiting = [names for names in self._untaken if not names <= ours.keys()]
        self.passed_over += len(self._untaken) - len(waiting)
        self._untaken = [*waiting, frozenset(ours)]
        self._time = max(self._time, time)
        self._positions |= ours
        self._stamps |= dict.fromkeys(ours, time)

    def _is_ours(self, joint: str) -> bool:
        return self._joints is None or joint in self._joints

    def _on_wrench(self, finger: str, said: Any) -> None:
        time, (before, _) = seconds_of(said.header.stamp), self._wrenches.get(finger, (-math.inf, None))
        # One that a newer one has overtaken is dropped. The newer one would be stale if it were of another clock.
        if not before - self._max_age <= time < before:
            torque, force = said.wrench.torque, said.wrench.force
            self._wrenches[finger] = time, np.array([torque.x, torque.y, torque.z, force.x, force.y, force.z])

    def _on_pad(self, pad: str, said: Any) -> None:
        # The message has no stamp, so it gets that of the last joint state; before the first, its age is unknown.
        if math.isfinite(self._time):
            self._pressures[pad] = self._time, np.array(said.data)

    def _on_vision(self, said: Any) -> None:
        self._pictures.add(round(1e6 * seconds_of(said.header.stamp)), said)
