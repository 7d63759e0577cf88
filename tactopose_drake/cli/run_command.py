"""`tactopose run`: runs scenarios, simulated or on devices, and shows the run."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

import click

from tactopose_drake.cli.consoles import ERRORS, OUT, print_written, tell_warnings
from tactopose_drake.cli.option_types import HAND, HAND_HELP, PATH
from tactopose_drake.cli.titles import grasp_title
from tactopose_drake.core.mesh.repair import MeshRepairWarning
from tactopose_drake.core.validation import told_of
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.estimation.output_files import check_outputs
from tactopose_drake.runs.monitor import Monitor, estimate_line, explained_estimate, wrong_senses
from tactopose_drake.runs.page_recorder import PageRecorder
from tactopose_drake.runs.scenario_run import run_scenario
from tactopose_drake.runs.stepping import Observer, Progress, RunView
from tactopose_drake.station.message_channels import LcmSenses, Ros2Senses
from tactopose_drake.station.scenario import Scenario, load_scenario, scenario_file

_seconds = click.FloatRange(min=0.0, min_open=True)


@click.command()
@click.argument("scenario", type=str)
@click.option("--hand", type=HAND, help=f"{HAND_HELP}, in place of the scenario's.")
@click.option("--duration", type=_seconds, help="s; the scenario's by default, with real devices until Ctrl-C.")
@click.option("--record", type=PATH, help="Folder for a recording, new or empty: CAN logs, other signals, manifest.")
@click.option("--html", type=PATH, help="Writes a page here: hand, touch and belief at any time, with a slider.")
@click.option("--picture", type=PATH, help="Writes a picture of the last estimate here, as PNG.")
@click.option("--monitor", is_flag=True, help="Shows rates, ages, forces, pressures and the estimate live.")
def run(
    scenario: str,
    hand: str | None,
    duration: float | None,
    record: Path | None,
    html: Path | None,
    picture: Path | None,
    monitor: bool,
) -> None:
    """Runs a SCENARIO, simulated or on CAN devices: one of the package by name, or a YAML file.

    For a simulated run it prints whether the grasp is stable, and the error of the estimate.
    """
    tell_warnings(MeshRepairWarning)
    loaded = load_scenario(scenario)
    if hand is not None:
        loaded.hand = hand
        with told_of("--hand: "):
            loaded.validate()
    for path in (html, picture):
        if path is not None and record is not None and path.absolute().is_relative_to(record.absolute()):
            raise InvalidInputError(f"{path} must not be in {record}, as a recording's folder holds nothing else.")
    check_outputs((html, picture), inputs=(scenario_file(scenario), None if hand is None else Path(hand), record))
    drawn = _recorder(loaded) if html is not None or picture is not None else None
    earlier = [path for path in (html, picture) if path is not None and path.is_file()]
    written: list[Path] = []
    with showing(monitor) as (show, tell):

        def keep_and_show(view: RunView) -> None:
            if drawn is not None:
                drawn.show(view)
            show(view)

        view = run_scenario(loaded, duration=duration, record=record, observer=keep_and_show, tell=tell)
        if drawn is not None:
            tell("writing the results")
            written = _save(drawn, html, picture, f"{grasp_title(loaded)}: {Path(scenario).name}")
    print_written(written, earlier)
    if record is not None:
        OUT.print(f"Recorded: {record}", soft_wrap=True)
    for lost in view.lost:
        ERRORS.print(f"not recorded: {lost}", style="yellow")
    for cut in view.cut:
        ERRORS.print(cut, style="yellow")
    if view.slowness:
        ERRORS.print(f"warning: {view.slowness}", style="yellow")
    print_end(view)


def _recorder(scenario: Scenario) -> PageRecorder:
    if isinstance(scenario.senses, LcmSenses | Ros2Senses):
        raise InvalidInputError("--html and --picture must be left out if the senses are messages.")
    return PageRecorder(scenario, scenario.object_model())


def _save(drawn: PageRecorder, html: Path | None, picture: Path | None, title: str) -> list[Path]:
    """Writes page and picture as requested, or prints why not; returns the written paths."""
    is_written = {}
    if html is not None:
        is_written[html] = drawn.save(html, title)
    if picture is not None:
        is_written[picture] = drawn.save_picture(picture)
    for path in (path for path, done in is_written.items() if not done):
        OUT.print(f"{path} is not written, since there was no estimate.", style="yellow", soft_wrap=True)
    return [path for path, done in is_written.items() if done]


@contextlib.contextmanager
def showing(monitor: bool) -> Iterator[tuple[Observer, Progress]]:
    """Yields an observer and a progress callback for a run."""
    if not monitor:
        with ERRORS.status("starting") as status:
            yield (lambda view: None), status.update
        return
    with Monitor(OUT) as live:
        yield live.show, lambda message: ERRORS.print(message, style="dim")


def print_end(view: RunView) -> None:
    """Prints the last estimate; exits with status 1 if there is none."""
    OUT.print(f"{view.time:.2f} s: {estimate_line(view)}", soft_wrap=True, highlight=False)
    if (wrong := wrong_senses(view)) != "ok":
        OUT.print(f"Senses: {wrong}.", soft_wrap=True, highlight=False)
    if view.outcome:
        OUT.print(f"{view.outcome[0].upper()}{view.outcome[1:]}.", soft_wrap=True, highlight=False)
    if explained_estimate(view) is None:
        raise click.exceptions.Exit(1)
