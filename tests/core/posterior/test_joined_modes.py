from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from tactopose_drake.core.objectives.objective import NormalEquations
from tactopose_drake.core.poses import compose, exp_so3, increments_between, make_poses, retract
from tactopose_drake.core.posterior.joined_modes import Families, Landscape, find_families
from tactopose_drake.core.posterior.joining_kernels import Lengths
from tactopose_drake.core.posterior.mode_moments_kernels import Joined, join
from tactopose_drake.core.posterior.posterior_params import MomentParams
from tactopose_drake.core.validation import FloatArray
from tests.core.posterior.valleys import moments_of

SIGMAS = np.array([0.03, 0.02, 0.05, 0.001, 0.002, 0.0015])
SCALE = np.outer(SIGMAS, SIGMAS)
# A metre for each standard deviation.
LENGTHS = Lengths(SIGMAS, 1.0, 0.01)
ALONE, NONE = np.eye(3, 4)[None], np.empty((0, 3, 4))
X_PO = make_poses(exp_so3(np.array([0.4, -1.0, 2.0])), np.array([0.1, 0.0, -0.2]))
# A half turn about the line through this point along the y-axis.
HALF_TURN = np.array([[-1.0, 0.0, 0.0, 0.08], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, -1.0, -0.06]])


def centred(mass: list[float], covariance: FloatArray) -> Joined:
    """Moments of modes with these masses, and these covariances about their poses."""
    count = len(covariance)
    return Joined(np.array(mass), np.full(count, 50.0), np.zeros((count, 6)), covariance.copy())


def join_all(found: Families, cost: list[float], moments: Joined) -> NDArray[np.intp]:
    """Joins families in the order of cost, and returns the index of each one's new mode."""
    order, owner = np.argsort(cost), np.full(len(found.X_PO), -1)
    join(found.X_PO, order, found.symmetry_poses, found.family, found.arm, moments, owner)
    return owner


def beside(*lengths: float) -> FloatArray:
    """Poses so many standard deviations from X_PO, along a direction of its own each."""
    return retract(np.tile(X_PO, (len(lengths), 1, 1)), np.diag(SIGMAS)[: len(lengths)] * np.array(lengths)[:, None])


class Costs:
    """Costs by the increments from X_PO in standard deviations, shape (B, 6), with derivatives by differences."""

    def __init__(self, height: Callable[[FloatArray], FloatArray], curvature: float = 1.0) -> None:
        """Here `curvature` is what stands for the Hessian's diagonal, per squared standard deviation."""
        self.asked, self._height, self._curvature = 0, height, curvature

    def cost(self, X: FloatArray) -> FloatArray:
        self.asked += len(X)
        return self._height(increments_between(np.broadcast_to(X_PO, X.shape), X) / SIGMAS)

    def normal_equations(self, X: FloatArray) -> NormalEquations:
        steps, cost = 1e-4 * np.diag(SIGMAS), self.cost(X)
        ahead, behind = (
            self._height(increments_between(np.broadcast_to(X_PO, (6, *X.shape)).reshape(-1, 3, 4), beside) / SIGMAS)
            for beside in (
                np.concatenate([retract(X, np.tile(sign * step, (len(X), 1))) for step in steps]) for sign in (1, -1)
            )
        )
        with np.errstate(invalid="ignore"):  # Costs may be infinite.
            slope = np.nan_to_num((ahead - behind).reshape(6, -1).T, posinf=0.0, neginf=0.0) / (2e-4 * SIGMAS)
        hessian = np.tile(np.diag(self._curvature / SIGMAS**2), (len(X), 1, 1))
        return NormalEquations(cost, np.ascontiguousarray(slope), hessian)


def valleys(places: list[float], costs: list[float]) -> Costs:
    """Costs by the way from X_PO along the first direction, in standard deviations: given at some, else between."""
    return Costs(lambda u: np.interp(u[:, 0], places, costs) + 0.5 * np.square(u[:, 1:]).sum(axis=1))


def families(
    X: FloatArray,
    objective: Costs,
    symmetries: FloatArray = ALONE,
    between: FloatArray = NONE,
    false_ones: Callable[[FloatArray], NDArray[np.bool_]] | None = None,
) -> Families:
    return find_families(X, objective.cost(X), Landscape(objective, LENGTHS, false_ones), symmetries, 0.1, between)


def all_one(X: FloatArray, symmetries: FloatArray = ALONE) -> Families:
    return families(X, valleys([0.0], [0.0]), symmetries)


def along(*lengths: float) -> FloatArray:
    """Poses so many standard deviations from X_PO along the first direction."""
    u = np.zeros((len(lengths), 6))
    u[:, 0] = SIGMAS[0] * np.array(lengths)
    return retract(np.tile(X_PO, (len(lengths), 1, 1)), u)


