import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tactopose_drake as tp
from tactopose_drake.core.poses import make_poses, random_rotations, transform_points
from tactopose_drake.core.sensing.patches import PatchParams
from tactopose_drake.errors import InvalidInputError

PITCH = 0.0025
ALPHA = 1e-7  # 1 mm for 10 kPa
CELLS = np.array([[PITCH * i, PITCH * j, 0.0] for j in range(8) for i in range(3)])
OUT = np.tile([0.0, 0.0, -1.0], (24, 1))

seeds = st.integers(0, 2**32 - 1)


def pressed_by(depth: np.ndarray) -> np.ndarray:
    """Pressures (n,) of cells that the object presses in by some depths (n,), m."""
    return np.maximum(depth, 0.0) / ALPHA


def noise(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(1e2, 1e4, 24)


def only(*cells: int) -> np.ndarray:
    pressure = np.zeros(24)
    pressure[list(cells)] = 8e3
    return pressure


def bent_pad() -> tuple[np.ndarray, np.ndarray]:
    """Cells and normals of a pad that is bent round the y axis by 100 degrees, the finger below it."""
    angle = np.radians(np.linspace(-50.0, 50.0, 7))
    normals = np.array([[math.sin(a), 0.0, math.cos(a)] for a in angle for _ in range(5)])
    return 0.008 * normals + [[0.0, 0.002 * j, 0.0] for _ in angle for j in range(5)], normals


def describe_bent(pressure: np.ndarray) -> tp.Patch:
    cells, normals = bent_pad()
    return tp.describe_patch(cells, pressure, alpha=ALPHA, n_PT=normals)


def test_without_normals_it_is_the_thesis_formula() -> None:
    pressure = noise(1)
    patch = tp.describe_patch(CELLS, pressure, alpha=ALPHA)
    M = np.column_stack([CELLS[:, 0], CELLS[:, 1], ALPHA * pressure])
    np.testing.assert_allclose(patch.centroid, M.mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(patch.covariance, (M - M.mean(axis=0)).T @ (M - M.mean(axis=0)) / 23, rtol=1e-9)
    np.testing.assert_allclose(patch.points, M, atol=1e-15)
    # With a negative alpha the z axis points out of the pad.
    turned = tp.describe_patch(CELLS, pressure, alpha=-ALPHA)
    np.testing.assert_allclose(turned.centroid, patch.centroid * [1.0, 1.0, -1.0], rtol=1e-12)
    np.testing.assert_allclose(turned.n_PT, -patch.n_PT)
    assert turned.eigenvectors[2, 2] < 0 < patch.eigenvectors[2, 2]


def test_without_normals_a_pad_may_lie_far_from_the_origin() -> None:
    shift = np.array([0.2, -0.1, 0.3])
    there, here = (tp.describe_patch(cells, noise(1), alpha=ALPHA) for cells in (CELLS + shift, CELLS))
    np.testing.assert_allclose(there.n_PT, here.n_PT, atol=1e-12)
    np.testing.assert_allclose(there.centroid, here.centroid + shift, rtol=1e-12)


@given(seeds)
def test_the_components_are_a_right_handed_frame_that_makes_the_covariance_diagonal(seed: int) -> None:
    patch = tp.describe_patch(CELLS, noise(seed), alpha=ALPHA, n_PT=OUT)
    E = patch.eigenvectors
    np.testing.assert_allclose(E.T @ E, np.eye(3), atol=1e-12)
    assert np.linalg.det(E) == pytest.approx(1.0)
    np.testing.assert_allclose(E.T @ patch.covariance @ E, np.diag(patch.eigenvalues), atol=1e-16)
    assert np.all(np.diff(patch.eigenvalues) <= 0)


def test_the_third_component_is_the_outward_normal_of_a_tilted_face() -> None:
    for degrees in (0.0, 2.0, 7.0, -20.0):
        slope = math.tan(math.radians(degrees))
        patch = tp.describe_patch(CELLS, pressed_by(0.004 + slope * (CELLS[:, 1] - 0.009)), alpha=ALPHA, n_PT=OUT)
        assert patch.status == "area"
        # Deeper towards +y: the surface, and its normal that points into the pad (+z), leans back.
        normal = [0.0, -math.sin(math.radians(degrees)), math.cos(math.radians(degrees))]
        np.testing.assert_allclose(patch.eigenvectors[:, 2], normal, atol=1e-12)
        # The pad is longest along y, and its last cell lies that way.
        assert patch.eigenvectors[1, 0] > 0.9


@given(seeds)
def test_moving_the_frame_moves_the_patch(seed: int) -> None:
    generator = np.random.default_rng(seed)
    X = make_poses(random_rotations(generator, 1), generator.normal(size=(1, 3)))[0]
    patch = tp.describe_patch(CELLS, noise(seed), alpha=ALPHA, n_PT=OUT)
    moved = tp.describe_patch(transform_points(X, CELLS), patch.pressure, alpha=ALPHA, n_PT=OUT @ X[:, :3].T)
    np.testing.assert_allclose(moved.centroid, transform_points(X, patch.centroid[None])[0], atol=1e-12)
    np.testing.assert_allclose(moved.eigenvalues, patch.eigenvalues, atol=1e-15)
    np.testing.assert_allclose(moved.eigenvectors, X[:, :3] @ patch.eigenvectors, atol=1e-6)


def test_a_ball_on_a_bent_pad() -> None:
    cells, normals = bent_pad()
    # A ball as large as the bend presses the pad's middle; its points there lie on the ball.
    ball, radius = np.array([0.0, 0.004, 0.0145]), 0.008
    along = np.sum((ball - cells) * normals, axis=1)
    square = radius**2 - (np.sum((ball - cells) ** 2, axis=1) - along**2)
    depth = np.where(square > 0, np.sqrt(np.maximum(square, 0.0)) - along, 0.0)
    patch = describe_bent(pressed_by(depth))
    assert patch.status == "area"
    assert 5 < patch.active.sum() < 35
    np.testing.assert_allclose(np.linalg.norm(patch.points[patch.active] - ball, axis=1), radius, rtol=1e-12)
    np.testing.assert_allclose(patch.eigenvectors[:, 2], [0.0, 0.0, -1.0], atol=1e-9)


def test_nothing_is_felt() -> None:
    patch = tp.describe_patch(CELLS, np.zeros(24), alpha=ALPHA)
    assert patch.status == "no_contact"
    for value in (patch.centroid, patch.covariance, patch.eigenvectors, patch.eigenvalues):
        assert np.isnan(value).all()
    below = tp.describe_patch(CELLS, np.full(24, 90.0), alpha=ALPHA, threshold=90.0)
    assert below.status == "no_contact"


def test_one_cell_is_a_point() -> None:
    patch = tp.describe_patch(CELLS, only(7), alpha=ALPHA, n_PT=OUT)
    assert patch.status == "point"
    np.testing.assert_allclose(patch.centroid, CELLS[7] + [0.0, 0.0, 8e-4])
    assert np.isnan(patch.covariance).all()
    assert np.isnan(patch.eigenvectors).all()


def test_cells_at_one_place_are_a_point() -> None:
    apart = 1e-160 * np.random.default_rng(0).normal(size=(4, 3))
    assert tp.describe_patch(apart, np.full(4, 1000.0), alpha=ALPHA, n_PT=OUT[:4]).status == "point"


@pytest.mark.parametrize("cells", [(0, 1), (0, 12), (3, 4, 5), (1, 4, 7, 10), (0, 7, 14), (5, 23)])
def test_a_row_tells_its_own_direction_only(cells: tuple[int, ...]) -> None:
    patch = tp.describe_patch(CELLS, only(*cells), alpha=ALPHA, n_PT=OUT)
    assert patch.status == "row"
    way = CELLS[cells[-1]] - CELLS[cells[0]]
    # Towards the last cell of the pad, not of the row.
    way = way if way @ (CELLS[-1] - CELLS[0]) >= 0 else -way
    np.testing.assert_allclose(patch.eigenvectors[:, 0], way / np.linalg.norm(way), atol=1e-12)
    assert patch.eigenvalues[0] == pytest.approx(np.trace(patch.covariance))
    assert np.isnan(patch.eigenvectors[:, 1:]).all()
    assert np.isnan(patch.eigenvalues[1:]).all()


def test_a_row_round_a_bent_pad_is_a_row_too() -> None:
    pressure = np.zeros(35)
    pressure[[2, 7, 12, 17, 22, 27, 32]] = [1e3, 4e3, 6e3, 7e3, 6e3, 4e3, 1e3]
    assert describe_bent(pressure).status == "row"
    pressure[[1, 3, 11, 13, 16, 18, 21, 23, 31, 33]] = 1e3
    assert describe_bent(pressure).status == "area"


def test_depths_that_differ_more_than_the_patch_is_wide_tell_no_normal() -> None:
    depth = np.zeros(24)
    depth[[9, 10, 12, 13]] = 0.005, 0.0001, 0.0001, 0.005
    patch = tp.describe_patch(CELLS, pressed_by(depth), alpha=ALPHA, n_PT=OUT)
    assert patch.status == "narrow"
    lenient = PatchParams(least_alignment=0.0)
    assert tp.describe_patch(CELLS, pressed_by(depth), alpha=ALPHA, n_PT=OUT, params=lenient).status == "area"
    assert np.isfinite(patch.eigenvectors).all()


def test_dead_and_saturated_cells_are_named() -> None:
    pressure = noise(3)
    pressure[4], pressure[9] = np.nan, 2e4
    patch = tp.describe_patch(CELLS, pressure, alpha=ALPHA, n_PT=OUT, saturation=2e4)
    assert np.flatnonzero(patch.dead).tolist() == [4]
    assert np.flatnonzero(patch.saturated).tolist() == [9]
    assert not patch.active[4]
    assert patch.active[9]
    rest = np.arange(24) != 4
    alone = tp.describe_patch(CELLS[rest], pressure[rest], alpha=ALPHA, n_PT=OUT[rest])
    np.testing.assert_allclose(patch.eigenvectors, alone.eigenvectors, atol=1e-12)


def test_a_patch_without_a_limit_is_described_again_from_what_it_says() -> None:
    patch = tp.describe_patch(CELLS, noise(3), alpha=ALPHA, n_PT=OUT)
    assert patch.saturation == np.inf
    limits = {"threshold": patch.threshold, "saturation": patch.saturation}
    again = tp.describe_patch(patch.p_PT, patch.pressure, alpha=patch.alpha, n_PT=patch.n_PT, **limits)
    np.testing.assert_array_equal(again.eigenvectors, patch.eigenvectors)
    assert again.saturation == np.inf
    for impossible in (-np.inf, np.nan):
        with pytest.raises(InvalidInputError, match="saturation must be a finite number"):
            tp.describe_patch(CELLS, noise(3), alpha=ALPHA, n_PT=OUT, saturation=impossible)


def test_half_the_pitch_is_how_far_a_cell_feels_to_its_sides() -> None:
    pad = np.array([[x, y, 0.0] for x in (0.0, 0.006, 0.012) for y in (0.0, 0.005, 0.010)])
    assert tp.describe_patch(pad, np.ones(9), alpha=1e-7).half_pitch == pytest.approx(0.0025)
    assert tp.describe_patch(pad[:1], np.ones(1), alpha=1e-7).half_pitch == 0.0


def test_without_normals_one_row_of_cells_is_enough() -> None:
    patch = tp.describe_patch(CELLS[[0, 3, 6]], np.full(3, 1e4), alpha=ALPHA)
    np.testing.assert_allclose(patch.points[:, 2], 1e-3)
    assert patch.status == "row"
    alone = tp.describe_patch(CELLS[:1], [1e4], alpha=ALPHA)
    np.testing.assert_allclose(alone.centroid, [0.0, 0.0, 1e-3])


def test_a_patch_cannot_be_changed() -> None:
    pressure = noise(5)
    patch = tp.describe_patch(CELLS, pressure, alpha=ALPHA)
    pressure[:] = 0.0
    assert patch.active.all()
    with pytest.raises(ValueError, match="read-only"):
        patch.centroid[0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        patch.points[0] = 1.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        patch.alpha = 1.0  # type: ignore[misc]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"p_PT": np.zeros((0, 3)), "pressure": []}, "p_PT must have 1 or more cells, not 0"),
        ({"p_PT": CELLS[:, :2]}, r"p_PT must have the shape \(n, 3\), not \(24, 2\)"),
        ({"p_PT": np.full((24, 3), math.nan)}, r"p_PT\[0, 0\] must be .*, not nan"),
        ({"pressure": np.zeros(23)}, r"pressure must have the shape \(24,\), not \(23,\)"),
        ({"pressure": np.full(24, math.nan)}, "pressure must be known at one cell or more"),
        ({"pressure": np.full(24, math.inf)}, r"pressure\[0\] must be .*, not inf"),
        (
            {"pressure": np.where(np.arange(24) == 5, -1.0, np.nan)},
            r"pressure\[5\] must be a number >= 0, or NaN, not -1",
        ),
        ({"pressure": ["a"] * 24}, "pressure\\[0\\] must be a number, not 'a'"),
        ({"alpha": math.nan}, "alpha must be .*, not nan"),
        ({"alpha": -ALPHA, "n_PT": OUT}, "alpha must be a number >= 0 if n_PT is given, not -1e-07"),
        ({"n_PT": OUT[:5]}, r"n_PT must have the shape \(24, 3\), not \(5, 3\)"),
        ({"n_PT": 2.0 * OUT}, r"n_PT\[0\] must have the length .*, not 2"),
        ({"threshold": -1.0}, "threshold must be a number >= 0, not -1"),
        ({"threshold": 1e300}, "threshold"),
        ({"threshold": 5.0, "saturation": 5.0}, "saturation must be a number > threshold = 5, not 5"),
        ({"p_PT": 1e3 * CELLS}, "p_PT.*Multiply by 0.001 what is in millimetres"),
        (
            {"p_PT": 1e3 * CELLS - [3.0, 9.0, 0.0]},
            "p_PT must be spread over at most 1 m, not .* m",
        ),
        (
            {"alpha": 1e-4},
            r"pressure\[\d+\] must be a depth up to 0.1 m, not .* m, which .* Pa at alpha = 0.0001 m/Pa are",
        ),
        (
            {"alpha": -1e-4},
            r"pressure\[\d+\] must be a depth up to 0.1 m, not .* m, which .* Pa at alpha = 0.0001 m/Pa are",
        ),
        (
            {"threshold": 2e6},
            "threshold must be a depth up to 0.1 m, not 0.2 m, which 2e\\+06 Pa at alpha = 1e-07 m/Pa are",
        ),
        ({"p_PT": CELLS[:, [2, 0, 1]]}, "n_PT must be the normals of a pad that is parallel to the z axis"),
        ({"p_PT": bent_pad()[0][:24]}, "n_PT must be the normals of a curved pad, whose cells are not in a plane"),
    ],
)
def test_bad_frames_are_named(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        tp.describe_patch(**({"p_PT": CELLS, "pressure": noise(0), "alpha": ALPHA} | arguments))  # type: ignore[arg-type]


def test_parameters_of_another_type_are_named() -> None:
    with pytest.raises(InvalidInputError, match=r"^params must be a PatchParams, not an int"):
        tp.describe_patch(CELLS, noise(0), alpha=ALPHA, params=3)  # type: ignore[arg-type]
