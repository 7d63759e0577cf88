import numpy as np
import pytest
import trimesh

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.hand_geometry import HandGeometry
from tactopose_drake.core.exploration.guarded_moves import GuardedMoves
from tactopose_drake.core.exploration.next_touch import (
    Hold,
    SafetyParams,
    TouchNoise,
    choose_touch,
    information,
    is_allowed,
    predict,
)
from tactopose_drake.core.poses import exp_so3, make_poses
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture
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


def spins(*angles: float, probability: list[float] | None = None) -> GaussianMixture:
    X = make_poses(exp_so3(np.array([[0.0, 0.0, angle] for angle in angles])), np.zeros((len(angles), 3)))
    share = np.ones(len(angles)) if probability is None else np.array(probability)
    return GaussianMixture(X, share / share.sum(), np.tile(COVARIANCE, (len(angles), 1, 1)))


def inward(*angles: float, height: float = 0.0) -> GuardedMoves:
    """Straight motions to the axis from these directions."""
    away = np.array([[np.cos(angle), np.sin(angle), 0.0] for angle in angles])
    return GuardedMoves.lines(0.1 * away + [0, 0, height], -away, 0.12, radius=TIP)


def simulated_information(
    model: ObjectModel, belief: GaussianMixture, moves: GuardedMoves, noise: TouchNoise, draws: int
) -> np.ndarray:
    """Mutual information of mode and touch by Monte Carlo of the predicted Gaussians, for motions that always hit."""
    generator = np.random.default_rng(0)
    _, mean, covariance = predict(model, belief, moves, noise)
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
    bound = information(mug, belief, moves, noise)
    sampled = simulated_information(mug, belief, moves, noise, draws=1500)
    assert np.all(bound <= sampled + 0.03)
    assert np.corrcoef(bound, sampled)[0, 1] > 0.95
    assert bound[:4].max() > 0.5 * sampled.max() > 0.2


def test_more_noise_tells_less_and_a_normal_tells_more(mug: ObjectModel) -> None:
    belief, moves = spins(0.0, 0.3), inward(0.0, 0.15, 0.3)
    plain = information(mug, belief, moves, TouchNoise(position=0.004, normal=None))
    with_normal = information(mug, belief, moves, TouchNoise(position=0.004))
    blunt = information(mug, belief, moves, TouchNoise(position=0.02, normal=None))
    assert np.all(with_normal >= plain - 1e-9)
    assert with_normal.max() > plain.max() + 0.02
    assert blunt.max() < 0.9 * plain.max()


def test_equal_modes_and_a_single_one_leave_nothing_to_tell(mug: ObjectModel) -> None:
    np.testing.assert_allclose(information(mug, spins(0.3), inward(0.0, 1.0)), 0.0, atol=1e-12)
    np.testing.assert_allclose(information(mug, spins(0.3, 0.3), inward(0.0, 1.0)), 0.0, atol=1e-9)


def test_predictions_have_the_spread_of_the_mode_and_the_sensor(mug: ObjectModel) -> None:
    noise = TouchNoise()
    hit, mean, covariance = predict(mug, spins(0.0), inward(np.pi), noise)
    assert hit[0, 0] == 1.0
    # Far from edges the way's variance is the pose's along the motion and the sensor's.
    assert mean[0, 0, 0] == pytest.approx(0.1 - 0.03 - TIP, abs=5e-4)
    assert np.sqrt(covariance[0, 0, 0, 0]) == pytest.approx(np.hypot(0.0008, noise.position), rel=0.1)
    np.testing.assert_allclose(mean[0, 0, 1:], [-1, 0, 0], atol=0.03)


HELD = np.array([[0.0, 0.03, 0.0], [0.0, -0.03, 0.02], [0.0, -0.03, -0.02], [-0.03, 0.0, 0.03]])
NAMES = ("thumb", "first", "middle", "ring")


def test_the_best_allowed_motion_is_chosen(mug: ObjectModel) -> None:
    belief = spins(0.0, np.pi)
    moves = {"little": inward(1.2, 1.9), "ring": inward(np.pi, 2.0)}
    found = choose_touch(mug, Hold(Contacts(HELD), NAMES, 0.7), belief, moves)
    assert found is not None
    assert (found.finger, found.move) == ("ring", 0)
    assert found.information == found.value["ring"].max()
    assert found.expected_entropy == pytest.approx(np.log(2) - found.information)
    assert found.allowed["little"].all()


def test_a_belief_without_a_mode_is_refused(mug: ObjectModel) -> None:
    nothing, contacts = GaussianMixture.empty(), Contacts(HELD)
    with pytest.raises(InvalidInputError, match="belief: has no mode"):
        choose_touch(mug, Hold(contacts, NAMES, 0.7), nothing, {"ring": inward(np.pi)})
    with pytest.raises(InvalidInputError, match="belief: has no mode"):
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
    unlikely = spins(0.0, np.pi, probability=[0.01, 0.99])
    assert is_allowed(mug, Hold(contacts, NAMES, 0.7), unlikely, "little", moves).all()
    safer = SafetyParams(likely=0.005)
    assert not is_allowed(mug, Hold(contacts, NAMES, 0.7), unlikely, "little", moves, safety=safer).any()
    assert choose_touch(mug, Hold(contacts, NAMES, 0.7), unlikely, {"little": moves}) is not None
    assert choose_touch(mug, Hold(contacts, NAMES, 0.7), unlikely, {"little": moves}, safety=safer) is None


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


def test_each_contact_has_a_name(mug: ObjectModel) -> None:
    with pytest.raises(InvalidInputError, match="fingers: are 2 names; allowed are as many as contacts, 4"):
        choose_touch(mug, Hold(Contacts(HELD), NAMES[:2], 0.7), spins(0.0), {})
