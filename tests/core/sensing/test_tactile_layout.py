import numpy as np
import pytest

from tactopose_drake.core.sensing.tactile_layout import TactileLayout
from tactopose_drake.core.sensing.tactile_patterns import CapsulePattern, CellRow, RowPattern
from tactopose_drake.errors import InvalidInputError

from .tactile_fields import fingertip, grid

BENT = RowPattern(
    normal=[0.0, -1.0, 0.0],
    pitch=0.0052,
    rows=[
        CellRow(center=[0.0, -0.0095, 0.0], count=3, cell=[0.0055, 0.0047]),
        CellRow(center=[0.006, -0.009, 0.0], tangent_deg=15, count=3, cell=[0.0055, 0.0047]),
    ],
)


def test_cells_are_where_the_rows_say() -> None:
    layout = BENT.make()
    z = [0.0052, 0, -0.0052]  # along x normal = -z
    expected = [[0, -0.0095, at] for at in z] + [[0.006, -0.009, at] for at in z]
    np.testing.assert_allclose(layout.p_TC, expected, atol=1e-12)
    np.testing.assert_allclose(layout.areas, 0.0055 * 0.0047)
    tilt = np.radians(15)
    np.testing.assert_allclose(layout.n_T[:3], [[0, -1, 0]] * 3, atol=1e-12)
    np.testing.assert_allclose(layout.n_T[3:], [[np.sin(tilt), -np.cos(tilt), 0]] * 3, atol=1e-12)


def bent_row(along: float, across: float, bend: float, count: int = 1) -> CellRow:
    """A row of cells of 1 mm x 1 mm on a cylinder of 5 mm about y, the arc `along` from its top; `bend` is off by."""
    angle = along / 0.005
    center = [0.005 * np.sin(angle) * bend, across, 0.005 * np.cos(angle) * bend]
    return CellRow(center=center, tangent_deg=float(np.degrees(angle)), count=count)


# Above a plate of 0.8 mm, about its edge, and below.
AROUND_A_PLATE = [
    CellRow(center=[0.0, 0.0, 0.0004]),
    CellRow(center=[0.0005, 0.0, 0.0], tangent_deg=90.0, cell=[0.0008, 0.001]),
    CellRow(center=[0.0, 0.0, -0.0004], tangent_deg=180.0),
]


@pytest.mark.parametrize(
    ("rows", "is_allowed"),
    [
        ([bent_row(0.0, 0.0, 1.0), bent_row(0.00101, 0.0, 1.0)], True),
        ([bent_row(0.0, 0.0, 1.0), bent_row(0.0009, 0.0, 1.0)], False),
        ([bent_row(0.002, 0.0, 1.0), bent_row(0.00101, 0.0, 1.0), bent_row(0.0022, 0.0, 1.0)], False),
        ([bent_row(0.0, 0.0, 1.0), bent_row(0.0009, 0.001, 1.0)], True),  # side by side
        ([bent_row(0.0, 0.0, 1.0, 3), bent_row(0.0, 0.002, 1.0, 2)], False),  # cells at +-1 and at 1.5 and 2.5
        ([bent_row(0.0, 0.0, 1.0, 3), bent_row(0.0, 0.0025, 1.0, 2)], True),
        ([bent_row(0.0, 0.0, 1.0), bent_row(0.0005, 0.0, 0.9)], False),  # a little deeper
        (AROUND_A_PLATE, True),
    ],
)
def test_rows_do_not_overlap(rows: list[CellRow], is_allowed: bool) -> None:
    pattern = RowPattern(rows=rows)
    if is_allowed:
        assert len(pattern.make()) == sum(row.count for row in rows)
        return
    last = len(rows) - 1
    with pytest.raises(InvalidInputError, match=rf"rows\[{last}\].center must not be .* overlap those of rows\[0\]"):
        pattern.make()


def wedges_of(layout: TactileLayout, points: np.ndarray) -> np.ndarray:
    """In how many wedges each point is, on the cells' outer side."""
    height = np.einsum("mki,pi->pmk", layout.planes[..., :3], points) + layout.planes[..., 3]
    side = np.einsum("mi,pmi->pm", layout.n_T, points[:, None] - layout.p_TC)
    return (np.all(height >= 0, axis=2) & (np.abs(side) < 0.002)).sum(axis=1)


def test_the_wedges_of_a_round_pad_fill_the_space_about_it_once() -> None:
    layout, generator = fingertip(), np.random.default_rng(0)
    psi, z = generator.uniform(-1.0, 1.0, 2000), generator.uniform(0.001, 0.013, 2000)
    radius = generator.uniform(0.0085, 0.0102, 2000)
    points = np.column_stack([radius * np.sin(psi), -radius * np.cos(psi), z])
    np.testing.assert_array_equal(wedges_of(layout, points), 1)


def test_no_point_between_bent_rows_is_in_two_wedges() -> None:
    points = np.random.default_rng(1).uniform([-0.003, -0.0115, -0.008], [0.009, -0.007, 0.008], (4000, 3))
    counts = wedges_of(BENT.make(), points)
    assert counts.max() == 1
    assert np.mean(counts) > 0.3


