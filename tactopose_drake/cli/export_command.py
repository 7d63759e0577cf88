"""`tactopose export`: converts recordings to formats of other programs."""

from pathlib import Path

import click

from tactopose_drake.cli.consoles import ERRORS, reporting
from tactopose_drake.cli.option_types import PATH
from tactopose_drake.estimation.output_files import check_outputs
from tactopose_drake.runs.csv_export import write_csv
from tactopose_drake.runs.manifest import load_manifest
from tactopose_drake.runs.mcap_export import write_mcap
from tactopose_drake.runs.recorded_senses import read_recording

_WRITERS = {"mcap": write_mcap, "csv": write_csv}


@click.command()
@click.argument("log", type=PATH)
@click.option("--format", "kind", type=click.Choice(list(_WRITERS)), required=True, help="Of the file.")
@click.option("--out", type=PATH, help="The file; LOG with the format's ending by default.")
def export(log: Path, kind: str, out: Path | None) -> None:
    """Writes LOG, a folder by `run --record`, as one file: for Foxglove, PlotJuggler and rosbag2, or as a table."""
    load_manifest(log)  # Reports a folder that is not a recording before anything else.
    if out is None:
        # `.` and `..` are resolved to the folder's name.
        out = log.resolve().parent / f"{log.resolve().name}.{kind}"
    check_outputs((out,), inputs=(log,))
    with reporting((out,)):
        with ERRORS.status("reading the recording") as status:
            run = read_recording(log)
            status.update("writing")
            _WRITERS[kind](run, out)
        for problem in run.problems:
            ERRORS.print(problem, style="yellow")
