"""The display of an estimate: as a page in a browser or a notebook, and as a small table with a picture."""

import base64
import dataclasses
import html
import importlib
import os
import sys
import tempfile
import webbrowser
from pathlib import Path

from tactopose_drake.estimation.descriptions import free_line, meaning, sigma_cells
from tactopose_drake.estimation.far_origins import about_middle
from tactopose_drake.estimation.pose_hypothesis import PoseHypothesis
from tactopose_drake.estimation.question import Question
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.visualization.estimate_page import estimate_meshcat, page_of
from tactopose_drake.visualization.page import save_html, with_panel
from tactopose_drake.visualization.page_tables import PageTable, Row, table_html
from tactopose_drake.visualization.picture import small_picture
from tactopose_drake.visualization.scene import Scene, scene_of

_MOST_ROWS = 5
_FRAME = '<iframe srcdoc="{page}" width="100%" height="620" style="border:1px solid #ccc"></iframe>'


def show(estimate: PoseEstimate) -> Path | None:
    """Shows an estimate's page below a notebook's cell (returns None), or in the web browser (returns its file)."""
    scene = _page_scene(estimate)
    page = page_of(scene, estimate)
    if "ipykernel" in sys.modules:
        content = with_panel(estimate_meshcat(scene).StaticHtml(), page)
        display = importlib.import_module("IPython.display")
        display.display(display.HTML(_FRAME.format(page=html.escape(content))))
        return None
    path = Path(tempfile.mkdtemp(prefix="tactopose_")) / "estimate.html"
    save_html(path, estimate_meshcat(scene), page)
    open_page(path)
    return path


def open_page(path: Path) -> None:
    """Opens a page in the web browser if there is a display."""
    if sys.platform in ("darwin", "win32") or any(name in os.environ for name in ("DISPLAY", "WAYLAND_DISPLAY")):
        webbrowser.open(path.absolute().as_uri())


def save_estimate(path: Path, estimate: PoseEstimate) -> None:
    """Writes an estimate's page.

    Raises:
        InvalidInputError: if the estimate does not hold the inputs it was made from.
        InvalidFileError: if the file cannot be written.
    """
    scene = _page_scene(estimate)
    save_html(path, estimate_meshcat(scene), page_of(scene, estimate))


def _about_middle(hypothesis: PoseHypothesis, question: Question | None) -> PoseHypothesis:
    return hypothesis if question is None else about_middle(hypothesis, question.model)


def notebook_html(estimate: PoseEstimate) -> str:
    """A small table of an estimate, with a picture if the estimate holds the inputs it was made from."""
    question = estimate.question
    headings = ("probability", "x y z, mm", "quaternion wxyz", "\u00b1 mm", "\u00b1 deg")
    rows = []
    for hypothesis in estimate.hypotheses[:_MOST_ROWS]:
        # Rotations are compared with translations by the object's size; if it is not known, 0.1 m is used.
        size = 0.1 if question is None else question.model.size
        cells = (
            f"{hypothesis.probability:.1%}",
            " ".join(f"{1e3 * x:z.1f}" for x in hypothesis.X_PO.translation()),
            " ".join(f"{x:z.3f}" for x in hypothesis.X_PO.rotation().ToQuaternion().wxyz()),
            *sigma_cells(_about_middle(hypothesis, question), size),
        )
        rows.append(Row(cells))
    parts = [
        f"<b>{estimate.status.replace('_', ' ')}</b>: {meaning(estimate)}.<br>",
        html.escape(free_line(_about_middle(estimate.best, question))),
        table_html(PageTable("", headings, tuple(rows))),
    ]
    hidden = len(estimate.hypotheses) - _MOST_ROWS
    if hidden > 0:
        parts.append(f"and {hidden} less probable")
    if question is not None:
        data = base64.b64encode(small_picture(scene_of(estimate))).decode()
        parts.append(f'<img alt="the estimate" src="data:image/png;base64,{data}">')
    return "<div>" + "".join(parts) + "</div>"


def _page_scene(estimate: PoseEstimate) -> Scene:
    """The scene, with friction cones if the estimate assumes a coefficient of friction; a switch shows them."""
    scene = scene_of(estimate)
    assert estimate.question is not None
    return dataclasses.replace(scene, friction=estimate.question.evidence.friction)
