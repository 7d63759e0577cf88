"""Runs a scenario: in the simulator as fast as possible, on CAN devices in real time, or as messages arrive."""

import contextlib
import dataclasses
from collections.abc import Collection
from pathlib import Path

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import LATEST, instance_of, positive_number
from tactopose_drake.drivers.lcm_inbox import LcmInbox, open_lcm
from tactopose_drake.drivers.ros2_link import Ros2Link
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.runs.device_run import check_devices, run_devices
from tactopose_drake.runs.grasp_watch import GraspWatch
from tactopose_drake.runs.message_run import run_messages
from tactopose_drake.runs.publishing import open_publisher, publishing
from tactopose_drake.runs.recording import Recording
from tactopose_drake.runs.ros2_inbox import Ros2Inbox
from tactopose_drake.runs.scenario_replay import replay
from tactopose_drake.runs.simulation import start_simulation
from tactopose_drake.runs.stepping import Observer, Progress, RunView, advance
from tactopose_drake.station.can_senses import CanSenses, SimulatedDevices
from tactopose_drake.station.message_channels import LcmSenses, Ros2Senses
from tactopose_drake.station.scenario import Scenario
from tactopose_drake.station.senses import RecordedSenses
from tactopose_drake.station.simulated import check_bodies, make_station


def run_scenario(
    scenario: Scenario,
    *,
    duration: float | None = None,
    record: Path | None = None,
    observer: Observer = lambda view: None,
    tell: Progress = lambda message: None,
) -> RunView:
    """Runs a scenario with any kind of senses; a keyboard interrupt ends it.

    Args:
        scenario: the scenario.
        duration: duration, s. None: the scenario's; with real devices or messages until it is interrupted; all of a
            recording.
        record: a new or empty folder for a recording. Recordings and senses by messages cannot be recorded.
        observer: called with the run at the period of the estimates.
        tell: called with the name of each step that starts.

    Returns:
        The run at its end; its devices are closed.

    Raises:
        InvalidInputError: if the scenario cannot be run.
        DriverError: if a bus cannot be opened, or a device cannot be tared.
    """
    instance_of("scenario", scenario, Scenario)
    scenario.validate()
    duration = None if duration is None else positive_number("duration", duration, most=LATEST)
    for kind, run_of_kind, bus, recorder in _MESSAGES:
        if isinstance(scenario.senses, kind):
            if record is not None:
                raise InvalidInputError(
                    f"record must be None if the senses come over {bus}. Record them by `{recorder}`."
                )
            return run_of_kind(scenario, duration, observer, tell)
    observer = publishing(scenario, observer)
    if isinstance(scenario.senses, RecordedSenses):
        if record is not None:
            raise InvalidInputError("record must be None if the scenario's senses are a recording.")
        played = replay(Path(scenario.senses.folder), scenario, duration=duration, observer=observer, tell=tell)
        return played.view if played.whole else dataclasses.replace(played.view, cut=played.ends)
    devices = scenario.senses if isinstance(scenario.senses, CanSenses) else None
    if devices is None or devices.simulated == SimulatedDevices():
        check_bodies(scenario)
    if devices is not None:
        check_devices(scenario, duration)
    with contextlib.ExitStack() as parts:
        recording = None if record is None else parts.enter_context(Recording(record, scenario))

        def record_and_show(view: RunView) -> None:
            if recording is not None:
                recording.write_estimate(view.diagram, view.context)
                if recording.lost:
                    tell(recording.lost[0])
            observer(view)

        tell("reading the object")
        model = scenario.object_model()
        run = _run_simulated if devices is None else run_devices
        view = run(scenario, model, duration, recording, record_and_show, tell)
    return view if recording is None else dataclasses.replace(view, lost=recording.lost)


def _run_simulated(
    scenario: Scenario,
    model: ObjectModel,
    duration: float | None,
    recording: Recording | None,
    observer: Observer,
    tell: Progress,
) -> RunView:
    tell("preparing the grasp")
    station = make_station(scenario, model=model)
    if recording is not None:
        recording.begin(0.0, {})
    simulator = start_simulation(station, None if recording is None else recording.write)
    tell("simulating")
    until = scenario.duration if duration is None else duration
    watch = GraspWatch(station)

    def watch_and_show(view: RunView) -> None:
        watch.see(view.context)
        observer(dataclasses.replace(view, true_pose=station.object_pose(view.context)))

    view = advance(simulator, None, scenario.estimation.estimator.period, until, watch_and_show)
    return dataclasses.replace(view, outcome=watch.outcome(view.context))


def _run_lcm(scenario: Scenario, duration: float | None, observer: Observer, tell: Progress) -> RunView:
    """Runs by messages `lcmt_hand_senses` and `lcmt_object_pose`; raises BusError if LCM cannot be opened."""
    senses = scenario.senses
    assert isinstance(senses, LcmSenses)
    link = open_lcm(senses.url)
    out = open_publisher(scenario, senses.url, link)

    def inbox(_: Collection[str]) -> LcmInbox:
        return LcmInbox(link, senses.channel, senses.vision)

    return run_messages(scenario, senses.max_age, inbox, out, duration, observer, tell)


def _run_ros2(scenario: Scenario, duration: float | None, observer: Observer, tell: Progress) -> RunView:
    """Runs by messages of ROS 2; raises BusError if the domain cannot be joined."""
    senses = scenario.senses
    assert isinstance(senses, Ros2Senses)
    link, out = Ros2Link(senses.domain, senses.config), open_publisher(scenario)

    def inbox(joints: Collection[str]) -> Ros2Inbox:
        return Ros2Inbox(link, senses, joints)

    return run_messages(scenario, senses.max_age, inbox, out, duration, observer, tell)


# Senses that are messages: the function that runs them, the middleware, and its own recorder.
_MESSAGES = ((LcmSenses, _run_lcm, "LCM", "lcm-logger"), (Ros2Senses, _run_ros2, "ROS 2", "ros2 bag record"))
