from pathlib import Path

import numpy as np
import pytest

from tactopose_drake.core.surfaces import Capsule
from tactopose_drake.errors import InvalidFileError, InvalidInputError
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.tactile_pads import load_tactile_pad
from tactopose_drake.resources import model_path
from tests.hand.grippers import YAML, write_gripper


@pytest.mark.parametrize(("name", "cells"), [("bh280_finger", 24), ("bh280_palm", 24), ("fingertip_1mm", 513)])
def test_every_shipped_array_loads(name: str, cells: int) -> None:
    pad = load_tactile_pad(name)
    assert len(pad.layout) == cells
    assert pad.model.noise > 0
    assert f"{cells} cells" in model_path("sensors", f"{name}.yaml").read_text()


def test_the_finger_has_the_published_cells() -> None:
    layout = load_tactile_pad("bh280_finger").layout
    np.testing.assert_allclose(layout.p_TC[0], [0.02225, -0.0095, 0.0052])
    np.testing.assert_allclose(layout.p_TC[23], [0.05542, -0.00213, -0.0052])
    np.testing.assert_allclose(layout.areas[:15], 25.9e-6, rtol=5e-3)
    np.testing.assert_allclose(layout.areas[15:], 14.0e-6, rtol=0.01)
    np.testing.assert_allclose(layout.n_T[0], [0, -1, 0], atol=1e-12)
    assert layout.n_T[23] @ [1, 0, 0] == pytest.approx(np.sin(np.radians(74.5)))
    # The tangent that is given for a row points to where the next row is, within the bend between them.
    middle = layout.p_TC[1::3]
    chord = np.degrees(np.arctan2(*np.diff(middle, axis=0)[:, 1::-1].T))
    tangent = np.degrees(np.arctan2(layout.n_T[1::3, 0], -layout.n_T[1::3, 1]))
    assert np.all((chord > tangent[:-1] - 1) & (chord < tangent[1:] + 1))


def test_the_palm_has_the_published_cells() -> None:
    layout = load_tactile_pad("bh280_palm").layout
    np.testing.assert_allclose(layout.p_TC[[0, 4, 5, 11, 23]] * 1e3, [
        [22, 15.9, 77.5], [-22, 15.9, 77.5], [33, 5.3, 77.5], [-33, 5.3, 77.5], [-22, -15.9, 77.5],
    ])  # fmt: skip
    np.testing.assert_allclose(layout.areas, 97e-6)
    np.testing.assert_allclose(layout.n_T, np.tile([0, 0, 1], (24, 1)), atol=1e-12)


