"""Runs a scenario whose senses are messages over LCM."""

from collections.abc import Collection

from tactopose_drake.drivers.lcm_inbox import LcmInbox, open_lcm
from tactopose_drake.runs.message_run import run_messages
from tactopose_drake.runs.publishing import open_publisher
from tactopose_drake.runs.stepping import Observer, Progress, RunView
from tactopose_drake.station.message_channels import LcmSenses
from tactopose_drake.station.scenario import Scenario


def run_lcm(scenario: Scenario, duration: float | None, observer: Observer, tell: Progress) -> RunView:
    """Runs as `run_messages` does, with messages `lcmt_hand_senses` and `lcmt_object_pose`.

    Args:
        scenario: a scenario with `LcmSenses`.
        duration: duration, s; None: until it is interrupted.
        observer: called with the run after each belief.
        tell: called with the name of each step that starts.

    Raises:
        InvalidInputError: if the scenario cannot be run.
        BusError: if LCM cannot be opened.
    """
    senses = scenario.senses
    assert isinstance(senses, LcmSenses)
    link = open_lcm(senses.url)
    out = open_publisher(scenario, senses.url, link)

    def inbox(_: Collection[str]) -> LcmInbox:
        return LcmInbox(link, senses.channel, senses.vision)

    return run_messages(scenario, senses.max_age, inbox, out, duration, observer, tell)
