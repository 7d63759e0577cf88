"""`tactopose check-hand`: checks a hand's files, with a table and a page as results."""

from pathlib import Path

import click
from rich import box
from rich.table import Table

from tactopose_drake.cli.consoles import ERRORS, OUT, reporting
from tactopose_drake.cli.hand_page import save_hand_page
from tactopose_drake.cli.option_types import HAND, PATH
from tactopose_drake.estimation.output_files import check_outputs
from tactopose_drake.hand.findings import Finding, fingers_yaml
from tactopose_drake.hand.hand_check import check_hand
from tactopose_drake.hand.hand_config import PadConfig
from tactopose_drake.hand.tactile_pads import load_tactile_pad
from tactopose_drake.visualization.layout_picture import save_layout_picture

_STYLES = {"ok": "green", "note": "yellow", "fault": "red"}
_SUGGESTED = "Suggested entries of these fingers in the hand's file:"


@click.command("check-hand")
@click.argument("hand", type=HAND)
@click.option("--html", type=PATH, help="Writes a page that shows the hand with its frames and fingertips, by name.")
@click.option("--cells", type=PATH, help="Writes a picture of the tactile pads' cells with their numbers, as PNG.")
def check_hand_command(hand: str, html: Path | None, cells: Path | None) -> None:
    """Checks HAND, a hand's YAML file, or one of the package by name: the exit status is 2 if it has a fault."""
    check_outputs((html, cells), inputs=(Path(hand),))
    with ERRORS.status(f"checking {hand}"):
        check = check_hand(hand)
    pads = [] if check.parts is None else check.parts.hand.config.pads
    unwritten = {}
    if html is not None and check.parts is None:
        unwritten[html] = "the hand cannot be read"
    if cells is not None and not pads:
        unwritten[cells] = "the hand cannot be read" if check.parts is None else "the hand has no tactile pads"
    written = [path for path in (html, cells) if path is not None and path not in unwritten]
    suggested = [_SUGGESTED, fingers_yaml(check.entries)] if check.entries else []
    with reporting(written, findings_table(hand, check.findings), *suggested):
        if html in written:
            save_hand_page(html, hand, check)
        if cells in written:
            _save_cells(cells, pads)
    for path, reason in unwritten.items():
        OUT.print(f"{path} is not written, since {reason}.", style="yellow", soft_wrap=True)
    for fault in check.faults:
        named = fault.text.startswith((f"{hand}: ", f"{hand} "))
        ERRORS.print(f"error: {fault.text if named else f'{hand}: {fault.part}: {fault.text}'}.", style="red")
    if check.faults:
        raise click.exceptions.Exit(2)


def _save_cells(path: Path, pads: list[PadConfig]) -> None:
    """Writes the picture; an array that several pads share is drawn once."""
    arrays: dict[str, list[str]] = {}
    for pad in pads:
        arrays.setdefault(pad.array, []).append(pad.name)
    rows = {f"{', '.join(names)} ({Path(array).stem})": array for array, names in arrays.items()}
    save_layout_picture(path, {row: load_tactile_pad(array).layout for row, array in rows.items()})


def findings_table(hand: str, findings: tuple[Finding, ...]) -> Table:
    """A table with one row for each finding."""
    table = Table(title=f"The hand {hand}", box=box.SIMPLE_HEAD, pad_edge=False)
    for heading in ("", "part", "what was found"):
        table.add_column(heading)
    for finding in findings:
        table.add_row(finding.verdict, finding.part, finding.text, style=_STYLES[finding.verdict])
    return table