def test_modes_are_one_where_the_cost_between_hardly_rises() -> None:
    ridge = MomentParams().ridge
    for height, together in ((ridge - 0.1, True), (ridge + 0.1, False)):
        # Above the higher one, which costs 0.5.
        objective = valleys([0.0, 5.0, 10.0], [0.0, 0.5 + height, 0.5])
        family = families(along(0.0, 10.0), objective).family
        assert (family[1] == 0) == together


def test_a_ridge_beside_the_middle_counts_too() -> None:
    for place in (1.0, 2.0, 4.0, 5.0):
        objective = valleys([0.0, place - 0.5, place, place + 0.5, 6.0], [0.0, 0.0, 6.0, 0.0, 0.0])
        np.testing.assert_array_equal(families(along(0.0, 6.0), objective).family, [0, 1])


def test_minima_along_a_valley_are_one_by_those_between_and_not_across_a_ridge() -> None:
    places = np.arange(0.0, 31.0)
    bumps = 1.5 * (1.0 - np.cos(2.0 * np.pi * places / 6.0)) / 2.0
    bumps[(places > 18.0) & (places < 24.0)] = 8.0
    valley = valleys(places.tolist(), bumps.tolist())
    np.testing.assert_array_equal(families(along(0.0, 24.0, 6.0, 12.0, 30.0), valley).family, [0, 1, 0, 0, 1])


def test_of_many_minima_few_ways_are_laid_and_the_families_are_those_of_all_ways() -> None:
    minima = np.random.default_rng(3).permutation(np.concatenate([np.arange(0.0, 11.0, 2.0), np.arange(16.0, 27.0, 2)]))
    pairs = len(minima) * (len(minima) - 1) // 2
    places = np.linspace(0.0, 26.0, 2601)
    for ridge in (0.0, 9.0):
        # Bumps along a valley, and a high ridge across it in the middle, or none.
        bumps = 0.9 * (1.0 - np.cos(np.pi * places)) / 2.0 + np.where(np.abs(places - 13.0) < 2.5, ridge, 0.0)
        valley = valleys(places.tolist(), bumps.tolist())
        family = families(along(*minima), valley).family
        side = (minima > 13.0) & (ridge > 0.0)
        np.testing.assert_array_equal(family, [np.flatnonzero(side == own)[0] for own in side])
        # Eleven for each pair, and 36 more for each that leads over the ridge, would be all of them.
        assert valley.asked < (18 * pairs if ridge else 5 * pairs)


@pytest.mark.parametrize(("height", "bent"), [(9.0, 0), (11.0, 2)])
def test_no_way_is_bent_where_straight_ones_join_minima_whatever_lower_ways_there_are(height: float, bent: int) -> None:
    # The first two are one, as a saddle of 5 is little higher than the second. Then 9 is little higher than the third.
    valley = valleys([0.0, 3.0, 6.0, 9.0, 12.0], [0.0, 5.0, 4.0, height, 4.5])
    family = families(along(0.0, 6.0, 12.0), valley).family
    np.testing.assert_array_equal(family, [0, 0, 0] if bent == 0 else [0, 0, 2])
    # The three minima, and eleven poses on each of three straight ways; five times five, and six between, on each bent.
    assert valley.asked == 3 + 3 * 11 + bent * 31


def test_minima_between_which_no_pose_is_possible_are_apart() -> None:
    walled = Costs(lambda u: np.where(np.abs(u[:, 0] - 3.0) < 2.0, np.inf, 0.0))
    np.testing.assert_array_equal(families(along(0.0, 6.0), walled).family, [0, 1])


def test_two_gaussians_are_one_up_to_seven_standard_deviations() -> None:
    def cost(way: FloatArray, apart: float) -> FloatArray:
        return -np.logaddexp(-0.5 * way**2, -0.5 * (way - apart) ** 2)

    for apart, together in ((6.8, True), (7.1, False)):
        places = np.linspace(-1.0, 8.0, 901)
        family = families(along(0.0, apart), valleys(places.tolist(), cost(places, apart).tolist())).family
        assert (family[1] == 0) == together


def test_a_high_minimum_between_two_low_ones_does_not_join_them() -> None:
    # From the one in the middle the ways to the others rise by no more than a ridge; from those they rise by six.
    hill = valleys([0.0, 4.0, 5.0, 6.0, 10.0], [0.0, 6.0, 5.0, 6.0, 0.5])
    family = families(along(0.0, 10.0, 5.0), hill).family
    assert family[0] != family[1]
    low = valleys([0.0, 4.0, 5.0, 6.0, 10.0], [0.0, 1.9, 1.0, 1.9, 0.5])
    np.testing.assert_array_equal(families(along(0.0, 10.0, 5.0), low).family, [0, 0, 0])


