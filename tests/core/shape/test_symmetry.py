import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactopose_drake.core.poses import compose, exp_so3, rotation_angles, transform_points
from tactopose_drake.core.shape.symmetry import RotationalSymmetry, symmetry_group
from tactopose_drake.errors import InvalidInputError
from tests.core.meshes import random_pose

Z = np.array([0.0, 0.0, 1.0])


@given(seed=st.integers(0, 2**32 - 1), order=st.integers(2, 12))
@settings(max_examples=20)
def test_groups_are_closed_and_fix_the_point(seed: int, order: int) -> None:
    generator = np.random.default_rng(seed)
    R, point = random_pose(generator)[:3, :3], generator.uniform(-0.1, 0.1, 3)
    group = symmetry_group([RotationalSymmetry(R[:, 2], point, order), RotationalSymmetry(R[:, 0], point, 2)])
    assert len(group) == 2 * order
    np.testing.assert_allclose(group[0], np.eye(3, 4))
    np.testing.assert_allclose(transform_points(group, point[None])[:, 0], np.tile(point, (len(group), 1)), atol=1e-12)
    products = compose(group[:, None], group[None]).reshape(-1, 3, 4)
    for product in products:
        assert rotation_angles(group[:, :, :3], product[:, :3]).min() < 1e-6


def test_continuous_symmetries_are_not_in_the_group() -> None:
    axis = RotationalSymmetry(Z, np.zeros(3), 0)
    assert axis.is_continuous
    np.testing.assert_array_equal(symmetry_group([axis]), np.eye(3, 4)[None])
    np.testing.assert_array_equal(axis.poses(), np.eye(3, 4)[None])


def test_axes_that_belong_to_no_finite_group_are_refused() -> None:
    tilted = exp_so3(np.array([0.5, 0.0, 0.0])) @ Z
    with pytest.raises(
        InvalidInputError, match="symmetry must have axes that generate a group of at most 60 rotations"
    ):
        symmetry_group([RotationalSymmetry(Z, np.zeros(3), 4), RotationalSymmetry(tilted, np.zeros(3), 4)])


@pytest.mark.parametrize(
    ("axis", "point", "order", "message"),
    [
        ([0, 0, 2], [0, 0, 0], 2, "axis must have the length .*, not 2"),
        ([0, 0, 1], [0, np.nan, 0], 2, r"point\[1\] must be .*, not nan"),
        ([0, 0, 1], [0, 0, 0], 1, "order must be 0 .* or an integer .*2.*, not 1"),
        ([0, 0, 1], [0, 0, 0], -2, "order must be .*, not -2"),
        ([0, 0, 1], [0, 0, 0], 360, "order must be an integer from 0 to 60, not 360"),
    ],
)
def test_impossible_symmetries_are_refused(axis: list[float], point: list[float], order: int, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        RotationalSymmetry(np.array(axis, dtype=float), np.array(point, dtype=float), order)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_an_axis_off_the_origin_moves_it_and_may_be_seen_from_elsewhere(seed: int) -> None:
    generator = np.random.default_rng(seed)
    point, p_OC, places = generator.uniform(-0.1, 0.1, (3, 3))
    symmetry = RotationalSymmetry(random_pose(generator)[:3, 2], point, 3)
    step = 1e-6
    back, forth = (point - exp_so3(turn * symmetry.axis) @ point for turn in (-step, step))
    np.testing.assert_allclose((forth - back) / (2.0 * step), symmetry.moment, atol=1e-9)
    # The same points of the object go to the same places.
    by_O, by_C = symmetry.poses(), symmetry.seen_from(p_OC).poses()
    in_C = transform_points(by_C, (places - p_OC)[None])
    np.testing.assert_allclose(in_C + p_OC, transform_points(by_O, places[None]), atol=1e-12)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_a_half_turn_is_a_turn_that_puts_the_axis_upside_down(seed: int) -> None:
    symmetry = RotationalSymmetry(random_pose(np.random.default_rng(seed))[:3, 2], np.zeros(3), 0)
    np.testing.assert_allclose(symmetry.half_turn @ symmetry.axis, -symmetry.axis, atol=1e-12)
    np.testing.assert_allclose(symmetry.half_turn @ symmetry.half_turn.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(symmetry.half_turn) == pytest.approx(1.0)
