"""Publishes beliefs to other processes over LCM or ROS 2, as the scenario says."""

import math
import time

from tactopose_drake.drivers.lcm_inbox import LcmConnection, open_lcm
from tactopose_drake.drivers.lcm_messages import ObjectBeliefMessage
from tactopose_drake.runs.message_run import Publisher
from tactopose_drake.runs.ros2_publisher import Ros2Publisher
from tactopose_drake.runs.stepping import Observer, RunView
from tactopose_drake.station.message_channels import LcmPublishing, Ros2Publishing
from tactopose_drake.station.scenario import Scenario
from tactopose_drake.systems.lcm_belief import belief_message


class LcmPublisher:
    """Publishes beliefs as messages `lcmt_object_belief`, all with the same session number."""

    def __init__(self, params: LcmPublishing, known_url: str = "", known: LcmConnection | None = None) -> None:
        """Opens LCM, unless `known` is a connection to the same URL."""
        self._link = known if known is not None and params.url == known_url else open_lcm(params.url)
        self._channel, self.max_modes = params.channel, params.max_modes
        self._session = time.time_ns()

    def send(self, message: ObjectBeliefMessage) -> None:
        """Publishes a message."""
        message.session = self._session
        self._link.publish(self._channel, message.encode())


def open_publisher(scenario: Scenario, known_url: str = "", known: LcmConnection | None = None) -> Publisher | None:
    """Opens the publisher of a run's beliefs; None if the scenario does not publish.

    Args:
        scenario: the run's scenario.
        known_url: URL of an LCM connection that is already open.
        known: that connection.

    Raises:
        InvalidInputError: if a package is not installed.
        BusError: if LCM or DDS cannot be opened.
    """
    if isinstance(scenario.publish, Ros2Publishing):
        return Ros2Publisher(scenario.publish, scenario.object_mesh())
    return None if scenario.publish is None else LcmPublisher(scenario.publish, known_url, known)


def publishing(scenario: Scenario, observer: Observer) -> Observer:
    """Wraps an observer so that a station's beliefs are published, too, if the scenario says so.

    A belief is dated when its touch was read, which is a period before it is known. A pose that is held from an earlier
    estimate keeps the time of that estimate.

    Args:
        scenario: a scenario whose senses are not messages.
        observer: the observer to wrap.

    Raises:
        InvalidInputError: if a package is not installed.
        BusError: if LCM or DDS cannot be opened.
    """
    out = open_publisher(scenario)
    if out is None:
        return observer
    touched = 0.0

    def publish_and_show(view: RunView) -> None:
        nonlocal touched
        estimate, status = view.believed("hypotheses"), view.believed("status")
        message = belief_message(estimate, status, out.max_modes)
        if (belief := view.value("tracked_belief")) is not None:  # It may be late.
            touched = belief.time
        elif estimate is None or not status.startswith("held"):
            touched = _last_update(view.context.get_time(), scenario.estimation.estimator.period)
        begun = 0.0 if view.devices is None else next(iter(view.devices.buses.values())).origin
        message.utime = round(1e6 * (begun + touched))
        out.send(message)
        observer(view)

    return publish_and_show


def _last_update(time: float, period: float) -> float:
    """When the estimator was updated last, s, if a step of the run has ended at `time`: the update then is pending."""
    return period * max(math.ceil(time / period - 1e-6) - 1, 0)
