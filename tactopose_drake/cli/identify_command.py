"""`tactopose identify`: identifies the touched object among many."""

import contextlib
import os
from concurrent.futures import Executor
from pathlib import Path
from typing import get_args

import click
from rich import box
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
from rich.table import Table

from tactopose_drake.cli.consoles import ERRORS, progress_bar, reporting, tell_warnings
from tactopose_drake.cli.option_types import PATH
from tactopose_drake.cli.workers import processes
from tactopose_drake.core.mesh.repair import MeshRepairWarning
from tactopose_drake.errors import InvalidFileError
from tactopose_drake.estimation.data_checks import naming_contacts_of
from tactopose_drake.estimation.files import save_identification
from tactopose_drake.estimation.identification import check_prior, identify
from tactopose_drake.estimation.identities import Identification
from tactopose_drake.estimation.object_library import LibraryWarning, ObjectLibrary
from tactopose_drake.estimation.output_files import check_outputs
from tactopose_drake.estimation.ranking import Likelihood
from tactopose_drake.hand.touch_file import load_touch

_MOST_ROWS = 12
_BAR = 12  # characters of the longest bar
_NONE = "none of these"


@click.command(name="identify")
@click.option("--library", "folder", type=PATH, required=True, help="Folder of meshes in metres, or a manifest.")
@click.option("--contacts", "contacts_file", type=PATH, required=True, help="contacts.yaml: contacts, patches.")
@click.option(
    "--jobs",
    type=click.IntRange(min=1),
    default=os.cpu_count() or 1,
    show_default="number of cores",
    help="Number of processes that index new objects.",
)
@click.option(
    "--likelihood",
    type=click.Choice(get_args(Likelihood)),
    default="evidence",
    show_default=True,
    help="Measure that ranks the objects; the inverse of the lowest cost is the thesis' one.",
)
@click.option(
    "--unknown-prior",
    type=float,
    default=1.0 / 3.0,
    show_default="a third",
    help="Prior probability that it is none of the objects; 0 rules that out.",
)
@click.option("--out", type=PATH, help="Writes the result here, as JSON.")
def identify_command(
    folder: Path, contacts_file: Path, jobs: int, likelihood: Likelihood, unknown_prior: float, out: Path | None
) -> None:
    """Identifies the touched object among those of a library; it may be none of them."""
    contacts, patches, planes = load_touch(contacts_file)
    if planes:
        raise InvalidFileError(f"{contacts_file}: planes must be left out, as they are not used to identify objects.")
    tell_warnings(LibraryWarning, MeshRepairWarning)
    check_prior("--unknown-prior", unknown_prior)
    check_outputs((out,), inputs=(folder, contacts_file))
    with contextlib.nullcontext() if jobs == 1 else processes(jobs) as executor:
        library = _open(folder, executor)
    # The few candidates are estimated in this process: starting others would take longer than they save.
    comparing = ERRORS.status(f"comparing {len(library)} objects (the first run on a machine compiles its kernels)")
    with comparing, naming_contacts_of(contacts_file):
        found = identify(library, contacts, patches=patches, likelihood=likelihood, unknown_prior=unknown_prior)
    with reporting((out,), _table(found), identification_line(found)):
        if out is not None:
            save_identification(out, found)


def _open(folder: Path, executor: Executor | None) -> ObjectLibrary:
    """Opens a library with a progress bar of its indexing."""
    columns = (TextColumn("indexing"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with progress_bar(*columns) as progress:
        task = progress.add_task("indexing", total=None)
        return ObjectLibrary.open(
            folder,
            executor=executor,
            on_progress=lambda done, total: progress.update(task, completed=done, total=total),
        )


def _table(found: Identification) -> Table:
    """A table of the objects that were estimated, the most likely first, and of an unknown object."""
    table = Table(title="Touched object", box=box.SIMPLE_HEAD, pad_edge=False)
    for heading in ("rank", "object", "probability", "", "log evidence", "explained"):
        is_number = heading in ("rank", "probability", "log evidence")
        # Long names are folded, but not numbers.
        table.add_column(
            heading, justify="right" if is_number else "left", no_wrap=heading != "object", overflow="fold"
        )
    most = max(found.best.probability, found.unknown)
    shown = [identity for identity in found[:_MOST_ROWS] if identity.estimate is not None]
    for identity in shown:
        assert identity.estimate is not None
        table.add_row(
            str(identity.rank),
            identity.name,
            f"{identity.probability:.1%}",
            "\u2588" * round(_BAR * identity.probability / most),
            f"{identity.log_evidence:.1f}",
            "no" if identity.estimate.status == "no_solution" else "yes",
        )
    table.add_row("", _NONE, f"{found.unknown:.1%}", "\u2588" * round(_BAR * found.unknown / most), style="italic")
    if len(found) > len(shown):
        table.caption = f"and {len(found) - len(shown)} less likely"
    return table


def identification_line(found: Identification) -> str:
    """A sentence on the meaning of the status."""
    ties = [identity for identity in found if identity.rank == found.best.rank]
    names = [identity.name for identity in ties]
    name = found.best.name if len(ties) == 1 else f"{' or '.join(names)}, which have the same shape"
    if found.unknown >= 0.5:
        explanation = f"It is probably {_NONE} ({found.unknown:.0%}); the nearest is {name}."
    elif found.unknown >= sum(identity.probability for identity in ties):
        explanation = f"That is not certain; it may be {_NONE} ({found.unknown:.0%}), or {name}."
    else:
        explanation = {
            "ok": f"It is {name}.",
            "ambiguous": f"That is not certain; the most probable is {name}.",
            "no_solution": f"Not even the most probable explains the touch within its noise: {name}.",
        }[found.status]
    return f"{found.status}: {explanation} ({1e3 * found.duration:.0f} ms)"
