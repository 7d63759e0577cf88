import math

import numpy as np
import pytest
import trimesh

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.hand_geometry import HandGeometry
from tactopose_drake.core.exploration.chance_touch import choose_by_chance
from tactopose_drake.core.exploration.foreseen_touch import (
    Foreseen,
    TouchNoise,
    entropy,
    foresee,
    told_of_mode,
    told_within_modes,
)
from tactopose_drake.core.exploration.guarded_moves import GuardedMoves
from tactopose_drake.core.exploration.next_touch import (
    Candidate,
    Hold,
    TouchCriterion,
    choose_telling_touch,
    choose_touch,
    information,
    is_allowed,
    name_information,
)
from tactopose_drake.core.exploration.tolerance import Tolerance
from tactopose_drake.core.poses import exp_so3, make_poses
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture
from tactopose_drake.core.posterior.moved_origin import mixture_of_origin
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.errors import InvalidInputError

TIP = 0.008
COVARIANCE = np.diag([0.02**2] * 3 + [0.0008**2] * 3)


@pytest.fixture(scope="module")
def mug() -> ObjectModel:
    """A cylinder about z with a lug towards +x: only a touch of the lug, or of its absence, tells the spin."""
    body = trimesh.creation.cylinder(radius=0.03, height=0.1, sections=96)
    lug = trimesh.creation.box((0.02, 0.015, 0.04), transform=trimesh.transformations.translation_matrix([0.038, 0, 0]))
    mesh = trimesh.boolean.union([body, lug], engine="manifold")
    return ObjectModel.from_mesh(mesh, symmetry="none", max_grid_bytes=8_000_000, samples=300)


def test_modes_are_told_apart_by_as_much_as_their_answers_overlap_at_least() -> None:
    """By the integral of the root of both densities; the truth, of the same answers, is more."""
    mean, sigma, weights = np.array([0.0, 0.002]), np.array([0.001, 0.0015]), np.array([0.7, 0.3])
    unused, variance = np.zeros((2, 1, 6, 6)), np.square(sigma)[:, None, None, None]
    chance = np.full((2, 1), 0.96)
    foreseen = Foreseen(np.ones((2, 1)), chance, mean[:, None, None], variance, unused[:, 0], unused, unused, unused)
    z = np.linspace(-0.02, 0.02, 40_001)
    density = np.exp(-0.5 * ((z - mean[:, None]) / sigma[:, None]) ** 2) / (math.sqrt(2.0 * math.pi) * sigma[:, None])
    step, hit = z[1] - z[0], chance[0, 0]
    overlap = hit * np.sqrt(density[:, None] * density[None]).sum(axis=2) * step + 1.0 - hit
    found = told_of_mode(weights, foreseen)[0]
    assert found == pytest.approx(-weights @ np.log(overlap @ weights), rel=1e-6)
    mixture = weights @ density
    told = np.sum(weights[:, None] * density * np.log(np.maximum(density, 1e-300) / np.maximum(mixture, 1e-300))) * step
    assert 0.5 * told < found < hit * told


def spins(*angles: float, probability: list[float] | None = None) -> GaussianMixture:
    X = make_poses(exp_so3(np.array([[0.0, 0.0, angle] for angle in angles])), np.zeros((len(angles), 3)))
    share = np.ones(len(angles)) if probability is None else np.array(probability)
    return GaussianMixture(X, share / share.sum(), np.tile(COVARIANCE, (len(angles), 1, 1)))


def inward(*angles: float, height: float = 0.0) -> GuardedMoves:
    """Straight motions to the axis from these directions."""
    away = np.array([[np.cos(angle), np.sin(angle), 0.0] for angle in angles])
    return GuardedMoves.lines(0.1 * away + [0, 0, height], -away, 0.12, radius=TIP)


