"""`tactopose run`: whole scenarios, simulated or on devices; and what is shown of a run."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

import click

from tactopose_drake.cli.consoles import ERRORS, OUT
from tactopose_drake.runs.monitor import Monitor, estimate_line
from tactopose_drake.runs.scenario_run import run_scenario
from tactopose_drake.runs.stepping import Observer, Progress, RunView
from tactopose_drake.station.scenario import load_scenario

_path = click.Path(path_type=Path)
_seconds = click.FloatRange(min=0.0, min_open=True)


@click.command()
@click.argument("scenario", type=str)
@click.option("--duration", type=_seconds, help="s; the scenario's by default, with real devices until Ctrl-C.")
@click.option("--record", type=_path, help="Folder for a recording, new or empty: CAN logs, other signals, manifest.")
@click.option("--monitor", is_flag=True, help="Shows rates, ages, forces, pressures and the estimate live.")
def run(scenario: str, duration: float | None, record: Path | None, monitor: bool) -> None:
    """Runs a SCENARIO, simulated or on CAN devices: one of the package by name, or a YAML file."""
    loaded = load_scenario(scenario)
    with showing(monitor) as (show, tell):
        view = run_scenario(loaded, duration=duration, record=record, observer=show, tell=tell)
    if record is not None:
        OUT.print(f"Recorded: {record}", soft_wrap=True)
    for lost in view.lost:
        ERRORS.print(f"not recorded: {lost}", style="yellow")
    print_end(view)


@contextlib.contextmanager
def showing(monitor: bool) -> Iterator[tuple[Observer, Progress]]:
    """What is to see a run, and what is to be told what begins."""
    if not monitor:
        with ERRORS.status("starting") as status:
            yield (lambda view: None), status.update
        return
    with Monitor(OUT) as live:
        yield live.show, lambda message: ERRORS.print(message, style="dim")


def print_end(view: RunView) -> None:
    """Says what the last estimate is; the exit status tells whether there is one."""
    OUT.print(f"{view.context.get_time():.2f} s: {estimate_line(view)}", soft_wrap=True, highlight=False)
    if view.outcome:
        OUT.print(f"{view.outcome[0].upper()}{view.outcome[1:]}.", soft_wrap=True, highlight=False)
    if view.diagram.GetOutputPort("hypotheses").Eval(view.context) is None:
        raise click.exceptions.Exit(1)
