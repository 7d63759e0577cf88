"""Latency over LCM from a hand's senses to a belief in another process, and lost messages.

This process is the hand: it sends the measurements of a scenario's simulated hand, 200 times per second. `tactopose
run` is started as another process, and sends its belief back. At the times --restart-sender and --restart-estimator, s,
either is restarted. Needs `pip install tactopose_drake[lcm]`.

    python examples/lcm_latency.py --url 'udpm://239.255.76.67:7667?ttl=0' --duration 60
"""

import argparse
import dataclasses
import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from pydrake.common.yaml import yaml_dump_typed

import tactopose_drake as tp
from tactopose_drake.drivers import HandSensesMessage, ObjectBeliefMessage, ObjectPoseMessage, open_lcm
from tactopose_drake.hand import NamedJoints, load_hand_config, make_hand_plant
from tactopose_drake.runs import rehearse
from tactopose_drake.station import LcmPublishing, LcmSenses, Scenario, load_scenario
from tactopose_drake.systems import PoseTrackingParams, Signal

_SILENCE = 1.0  # minimum pause of a sender that is restarted, s
_LATEST = 120.0  # maximum wait for an answer of the estimator, s


@dataclasses.dataclass(frozen=True)
class Report:
    """The measurements since the estimator's first answer after the last start of either process.

    Attributes:
        sent: number of messages of the senses.
        received, lost, passed_over: the estimator's counts of these.
        latency: time from sending a message to receiving its belief, for each belief, s.
        said: remarks of the estimator during the whole run, in order, each once.
    """

    sent: int
    received: int
    lost: int
    passed_over: int
    latency: np.ndarray
    said: tuple[str, ...]


def make_scenario(url: str) -> Scenario:
    """A scenario that receives senses and sends beliefs over LCM."""
    scenario = load_scenario("shadow_like").without_errors()
    scenario.senses, scenario.publish = LcmSenses(url=url, vision="VISION"), LcmPublishing(url=url)
    scenario.tracking = PoseTrackingParams(use_joint_velocities=False)
    return scenario


class Hand:
    """Sends a hand's measurements, and records the beliefs that come back."""

    def __init__(self, url: str, felt: Mapping[str, Signal], joints: tuple[str, ...]) -> None:
        """Opens LCM."""
        self._link, self._felt, self._joints = open_lcm(url), felt, joints
        self._generator, self._start = np.random.default_rng(0), time.monotonic()
        self._link.subscribe("OBJECT_BELIEF", self._hear).set_queue_capacity(0)
        self.begin_anew()
        self.said: dict[str, None] = {}

    def begin_anew(self) -> None:
        """Starts a new sequence, as if the process had been restarted."""
        self._sent: dict[int, float] = {}
        self.sequence, self.latency = 0, list[float]()
        self.first: ObjectBeliefMessage | None = None
        self.last = ObjectBeliefMessage()

    def send(self) -> None:
        """Sends one message of the senses; after the grasp's end, its last values with the sensors' noise."""
        now = time.monotonic()
        felt = {name: signal.at(now - self._start) for name, signal in self._felt.items()}
        wrenches = {
            name.removeprefix("wrench_"): value + 1e-3 * self._generator.normal(size=6)
            for name, value in felt.items()
            if name.startswith("wrench_") and value is not None
        }
        joints = dict(zip(self._joints, felt["joint_positions"].tolist(), strict=True))
        utime = round(1e6 * time.time())
        if self.sequence % 20 == 0 and felt["prior"] is not None:
            self._link.publish("VISION", vision(felt["prior"], utime).encode())
        message = HandSensesMessage(utime=utime, sequence=self.sequence, joints=joints, wrenches=wrenches)
        self._sent[self.sequence] = time.monotonic()
        self._link.publish("HAND_SENSES", message.encode())
        self.sequence += 1

    def hear(self, timeout: float) -> None:
        """Receives beliefs for `timeout` s; handles at least those that have arrived."""
        end = time.monotonic() + timeout
        while self._link.handle_timeout(max(0, math.ceil(1e3 * (end - time.monotonic())))) or time.monotonic() < end:
            pass

    def fall_silent(self) -> None:
        """Sends nothing until the estimator has reported missing senses, and for `_SILENCE` at least."""
        end = time.monotonic() + _LATEST
        self.hear(_SILENCE)
        while "no senses for" not in self.said and time.monotonic() < end:
            self.hear(_SILENCE)

    def _hear(self, channel: str, data: bytes) -> None:
        belief = ObjectBeliefMessage.decode(data)
        for text in ("no senses for", "began anew", "are back", "clock went back"):
            if text in belief.status:
                self.said[text] = None
        if self.first is not None and belief.session != self.first.session:
            self.said["another estimator"] = None
            self.first = None
        sent = self._sent.pop(belief.sequence, None)
        if sent is None:
            return
        if self.first is None:
            self.first, self.latency = belief, []
        else:
            self.latency.append(time.monotonic() - sent)
        self.last = belief

    def report(self) -> Report:
        """The measurements since the first belief of the present sender and estimator."""
        assert self.first is not None
        counts = [getattr(self.last, name) - getattr(self.first, name) for name in ("received", "lost", "passed_over")]
        sent = self.last.sequence - self.first.sequence
        return Report(sent, *counts, np.array(self.latency), tuple(self.said))