def test_a_touch_is_foreseen_as_unsure_as_the_surface_leans_away(mug: ObjectModel) -> None:
    sure = GaussianMixture(np.eye(3, 4)[None], np.ones(1), 1e-14 * np.eye(6)[None])
    lean = np.radians([0.0, 30.0, 60.0, 85.0])
    # From above onto the flat top.
    down = np.stack([np.sin(lean), np.zeros(4), -np.cos(lean)], axis=1)
    moves = GuardedMoves.lines([0.0, 0.0, 0.05 + TIP] - 0.02 * down, down, 0.04, radius=TIP)
    noise = TouchNoise(position=0.001, normal=None)
    found = foresee(mug, sure, moves, noise)
    assert found.hit.all()
    np.testing.assert_allclose(np.sqrt(found.covariance[0, :3, 0, 0]), 0.001 / np.cos(lean[:3]), rtol=0.02)
    assert np.sqrt(found.covariance[0, 3, 0, 0]) == pytest.approx(0.001 / noise.least_facing, rel=0.02)
    with_normal = foresee(mug, sure, moves, TouchNoise(position=0.001, normal=0.05)).covariance[0, 0]
    np.testing.assert_allclose(with_normal[1:, 1:], 0.05**2 * np.eye(3), atol=1e-6)


def test_a_motion_that_meets_the_object_wherever_it_is_leaves_the_mode_as_wide_as_it_is(mug: ObjectModel) -> None:
    foreseen = foresee(mug, spins(0.3), inward(0.0), TouchNoise())
    assert foreseen.hit.all()
    np.testing.assert_allclose(foreseen.given_hit[0, 0], foreseen.prior[0], rtol=1e-9, atol=1e-15)


