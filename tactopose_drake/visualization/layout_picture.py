"""A picture of tactile arrays with the numbers of their cells, to see where each pressure of a frame is measured."""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tactopose_drake.core.sensing.tactile_layout import TactileLayout
from tactopose_drake.core.validation import FloatArray, check_count, instance_of
from tactopose_drake.estimation.output_files import written_beside

_DPI = 100
_CELL = 0.26  # edge of a cell, inches, if the panel's size allows it
_MARGIN = (0.9, 0.9)  # margins of a panel, inches
_SMALLEST, _LARGEST = 2.4, 24.0  # limits of a panel's inner size, inches
_INK, _FACE, _EDGE = "#23272e", "#f4e3a1", "#8d7a35"


class _View(NamedTuple):
    """The view of the cells whose normals are nearest to one axis: that normal, and the axes to the right and up."""

    name: str
    normal: tuple[int, int, int]
    right: int
    is_mirrored: bool
    up: int


# Seen from outside: right, up and towards the viewer form a right-handed frame.
_VIEWS = (
    _View("z", (0, 0, 1), 0, False, 1),
    _View("-z", (0, 0, -1), 0, True, 1),
    _View("x", (1, 0, 0), 1, False, 2),
    _View("-x", (-1, 0, 0), 1, True, 2),
    _View("y", (0, 1, 0), 0, True, 2),
    _View("-y", (0, -1, 0), 0, False, 2),
)


def save_layout_picture(path: str | Path, layouts: Mapping[str, TactileLayout]) -> None:
    """Writes a picture of tactile arrays: each cell's outline and its number, from 0, as in a frame of pressures.

    Cells are seen from outside, in the pad's frame T. A curved pad has several panels; each cell is in the panel of the
    axis of T that is nearest to its normal.

    Args:
        path: the PNG file.
        layouts: the arrays, by the name of their row in the picture.

    Raises:
        InvalidInputError: if there is no array, or a value has another type.
        InvalidFileError: if the file cannot be written.
    """
    check_count("layouts", len(layouts), "arrays")
    rows = {name: panels_of(layout) for name, layout in layouts.items()}
    sizes = {name: [_size(layouts[name], view, cells) for view, cells in panels] for name, panels in rows.items()}
    widths = [sum(width + _MARGIN[0] for width, _ in row) for row in sizes.values()]
    heights = [max(height for _, height in row) + _MARGIN[1] + 0.3 for row in sizes.values()]
    figure = Figure(figsize=(max(widths), sum(heights)), dpi=_DPI)
    FigureCanvasAgg(figure)
    top = sum(heights)
    for (name, panels), height in zip(rows.items(), heights, strict=True):
        left = 0.7
        figure.text(
            0.15 / max(widths), (top - 0.25) / sum(heights), f"{name}: {len(layouts[name])} cells", weight="bold"
        )
        for (view, cells), (inner_width, inner_height) in zip(panels, sizes[name], strict=True):
            bottom = top - 0.5 - inner_height
            place = left / max(widths), bottom / sum(heights), inner_width / max(widths), inner_height / sum(heights)
            draw_cells(figure, figure.add_axes(place), layouts[name], view, cells)
            left += inner_width + _MARGIN[0]
        top -= height
    with written_beside(Path(path)) as beside:
        figure.savefig(beside, facecolor="white", format="png")


def panels_of(layout: TactileLayout) -> list[tuple[_View, NDArray[np.intp]]]:
    """The views that a layout needs, and the numbers of the cells in each."""
    instance_of("layouts", layout, TactileLayout)
    nearest = np.argmax(layout.n_T @ np.array([view.normal for view in _VIEWS]).T, axis=1)
    panels = ((view, np.flatnonzero(nearest == i)) for i, view in enumerate(_VIEWS))
    return [(view, cells) for view, cells in panels if len(cells)]


def _size(layout: TactileLayout, view: _View, cells: NDArray[np.intp]) -> tuple[float, float]:
    """Width and height of a panel, inches."""
    corners = layout.corners[cells][:, :, [view.right, view.up]]
    extent = np.maximum(np.ptp(corners.reshape(-1, 2), axis=0), 1e-9)
    scale = _CELL / float(np.sqrt(np.median(layout.areas)))
    scale = min(max(scale, _SMALLEST / float(extent.max())), _LARGEST / float(extent.max()))
    width, height = np.maximum(scale * extent, 0.6)
    return float(width), float(height)


def draw_cells(figure: Figure, axes: Axes, layout: TactileLayout, view: _View, cells: NDArray[np.intp]) -> None:
    """Draws the cells of a panel, in mm, with their numbers."""
    corners: FloatArray = 1e3 * layout.corners[cells][:, :, [view.right, view.up]]
    axes.add_collection(PolyCollection(list(corners), facecolor=_FACE, edgecolor=_EDGE, linewidth=0.6))
    flat = corners.reshape(-1, 2)
    low, high = flat.min(axis=0), flat.max(axis=0)
    low, high = low - 0.03 * (high - low + 0.1), high + 0.03 * (high - low + 0.1)
    axes.set_xlim(*((high[0], low[0]) if view.is_mirrored else (low[0], high[0])))
    axes.set_ylim(low[1], high[1])
    axes.set_aspect("equal", adjustable="datalim")
    inches = axes.get_position().width * figure.get_figwidth() / (high[0] - low[0])
    for number, cell in zip(cells, corners, strict=True):
        edges = np.linalg.norm(cell - np.roll(cell, 1, axis=0), axis=1)
        room = 72.0 * inches * float(edges.min())  # points
        middle = cell.mean(axis=0)
        size = min(0.55 * room, 1.4 * room / len(str(number)), 14.0)
        axes.text(float(middle[0]), float(middle[1]), str(number), ha="center", va="center", fontsize=size, color=_INK)
    axes.set_title(f"normals along {view.name} of T", fontsize=8)
    axes.set_xlabel(f"{'xyz'[view.right]} of T, mm", fontsize=8)
    axes.set_ylabel(f"{'xyz'[view.up]} of T, mm", fontsize=8)
    axes.tick_params(labelsize=7)
