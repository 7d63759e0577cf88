import numpy as np
import pytest

from tactopose_drake.core.grasping.held_axis import HeldAxis, find_held_axis
from tactopose_drake.core.poses import compose, exp_so3, make_poses, random_rotations, retract

AXIS, MIDDLE, HALF = np.array([0.0, 0.0, 1.0]), np.array([0.002, -0.001, 0.05]), 0.08


def poses(generator: np.random.Generator, count: int = 1) -> np.ndarray:
    return make_poses(random_rotations(generator, count), 0.1 * generator.normal(size=(count, 3)))


def find(X_PO: np.ndarray, covariance: np.ndarray, towards: np.ndarray, p_PG: np.ndarray | None = None) -> HeldAxis:
    count = len(X_PO)
    return find_held_axis(
        X_PO,
        np.broadcast_to(covariance, (count, 6, 6)),
        np.full(count, 3.0),
        axis=AXIS,
        middle=MIDDLE,
        half_length=HALF,
        towards=towards,
        p_PG=np.zeros(3) if p_PG is None else p_PG,
    )


def test_neither_spin_nor_slide_nor_the_end_that_is_up_moves_the_axis() -> None:
    generator = np.random.default_rng(0)
    X_PO = poses(generator)
    towards = X_PO[0, :, 2]
    about_axis = make_poses(exp_so3(np.array([0.0, 0.0, 1.3])), MIDDLE - exp_so3(np.array([0.0, 0.0, 1.3])) @ MIDDLE)
    slid = make_poses(np.eye(3), np.array([0.0, 0.0, 0.013]))
    flip = make_poses(np.diag([1.0, -1.0, -1.0]), MIDDLE - np.diag([1.0, -1.0, -1.0]) @ MIDDLE)
    alike = np.concatenate([X_PO, *(compose(X_PO, move[None]) for move in (about_axis, slid, flip))])
    held = find(alike, np.zeros((6, 6)), towards)
    np.testing.assert_allclose(held.direction, towards, atol=1e-12)
    assert held.sigma < 1e-9
    # The point is on the axis, and nearest to the grip.
    on_axis = X_PO[0, :, :3] @ MIDDLE + X_PO[0, :, 3]
    assert np.linalg.norm(np.cross(held.p_PQ - on_axis, towards)) < 1e-12
    assert abs(held.p_PQ @ held.direction) < 1e-12
    np.testing.assert_allclose(held.point(0.1) - held.p_PQ, 0.1 * towards)
    # What they do is to leave the end open: one of them has slid, and one is the other way round.
    ends = (on_axis - held.p_PQ) @ towards + HALF + np.array([0.0, 0.0, 0.013, 0.0])
    assert held.end == pytest.approx(ends.mean())
    assert held.sigma_end == pytest.approx(ends.std())
    assert held.same_way == pytest.approx(0.75)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_it_ends_where_the_object_does(sign: float) -> None:
    X_PO = poses(np.random.default_rng(4))
    held = find(X_PO, np.diag([0.0, 0.0, 0.0, 4e-6, 4e-6, 4e-6]), sign * X_PO[0, :, 2])
    end = X_PO[0, :, :3] @ (MIDDLE + sign * HALF * AXIS) + X_PO[0, :, 3]
    np.testing.assert_allclose(held.point(held.end), end, atol=1e-12)
    assert held.sigma_end == pytest.approx(0.002)
    assert held.same_way == (sign > 0.0)


def test_it_points_where_it_is_asked_to() -> None:
    X_PO = poses(np.random.default_rng(1))
    for towards in (X_PO[0, :, 2], -X_PO[0, :, 2]):
        np.testing.assert_allclose(find(X_PO, np.zeros((6, 6)), towards).direction, towards)


@pytest.mark.parametrize("off_axis", [0.0, 0.02])
def test_the_stated_deviation_is_that_of_samples(off_axis: float) -> None:
    generator = np.random.default_rng(2)
    X_PO = poses(generator)
    towards, p_PG = X_PO[0, :, 2], X_PO[0, :, :3] @ (MIDDLE + np.array([off_axis, 0.0, 0.0])) + X_PO[0, :, 3]
    # Turns and shifts belong together, so that the end moves by less, or by more, than by both for themselves.
    root = np.diag([1.0, 3.0, 50.0, 0.1, 0.1, 0.1]) @ generator.normal(size=(6, 6))
    # Turned about the axis and moved along it by much, about y and z by little: none of the first two counts.
    covariance = np.diag([0.0, 0.02**2, 0.0, 0.0, 0.0, 0.0])
    stated = find(X_PO, covariance, towards, p_PG).sigma
    assert stated == pytest.approx(0.02 * (HALF + MIDDLE[2]), rel=1e-6)
    covariance = 1e-5 * root @ root.T
    held = find(X_PO, covariance, towards, p_PG)
    increments = generator.multivariate_normal(np.zeros(6), covariance, 4000)
    ends = np.array([find(X[None], np.zeros((6, 6)), towards, p_PG).point(held.end) for X in retract(X_PO, increments)])
    spread = np.sqrt(np.linalg.eigvalsh(np.cov(ends.T))[-1])
    assert held.sigma == pytest.approx(spread, rel=0.1)
    lengths = [find(X[None], np.zeros((6, 6)), towards, p_PG).end for X in retract(X_PO, increments)]
    assert held.sigma_end == pytest.approx(np.std(lengths), rel=0.1)


@pytest.mark.parametrize("first", [0, 1])
def test_a_rod_across_the_direction_that_is_asked_for_has_one_axis_too(first: int) -> None:
    """Two hypotheses hold it end for end, and both lean towards that direction by half a degree."""
    X_PO = poses(np.random.default_rng(5))
    flip = make_poses(np.diag([1.0, -1.0, -1.0]), MIDDLE - np.diag([1.0, -1.0, -1.0]) @ MIDDLE)
    towards, lean = X_PO[0, :, 0], np.array([[0.0, 0.01, 0.0, 0.0, 0.0, 0.0]])
    both = np.concatenate([retract(X_PO, lean), retract(compose(X_PO, flip[None]), lean)])
    assert np.all(both[:, :, :3] @ AXIS @ towards > 0.0)
    held = find(both[[first, 1 - first]], np.zeros((6, 6)), towards)
    np.testing.assert_allclose(np.abs(held.direction @ X_PO[0, :, :3]), AXIS, atol=1e-3)
    assert held.sigma < 0.02 * HALF
    assert held.same_way == pytest.approx(0.5)


def test_hypotheses_that_disagree_widen_it() -> None:
    X_PO = poses(np.random.default_rng(3))
    aside = retract(X_PO, np.array([[0.0, 0.0, 0.0, *(0.01 * X_PO[0, :, 0])]]))
    held = find(np.concatenate([X_PO, aside]), np.zeros((6, 6)), X_PO[0, :, 2])
    assert held.sigma == pytest.approx(0.005, rel=1e-6)
