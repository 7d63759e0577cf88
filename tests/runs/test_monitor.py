"""The live table, and what it says where there is no terminal."""

import io
import re

from rich.console import Console

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.drivers.simulation import faults
from tactopose_drake.runs.monitor import Monitor, monitor_table
from tactopose_drake.runs.stepping import RunView
from tests.runs.stations import Running, fingers_running, pads_running


def view_of(running: Running) -> RunView:
    return RunView(running.station.diagram, running.simulator.get_context(), running.devices)


def watch(running: Running, console: Console, duration: float) -> None:
    with Monitor(console) as monitor:
        for _ in range(round(duration / 0.1)):
            running.run(0.1)
            monitor.show(view_of(running))


def printed(table) -> str:
    console = Console(file=io.StringIO(), width=200)
    console.print(table)
    return console.file.getvalue()


def test_a_line_a_second_without_a_terminal(cube: ObjectModel) -> None:
    console = Console(file=io.StringIO(), width=80)
    with fingers_running(cube) as running:
        running.run(0.2)
        running.rig["ring"].faults = [faults.silence]
        watch(running, console, 2.5)
    lines = console.file.getvalue().splitlines()
    assert len(lines) == 3
    assert "thumb 4.89 N 200 Hz" in lines[-1]
    assert "ring no force 0 Hz" in lines[-1]
    assert re.search(r"ring: stale: 2\.\d+ s; no reply", lines[-1])
    assert re.search(r"object at -?\d+\.\d -?\d+\.\d -?\d+\.\d mm; \d+ hypothes[ie]s", lines[-1])


def test_a_table_on_a_terminal(cube: ObjectModel) -> None:
    console = Console(file=io.StringIO(), force_terminal=True, width=120)
    with fingers_running(cube) as running:
        watch(running, console, 0.5)
        table = printed(monitor_table(view_of(running), {"thumb": 200.0}))
    assert "thumb" in console.file.getvalue()
    (row,) = [line for line in table.splitlines() if line.strip().startswith("thumb")]
    assert re.fullmatch(r" *thumb +200 +\d+ +4\.89 N +ok *", row)


def test_pressures_of_the_pads(can: ObjectModel) -> None:
    with pads_running(can) as running:
        running.run(0.4)
        table = printed(monitor_table(view_of(running), {}))
    assert "finger_1 44 kPa, finger_2 36 kPa, finger_3 42 kPa, palm 40 kPa" in table
