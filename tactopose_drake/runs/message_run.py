"""Runs a scenario whose senses are messages, updates the belief for the newest of them, and publishes it."""

import contextlib
import dataclasses
import math
import time
from collections.abc import Callable, Collection
from typing import Protocol

import numpy as np
from pydrake.math import RigidTransform

from tactopose_drake.core.poses import make_poses, matrix_from_quaternion
from tactopose_drake.core.tracking.frame import PoseMeasurement
from tactopose_drake.drivers.lcm_messages import HandSensesMessage, ObjectBeliefMessage, ObjectPoseMessage
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.hand_config import HandConfig, load_hand_config
from tactopose_drake.hand.tactile_pads import load_tactile_pad
from tactopose_drake.runs.stepping import Observer, Progress, RunView
from tactopose_drake.station.scenario import Scenario
from tactopose_drake.systems.lcm_belief import belief_message
from tactopose_drake.systems.lcm_hand_senses import misfits
from tactopose_drake.systems.object_tracker import ObjectTracker

_HEARTBEAT = 0.1  # s between two published messages during a silence of the senses


class Inbox(Protocol):
    """Receives messages of senses and vision; see `LcmInbox`."""

    received: int
    lost: int
    passed_over: int

    def wait(self, timeout: float) -> None:
        """Receives all messages that have arrived; waits up to `timeout`, s, for a first one."""

    def take(self) -> HandSensesMessage | None:
        """Returns the newest senses, each only once; None if there are no new ones."""

    def take_vision(self, utime: int) -> ObjectPoseMessage | None:
        """Returns the pose from vision for senses of this time, each only once."""

    def take_remarks(self) -> tuple[str, ...]:
        """Returns remarks on the received messages, each only once."""


class Publisher(Protocol):
    """Publishes beliefs with up to `max_modes` modes."""

    max_modes: int

    def send(self, message: ObjectBeliefMessage) -> None:
        """Publishes a message."""


def run_messages(
    scenario: Scenario,
    max_age: float,
    open_inbox: Callable[[Collection[str]], Inbox],
    out: Publisher | None,
    duration: float | None,
    observer: Observer,
    tell: Progress,
) -> RunView:
    """Runs until the duration is over, or the keyboard interrupts.

    All messages of the senses are received. The belief is updated with the newest one and published at once; during a
    silence a belief with the status "lost" is published ten times a second. The duration counts from the end of the
    preparations, even if the senses are still silent.

    Args:
        scenario: a scenario whose senses are messages.
        max_age: silence after which the belief's status is "lost", s.
        open_inbox: opens the inbox for a hand with these joint names.
        out: publishes beliefs; None: they are not published.
        duration: duration, s; None: until it is interrupted.
        observer: called with the run after each belief, and ten times a second during a silence.
        tell: called with the name of each step that starts.
    """
    tell("reading the object")
    hand, model = load_hand_config(scenario.hand), scenario.object_model()
    tell("preparing the estimate")
    _warm_up(ObjectTracker(hand, model, scenario.tracking))
    tracker = ObjectTracker(hand, model, scenario.tracking)
    run = _MessageRun(max_age, hand, tracker, open_inbox(tracker.joint_names), out)
    view = RunView(tracker.diagram, tracker.context)
    began = time.monotonic()
    end = math.inf if duration is None else began + duration
    tell("waiting for senses")
    with contextlib.suppress(KeyboardInterrupt):
        while time.monotonic() < end:
            if run.step(min(_HEARTBEAT, end - time.monotonic())):
                tell("running")
                start = tracker.context.get_time() - (time.monotonic() - began)  # The sender's clock may restart.
                view = dataclasses.replace(view, status=run.status, start=start)
                observer(view)
    return dataclasses.replace(view, status=run.status)


