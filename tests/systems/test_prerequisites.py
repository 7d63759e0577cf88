"""What a port shows is what its system's inputs and state say now: all that it is computed of is declared."""

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, Diagram, InputPort, OutputPort, System

from tactopose_drake.runs.simulation import start_simulation
from tactopose_drake.station.scenario import load_scenario
from tactopose_drake.station.simulated import make_station
from tactopose_drake.systems.collectable_system import CollectableSystem
from tactopose_drake.systems.pose_tracking import PoseTrackingParams


def leaves(diagram: Diagram) -> Iterator[CollectableSystem]:
    system: System
    for system in diagram.GetSystems():
        if isinstance(system, Diagram):
            yield from leaves(system)
        elif isinstance(system, CollectableSystem):
            yield system


def plain(value: Any) -> Any:
    """A value of lists, dictionaries and texts, for comparison."""
    if isinstance(value, RigidTransform):
        return plain(value.GetAsMatrix34())
    if isinstance(value, np.ndarray):
        return (value.shape, value.tobytes())
    if dataclasses.is_dataclass(value):
        return [plain(getattr(value, field.name)) for field in dataclasses.fields(value)]
    if isinstance(value, dict):
        return {name: plain(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    return repr(value)


def shown(ports: list[OutputPort], root: Context) -> dict[str, Any]:
    found = {}
    for port in ports:
        system = port.get_system()
        found[f"{system.GetSystemPathname()}: {port.get_name()}"] = plain(port.Eval(system.GetMyContextFromRoot(root)))
    return found


def undeclared(port: OutputPort, root: Context, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Which inputs of its system a port reads, although Drake is not told that it changes with them."""
    system, read, evaluate = port.get_system(), set(), InputPort.Eval

    def watched(source: InputPort, context: Context) -> Any:
        if source.get_system() is system:
            read.add(int(source.get_index()))
        return evaluate(source, context)

    root.SetAllCacheEntriesOutOfDate()
    with monkeypatch.context() as patch:
        patch.setattr(InputPort, "Eval", watched)
        port.Eval(system.GetMyContextFromRoot(root))
    untold = [index for index in sorted(read) if not system.HasDirectFeedthrough(index, int(port.get_index()))]
    return [f"{system.get_name()}: {port.get_name()} by {system.get_input_port(index).get_name()}" for index in untold]


@pytest.mark.parametrize("name", ["shadow_like", "barrett_like"])
def test_no_port_of_a_running_station_shows_what_was(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = load_scenario(name)
    scenario.planner.grasps = 2
    scenario.tracking = PoseTrackingParams()
    station = make_station(scenario)
    simulator = start_simulation(station, None)
    root = simulator.get_mutable_context()
    ports = [leaf.get_output_port(i) for leaf in leaves(station.diagram) for i in range(leaf.num_output_ports())]
    first, moved = shown(ports, root), set()
    for time in (0.1, 0.25, 1.0):
        simulator.AdvanceTo(time)
        kept = shown(ports, root)
        root.SetAllCacheEntriesOutOfDate()
        fresh = shown(ports, root)
        assert [port for port in kept if kept[port] != fresh[port]] == []
        moved |= {port for port in fresh if fresh[port] != first[port]}
    assert len(moved) > 0.6 * len(ports)
    assert [missing for port in ports for missing in undeclared(port, root, monkeypatch)] == []