def test_minima_that_take_different_contacts_for_false_are_one_over_a_lower_ridge_only() -> None:
    def by_side(X: FloatArray) -> NDArray[np.bool_]:
        way = increments_between(np.broadcast_to(X_PO, X.shape), X)[:, 0] / SIGMAS[0]
        return np.stack([way < 3.0, way > 3.0, np.zeros(len(X), dtype=np.bool_)], axis=1)

    params = MomentParams()
    for height, together in ((params.plateau - 0.1, True), (params.plateau + 0.1, False)):
        plateau = valleys([0.0, 1.0, 5.0, 6.0], [0.0, height, height, 0.0])
        assert (families(along(0.0, 6.0), plateau, false_ones=by_side).family[1] == 0) == together
        # With the same ones they are one over a ridge of either height.
        alike = families(along(0.0, 6.0), plateau, false_ones=lambda X: np.ones((len(X), 3), dtype=np.bool_))
        np.testing.assert_array_equal(alike.family, [0, 0])


def test_a_bent_valley_is_one_mode() -> None:
    bent = Costs(lambda u: np.square(u[:, 1] - _arch(u[:, 0])), curvature=2.0)
    assert bent.cost(along(3.0))[0] > 2.0 * MomentParams().ridge  # Straight, the way is high.
    np.testing.assert_array_equal(families(along(0.0, 6.0), bent).family, [0, 0])
    # Where steps lead nowhere, the straight way counts.
    np.testing.assert_array_equal(families(along(0.0, 6.0), Costs(bent._height, 1e9)).family, [0, 1])
    np.testing.assert_array_equal(families(along(0.0, 1.0), Costs(bent._height, 1e9)).family, [0, 0])


@pytest.mark.parametrize("place", [2.5, 3.0, 3.5])
def test_paths_do_not_slide_off_a_ridge_to_both_its_sides(place: float) -> None:
    # The ridge is steep along the path, so that poses on its flanks would slide far down if they could.
    ridge = Costs(lambda u: 12.0 * np.exp(-2.0 * np.square(u[:, 0] - place)) + 0.5 * np.square(u[:, 1]), 0.05)
    np.testing.assert_array_equal(families(along(0.0, 6.0), ridge).family, [0, 1])


def test_a_ridge_between_two_poses_of_a_bent_path_counts() -> None:
    # It is narrower than the distance of the poses that are relaxed, and lies halfway between two of them.
    narrow = Costs(
        lambda u: np.square(u[:, 1] - _arch(u[:, 0])) + np.where(np.abs(u[:, 0] - 3.5) < 0.2, 20.0, 0.0), curvature=2.0
    )
    np.testing.assert_array_equal(families(along(0.0, 6.0), narrow).family, [0, 1])


@pytest.mark.parametrize("half_turns", [0, 1])
def test_modes_are_one_by_way_of_minima_between_them_that_are_no_modes(half_turns: int) -> None:
    def corner(u: FloatArray) -> FloatArray:
        """A valley along the first direction, and at its end along the second one."""
        X = retract(np.tile(X_PO, (len(u), 1, 1)), u * SIGMAS)
        both = np.stack([increments_between(np.broadcast_to(X_PO, X.shape), Y) / SIGMAS for Y in (X, turned(X))])
        return np.minimum(np.square(both[..., 1]), np.square(both[..., 0] - 8.0)).min(axis=0)

    def turned(X: FloatArray) -> FloatArray:
        return compose(X, HALF_TURN) if half_turns else X

    u = np.zeros((5, 6))
    u[:, :2] = np.array([[0.0, 0.0], [8.0, 8.0], [4.0, 0.0], [8.0, 0.0], [8.0, 4.0]]) * SIGMAS[:2]
    X = retract(np.tile(X_PO, (5, 1, 1)), u)
    symmetries = np.stack([np.eye(3, 4), HALF_TURN]) if half_turns else ALONE
    X[3:] = turned(X[3:])
    np.testing.assert_array_equal(families(X[:2], Costs(corner, 1e9), symmetries).family, [0, 1])
    np.testing.assert_array_equal(families(X[:2], Costs(corner, 1e9), symmetries, between=X[2:]).family, [0, 0])
    np.testing.assert_array_equal(families(X[:2], Costs(corner, 1e9), symmetries, between=X[2:3]).family, [0, 1])


def _arch(way: FloatArray) -> FloatArray:
    return 0.5 * way * (6.0 - way)