class _MessageRun:
    """Receives messages, updates the belief, and publishes it.

    Attributes:
        tracker: the tracker that keeps the belief.
        status: status of the last belief with all remarks, or that no messages arrive.
    """

    def __init__(
        self, max_age: float, hand: HandConfig, tracker: ObjectTracker, inbox: Inbox, out: Publisher | None
    ) -> None:
        self.tracker, self.status = tracker, ""
        self._max_age, self._out, self._inbox = max_age, out, inbox
        self._fingers = hand.sensing
        self._cells = {pad.name: len(load_tactile_pad(pad.array).layout) for pad in hand.pads}
        self._last, self._last_time, self._beat_time = ObjectBeliefMessage(), -math.inf, -math.inf
        self._last_utime: int | None = None
        self._is_silent = False

    def step(self, timeout: float) -> bool:
        """Waits up to `timeout`, s, for a message and updates the belief; returns whether the status is new."""
        self._inbox.wait(timeout)
        senses = self._inbox.take()
        if senses is None:
            return self._be_patient("no senses for")
        if senses.utime == self._last_utime and time.monotonic() > self._last_time + self._max_age:
            # Its sender repeats a measurement, as of a hand whose sensors hang.
            return self._be_patient("the senses' time has stood still for")
        remarks = list(self._inbox.take_remarks())
        if self._is_silent:
            remarks.append(f"the senses are back after {time.monotonic() - self._last_time:.1f} s")
        self._last, self._is_silent = self._believe(senses, remarks), False
        if senses.utime != self._last_utime:
            self._last_utime, self._last_time = senses.utime, time.monotonic()
        self.status = self._last.status
        self._send(self._last)
        return True

    def _believe(self, senses: HandSensesMessage, remarks: list[str]) -> ObjectBeliefMessage:
        """Updates the belief with a message; parts that do not fit the hand are ignored, with a remark."""
        joints = self.tracker.joint_names
        remarks += misfits(senses, joints, self._fingers, self._cells)
        vision = _measurement(self._inbox.take_vision(senses.utime), remarks)
        pressures = {name: values for name, values in senses.pressures.items() if self._cells.get(name) == len(values)}
        try:
            belief = self.tracker.update(
                {name: F_S for name, F_S in senses.wrenches.items() if name in self._fingers},
                {name: value for name, value in senses.joints.items() if name in joints},
                1e-6 * senses.utime,
                pressures=pressures,
                vision=vision,
            )
        except InvalidInputError as error:  # an invalid time
            return ObjectBeliefMessage(status=f"lost: {str(error).removesuffix('.')}")
        status = belief.message + "".join(
            ("; " if belief.remarks or i else ": ") + text for i, text in enumerate(remarks)
        )
        message = belief_message(self.tracker.estimate, status, 64 if self._out is None else self._out.max_modes)
        message.utime, message.sequence = senses.utime, senses.sequence
        return message

    def _be_patient(self, what: str) -> bool:
        """Publishes what has lasted since the last new senses from time to time; returns whether it did after some."""
        now = time.monotonic()
        silence = now - self._last_time
        if silence <= self._max_age or now - self._beat_time < _HEARTBEAT:
            return False
        self._beat_time = now
        self._is_silent = math.isfinite(silence)
        text = f"{what} {silence:.1f} s" if self._is_silent else "no senses yet"
        remarks = "".join(f"; {remark}" for remark in self._inbox.take_remarks())
        self.status = f"lost: {text}{remarks}"
        self._send(dataclasses.replace(self._last, status=self.status))
        return self._is_silent

    def _send(self, message: ObjectBeliefMessage) -> None:
        if self._out is None:
            return
        inbox = self._inbox
        message.received, message.lost, message.passed_over = inbox.received, inbox.lost, inbox.passed_over
        self._out.send(message)


def _measurement(message: ObjectPoseMessage | None, remarks: list[str]) -> PoseMeasurement | None:
    """Converts a message of vision; None without one, or if it is invalid, which adds a remark."""
    if message is None:
        return None
    length = float(np.linalg.norm(message.quaternion_wxyz))
    if not abs(length - 1.0) < 1e-3:
        remarks.append(f"vision: its quaternion has the length {length:g}")
        return None
    try:
        R_PO = matrix_from_quaternion(message.quaternion_wxyz)
        return PoseMeasurement(1e-6 * message.utime, make_poses(R_PO, message.position), message.covariance)
    except InvalidInputError as error:
        remarks.append(f"vision: {str(error).removesuffix('.')}")
        return None


def _warm_up(tracker: ObjectTracker) -> None:
    """Updates the belief a few times with a synthetic touch, as first calls are slow."""
    joints = np.zeros(len(tracker.joint_names))
    touch = np.array([0.0, 0.0, 0.0, 0.0, 2.0, -2.0])
    names = [tracker.diagram.get_input_port(index).get_name() for index in range(tracker.diagram.num_input_ports())]
    fingers = [name.removeprefix("wrench_") for name in names if name.startswith("wrench_")]
    vision = PoseMeasurement(0.0, RigidTransform().GetAsMatrix34(), np.eye(6) * 1e-3)
    for k in range(3):
        tracker.update(dict.fromkeys(fingers, touch + 1e-3 * k), joints, 0.01 * k, vision=vision)
