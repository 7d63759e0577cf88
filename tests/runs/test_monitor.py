"""The live table, and what it says where there is no terminal."""

import io
import re
from types import SimpleNamespace

import pytest
from pydrake.math import RigidTransform
from rich.console import Console

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.drivers.simulation import faults
from tactopose_drake.runs.device_run import slowness_of
from tactopose_drake.runs.monitor import Monitor, estimate_line, monitor_table
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
    assert re.search(r"ring: stale: 2\.\d+ s old; no reply", lines[-1])
    assert re.search(r"object at -?\d+\.\d -?\d+\.\d -?\d+\.\d mm; \d+ hypothes[ie]s", lines[-1])


def test_one_run_after_another(cube: ObjectModel) -> None:
    """Rates are not counted from the samples of the run before, whose clock may be any other."""
    console = Console(file=io.StringIO(), width=80)
    monitor = Monitor(console)
    for duration in (2.5, 1.5):
        with fingers_running(cube) as running, monitor:
            for _ in range(round(duration / 0.1)):
                running.run(0.1)
                monitor.show(view_of(running))
    assert "thumb 4.89 N 200 Hz" in console.file.getvalue().splitlines()[-1]


def test_a_table_on_a_terminal(cube: ObjectModel) -> None:
    console = Console(file=io.StringIO(), force_terminal=True, width=120)
    with fingers_running(cube) as running:
        watch(running, console, 0.5)
        table = printed(monitor_table(view_of(running), {"thumb": 200.0}))
    assert "thumb" in console.file.getvalue()
    (row,) = [line for line in table.splitlines() if line.strip().startswith("thumb")]
    assert re.fullmatch(r" *thumb +200 +\d+ +4\.89 N +ok *", row)


class Ports:
    """A diagram by what its ports give."""

    def __init__(self, **values: object) -> None:
        self.values = values

    def HasOutputPort(self, name: str) -> bool:
        return name in self.values

    def GetOutputPort(self, name: str) -> SimpleNamespace:
        return SimpleNamespace(Eval=lambda context: self.values[name])


def estimate_of(status: str, count: int, probability: float) -> SimpleNamespace:
    return SimpleNamespace(status=status, hypotheses=[None] * count, best=SimpleNamespace(probability=probability))


INSTANT = {
    "status": "ok",
    "object_pose": RigidTransform([0.001, 0.002, 0.003]),
    "hypotheses": estimate_of("ok", 1, 1.0),
}


@pytest.mark.parametrize(
    ("values", "line"),
    [
        ({}, "ok; object at 1.0 2.0 3.0 mm; 1 hypothesis, the best with 100%"),
        (
            {"object_pose": RigidTransform([-1e-6, 0.002, 0.003])},
            "ok; object at 0.0 2.0 3.0 mm; 1 hypothesis, the best with 100%",
        ),
        (
            {"status": "held: no pose explains the touch", "hypotheses": estimate_of("no_solution", 12, 1.0)},
            "held: no pose explains the touch",
        ),
        (
            {
                "tracked_status": "slipping",
                "tracked_object_pose": RigidTransform([0.004, 0.005, 0.006]),
                "tracked_hypotheses": estimate_of("ambiguous", 3, 0.5),
            },
            "slipping; object at 4.0 5.0 6.0 mm; 3 hypotheses, the best with 50%",
        ),
        (
            {"tracked_status": "lost", "tracked_object_pose": RigidTransform(), "tracked_hypotheses": None},
            "lost",
        ),
    ],
)
def test_a_pose_is_shown_where_one_explains_the_touch_and_that_of_the_belief_where_there_is_one(
    values: dict[str, object], line: str
) -> None:
    assert estimate_line(RunView(Ports(**{**INSTANT, **values}), None)) == line


def test_pressures_of_the_pads(can: ObjectModel) -> None:
    with pads_running(can) as running:
        running.run(0.4)
        table = printed(monitor_table(view_of(running), {}))
    assert "finger_1 44 kPa, finger_2 36 kPa, finger_3 42 kPa, palm 40 kPa" in table


def test_a_run_that_falls_behind_its_devices_says_by_how_much() -> None:
    assert slowness_of(0.2, 2.0) == ""
    assert slowness_of(0.3, 2.0) != ""
    assert slowness_of(7.0, 2.0).startswith("at 2.00 s the run was 7.00 s behind its devices, its most: estimates take")


def test_a_clock_that_begins_anew_and_a_silence_are_shown() -> None:
    console = Console(file=io.StringIO(), width=200)
    diagram = Ports(**INSTANT)
    diagram.num_output_ports = lambda: 0
    with Monitor(console) as monitor:
        for time, status in ((1e9, "ok: a"), (1e9 + 0.1, "ok: b"), (0.0, "ok: c"), (0.1, "lost: no senses for 0.2 s")):
            context = SimpleNamespace(get_time=lambda time=time: time)
            monitor.show(RunView(diagram, context, status=status, start=time - 3.0))
    lines = console.file.getvalue().splitlines()
    assert len(lines) == 3
    assert lines[0].startswith("3.00 s")
    assert "ok: a; object at 1.0 2.0 3.0 mm" in lines[0]
    assert "ok: c; object at" in lines[1]
    assert lines[2].endswith("lost: no senses for 0.2 s")
