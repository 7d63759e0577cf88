"""Runs a scenario whose senses are messages: a belief for each, as fast as it goes; and sends beliefs."""

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

_HEARTBEAT = 0.1  # s between two messages while nothing comes in


class Inbox(Protocol):
    """What a hand senses and what vision says, as it comes in; `LcmInbox` says more of each."""

    received: int
    lost: int
    passed_over: int

    def wait(self, timeout: float) -> None:
        """Takes in all that is there; waits for a first message for as long as that, s."""

    def take(self) -> HandSensesMessage | None:
        """The newest senses, once."""

    def take_vision(self, utime: int) -> ObjectPoseMessage | None:
        """What vision says, once."""

    def take_remarks(self) -> tuple[str, ...]:
        """What is to be said of what came, once."""


class Publisher(Protocol):
    """What sends beliefs; `max_modes` that a message has."""

    max_modes: int

    def send(self, message: ObjectBeliefMessage) -> None:
        """Sends one."""


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

    Every message of the senses is taken in. A belief is made of the newest that is there, and sent at once where the
    scenario publishes; during a silence one is sent ten times a second whose status is "lost". The run begins when all
    is prepared, however long the senses are silent then.

    Args:
        scenario: whose senses are messages.
        max_age: of a message; after a longer silence the belief is called lost, s.
        open_inbox: begins to take messages in, of a hand whose joints have these names.
        out: sends beliefs; None: nobody does.
        duration: s; until it is interrupted, if not given.
        observer: is shown each belief, and ten times a second a silence.
        tell: is told what begins.
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
                start = tracker.context.get_time() - (time.monotonic() - began)  # The sender's clock may begin anew.
                view = dataclasses.replace(view, status=run.status, start=start)
                observer(view)
    return dataclasses.replace(view, status=run.status)


class _MessageRun:
    """Takes messages in, and sends beliefs.

    Attributes:
        tracker: makes them.
        status: of the last one, with all that is remarked; or that nothing comes any more.
    """

    def __init__(
        self, max_age: float, hand: HandConfig, tracker: ObjectTracker, inbox: Inbox, out: Publisher | None
    ) -> None:
        self.tracker, self.status = tracker, ""
        self._max_age, self._out, self._inbox = max_age, out, inbox
        self._fingers = tuple(finger.name for finger in hand.fingers if finger.sensor_frame)
        self._cells = {pad.name: len(load_tactile_pad(pad.array).layout) for pad in hand.pads}
        self._last, self._last_time, self._beat_time = ObjectBeliefMessage(), -math.inf, -math.inf
        self._is_silent = False

    def step(self, timeout: float) -> bool:
        """Waits for a message, s; makes a belief of it. Whether there is a new one, or none any more."""
        self._inbox.wait(timeout)
        senses = self._inbox.take()
        if senses is None:
            return self._be_patient()
        remarks = list(self._inbox.take_remarks())
        if self._is_silent:
            remarks.append(f"the senses are back after {time.monotonic() - self._last_time:.1f} s")
        message = self._believe(senses, remarks)
        self._last, self._last_time, self._is_silent = message, time.monotonic(), False
        self.status = message.status
        self._send(message)
        return True

    def _believe(self, senses: HandSensesMessage, remarks: list[str]) -> ObjectBeliefMessage:
        """A belief of one message; what of it does not fit the hand is left out, and remarked."""
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
        except InvalidInputError as error:  # a time that is none
            return ObjectBeliefMessage(status=f"lost: {str(error).removesuffix('.')}")
        status = belief.message + "".join(
            ("; " if belief.remarks or i else ": ") + text for i, text in enumerate(remarks)
        )
        message = belief_message(self.tracker.estimate, status, 64 if self._out is None else self._out.max_modes)
        message.utime, message.sequence = senses.utime, senses.sequence
        return message

    def _be_patient(self) -> bool:
        """Says that nothing comes in, now and then; whether it did, of what came once."""
        now = time.monotonic()
        silence = now - self._last_time
        if silence <= self._max_age or now - self._beat_time < _HEARTBEAT:
            return False
        self._beat_time = now
        self._is_silent = math.isfinite(silence)
        text = f"no senses for {silence:.1f} s" if self._is_silent else "no senses yet"
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
    """What vision says; None where it says nothing, or what cannot be."""
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
    """Some beliefs of a made-up touch, before anything is measured: the first call of everything is slow."""
    joints = np.zeros(len(tracker.joint_names))
    touch = np.array([0.0, 0.0, 0.0, 0.0, 2.0, -2.0])
    names = [tracker.diagram.get_input_port(index).get_name() for index in range(tracker.diagram.num_input_ports())]
    fingers = [name.removeprefix("wrench_") for name in names if name.startswith("wrench_")]
    vision = PoseMeasurement(0.0, RigidTransform().GetAsMatrix34(), np.eye(6) * 1e-3)
    for k in range(3):
        tracker.update(dict.fromkeys(fingers, touch + 1e-3 * k), joints, 0.01 * k, vision=vision)