def test_capsule_cells_lie_on_the_capsule_and_cover_it() -> None:
    layout = CapsulePattern().make()
    axis_point = np.column_stack([np.zeros((len(layout) * 4, 2)), np.clip(layout.corners[..., 2].ravel(), 0, 0.014)])
    outward = layout.corners.reshape(-1, 3) - axis_point
    np.testing.assert_allclose(np.linalg.norm(outward, axis=1), 0.009, rtol=1e-12)
    assert np.all(np.einsum("mi,mi->m", outward[::4], layout.n_T) > 0.0089)
    # A cylinder's strip, and of the sphere the part between two half-planes through x and two planes across x.
    half, end = np.radians(60), np.radians(80)
    expected = 2 * half * 0.009 * 0.014 + 2 * 0.009**2 * end * np.sin(half)
    assert layout.areas.sum() == pytest.approx(expected, rel=2e-3)
    edges = np.linalg.norm(np.roll(layout.corners, -1, axis=1) - layout.corners, axis=2)
    assert edges.max() <= 0.001 * (1 + 1e-12)
    assert edges.min() > 0.0004


def test_a_grid_has_upright_walls() -> None:
    layout = grid(2, 2)
    np.testing.assert_allclose(layout.planes[..., 2], 0.0, atol=1e-15)
    np.testing.assert_array_equal(wedges_of(layout, np.array([[0.0004, -0.0004, 0.0019], [0.0011, 0, 0]])), [1, 0])


SQUARE = np.array([[[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]])
UPRIGHT = np.tile([0.0, 0.0, 2.0], (1, 4, 1))


def test_a_single_cell() -> None:
    layout = TactileLayout(SQUARE, UPRIGHT)
    np.testing.assert_allclose(layout.p_TC, [[0.5, 0.5, 0]])
    np.testing.assert_array_equal(wedges_of(layout, np.array([[0.9, 0.1, 0.0], [1.1, 0.5, 0.0]])), [1, 0])


def test_neighbours_share_the_plane_between_them() -> None:
    two = np.concatenate([SQUARE, SQUARE + np.array([1.0, 0, 0])])
    ray = {corner: (0.1 * i, -0.05 * i, 1.0) for i, corner in enumerate(sorted({tuple(p) for p in two.reshape(-1, 3)}))}
    layout = TactileLayout(two, np.array([[ray[tuple(p)] for p in cell] for cell in two]))
    np.testing.assert_allclose(layout.planes[0, 1], -layout.planes[1, 3], atol=1e-12)


@pytest.mark.parametrize(
    ("corners", "message"),
    [
        (np.zeros((0, 4, 3)), "corners must have 1 or more cells, not 0"),
        (np.zeros((2, 4, 3)), r"corners\[0\] must be a cell that is convex with an area"),
        (SQUARE[:, [0, 2, 1, 3]], "must be a cell that is convex"),
        (SQUARE + np.array([[0, 0, 0], [0, 0, 0], [0, 0, 0.1], [0, 0, 0]]), "must be a cell that is flat"),
        (SQUARE * np.nan, r"corners\[0, 0, 0\] must be .*, not nan"),
        (np.zeros((3, 3)), "corners must have the shape .*"),
    ],
)
def test_impossible_cells_are_named(corners: np.ndarray, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        TactileLayout(corners, np.tile([0.0, 0.0, 1.0], (len(corners), 4, 1)))


@pytest.mark.parametrize(
    ("rays", "message"),
    [
        (-UPRIGHT, r"rays\[0, 0\] must point out of the cell, not into it"),
        (UPRIGHT[0], "rays must have the shape .*"),
        (np.where(UPRIGHT > 0, np.inf, 0.0), r"rays\[0, 0, 2\] must be .*, not inf"),
    ],
)
def test_impossible_rays_are_named(rays: np.ndarray, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        TactileLayout(SQUARE, rays)


@pytest.mark.parametrize(
    ("pattern", "message"),
    [
        (RowPattern(), "rows must have 1 or more rows, not 0"),
        (RowPattern(along=[1, 1, 0], rows=[CellRow()]), "along must have the length 1"),
        (RowPattern(normal=[0.6, 0, 0.8], rows=[CellRow()]), "normal must be at right angles to `along`, not"),
        (RowPattern(pitch=0.0, rows=[CellRow()]), "pitch must be .*, not 0"),
        (RowPattern(rows=[CellRow(), CellRow(count=0)]), r"rows\[1\]\.count must be .*, not 0"),
        (RowPattern(rows=[CellRow(cell=[0.001, -0.001])]), r"rows\[0\]\.cell\[1\] must be .*, not -0\.001"),
        (
            RowPattern(rows=[CellRow(count=2, cell=[0.001, 0.002])]),
            r"rows\[0\].cell\[1\] must be at most .*, not 0\.002 m",
        ),
        (RowPattern(rows=[CellRow(center=[0, 0])]), r"rows\[0\].center must have the shape .*"),
        (RowPattern(rows=[CellRow(tangent_deg=np.inf)]), "tangent_deg must be .*, not inf"),
        (RowPattern(rows=[CellRow(), CellRow()]), r"rows\[1\].center must not be .* overlap those of rows\[0\], at"),
        (CapsulePattern(radius=-1), "radius must be .*, not -1"),
        (CapsulePattern(half_angle_deg=90), "half_angle_deg must be above 0 and below 90, not 90"),
        (CapsulePattern(end_angle_deg=np.nan), "end_angle_deg must be .*, not nan"),
    ],
)
def test_an_impossible_pattern_is_named(pattern: RowPattern | CapsulePattern, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        pattern.make()