def test_the_answers_of_a_wide_mode_are_foreseen_as_its_poses_give_them(mug: ObjectModel) -> None:
    """The share of touches, and the distance's deviation, of 40 motions that pass the object at all places."""
    generator = np.random.default_rng(0)
    wide = GaussianMixture(np.eye(3, 4)[None], np.ones(1), np.diag(np.repeat([0.25, 0.01], 3) ** 2)[None])
    away = generator.normal(size=(40, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    moves = GuardedMoves.lines(0.04 * generator.normal(size=(40, 3)) + 0.15 * away, -away, 0.3, radius=TIP)
    foreseen = foresee(mug, wide, moves, TouchNoise(normal=None))
    felt = moves.feel(mug, wide.sample(4000, generator))
    hit = felt.is_hit.mean(axis=0)
    assert np.sqrt(np.mean(np.square(foreseen.hit[0] - hit))) < 0.04
    often = hit > 0.5
    way = np.ma.masked_array(felt.way, ~felt.is_hit)[:, often]
    ratio = np.log(foreseen.covariance[0, often, 0, 0] / np.asarray(way.var(axis=0)))
    assert np.sqrt(np.mean(np.square(ratio))) < 0.22


def test_modes_that_differ_in_their_spread_alone_are_told_apart_by_it() -> None:
    sigma, unknown = np.array([0.001, 0.004]), np.tile(np.eye(6), (2, 1, 1, 1))
    hit, chance, covariance = np.ones((2, 1)), np.full((2, 1), 0.96), np.square(sigma)[:, None, None, None]
    modes = np.eye(6)[None].repeat(2, axis=0)
    found = Foreseen(hit, chance, np.zeros((2, 1, 1)), covariance, modes, unknown, unknown, unknown)
    # The Bhattacharyya coefficient of two Gaussians about one mean; that there is a touch at all is nearly certain.
    overlap = math.sqrt(2.0 * sigma[0] * sigma[1] / (sigma @ sigma))
    same = 0.5 + 0.5 * (0.96 * overlap + 1.0 - 0.96)
    np.testing.assert_allclose(told_of_mode(np.array([0.5, 0.5]), found), -math.log(same), rtol=1e-9)


def between(model: ObjectModel, belief: GaussianMixture, moves: GuardedMoves, noise: TouchNoise) -> np.ndarray:
    return told_of_mode(belief.weights, foresee(model, belief, moves, noise))


def simulated_information(
    model: ObjectModel, belief: GaussianMixture, moves: GuardedMoves, noise: TouchNoise, draws: int
) -> np.ndarray:
    """Mutual information of mode and touch by Monte Carlo of the predicted Gaussians, for motions that always hit."""
    generator = np.random.default_rng(0)
    foreseen = foresee(model, belief, moves, noise)
    mean, covariance = foreseen.mean, foreseen.covariance
    gained = np.zeros(len(moves))
    for m in range(len(moves)):
        factor, precision = np.linalg.cholesky(covariance[:, m]), np.linalg.inv(covariance[:, m])
        log_scale = -0.5 * np.linalg.slogdet(covariance[:, m])[1]
        for i, weight in enumerate(belief.weights):
            z = mean[i, m] + generator.normal(size=(draws, mean.shape[2])) @ factor[i].T
            off = z[:, None] - mean[None, :, m]
            log_density = log_scale - 0.5 * np.einsum("dni,nij,dnj->dn", off, precision, off)
            log_all = np.logaddexp.reduce(log_density + np.log(belief.weights), axis=1)
            gained[m] += weight * np.mean(log_density[:, i] - log_all)
    return gained


def test_a_touch_where_all_modes_agree_tells_nothing(mug: ObjectModel) -> None:
    belief = spins(0.0, np.pi / 2)
    tells = information(mug, belief, inward(0.0, np.pi / 2, -2.4))
    assert tells[0] > 0.5 * np.log(2)
    assert tells[1] > 0.5 * np.log(2)
    assert tells[2] < 0.02


def test_one_touch_in_four_tells_whether_it_is_that_one(mug: ObjectModel) -> None:
    belief = spins(0.0, np.pi / 2, np.pi, -np.pi / 2)
    (tells,) = information(mug, belief, inward(0.0))
    exact = -(0.25 * np.log(0.25) + 0.75 * np.log(0.75))
    assert 0.75 * exact < tells <= exact


def test_it_is_a_lower_bound_and_close_to_what_sampling_gives(mug: ObjectModel) -> None:
    noise = TouchNoise()
    belief = spins(0.0, 0.25, 0.6, probability=[0.5, 0.3, 0.2])
    moves = inward(0.0, 0.2, 0.4, 0.6, 2.0)
    bound = between(mug, belief, moves, noise)
    sampled = simulated_information(mug, belief, moves, noise, draws=1500)
    assert np.all(bound <= sampled + 0.03)
    assert np.corrcoef(bound, sampled)[0, 1] > 0.95
    assert bound[:4].max() > 0.5 * sampled.max() > 0.2


def test_more_noise_tells_less_and_a_normal_tells_more(mug: ObjectModel) -> None:
    belief, moves = spins(0.0, 0.3), inward(0.0, 0.15, 0.3)
    plain = between(mug, belief, moves, TouchNoise(position=0.004, normal=None))
    with_normal = between(mug, belief, moves, TouchNoise(position=0.004))
    blunt = between(mug, belief, moves, TouchNoise(position=0.02, normal=None))
    assert np.all(with_normal >= plain - 1e-9)
    assert with_normal.max() > plain.max() + 0.02
    assert blunt.max() < 0.9 * plain.max()


def test_equal_modes_and_a_single_one_leave_nothing_to_tell_between_modes(mug: ObjectModel) -> None:
    noise = TouchNoise()
    np.testing.assert_allclose(between(mug, spins(0.3), inward(0.0, 1.0), noise), 0.0, atol=1e-12)
    np.testing.assert_allclose(between(mug, spins(0.3, 0.3), inward(0.0, 1.0), noise), 0.0, atol=1e-9)


def shifted(sigma: float) -> GaussianMixture:
    """One mode, whose place along x has this standard deviation, m; all else is known."""
    covariance = np.diag([1e-8] * 3 + [sigma**2, 1e-10, 1e-10])
    return GaussianMixture(np.eye(3, 4)[None], np.ones(1), covariance[None])


def test_a_wide_mode_is_told_by_how_much_a_touch_shrinks_it(mug: ObjectModel) -> None:
    tolerance, noise, sigma = Tolerance(), TouchNoise(normal=None), 0.01
    along, across = information(mug, shifted(sigma), inward(np.pi, np.pi / 2), TouchCriterion(noise=noise))
    resolved = tolerance.sigmas[3] ** 2
    after = 1.0 / (1.0 / sigma**2 + 1.0 / noise.position**2)
    # Where all points meet the flank, the motion along x measures x, by a Gaussian's update.
    assert along == pytest.approx(0.5 * np.log((sigma**2 + resolved) / (after + resolved)), rel=0.1)
    assert across < 0.5 * along
    assert entropy(shifted(sigma), tolerance) == pytest.approx(0.5 * np.log(1.0 + sigma**2 / resolved), rel=1e-3)


@pytest.mark.parametrize(("narrowed", "told"), [(0.5, math.log(2.0)), (0.8, math.log(1.25)), (0.1, math.log(2.0))])
def test_whether_there_is_a_touch_tells_what_it_narrows_and_one_bit_at_the_most(narrowed: float, told: float) -> None:
    tolerance = Tolerance(translation=1e-5, rotation=1e-4)
    wide = np.diag(np.repeat([0.3, 0.02], 3) ** 2)[None]
    half = wide.copy()
    half[0, 0, 0] *= narrowed**2
    share, given = np.array([[0.5]]), half[:, None]
    foreseen = Foreseen(share, share, np.zeros((1, 1, 1)), np.ones((1, 1, 1, 1)), wide, given, given, given)
    assert told_within_modes(np.ones(1), foreseen, tolerance)[0] == pytest.approx(told, rel=1e-3)


def test_what_an_answer_narrows_counts_as_often_as_there_is_one() -> None:
    tolerance = Tolerance(translation=1e-5, rotation=1e-4)
    wide = np.diag(np.repeat([0.3, 0.02], 3) ** 2)[None]
    narrow = wide.copy()
    narrow[0, 3, 3] *= 0.1**2
    answer = np.zeros((1, 1, 1)), np.ones((1, 1, 1, 1))
    share = np.array([[0.25]])
    foreseen = Foreseen(share, share, *answer, wide, wide[:, None], wide[:, None], narrow[:, None])
    assert told_within_modes(np.ones(1), foreseen, tolerance)[0] == pytest.approx(0.25 * math.log(10.0), rel=1e-3)


def test_a_mode_within_the_tolerance_leaves_little_to_tell(mug: ObjectModel) -> None:
    assert information(mug, shifted(0.0005), inward(np.pi))[0] < 0.02
    finer = TouchCriterion(tolerance=Tolerance(translation=0.0005))
    assert information(mug, shifted(0.0005), inward(np.pi), finer)[0] > 0.1


def test_one_wide_mode_is_touched_where_it_is_wide(mug: ObjectModel) -> None:
    moves = {"little": inward(np.pi / 2, np.pi)}
    found = choose_touch(mug, Hold(Contacts(HELD), NAMES, 0.7), shifted(0.02), moves)
    assert found is not None
    assert found.move == 1
    assert found.information > 0.8


def test_predictions_have_the_spread_of_the_mode_and_the_sensor(mug: ObjectModel) -> None:
    noise = TouchNoise()
    foreseen = foresee(mug, spins(0.0), inward(np.pi), noise)
    assert foreseen.hit[0, 0] == 1.0
    # Far from edges the way's variance is the pose's along the motion and the sensor's.
    assert foreseen.mean[0, 0, 0] == pytest.approx(0.1 - 0.03 - TIP, abs=5e-4)
    assert np.sqrt(foreseen.covariance[0, 0, 0, 0]) == pytest.approx(np.hypot(0.0008, noise.position), rel=0.1)
    np.testing.assert_allclose(foreseen.mean[0, 0, 1:], [-1, 0, 0], atol=0.03)


HELD = np.array([[0.0, 0.03, 0.0], [0.0, -0.03, 0.02], [0.0, -0.03, -0.02], [-0.03, 0.0, 0.03]])
NAMES = ("thumb", "first", "middle", "ring")


def test_the_best_allowed_motion_is_chosen(mug: ObjectModel) -> None:
    belief = spins(0.0, np.pi)
    moves = {"little": inward(1.2, 1.9), "ring": inward(np.pi, 2.0)}
    found = choose_touch(mug, Hold(Contacts(HELD), NAMES, 0.7), belief, moves)
    assert found is not None
    assert (found.finger, found.move) == ("ring", 0)
    assert found.information == found.value["ring"].max()
    assert found.entropy == pytest.approx(entropy(belief, Tolerance()))
    assert found.entropy > np.log(2)
    assert found.expected_entropy == pytest.approx(found.entropy - found.information)
    assert found.allowed["little"].all()


def test_what_a_touch_tells_does_not_hang_on_the_frame_of_the_object(mug: ObjectModel) -> None:
    mesh = trimesh.Trimesh(np.add(mug.vertices, [-0.8, 0.5, 1.1]), mug.faces)
    far = ObjectModel.from_mesh(mesh, symmetry="none", max_grid_bytes=8_000_000, samples=300)
    near, moves = spins(0.0, 2.0), {"free": inward(0.0, np.pi)}
    hold, belief = Hold(Contacts(HELD), NAMES, 0.7), mixture_of_origin(near, far.middle - mug.middle)
    found, expected = choose_touch(far, hold, belief, moves), choose_touch(mug, hold, near, moves)
    assert found is not None
    assert expected is not None
    assert found.entropy == pytest.approx(expected.entropy, rel=1e-2)
    np.testing.assert_allclose(found.value["free"], expected.value["free"], rtol=1e-2)
    named, by_mug = (
        choose_telling_touch([Candidate(model, known, 1.0)], hold, moves)
        for model, known in ((far, belief), (mug, near))
    )
    assert named is not None
    assert by_mug is not None
    assert named.information == pytest.approx(by_mug.information, abs=1e-6)
    by_chance, of_mug = (
        choose_by_chance(model, hold, known, moves, np.random.default_rng(0))
        for model, known in ((far, belief), (mug, near))
    )
    assert by_chance is not None
    assert of_mug is not None
    assert by_chance.information == pytest.approx(of_mug.information, rel=1e-2)


def test_a_belief_without_a_mode_is_refused(mug: ObjectModel) -> None:
    nothing, contacts = GaussianMixture.empty(), Contacts(HELD)
    with pytest.raises(InvalidInputError, match="belief must have 1 or more modes, not 0"):
        choose_touch(mug, Hold(contacts, NAMES, 0.7), nothing, {"ring": inward(np.pi)})
    with pytest.raises(InvalidInputError, match="belief must have 1 or more modes, not 0"):
        is_allowed(mug, Hold(contacts, NAMES, 0.7), nothing, "ring", inward(np.pi))


def test_a_finger_that_is_needed_stays(mug: ObjectModel) -> None:
    belief, contacts = spins(0.0, np.pi), Contacts(HELD)
    assert is_allowed(mug, Hold(contacts, NAMES, 0.7), belief, "ring", inward(np.pi)).all()
    assert not is_allowed(mug, Hold(contacts, NAMES, 0.7), belief, "thumb", inward(np.pi)).any()
    found = choose_touch(mug, Hold(contacts, NAMES, 0.7), belief, {"thumb": inward(np.pi)})
    assert found is None
    # With three fingers none may go.
    for name in NAMES[:3]:
        assert not is_allowed(mug, Hold(Contacts(HELD[:3]), NAMES[:3], 0.7), belief, name, inward(np.pi)).any()


def test_a_finger_that_holds_nothing_may_go_however_the_others_hold(mug: ObjectModel) -> None:
    two = Hold(Contacts(HELD[:2]), NAMES[:2], 0.7)
    assert is_allowed(mug, two, spins(0.0), "ring", inward(np.pi / 4)).all()
    assert not is_allowed(mug, two, spins(0.0), "first", inward(np.pi / 4)).any()


def test_a_motion_must_be_clear_at_each_likely_mode(mug: ObjectModel) -> None:
    # A knuckle ahead of the fingertip to the side, which only the lug would meet.
    tips = inward(0.7)
    body = tips.tip[:, :, None] + np.array([0.02, -0.035, 0.0])
    moves = GuardedMoves(tips.tip, TIP, body, np.array([0.01]))
    contacts = Contacts(HELD)
    here, there = spins(0.0), spins(np.pi)
    assert not is_allowed(mug, Hold(contacts, NAMES, 0.7), here, "little", moves).any()
    assert is_allowed(mug, Hold(contacts, NAMES, 0.7), there, "little", moves).all()
    both = spins(0.0, np.pi, probability=[0.1, 0.9])
    assert not is_allowed(mug, Hold(contacts, NAMES, 0.7), both, "little", moves).any()
    unlikely = spins(0.0, np.pi, probability=[0.02, 0.98])
    assert is_allowed(mug, Hold(contacts, NAMES, 0.7), unlikely, "little", moves).all()
    assert not is_allowed(mug, Hold(contacts, NAMES, 0.7), unlikely, "little", moves, likely=0.005).any()
    safer = TouchCriterion(likely=0.005)
    assert choose_touch(mug, Hold(contacts, NAMES, 0.7), unlikely, {"little": moves}) is not None
    assert choose_touch(mug, Hold(contacts, NAMES, 0.7), unlikely, {"little": moves}, criterion=safer) is None


def test_a_finger_that_would_meet_another_takes_another_way(mug: ObjectModel) -> None:
    belief, contacts = spins(0.0, np.pi), Contacts(HELD)
    moves = {"ring": inward(np.pi, 0.0)}
    barred = {"ring": HandGeometry(np.array([[-0.06, 0.0, 0.0]]), np.array([0.005]))}
    free = choose_touch(mug, Hold(contacts, NAMES, 0.7), belief, moves)
    found = choose_touch(mug, Hold(contacts, NAMES, 0.7), belief, moves, others=barred)
    assert free is not None
    assert found is not None
    assert list(free.allowed["ring"]) == [True, True]
    assert list(found.allowed["ring"]) == [False, True]
    assert found.move == 1
    with pytest.raises(InvalidInputError, match=r"others must have an entry for each finger that may .*'little'"):
        choose_touch(mug, Hold(contacts, NAMES, 0.7), belief, moves | {"little": inward(0.7)}, others=barred)


def test_each_contact_has_a_name(mug: ObjectModel) -> None:
    with pytest.raises(InvalidInputError, match="fingers must be as many names as there are contacts, 4, not 2"):
        choose_touch(mug, Hold(Contacts(HELD), NAMES[:2], 0.7), spins(0.0), {})


@pytest.fixture(scope="module")
def can() -> ObjectModel:
    """The mug without its lug."""
    mesh = trimesh.creation.cylinder(radius=0.03, height=0.1, sections=96)
    return ObjectModel.from_mesh(mesh, symmetry="none", max_grid_bytes=8_000_000, samples=300)


def test_the_name_is_told_where_objects_differ_and_not_where_poses_do(mug: ObjectModel, can: ObjectModel) -> None:
    candidates = [Candidate(mug, spins(0.0), 0.5), Candidate(can, spins(0.0), 0.5)]
    lug, flank = name_information(candidates, inward(0.0, 2.0))
    assert 0.5 * np.log(2.0) < lug <= np.log(2.0)
    assert flank < 0.02
    # Where the mug's spin alone is asked, this touch tells it; of the name it tells nothing.
    (told,) = name_information([Candidate(mug, spins(0.0, np.pi), 1.0)], inward(0.0))
    assert told < 1e-9


def test_what_tells_poses_of_one_object_apart_does_not_name_it(mug: ObjectModel) -> None:
    """Three places along the way, that no noise confuses: two of one object and one of another."""
    X = make_poses(np.tile(np.eye(3), (3, 1, 1)), np.array([[0.0, 0.0, 0.0], [-0.01, 0.0, 0.0], [-0.02, 0.0, 0.0]]))
    covariance = np.tile(1e-10 * np.eye(6), (3, 1, 1))
    for share in (0.5, 0.8):
        one = Candidate(mug, GaussianMixture(X[:2], np.full(2, 0.5), covariance[:2]), share)
        other = Candidate(mug, GaussianMixture(X[2:], np.ones(1), covariance[2:]), 1.0 - share)
        name = -share * math.log(share) - (1.0 - share) * math.log(1.0 - share)
        assert name_information([one, other], inward(np.pi))[0] == pytest.approx(name, rel=0.1)


def test_the_touch_that_names_the_object_is_chosen(mug: ObjectModel, can: ObjectModel) -> None:
    hold = Hold(Contacts(HELD), NAMES, 0.7)
    candidates = [Candidate(mug, spins(0.0), 2.0), Candidate(can, spins(0.0), 2.0)]
    found = choose_telling_touch(candidates, hold, {"little": inward(2.0, 0.0, -2.0)})
    assert found is not None
    assert found.move == 1
    assert found.entropy == pytest.approx(np.log(2.0))
    with pytest.raises(InvalidInputError, match="candidates"):
        choose_telling_touch([Candidate(mug, spins(0.0), 0.0)], hold, {"little": inward(0.0)})
    with pytest.raises(InvalidInputError, match="candidates"):
        choose_telling_touch([], hold, {"little": inward(0.0)})


def test_an_unlikely_pose_of_an_unlikely_object_forbids_nothing(mug: ObjectModel, can: ObjectModel) -> None:
    # The knuckle meets the mug's lug at the first of its poses, and the can at none.
    tips = inward(0.7)
    moves = {"little": GuardedMoves(tips.tip, TIP, tips.tip[:, :, None] + [0.02, -0.035, 0.0], np.array([0.01]))}
    hold = Hold(Contacts(HELD), NAMES, 0.7)

    def is_allowed_at(mug_probability: float, here: float) -> bool:
        poses = spins(0.0, np.pi, probability=[here, 1.0 - here])
        candidates = [Candidate(can, spins(0.0), 1.0 - mug_probability), Candidate(mug, poses, mug_probability)]
        return choose_telling_touch(candidates, hold, moves) is not None

    assert not is_allowed_at(0.5, 0.2)
    assert is_allowed_at(0.5, 0.09)
    assert is_allowed_at(0.04, 0.9)


def test_chance_takes_any_allowed_motion_that_meets_the_object(mug: ObjectModel) -> None:
    hold, past = Hold(Contacts(HELD), NAMES, 0.7), inward(0.5, height=0.2)
    moves = {"little": inward(1.2, 1.9, 2.2), "ring": past, "thumb": inward(0.1)}
    generator = np.random.default_rng(0)
    chosen = [choose_by_chance(mug, hold, spins(0.0, np.pi), moves, generator) for _ in range(30)]
    assert {(found.finger, found.move) for found in chosen if found} == {("little", i) for i in range(3)}
    assert all(found is not None and found.information >= 0.0 for found in chosen)
    assert choose_by_chance(mug, hold, spins(0.0), {"ring": past}, generator) is None


def test_a_least_probability_of_0_counts_all_that_is_possible(mug: ObjectModel, can: ObjectModel) -> None:
    # As above, the knuckle meets the lug at the first pose.
    tips = inward(0.7)
    moves = {"little": GuardedMoves(tips.tip, TIP, tips.tip[:, :, None] + [0.02, -0.035, 0.0], np.array([0.01]))}
    hold, poses, every = Hold(Contacts(HELD), NAMES, 0.7), spins(0.0, np.pi), TouchCriterion(likely=0.0)
    for probability, may_touch in ((0.0, True), (1e-6, False)):
        candidates = [Candidate(can, spins(0.0), 1.0), Candidate(mug, poses, probability)]
        assert (choose_telling_touch(candidates, hold, moves, criterion=every) is not None) == may_touch


def test_impossible_criteria_are_refused() -> None:
    """An exact touch has a singular covariance, and one at grazing incidence whose error is infinite tells nothing."""
    for name, value in (("position", 0.0), ("position", np.nan), ("normal", 0.0), ("least_facing", 0.0)):
        with pytest.raises(InvalidInputError, match=rf"TouchNoise\.{name} must be a .*number"):
            TouchNoise(**{name: value})
    with pytest.raises(InvalidInputError, match=r"TouchNoise\.least_facing must be .*, not 1\.1"):
        TouchNoise(least_facing=1.1)
    assert TouchNoise(normal=None).normal is None
    with pytest.raises(InvalidInputError, match=r"TouchCriterion\.likely must be a finite number, not nan"):
        TouchCriterion(likely=np.nan)
