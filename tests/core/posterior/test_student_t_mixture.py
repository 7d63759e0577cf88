import dataclasses

import numpy as np
import pytest

from tactopose_drake.core.poses import compose, increments_between, make_poses, random_rotations, retract
from tactopose_drake.core.posterior.student_t_mixture import StudentTMixture, in_chart

TAILS = (6, 1500.0)  # degrees of freedom, and the squared distance beyond which there is nothing


def poses(count: int) -> np.ndarray:
    generator = np.random.default_rng(3)
    return make_poses(random_rotations(generator, count), generator.normal(size=(count, 3)))


def information(count: int) -> np.ndarray:
    root = np.random.default_rng(4).normal(size=(count, 6, 6)) + 3.0 * np.eye(6)
    scale = np.repeat([0.1, 0.01], 3)
    return root @ np.swapaxes(root, 1, 2) / np.outer(scale, scale)


def densities(mixture: StudentTMixture, X_PO: np.ndarray) -> np.ndarray:
    density = np.zeros((len(X_PO), len(mixture.X_PO)))
    mixture.add_to(density, X_PO)
    return density / mixture.count.sum()


def mixture(count: int = 4000) -> StudentTMixture:
    center = np.array([[0.0] * 6, [0.4, -0.3, 0.2, 0.02, 0.0, 0.01], [0.0] * 6])
    share = np.array([2, 1, 1]) * count // 4
    return StudentTMixture(poses(2), np.array([0, 0, 1]), center, information(3), np.empty((3, 6, 0)), share, *TAILS)


def test_the_densities_add_up_to_one() -> None:
    # By importance sampling from one wide mixture, whose own density must be right for all of them.
    narrow, wide = mixture(), mixture(200_000)
    wide = dataclasses.replace(wide, information=wide.information / 1.5)
    X_PO = wide.sample(np.random.default_rng(0))
    ratio = densities(narrow, X_PO) / densities(wide, X_PO).sum(axis=1, keepdims=True)
    np.testing.assert_allclose(ratio.mean(axis=0), [0.75, 0.25], rtol=0.03)


def test_the_density_is_by_the_volume_of_poses() -> None:
    # The same density about a pose, told from another pose: the volume of increments there differs, that of poses not.
    X, center = poses(1)[0], np.array([0.9, -0.5, 0.3, 0.02, 0.0, 0.01])
    H = information(1)
    there = retract(X[None], center[None])
    found, local, turns = in_chart(X[None], np.array([0]), there, H, np.empty((1, 6, 0)))
    np.testing.assert_allclose(found[0], center, atol=1e-12)
    away = StudentTMixture(X[None], np.array([0]), found, local, turns, np.array([10]), *TAILS)
    here = StudentTMixture(
        retract(X[None], center[None]), np.array([0]), np.zeros((1, 6)), H, np.empty((1, 6, 0)), np.array([10]), *TAILS
    )
    near = retract(here.X_PO, 0.003 * np.random.default_rng(1).normal(size=(20, 6)) * [1, 1, 1, 0.1, 0.1, 0.1])
    np.testing.assert_allclose(densities(away, near), densities(here, near), rtol=0.02)


@pytest.mark.parametrize("angle", [0.0, 1e-4, 1.0, 3.0])
def test_directions_at_a_pose_are_told_by_how_the_increments_to_it_change(angle: float) -> None:
    """And what is known of them stays as it is."""
    X, generator = poses(1), np.random.default_rng(4)
    center = np.concatenate([angle * np.array([0.36, -0.48, 0.8]), [0.02, 0.0, -0.01]])
    there, H, turns = retract(X, center[None]), information(1), generator.normal(size=(1, 6, 3))
    found, local, moved = in_chart(X, np.array([0]), there, H, turns)
    np.testing.assert_allclose(found[0], center, atol=1e-9)
    ends = retract(there, 1e-6 * turns[0].T), retract(there, -1e-6 * turns[0].T)
    change = (increments_between(X, ends[0]) - increments_between(X, ends[1])) / 2e-6
    np.testing.assert_allclose(moved[0], change.T, atol=1e-5)
    np.testing.assert_allclose(moved[0].T @ local[0] @ moved[0], turns[0].T @ H[0] @ turns[0], rtol=1e-6)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 0.5, 2.0, 2.99, 3.01, np.pi - 1e-9, np.pi])
def test_the_density_is_right_at_any_angle(angle: float) -> None:
    generator = np.random.default_rng(6)
    axes = generator.normal(size=(30, 3))
    w = angle * axes / np.linalg.norm(axes, axis=1, keepdims=True)
    u = np.concatenate([w, 0.01 * generator.normal(size=(30, 3))], axis=1)
    center, H, X = 0.1 * generator.normal(size=(1, 6)), information(1), poses(1)
    turned = StudentTMixture(X, np.array([0]), center, H, np.empty((1, 6, 0)), np.array([1]), *TAILS)
    there = retract(X, u)
    d = increments_between(X[0], there) - center
    # The volume of increments over that of poses: det of the right Jacobian, 2 (1 - cos) / angle^2 = sinc^2(angle / 2).
    volume = np.sinc(angle / (2.0 * np.pi)) ** 2
    expected = (6.0 / (6.0 + np.einsum("bi,ij,bj->b", d, H[0], d))) ** 6 / volume
    found = densities(turned, there)[:, 0]
    np.testing.assert_allclose(found / found[0], expected / expected[0], rtol=1e-6)
    at_center = densities(turned, retract(X, center))[0, 0] * np.sinc(np.linalg.norm(center[0, :3]) / (2 * np.pi)) ** 2
    np.testing.assert_allclose(found / at_center, expected, rtol=1e-6)


