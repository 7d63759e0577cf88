from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

from tactopose_drake.core.sensing.tactile_layout import TactileLayout
from tactopose_drake.errors import InvalidFileError, InvalidInputError
from tactopose_drake.hand.tactile_pads import load_tactile_pad
from tactopose_drake.visualization.layout_picture import draw_cells, panels_of, save_layout_picture

ARRAYS = ("bh280_palm", "bh280_finger", "fingertip_1mm")


@pytest.fixture(params=ARRAYS)
def layout(request: pytest.FixtureRequest) -> TactileLayout:
    return load_tactile_pad(request.param).layout


def test_each_cell_is_in_the_panel_that_it_faces(layout: TactileLayout) -> None:
    panels = panels_of(layout)
    np.testing.assert_array_equal(np.sort(np.concatenate([cells for _, cells in panels])), np.arange(len(layout)))
    for view, cells in panels:
        assert (layout.n_T[cells] @ view.normal > 0.57).all()
        # Right, up and towards who looks are a right-handed frame.
        right = (-1 if view.is_mirrored else 1) * np.eye(3)[view.right]
        np.testing.assert_array_equal(np.cross(right, np.eye(3)[view.up]), view.normal)


def test_each_number_stands_in_its_cell(layout: TactileLayout) -> None:
    for view, cells in panels_of(layout):
        figure = Figure(figsize=(6, 6))
        axes = figure.add_axes((0.1, 0.1, 0.8, 0.8))
        draw_cells(figure, axes, layout, view, cells)
        assert axes.xaxis_inverted() == view.is_mirrored
        assert [int(text.get_text()) for text in axes.texts] == cells.tolist()
        for text, cell in zip(axes.texts, layout.corners[cells], strict=True):
            corners = 1e3 * cell[:, [view.right, view.up]]
            edges = np.roll(corners, -1, axis=0) - corners
            offsets = np.array(text.get_position()) - corners
            sides = edges[:, 0] * offsets[:, 1] - edges[:, 1] * offsets[:, 0]
            assert np.all(sides > 0) or np.all(sides < 0)


def test_the_picture_holds_a_row_for_each_array(tmp_path: Path) -> None:
    layouts = {name: load_tactile_pad(name).layout for name in ARRAYS[:2]}
    save_layout_picture(tmp_path / "one.png", {"palm": layouts["bh280_palm"]})
    save_layout_picture(tmp_path / "two.png", layouts)
    one, two = imread(tmp_path / "one.png"), imread(tmp_path / "two.png")
    assert two.shape[0] > 1.5 * one.shape[0]
    assert one.std() > 0.05


def test_what_cannot_be_drawn_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="layouts must have 1 or more arrays, not 0"):
        save_layout_picture(tmp_path / "none.png", {})
    with pytest.raises(InvalidInputError, match="layouts"):
        save_layout_picture(tmp_path / "none.png", {"palm": 3})  # type: ignore[dict-item]
    with pytest.raises(InvalidFileError, match=r"absent"):
        save_layout_picture(tmp_path / "absent" / "x.png", {"palm": load_tactile_pad("bh280_palm").layout})
