"""`tactopose replay`: replays recordings through the drivers."""

import contextlib
import dataclasses
from collections.abc import Iterator
from pathlib import Path

import click

from tactopose_drake.cli.consoles import OUT, print_written, tell_warnings
from tactopose_drake.cli.option_types import PATH
from tactopose_drake.cli.run_command import print_end, showing
from tactopose_drake.cli.titles import grasp_title
from tactopose_drake.core.mesh.repair import MeshRepairWarning
from tactopose_drake.estimation.output_files import check_outputs, written_beside
from tactopose_drake.runs.estimate_writer import EstimateWriter
from tactopose_drake.runs.manifest import load_manifest
from tactopose_drake.runs.page_recorder import PageRecorder
from tactopose_drake.runs.scenario_replay import replay as replay_recording
from tactopose_drake.runs.stepping import RunView
from tactopose_drake.station.scenario import load_scenario, scenario_file


@click.command()
@click.argument("log", type=PATH)
@click.option("--scenario", required=True, help="With the same hand, object and devices; the estimation may differ.")
@click.option(
    "--speed", type=click.Choice(["max", "real"]), default="max", show_default=True, help="How fast it plays."
)
@click.option("--out", type=PATH, help="Writes the estimates here, as JSON lines.")
@click.option("--html", type=PATH, help="Writes a page here: hand, touch and belief at any time, with a slider.")
@click.option("--monitor", is_flag=True, help="Shows rates, ages, forces, pressures and the estimate live.")
def replay(log: Path, scenario: str, speed: str, out: Path | None, html: Path | None, monitor: bool) -> None:
    """Replays LOG, a folder by `run --record`, through the drivers; estimates are reproducible to the last bit."""
    tell_warnings(MeshRepairWarning)
    loaded = load_scenario(scenario)
    check_outputs((out, html), inputs=(log, scenario_file(scenario)))
    written = [path for path in (out, html) if path is not None]
    earlier = [path for path in written if path.is_file()]
    page = None
    if html is not None:
        # Whether the hand's calibration holds depends on where the recorded data came from.
        recorded = dataclasses.replace(loaded, senses=load_manifest(log).scenario.senses)
        page = PageRecorder(recorded, loaded.object_model())
    with contextlib.ExitStack() as parts:
        writer = None if out is None else parts.enter_context(_written(out))
        show, tell = parts.enter_context(showing(monitor))

        def write_and_show(view: RunView) -> None:
            if writer is not None:
                writer.write(view.diagram, view.context)
            if page is not None:
                page.show(view)
            show(view)

        played = replay_recording(log, loaded, paced=speed == "real", observer=write_and_show, tell=tell)
    title = f"{grasp_title(loaded)}: recording {log.absolute().name}"
    if page is not None and html is not None and not page.save(html, title):
        written.remove(html)
    for end in played.ends:
        OUT.print(end, style=None if played.whole else "yellow", soft_wrap=True, markup=False)
    if played.difference:
        OUT.print(played.difference, style="yellow", soft_wrap=True, markup=False)
    if html is not None and html not in written:
        OUT.print(f"{html} is not written, since there was no estimate.", style="yellow", soft_wrap=True)
    print_written(written, earlier)
    print_end(played.view)


@contextlib.contextmanager
def _written(out: Path) -> Iterator[EstimateWriter]:
    """A writer of a file that is created only when it is complete.

    Raises:
        InvalidFileError: if it could not be written completely.
    """
    with written_beside(out) as beside:
        with EstimateWriter(beside) as writer:
            yield writer
        if writer.file.error:
            raise writer.file.error