def test_a_joined_mixture_has_the_density_of_both() -> None:
    one, other = mixture(40), dataclasses.replace(mixture(80), center=0.5 * mixture().center)
    both, X_PO = one.joined(other), one.X_PO[:1].repeat(20, axis=0)
    X_PO = retract(X_PO, 0.1 * np.random.default_rng(8).normal(size=(20, 6)) * [1, 1, 1, 0.1, 0.1, 0.1])
    separate = np.zeros((20, 2))
    one.add_to(separate, X_PO)
    other.add_to(separate, X_PO)
    assert (separate[:, 0] > 0.0).all()
    np.testing.assert_allclose(densities(both, X_PO) * both.count.sum(), separate, rtol=1e-9)


def test_the_samples_scatter_as_they_should() -> None:
    whole = mixture(80_000)
    X_PO = whole.sample(np.random.default_rng(2))
    assert len(X_PO) == whole.count.sum()
    last = increments_between(whole.X_PO[1], X_PO[-whole.count[2] :])
    # A Student-t density's covariance is its scale matrix times f / (f - 2).
    scatter = last.T @ last / len(last)
    np.testing.assert_allclose(np.trace(scatter @ whole.information[2]) / 6, 1.5, rtol=0.1)


def test_a_direction_that_changes_nothing_does_not_count() -> None:
    H, X = information(1), poses(1)
    turn = np.array([0.3, 0.0, 0.8, 0.1, -0.2, 0.05])
    free = StudentTMixture(X, np.array([0]), np.zeros((1, 6)), H, turn[None, :, None], np.array([10]), *TAILS)
    u = np.array([0.02, 0.01, -0.03, 0.001, 0.0, 0.002])
    along = retract(X, np.stack([u, u + 0.1 * turn, u - 0.05 * turn]))
    density = densities(free, along)[:, 0]
    # But for the volume of increments, which differs a little.
    np.testing.assert_allclose(density, density[0], rtol=2e-3)
    # And the scale along it changes nothing either.
    n = np.eye(6) - np.outer(turn, turn) / (turn @ turn)
    held, loose = (
        dataclasses.replace(free, information=n @ H @ n + scale * np.outer(turn, turn)) for scale in (1e5, 1e3)
    )
    np.testing.assert_allclose(densities(held, along), densities(loose, along), rtol=1e-6)


def test_far_away_there_is_nothing() -> None:
    far = retract(poses(2)[:1], np.array([[0.0, 0.0, 0.0, 50.0, 0.0, 0.0]]))
    assert densities(mixture(), far).sum() == pytest.approx(0.0)


def test_every_second_sample_of_a_component_is_opposite_to_the_one_before_it() -> None:
    whole = mixture(40)
    X_PO = whole.sample(np.random.default_rng(0))
    begin = 0
    for j, count in enumerate(whole.count.tolist()):
        u = increments_between(whole.X_PO[whole.group[j]], X_PO[begin : begin + count]) - whole.center[j]
        np.testing.assert_allclose(u[::2], -u[1::2], atol=1e-9)
        assert np.linalg.norm(u[::2], axis=1).min() > 0.0
        begin += count


def test_groups_have_their_random_numbers_in_common() -> None:
    """So that what is said of modes that are alike does not hang on which of them was found first."""
    whole = mixture(40)
    u = increments_between(whole.X_PO[whole.group.repeat(whole.count)], whole.sample(np.random.default_rng(0)))
    white = []
    for j, begin in enumerate(np.cumsum(whole.count) - whole.count):
        own = np.eye(6)
        own[3:, 3:] = whole.X_PO[whole.group[j], :, :3]
        root = np.linalg.cholesky(own.T @ whole.information[j] @ own)
        white.append((u[begin : begin + 10] - whole.center[j]) @ own @ root)
    np.testing.assert_allclose(white[2], white[0][:10], atol=1e-9)
    assert np.abs(white[1] - white[0]).max() > 0.1


def test_samples_turn_with_the_frame_that_poses_are_in() -> None:
    whole = mixture(40)
    X, turn = poses(5)[0], np.eye(6)
    turn[3:, 3:] = X[:, :3]
    turned = dataclasses.replace(
        whole,
        X_PO=compose(X, whole.X_PO),
        center=whole.center @ turn.T,
        information=turn @ whole.information @ turn.T,
    )
    expected = compose(X, whole.sample(np.random.default_rng(0)))
    np.testing.assert_allclose(turned.sample(np.random.default_rng(0)), expected, atol=1e-9)
