"""Tables of estimates for the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from rich import box
from rich.table import Table

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.estimation.descriptions import sigma_cells
from tactopose_drake.estimation.far_origins import about_middle
from tactopose_drake.estimation.results import PoseEstimate

if TYPE_CHECKING:
    from tactopose_drake.cli.demo_reports import FingerReport, PadReport, PoseReport

_MOST_ROWS = 8


def hypotheses_table(estimate: PoseEstimate, model: ObjectModel) -> Table:
    """A table of the most probable hypotheses, with standard deviations in the determined directions."""
    table = Table(
        title=f"Pose of {model.name} in the palm frame",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        collapse_padding=True,  # to fit in 80 columns
    )
    for heading in ("prob.", "translation, mm", "quaternion wxyz", "\u00b1 mm", "\u00b1 deg", "cost"):
        table.add_column(heading, justify="right", no_wrap=True)
    for hypothesis in estimate.hypotheses[:_MOST_ROWS]:
        table.add_row(
            f"{hypothesis.probability:.1%}",
            " ".join(f"{1e3 * x:z.1f}" for x in hypothesis.X_PO.translation()),
            " ".join(f"{x:z.3f}" for x in hypothesis.X_PO.rotation().ToQuaternion().wxyz()),
            *sigma_cells(about_middle(hypothesis, model), model.size),
            f"{hypothesis.cost:.4g}",
        )
    hidden = len(estimate.hypotheses) - _MOST_ROWS
    if hidden > 0:
        table.caption = f"and {hidden} less probable"
    return table


def fingers_table(fingers: Sequence[FingerReport]) -> Table:
    """A table of contacts from the wrenches, compared with the true ones."""
    table = Table(title="Contacts from the fingertips' wrenches, against the simulator's own", box=box.SIMPLE_HEAD)
    table.add_column("finger")
    for heading in ("force, N", "point error, mm", "normal error, deg"):
        table.add_column(heading, justify="right")
    for finger in fingers:
        table.add_row(
            finger.finger,
            f"{finger.force:.2f}",
            "no contact there" if finger.position_error is None else f"{1e3 * finger.position_error:.2f}",
            "" if finger.normal_error is None else f"{np.degrees(finger.normal_error):.2f}",
        )
    return table


def pads_table(pads: Sequence[PadReport]) -> Table:
    """A table of patches from the tactile arrays, compared with the true contacts."""
    table = Table(title="Patches on the tactile arrays, against the simulator's own contacts", box=box.SIMPLE_HEAD)
    table.add_column("pad")
    table.add_column("felt")
    for heading in ("active cells", "force on cells, N", "on the pad, N", "centroid error, mm", "normal error, deg"):
        table.add_column(heading, justify="right")
    for pad in pads:
        table.add_row(
            pad.pad,
            pad.status.replace("_", " "),
            str(pad.active_cells),
            f"{pad.force:.2f}",
            f"{pad.true_force:.2f}",
            "" if pad.centroid_error is None else f"{1e3 * pad.centroid_error:.2f}",
            "" if pad.normal_error is None else f"{np.degrees(pad.normal_error):.2f}",
        )
    return table


def poses_table(poses: Sequence[PoseReport]) -> Table:
    """A table of the object's pose by vision and by touch, compared with the truth."""
    table = Table(
        title="The object's pose, against the truth",
        caption="Means over the contacts (MDTS to MAE). In MATN, one that lies nearer to the other side of a thin wall "
        "counts as turned by 180 deg.",
        box=box.SIMPLE_HEAD,
    )
    table.add_column("error")
    for pose in poses:
        table.add_column(pose.name, justify="right")
    rows = [
        ("position, mm", [1e3 * pose.translation for pose in poses]),
        ("angle, deg", [np.degrees(pose.rotation) for pose in poses]),
        ("position where determined, mm", [1e3 * pose.determined_translation for pose in poses]),
        ("angle where determined, deg", [np.degrees(pose.determined_rotation) for pose in poses]),
        ("contacts to surface (MDTS), mm", [1e3 * pose.MDTS for pose in poses]),
        ("normals to surface (MATN), deg", [np.degrees(pose.MATN) for pose in poses]),
        ("touched points (RME), mm", [1e3 * pose.RME for pose in poses]),
        ("touched normals (MAE), deg", [np.degrees(pose.MAE) for pose in poses]),
    ]
    for name, values in rows:
        table.add_row(name, *(f"{value:.2f}" for value in values))
    return table
