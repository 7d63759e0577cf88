"""`tactopose calibrate`: estimates a hand's errors from grasps of a known object."""

import os
from collections.abc import Collection
from pathlib import Path

import click
import numpy as np
from rich import box
from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from tactopose_drake.cli.calibration_page import save_calibration_page
from tactopose_drake.cli.calibration_reports import HEADINGS, calibration_rows, remaining_line
from tactopose_drake.cli.consoles import ERRORS, progress_bar, reporting, tell_warnings
from tactopose_drake.cli.option_types import HAND, HAND_HELP, OBJECT, OBJECT_HELP, PATH, object_file
from tactopose_drake.core.mesh.repair import MeshRepairWarning
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.estimation.object_files import load_object
from tactopose_drake.estimation.output_files import check_outputs
from tactopose_drake.hand.calibration_file import HandCalibration
from tactopose_drake.hand.hand_calibration import USED, CalibrationParams, CalibrationResult, calibrate_hand
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.recorded_grasps import GRASP_ENDINGS, RecordedGrasp, load_grasps
from tactopose_drake.runs.manifest import MANIFEST
from tactopose_drake.runs.quiet_instant import read_quiet_grasp

_MOST_NAMED = 8  # undetermined combinations that are listed
_SURE = 0.9  # grasps whose pose is less probable than this are listed
_GOOD = (0.0005, 2.0)  # largest residuals of a contact with the right mesh, m and deg
_MANY = 0.25  # a finger is listed if more than one, and more than this share, of its contacts do not fit


@click.command("calibrate")
@click.option("--hand", type=HAND, required=True, help=f"{HAND_HELP}.")
@click.option("--object", "name", type=OBJECT, required=True, help=f"{OBJECT_HELP}.")
@click.option("--scale", type=float, default=1.0, show_default=True, help="Metres in the mesh's unit: 0.001 for mm.")
@click.option("--grasps", "folder", type=PATH, required=True, help="Folder of grasps: files or recordings.")
@click.option(
    "--out",
    type=PATH,
    default=Path("calibration.yaml"),
    show_default=True,
    help="The result, for the key `calibration` of the hand's file.",
)
@click.option("--html", type=PATH, help="Writes a page with all residuals, before and after, finger by finger.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of the searches for poses.")
def calibrate(hand: str, name: str, scale: float, folder: Path, out: Path, html: Path | None, seed: int) -> None:
    """Estimates a hand's errors from grasps of one known object, in poses that need not be known.

    The folder holds a YAML or JSON file for each grasp, or recordings of `tactopose run --record`.
    """
    tell_warnings(MeshRepairWarning)
    config, mesh = load_hand_config(hand, with_calibration=False), object_file(name)
    is_anew = bool(config.calibration) and os.path.realpath(out) == os.path.realpath(config.calibration)
    check_outputs((out, html), inputs=(mesh, Path(hand), folder), renewed=out if is_anew else None)
    with ERRORS.status(f"reading {name}"):
        model = load_object(mesh, scale=scale)
    grasps = _grasps(folder, model)
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with progress_bar(*columns) as progress:
        task = progress.add_task("calibrating", total=1.0)
        result = calibrate_hand(
            config,
            grasps,
            CalibrationParams(seed=seed),
            on_progress=lambda share, doing: progress.update(task, completed=share, description=doing),
        )
    names = [grasp.name for grasp in grasps]
    table = calibration_table(result.calibration, result.sliding)
    with reporting((out, html), table, *calibration_lines(result, names)):
        result.save(out)
        if html is not None:
            save_calibration_page(html, hand, result, names)


def _grasps(folder: Path, model: ObjectModel) -> tuple[RecordedGrasp, ...]:
    """Reads the grasps of a folder, from files and recordings in it."""
    if (folder / MANIFEST).is_file():
        raise InvalidInputError(f"{folder} must be a folder that holds a recording for each grasp, not one itself.")
    recordings = sorted(path.parent for path in folder.glob(f"*/{MANIFEST}")) if folder.is_dir() else []
    has_files = any(path.suffix.lower() in GRASP_ENDINGS for path in folder.iterdir()) if recordings else True
    grasps = list(load_grasps(folder, model)) if has_files else []
    for path in recordings:
        grasp, problems = read_quiet_grasp(path, model)
        grasps.append(grasp)
        for problem in problems:
            ERRORS.print(problem, style="yellow")
    return tuple(grasps)


def calibration_table(found: HandCalibration, sliding: Collection[str]) -> Table:
    """A table with one row for each estimated error, or for three of the same kind.

    Args:
        found: the calibration.
        sliding: names of the prismatic joints.
    """
    table = Table(title=f"The hand by {found.grasps} grasps", box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column(HEADINGS[0])
    for heading in HEADINGS[1:]:
        table.add_column(heading, justify="right")
    for row in calibration_rows(found, sliding):
        table.add_row(*row)
    return table


def calibration_lines(result: CalibrationResult, names: list[str]) -> list[str]:
    """Remarks on a calibration, one sentence each."""
    noise = result.calibration.noise
    lines = [remaining_line(result)]
    if noise.position > _GOOD[0] or noise.normal_deg > _GOOD[1]:
        lines.append(
            f"That is much: with the right mesh, and errors as the hand's `uncertainty` says, it is below "
            f"{1e3 * _GOOD[0]:g} mm and {_GOOD[1]:g} deg. Do not trust this calibration before you know why."
        )
    lines += [
        f"No wrench of {finger} gives a contact, so that nothing is known of this finger: {reason}."
        for finger, reason in result.without_contact.items()
    ]
    lines += [
        f"Of {finger}, {np.sum(weights < USED)} of {len(weights)} contacts do not fit the others and were ignored: "
        "its sensor, its wrenches' frame or its joints are not as the hand's file says."
        for finger, weights in result.contact_weights.items()
        if np.sum(weights < USED) > max(1.0, _MANY * len(weights)) and finger not in result.without_contact
    ]
    left_out = [name for name, weight in zip(names, result.grasp_weights, strict=True) if weight < USED]
    if left_out:
        lines.append(f"Left out, because no pose of the object explains them with the others: {', '.join(left_out)}.")
    doubtful = [
        name
        for name, weight, probability in zip(names, result.grasp_weights, result.pose_probability, strict=True)
        if weight >= USED and probability < _SURE
    ]
    if doubtful:
        lines.append(f"Another pose explains these, too, which the uncertainty includes: {', '.join(doubtful)}.")
    texts = [combination.text for combination in result.undetermined]
    if texts:
        more = f"; and {len(texts) - _MOST_NAMED} more" if len(texts) > _MOST_NAMED else ""
        lines.append(f"Not determined by these grasps: {'; '.join(texts[:_MOST_NAMED])}{more}.")
    if not result.converged:
        lines.append("The fit has not converged: record other grasps, or more of them.")
    return lines