@pytest.mark.parametrize("text", ["pattern: !RowPattern {row: []}", "pattern: !Grid {}", "model: 3", "[]", ""])
def test_a_broken_file_is_named(tmp_path: Path, text: str) -> None:
    path = tmp_path / "pad.yaml"
    path.write_text(text)
    with pytest.raises(InvalidFileError, match=r"pad\.yaml"):
        load_tactile_pad(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("pattern: !RowPattern {rows: []}", r"pad\.yaml: RowPattern.rows must have 1 or more rows, not 0"),
        ("pattern: !CapsulePattern {radius: 0}", r"pad\.yaml: CapsulePattern.radius must be .*, not 0"),
        (
            "pattern: !RowPattern {rows: [{}]}\nmodel: {dead_cells: [1]}",
            r"pad\.yaml: TactileModel.dead_cells must be .*, not 1",
        ),
        ("pattern: !RowPattern {rows: [{}]}\nperiod: -1", r"pad\.yaml: period must be .*, not -1"),
    ],
)
def test_an_impossible_value_is_named_with_its_file(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "pad.yaml"
    path.write_text(text)
    with pytest.raises(InvalidInputError, match=message):
        load_tactile_pad(path)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(
        InvalidFileError, match=r"none\.yaml must be .* bh280_finger, bh280_palm, fing.*, but there is no such file"
    ):
        load_tactile_pad(tmp_path / "none.yaml")


def test_the_fine_array_lies_on_the_shadow_like_hands_fingertips() -> None:
    layout = load_tactile_pad("fingertip_1mm").layout
    for finger in load_hand_config("shadow_like").fingers:
        tip = finger.surface.make()
        assert isinstance(tip, Capsule)
        p_FC = (layout.corners.reshape(-1, 3) - tip.X_SF[:, 3]) @ tip.X_SF[:, :3]
        p_FC[:, 2] -= np.clip(p_FC[:, 2], -0.5 * tip.length, 0.5 * tip.length)
        np.testing.assert_allclose(np.linalg.norm(p_FC, axis=1), tip.radius, rtol=1e-9)


def test_the_barrett_like_hands_pads_are_these_arrays() -> None:
    pads = {pad.name: pad.array for pad in load_hand_config("barrett_like").pads}
    assert pads == dict.fromkeys(("finger_1", "finger_2", "finger_3"), "bh280_finger") | {"palm": "bh280_palm"}


POINTS = """pattern: !PointPattern
  points: [[0, 0, 0], [0.004, 0, 0], [0, 0.004, 0.001]]
  cell: 0.003
"""

CORNERS = """pattern: !CornerPattern
  cells:
  - [[0, 0, 0], [0.004, 0, 0], [0.004, 0.003, 0], [0, 0.003, 0]]
  - [[0.004, 0, 0], [0.004, 0, -0.004], [0.004, 0.003, -0.004], [0.004, 0.003, 0]]
"""


def test_cells_by_their_middles(tmp_path: Path) -> None:
    path = tmp_path / "pad.yaml"
    path.write_text(POINTS)
    layout = load_tactile_pad(path).layout
    np.testing.assert_allclose(layout.p_TC, [[0, 0, 0], [0.004, 0, 0], [0, 0.004, 0.001]], atol=1e-12)
    np.testing.assert_allclose(layout.areas, 9e-6)
    np.testing.assert_allclose(layout.n_T, np.tile([0, 0, 1], (3, 1)), atol=1e-12)
    path.write_text(POINTS + "  normals: [[0, 0.6, 0.8]]\n")
    tilted = load_tactile_pad(path).layout
    np.testing.assert_allclose(tilted.n_T, np.tile([0, 0.6, 0.8], (3, 1)), atol=1e-12)
    np.testing.assert_allclose(tilted.areas, 9e-6)


def test_cells_by_their_corners_share_the_wall_between_them(tmp_path: Path) -> None:
    path = tmp_path / "pad.yaml"
    path.write_text(CORNERS)
    layout = load_tactile_pad(path).layout
    np.testing.assert_allclose(layout.areas, [12e-6, 12e-6])
    np.testing.assert_allclose(layout.n_T, [[0, 0, 1], [1, 0, 0]], atol=1e-12)
    # Around the bend a point is felt by one of them, and by one alone.
    points = np.array([[0.0045, 0.0015, 0.0002], [0.0042, 0.0015, 0.0006], [0.0021, 0.001, 0.0]])
    height = np.einsum("mki,qi->mqk", layout.planes[..., :3], points) + layout.planes[:, None, :, 3]
    np.testing.assert_array_equal(np.all(height >= 0, axis=2), [[False, True, True], [True, False, False]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("pattern: !PointPattern {}", "PointPattern.points must have 1 to .* points, not 0"),
        (
            POINTS + "  normals: [[0, 0, 1], [0, 0, 1]]",
            "PointPattern.normals must be 1, or as many as the 3 points, not 2",
        ),
        (POINTS + "  along: [0, 0, 1]", "PointPattern.along must be another direction than the normal of cell 0"),
        ("pattern: !CornerPattern {cells: []}", "CornerPattern.cells must have 1 to .* cells, not 0"),
        (
            "pattern: !PointPattern {points: [[0, 0, 77], [4, 0, 77]], cell: 4}",
            r"pad\.yaml: pattern: cell 0 must have edges of at most 0\.1 m, not 4 m\. Multiply by 0\.001",
        ),
        (
            "pattern: !PointPattern {points: [[0, 0, 0.077], [0, 0, 77]], cell: 0.004}",
            r"pad\.yaml: pattern: cell 1 must be off its frame by at most 1 m, not 77 m\. Multiply by 0\.001",
        ),
        (CORNERS + "  - [[0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0]]", r"corners\[2\] must be a cell that is convex"),
    ],
)
def test_cells_that_cannot_be_are_named(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "pad.yaml"
    path.write_text(text)
    with pytest.raises(InvalidInputError, match=message):
        load_tactile_pad(path)


def test_an_array_lies_beside_the_hand_that_names_it(tmp_path: Path) -> None:
    (tmp_path / "pad.yaml").write_text(POINTS)
    hand = write_gripper(tmp_path, yaml=YAML + "pads: [{name: tip, frame: left_tip, array: pad.yaml, alpha: 1e-8}]\n")
    (pad,) = load_hand_config(hand).pads
    assert len(load_tactile_pad(pad.array).layout) == 3


def test_a_pressure_a_little_beyond_the_range_is_the_range_and_more_is_none(tmp_path: Path) -> None:
    path = tmp_path / "pad.yaml"
    path.write_text(POINTS + "model: {range: 1.0e+5, dead_cells: [2]}\n")
    known, beyond = load_tactile_pad(path).known_pressures(np.array([1.0005e5, 1.002e5, 5e4]))
    np.testing.assert_array_equal(known, [1e5, np.nan, np.nan])
    np.testing.assert_array_equal(beyond, [False, True, False])
