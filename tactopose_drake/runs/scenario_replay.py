"""Plays a recording through the decoders, the drivers and the estimate, as if the devices said it all again."""

import contextlib
import dataclasses
import math
from pathlib import Path

from pydrake.systems.analysis import Simulator

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.runs.advance import Observer, Progress, RunView, advance
from tactopose_drake.runs.manifest import SIGNALS, load_manifest
from tactopose_drake.runs.simulation import TRUE_POSE
from tactopose_drake.station.can_devices import CanDevices, logged_buses
from tactopose_drake.station.hardware import make_hardware_station
from tactopose_drake.station.scenario import Scenario
from tactopose_drake.station.senses import CanSenses
from tactopose_drake.systems.signals import read_signals


@dataclasses.dataclass(frozen=True, eq=False)
class Replay:
    """How a replay went.

    Attributes:
        view: of the run at its end.
        ends: how each file ended, in a sentence: after how many frames, and whether it was cut off.
        whole: whether none was cut off.
    """

    view: RunView
    ends: tuple[str, ...]
    whole: bool


def replay(
    folder: Path,
    scenario: Scenario,
    *,
    paced: bool = False,
    duration: float | None = None,
    observer: Observer = lambda view: None,
    tell: Progress = lambda message: None,
) -> Replay:
    """Plays a recording to its end.

    The CAN logs go through the drivers in virtual time, so what comes out depends on the recording and the scenario
    alone, to the last bit, however fast it is played. A time limit of the search is lifted for the same reason.

    Args:
        folder: of the recording.
        scenario: what is to be estimated and how; of the same hand, object and devices.
        paced: whether it plays as fast as it was recorded; else as fast as it goes.
        duration: of the part that is played, from the beginning, s; all, if not given.
        observer: is shown the run at the period of the estimates.
        tell: is told what begins.

    Raises:
        InvalidFileError: if the folder is no recording.
        InvalidInputError: if the recording does not fit the scenario.
    """
    manifest = load_manifest(folder)
    manifest.check_scenario(scenario, folder)
    estimator = dataclasses.replace(scenario.estimation.estimator, max_duration=None)
    estimation = dataclasses.replace(scenario.estimation, estimator=estimator)
    senses = manifest.scenario.senses
    scenario = dataclasses.replace(scenario, senses=senses, estimation=estimation)
    signals, cut = read_signals(folder / SIGNALS)
    # What is beyond the last whole line is not known.
    last = max((signal.times[-1] for signal in signals.values()), default=0.0)
    signals.pop(TRUE_POSE, None)
    tell("reading the object")
    model = ObjectModel.from_mesh(scenario.object_mesh())
    with contextlib.ExitStack() as parts:
        devices = None
        if isinstance(senses, CanSenses):
            if senses.barrett_hand is not None:
                signals.pop("joint_positions", None)  # They are in the log.
            devices = CanDevices(senses, logged_buses({name: folder / file for name, file in manifest.buses.items()}))
            devices.set_biases(manifest.biases)
        station = make_hardware_station(scenario, devices, signals, model=model)
        if devices is not None:
            parts.enter_context(devices)
            devices.start(manifest.start)
        simulator = Simulator(station.diagram)
        if paced:
            simulator.set_target_realtime_rate(1.0)
        simulator.Initialize()
        tell("playing")
        until = min(math.inf if duration is None else duration, last if cut or devices is None else math.inf)
        buses = [] if devices is None else list(devices.buses.values())

        def at_end() -> bool:
            return bool(buses) and all(bus.log_end is not None for bus in buses)

        with contextlib.suppress(KeyboardInterrupt):
            advance(simulator, devices, scenario.estimation.estimator.period, until, observer, at_end)
        ends = [bus.log_end for bus in buses if bus.log_end is not None]
        texts = (*(str(end) for end in ends), *([cut] if cut else []))
        view = RunView(station.diagram, simulator.get_context())
        return Replay(view, texts, not cut and all(end.whole for end in ends))
