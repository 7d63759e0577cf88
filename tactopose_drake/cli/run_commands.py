"""`tactopose run` and `tactopose replay`: whole scenarios, and recordings of them, on the command line."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

import click

from tactopose_drake.cli.consoles import ERRORS, OUT
from tactopose_drake.estimation.output_files import check_outputs, written_beside
from tactopose_drake.runs.estimate_writer import EstimateWriter
from tactopose_drake.runs.monitor import Monitor, estimate_line
from tactopose_drake.runs.scenario_replay import replay as replay_recording
from tactopose_drake.runs.scenario_run import run_scenario
from tactopose_drake.runs.stepping import Observer, Progress, RunView
from tactopose_drake.station.scenario import load_scenario, scenario_file

_path = click.Path(path_type=Path)
_seconds = click.FloatRange(min=0.0, min_open=True)
_console, _errors = OUT, ERRORS


@click.command()
@click.argument("scenario", type=str)
@click.option("--duration", type=_seconds, help="s; the scenario's by default, with real devices until Ctrl-C.")
@click.option("--record", type=_path, help="Folder for a recording, new or empty: CAN logs, other signals, manifest.")
@click.option("--monitor", is_flag=True, help="Shows rates, ages, forces, pressures and the estimate live.")
def run(scenario: str, duration: float | None, record: Path | None, monitor: bool) -> None:
    """Runs a SCENARIO, simulated or on CAN devices: one of the package by name, or a YAML file."""
    loaded = load_scenario(scenario)
    with _showing(monitor) as (show, tell):
        view = run_scenario(loaded, duration=duration, record=record, observer=show, tell=tell)
    if record is not None:
        _console.print(f"Recorded: {record}", soft_wrap=True)
    for lost in view.lost:
        _errors.print(f"not recorded: {lost}", style="yellow")
    _end(view)


@click.command()
@click.argument("log", type=_path)
@click.option("--scenario", required=True, help="Of the same hand, object and devices; how to estimate may differ.")
@click.option(
    "--speed", type=click.Choice(["max", "real"]), default="max", show_default=True, help="How fast it plays."
)
@click.option("--out", type=_path, help="Writes the estimates here, a line of JSON each.")
@click.option("--monitor", is_flag=True, help="Shows rates, ages, forces, pressures and the estimate live.")
def replay(log: Path, scenario: str, speed: str, out: Path | None, monitor: bool) -> None:
    """Plays LOG, a folder that `run --record` made, through the drivers: the same estimates each time, bit by bit."""
    loaded = load_scenario(scenario)
    check_outputs((out,), inputs=(log, scenario_file(scenario)))
    with contextlib.ExitStack() as parts:
        writer = None if out is None else parts.enter_context(_written(out))
        show, tell = parts.enter_context(_showing(monitor))

        def write_and_show(view: RunView) -> None:
            if writer is not None:
                writer.write(view.diagram, view.context)
            show(view)

        played = replay_recording(log, loaded, paced=speed == "real", observer=write_and_show, tell=tell)
    for end in played.ends:
        _console.print(end, style=None if played.whole else "yellow", soft_wrap=True, markup=False)
    if played.difference:
        _console.print(played.difference, style="yellow", soft_wrap=True, markup=False)
    _end(played.view)


@contextlib.contextmanager
def _written(out: Path) -> Iterator[EstimateWriter]:
    """A writer of a file that is there when all is written.

    Raises:
        InvalidFileError: if it could not be written to its end.
    """
    with written_beside(out) as beside:
        with EstimateWriter(beside) as writer:
            yield writer
        if writer.file.problem:
            raise OSError(writer.file.problem)


@contextlib.contextmanager
def _showing(monitor: bool) -> Iterator[tuple[Observer, Progress]]:
    """What is to see a run, and what is to be told what begins."""
    if not monitor:
        with _errors.status("starting") as status:
            yield (lambda view: None), status.update
        return
    with Monitor(_console) as live:
        yield live.show, lambda message: _errors.print(message, style="dim")


def _end(view: RunView) -> None:
    """Says what the last estimate is; the exit status tells whether there is one."""
    _console.print(f"{view.context.get_time():.2f} s: {estimate_line(view)}", soft_wrap=True, highlight=False)
    if view.diagram.GetOutputPort("hypotheses").Eval(view.context) is None:
        raise click.exceptions.Exit(1)