def test_minima_round_an_axis_are_one() -> None:
    turns = np.zeros((3, 6))
    turns[:, 2] = np.radians([0.0, 120.0, -120.0])

    flat = Costs(lambda u: np.zeros(len(u)))
    np.testing.assert_array_equal(families(retract(np.tile(X_PO, (3, 1, 1)), turns), flat).family, [0, 0, 0])


def test_many_minima_along_a_flat_valley_are_one_but_for_one_behind_a_ridge() -> None:
    count = 2 * MomentParams().most_joined
    places = [*np.linspace(0.0, 1.0, count), 20.0]
    family = families(along(*places), valleys([0.0, 1.0, 10.0, 20.0], [0.0, 0.0, 50.0, 0.0])).family
    np.testing.assert_array_equal(family, [0] * count + [count])


def test_of_a_family_the_lowest_cost_stays_and_owns_the_others() -> None:
    found = all_one(along(0.0, 1.0, 9.0))._replace(family=np.array([0, 0, 2]))
    moments = centred([0.5, 0.1, 0.4], np.tile(np.diag(SIGMAS**2), (3, 1, 1)))
    np.testing.assert_array_equal(join_all(found, [3.0, 2.0, 4.0], moments), [1, 1, 2])
    np.testing.assert_allclose(moments.mass, [0.0, 0.6, 0.4])


def test_without_the_first_of_a_family_the_others_are_still_one() -> None:
    moments, owner = centred([0.6, 0.1, 0.3], np.tile(np.diag(SIGMAS**2), (3, 1, 1))), np.full(3, -1)
    found = all_one(along(0.0, 1.0, 2.0))
    join(found.X_PO, np.array([2, 1]), found.symmetry_poses, found.family, found.arm, moments, owner)
    np.testing.assert_allclose(moments.mass, [0.6, 0.0, 0.4])
    np.testing.assert_array_equal(owner, [-1, 2, 2])


def test_the_joint_moments_are_those_of_the_samples_together() -> None:
    generator = np.random.default_rng(3)
    X = beside(0.0, 1.5)
    u = generator.normal(size=(2, 4000, 6)) * np.array([SIGMAS, 1.4 * SIGMAS])[:, None] + 0.2 * SIGMAS
    samples = retract(np.repeat(X, 4000, axis=0), u.reshape(-1, 6))
    weights = np.zeros((8000, 2))
    weights[:4000, 0], weights[4000:, 1] = 0.6 / 4000, 0.4 / 4000
    joint = moments_of(X, samples, weights)._replace(mass=np.array([0.6, 0.4]))
    join_all(all_one(X), [0.0, 0.0], joint)
    together = moments_of(X[:1], samples, weights.sum(axis=1, keepdims=True))
    np.testing.assert_allclose(joint.mass, [1.0, 0.0])
    np.testing.assert_allclose(joint.first[0] / SIGMAS, together.first[0] / SIGMAS, atol=0.02)
    np.testing.assert_allclose(joint.second[0] / SCALE, together.second[0] / SCALE, atol=0.05)
    assert joint.effective_samples[0] == pytest.approx(together.effective_samples[0])


@pytest.mark.parametrize("seed", [0, 1])
def test_images_by_a_symmetry_are_compared_where_they_are_alike(seed: int) -> None:
    # The same two modes, of which the second is given as its image: mass and moments are the same.
    generator = np.random.default_rng(seed)
    roots = generator.normal(size=(2, 6, 6)) * SIGMAS[:, None] / 6
    covariance = roots @ np.swapaxes(roots, 1, 2) + np.diag(SIGMAS**2)
    X, cost, masses = beside(0.0, 1.0), [0.0, 1.0], [0.7, 0.3]
    direct = centred(masses, covariance)
    join_all(all_one(X), cost, direct)
    np.testing.assert_allclose(direct.mass, [1.0, 0.0])

    # How the second mode's increments turn with it, by differences.
    image = compose(X[1], HALF_TURN)
    u = increments_between(image, compose(retract(np.tile(X[1], (6, 1, 1)), 1e-6 * np.eye(6)), HALF_TURN)) / 1e-6
    covariance[1] = u.T @ covariance[1] @ u
    group, there = np.stack([np.eye(3, 4), HALF_TURN]), np.stack([X[0], image])
    by_image, half_a_turn_off = centred(masses, covariance), centred(masses, covariance)
    join_all(all_one(there, group), cost, by_image)
    np.testing.assert_allclose(by_image.mass, [1.0, 0.0])
    np.testing.assert_allclose(by_image.first / SIGMAS, direct.first / SIGMAS, atol=1e-6)
    np.testing.assert_allclose(by_image.second[0] / SCALE, direct.second[0] / SCALE, atol=1e-3)
    join_all(all_one(there), cost, half_a_turn_off)
    assert np.trace(half_a_turn_off.second[0][:3, :3]) > 0.25 * np.pi**2
