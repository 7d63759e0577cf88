"""Nothing is compiled or loaded in a control loop: what runs is ready when it is built."""

from collections.abc import Iterator
from contextlib import contextmanager

import numba.core.event
import pytest

from tactopose_drake.core.compilation import Kernel
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.runs.simulation import start_simulation
from tactopose_drake.station.scenario import Scenario, load_scenario
from tactopose_drake.station.simulated import make_station


class Compilations(numba.core.event.Listener):
    """What numba has begun to compile, by name."""

    def __init__(self) -> None:
        self.names: list[str] = []

    def on_start(self, event: numba.core.event.Event) -> None:
        self.names.append(event.data["dispatcher"].py_func.__name__)

    def on_end(self, event: numba.core.event.Event) -> None:
        pass


@contextmanager
def watched(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[str]]:
    """The names of all kernels that are compiled, or loaded from the cache, within."""
    listener, made_ready = Compilations(), Kernel.compile

    def compile_or_load(kernel: Kernel, sig: object) -> object:
        listener.names.append(kernel.py_func.__name__)
        return made_ready(kernel, sig)

    with monkeypatch.context() as patch, numba.core.event.install_listener("numba:compile", listener):
        patch.setattr(Kernel, "compile", compile_or_load)
        yield listener.names


def scenario_of(name: str) -> Scenario:
    scenario = load_scenario(name)
    scenario.planner.grasps = 2
    return scenario


@pytest.mark.parametrize("name", ["shadow_like", "barrett_like"])
def test_a_running_station_compiles_nothing(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = scenario_of(name)
    station = make_station(scenario, model=ObjectModel.from_mesh(scenario.object_mesh()))
    with watched(monkeypatch) as names:
        simulator = start_simulation(station, None)
        hypotheses = station.diagram.GetOutputPort("hypotheses")
        for step in range(1, 100):
            simulator.AdvanceTo(step * scenario.estimation.estimator.period)
            if hypotheses.Eval(simulator.get_context()) is not None:
                break
        assert hypotheses.Eval(simulator.get_context()) is not None
    assert names == []


def test_what_is_compiled_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    def twice(number: float) -> float:
        return 2.0 * number

    with watched(monkeypatch) as names:
        assert numba.njit(twice)(2.0) == 4.0
    assert names == ["twice"]