def vision(prior: tp.PosePrior, utime: int) -> ObjectPoseMessage:
    """The message of vision with a prior."""
    sigmas = np.repeat([prior.sigma_rotation, prior.sigma_translation], 3)
    X_PO = prior.X_PO
    wxyz = X_PO.rotation().ToQuaternion().wxyz()
    return ObjectPoseMessage(
        utime=utime, position=X_PO.translation(), quaternion_wxyz=wxyz, covariance=np.diag(sigmas**2)
    )


def start(folder: Path, scenario: Scenario) -> subprocess.Popen[bytes]:
    """Starts `tactopose run` in its own process."""
    file = folder / "lcm.scenario.yaml"
    file.write_text(yaml_dump_typed(scenario))
    command = [sys.executable, "-c", "from tactopose_drake.cli.main import main; main()", "run", str(file)]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def measure(duration: float, rate: float, url: str, restarts: Mapping[str, float]) -> Report:
    """Sends for `duration` s from the first answer on; restarts `sender` and `estimator` at the times in `restarts`."""
    scenario = make_scenario(url)
    joints = NamedJoints(*make_hand_plant(load_hand_config(scenario.hand))).names
    felt = rehearse(scenario, scenario.object_model())
    hand, begun = Hand(url, felt, joints), time.monotonic()
    due = dict(restarts)
    with tempfile.TemporaryDirectory() as folder:
        estimator, first = start(Path(folder), scenario), math.inf
        next_time = time.monotonic()
        try:
            while (now := time.monotonic()) < first + duration:
                hand.send()
                next_time += 1.0 / rate
                hand.hear(next_time - time.monotonic())
                if hand.first is not None:
                    first = min(first, time.monotonic())
                elif time.monotonic() > begun + _LATEST and math.isinf(first):
                    raise TimeoutError("the estimator does not answer")
                if now > first + due.get("sender", math.inf):
                    del due["sender"]
                    hand.fall_silent()
                    hand.begin_anew()
                    next_time = time.monotonic()
                if now > first + due.get("estimator", math.inf):
                    del due["estimator"]
                    estimator.kill()
                    estimator.wait()
                    estimator = start(Path(folder), scenario)
            hand.hear(1.0)
        finally:
            estimator.kill()
            estimator.wait()
    return hand.report()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--duration", type=float, default=60.0, help="s, from the first answer on")
    parser.add_argument("--rate", type=float, default=200.0, help="messages a second")
    parser.add_argument(
        "--url", required=True, help="LCM's; who can send to its group is heard (ttl=0: none hears this machine)"
    )
    parser.add_argument("--restart-sender", type=float, help="s after the first answer")
    parser.add_argument("--restart-estimator", type=float, help="s after the first answer")
    options = parser.parse_args()
    restarts = {"sender": options.restart_sender, "estimator": options.restart_estimator}
    known = {name: moment for name, moment in restarts.items() if moment is not None}
    report = measure(options.duration, options.rate, options.url, known)
    print(f"sent {report.sent}, received {report.received}, lost {report.lost}, passed over {report.passed_over}")
    shares = ", ".join(
        f"{share:g} %: {1e3 * np.percentile(report.latency, share):.1f} ms" for share in (50, 90, 99, 100)
    )
    print(f"{len(report.latency)} beliefs; from sending to the belief {shares}")
    if report.said:
        print("said: " + "; ".join(report.said))


if __name__ == "__main__":
    main()
