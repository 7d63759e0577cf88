"""Runs a scenario whose senses are messages of ROS 2."""

from tactopose_drake.drivers.ros2_link import Ros2Link
from tactopose_drake.runs.message_run import run_messages
from tactopose_drake.runs.publishing import open_publisher
from tactopose_drake.runs.ros2_inbox import Ros2Inbox
from tactopose_drake.runs.stepping import Observer, Progress, RunView
from tactopose_drake.station.message_channels import Ros2Senses
from tactopose_drake.station.scenario import Scenario


def run_ros2(scenario: Scenario, duration: float | None, observer: Observer, tell: Progress) -> RunView:
    """Runs as `run_messages` does, with messages of ROS 2.

    Args:
        scenario: a scenario with `Ros2Senses`.
        duration: duration, s; None: until it is interrupted.
        observer: called with the run after each belief.
        tell: called with the name of each step that starts.

    Raises:
        InvalidInputError: if the scenario cannot be run.
        BusError: if the domain cannot be joined.
    """
    senses = scenario.senses
    assert isinstance(senses, Ros2Senses)
    link = Ros2Link(senses.domain, senses.config)
    out = open_publisher(scenario)
    return run_messages(
        scenario, senses.max_age, lambda joints: Ros2Inbox(link, senses, joints), out, duration, observer, tell
    )
