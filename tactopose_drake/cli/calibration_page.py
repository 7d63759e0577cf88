"""A page that shows the residuals of each finger's contacts before and after a calibration."""

import html
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from tactopose_drake.cli.calibration_reports import HEADINGS, calibration_rows, remaining_line
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.estimation.output_files import written_beside
from tactopose_drake.hand.hand_calibration import CalibrationResult
from tactopose_drake.visualization.page_tables import PageTable, Row, table_html

_WIDTH, _ROW = 560, 22  # of a plot and of a finger's row in it, px
_LEFT = 90
_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; max-width: 60em; margin: 2em auto; padding: 0 1em; color: #222; }
table { border-collapse: collapse; } td, th { padding: 0.15em 0.8em 0.15em 0; text-align: right; }
td:first-child, th:first-child { text-align: left; } svg text { font-size: 12px; fill: #444; }
.before { fill: #c0392b; } .after { fill: #2471a3; } .axis { stroke: #999; stroke-width: 1; }
"""


def save_calibration_page(path: Path, hand: str, result: CalibrationResult, names: list[str]) -> None:
    """Writes the page: one file that works from disk.

    Raises:
        InvalidFileError: if the file cannot be written.
    """
    distances = _plot("Distance from the surface, mm", result, "distance", 1e3)
    angles = _plot("Angle between the normals, deg", result, "angle", 180.0 / np.pi)
    grasps = [
        (name, _cell(weight), _cell(probability))
        for name, weight, probability in zip(names, result.grasp_weights, result.pose_probability, strict=True)
    ]
    title = html.escape(Path(hand).name)
    untold = "".join(f"<li>{html.escape(combination.text)}</li>" for combination in result.undetermined)
    text = (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>Calibration of {title}</title>'
        f"<style>{_STYLE}</style></head><body><h1>Calibration of {title}</h1>"
        "<p>Each dot is a contact: above, red, of the uncalibrated hand, at the best pose of the object for it in each "
        "grasp; below, blue, of the calibrated hand.</p>"
        f"{distances}{angles}{_residuals(result)}"
        f"<p>{html.escape(remaining_line(result))} The residuals are smaller, because the fit absorbs a part.</p>"
        f"{_table('What was found', HEADINGS, calibration_rows(result.calibration, result.sliding))}<h2>Grasps</h2>"
        "<p>A grasp with weight 1 fits the others; one with 0 was ignored. If its pose is not "
        "certain, another one explains the grasp, too, and increases the standard deviations.</p>"
        f"{_table('', ('grasp', 'weight', 'probability of its pose'), grasps)}"
        "<h2>What these grasps do not determine</h2>"
        "<p>Common changes of all errors in a line: \u201cwith\u201d in the same direction, "
        f"\u201cagainst\u201d in the opposite one.</p><ul>{untold or '<li>nothing</li>'}</ul></body></html>\n"
    )
    with written_beside(path) as beside:
        # A file's name may have bytes that are no UTF-8.
        beside.write_text(text, encoding="utf-8", errors="backslashreplace")


def _table(title: str, headings: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    return table_html(PageTable(title, headings, tuple(map(Row, rows))))


def _residuals(result: CalibrationResult) -> str:
    """A table of the residuals by finger, before and after the calibration."""
    rows = []
    for finger in result.before:
        cells = [finger]
        for residuals in (result.before[finger], result.after[finger]):
            cells += [f"{1e3 * _rms(residuals.distance):.2f}", f"{np.degrees(_rms(residuals.angle)):.1f}"]
        rows.append(tuple(cells))
    return _table("", ("finger", "before, mm rms", "before, deg rms", "after, mm rms", "after, deg rms"), rows)


def _cell(value: float) -> str:
    """A number as text; empty if no finger touches."""
    return "" if np.isnan(value) else f"{value:.2f}"


def _rms(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else float("nan")


def _plot(title: str, result: CalibrationResult, quantity: str, unit: float) -> str:
    """A plot with two rows of dots for each finger, on a common axis."""
    both = [
        (name, kind, unit * getattr(side[name], quantity))
        for name in result.before
        for kind, side in (("before", result.before), ("after", result.after))
    ]
    known = np.concatenate([values[np.isfinite(values)] for _, _, values in both])
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
    low, high = min(low, 0.0), max(high, low + 1e-9, 0.0)
    scale = (_WIDTH - _LEFT - 20) / (high - low)
    parts, y = [], 0
    for name, kind, values in both:
        y += _ROW // 2 if kind == "after" else _ROW
        if kind == "before":
            parts.append(f'<text x="0" y="{y + 8}">{html.escape(name)}</text>')
        parts += [
            f'<circle class="{kind}" cx="{_LEFT + scale * (x - low):.1f}" cy="{y}" r="3" fill-opacity="0.6"/>'
            for x in values[np.isfinite(values)]
        ]
    height, zero = y + 2 * _ROW, _LEFT - scale * low
    parts.append(f'<line class="axis" x1="{zero:.1f}" x2="{zero:.1f}" y1="8" y2="{y + 8}"/>')
    for value in sorted({low, 0.0, high}):
        parts.append(
            f'<text x="{_LEFT + scale * (value - low):.1f}" y="{y + 24}" text-anchor="middle">{value:.3g}</text>'
        )
    return f'<h2>{title}</h2><svg width="{_WIDTH}" height="{height}" role="img">{"".join(parts)}</svg>'
