import math

import numpy as np
import pytest
import trimesh

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.identification.model_evidence import log_evidence
from tactopose_drake.core.identification.unknown_object import (
    UnknownObjectParams,
    log_evidence_of_any,
    unknown_probability,
)
from tactopose_drake.core.poses import transform_points
from tactopose_drake.core.shape.object_model import ObjectModel
from tests.core.meshes import ball, random_pose

SIGMA, TILT = 0.001, math.radians(5.0)
LOG_ROTATIONS = math.log(8.0 * math.pi**2)


def some_touch(count: int = 5, seed: int = 0) -> Contacts:
    generator = np.random.default_rng(seed)
    normals = generator.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Contacts(0.03 * generator.normal(size=(count, 3)), normals, sigma_position=SIGMA, sigma_normal=TILT)


def density(p_PC: np.ndarray, n_PC: np.ndarray | None = None) -> float:
    """Of places and normals, without the constants of the noise."""
    count = len(p_PC)
    noise = count * math.log(math.sqrt(2.0 * math.pi) * SIGMA)
    if n_PC is not None:
        noise += count * math.log(0.5 * TILT**2)
    contacts = Contacts(p_PC, n_PC, sigma_position=SIGMA, sigma_normal=TILT)
    return math.exp(log_evidence_of_any(contacts) - noise)


def test_of_one_contact_it_is_that_of_any_object() -> None:
    contacts = Contacts([[0.1, 0.0, 0.2]], [[0.0, 0.0, 1.0]], sigma_position=SIGMA, sigma_normal=TILT)
    sphere = ObjectModel.from_mesh(ball(0.04, 4), spacing=0.002, cache=False)
    # A ball's poses that explain one contact: within sigma of its radius, whatever direction the normal is turned to.
    shell = 4.0 * math.pi * 0.04**2 * math.sqrt(2.0 * math.pi) * SIGMA
    log_mass = math.log(8.0 * math.pi**2 * shell * 0.5 * TILT**2)
    expected = log_evidence(sphere, Evidence(contacts), log_mass) - LOG_ROTATIONS
    assert log_evidence_of_any(contacts) == pytest.approx(expected, abs=0.01)


def test_the_places_of_a_second_contact_have_a_density() -> None:
    radius = np.linspace(0.0, 0.8, 401)[1:]
    values = [density(np.array([[0.0, 0.0, 0.0], [r, 0.0, 0.0]])) for r in radius]
    total = float(np.sum(4.0 * np.pi * radius**2 * values) * (radius[1] - radius[0]))
    assert total == pytest.approx(1.0, abs=0.01)


def test_the_normals_have_a_density_and_point_outwards() -> None:
    p_PC = np.array([[-0.03, 0.0, 0.0], [0.03, 0.0, 0.0]])
    # McLaren's rule of 32 points, exact up to ninth powers: corners of an icosahedron, and middles of its faces.
    icosahedron = trimesh.creation.icosahedron()
    corners = icosahedron.vertices / np.linalg.norm(icosahedron.vertices, axis=1, keepdims=True)
    directions, weights = np.concatenate([corners, icosahedron.face_normals]), np.repeat([25.0, 27.0], [12, 20]) / 840.0
    values = np.array([[density(p_PC, np.array([a, b])) for a in directions] for b in directions])
    assert weights @ values @ weights == pytest.approx(density(p_PC), rel=0.01)
    outward, inward = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    assert density(p_PC, outward) > 1.5 * density(p_PC, inward)


def test_the_hand_and_the_order_of_the_contacts_change_nothing() -> None:
    contacts = some_touch()
    assert contacts.n_PC is not None
    X = random_pose(np.random.default_rng(1))[:3]
    order = [3, 0, 4, 1, 2]
    moved = Contacts(
        transform_points(X, contacts.p_PC)[order],
        (contacts.n_PC @ X[:, :3].T)[order],
        sigma_position=SIGMA,
        sigma_normal=TILT,
    )
    assert log_evidence_of_any(moved) == pytest.approx(log_evidence_of_any(contacts), abs=1e-9)


def test_a_touch_that_is_far_apart_is_as_likely_by_its_size() -> None:
    # Twice as large, four more places to be in each direction: (1/2)^(3 (k - 1)), as far as all sizes are as likely.
    contacts = some_touch()
    larger = Contacts(1.4 * contacts.p_PC, contacts.n_PC, sigma_position=SIGMA, sigma_normal=TILT)
    expected = -3.0 * (len(contacts) - 1) * math.log(1.4)
    assert log_evidence_of_any(larger) - log_evidence_of_any(contacts) == pytest.approx(expected, abs=0.5)


def test_places_along_a_line_are_likelier_than_if_objects_were_as_long_as_wide() -> None:
    generator = np.random.default_rng(3)
    p_PC = generator.normal(size=(5, 3)) * [0.005, 0.005, 0.06]
    normals = p_PC * [1.0, 1.0, 0.0]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    contacts = Contacts(p_PC, normals, sigma_position=SIGMA, sigma_normal=TILT)
    as_wide = UnknownObjectParams(aspects=((1.0, 1.0),))
    assert log_evidence_of_any(contacts) > log_evidence_of_any(contacts, as_wide) + 2.0
    # Where they lie about a middle they are hardly less likely for that.
    assert log_evidence_of_any(some_touch()) > log_evidence_of_any(some_touch(), as_wide) - 1.0


@pytest.mark.parametrize("objects", [1, 2, 20])
def test_the_odds_are_in_proportion_to_those_of_the_prior(objects: int) -> None:
    touch, evidence = some_touch(), [-10.0, -16.0, -19.0][: min(objects, 3)]
    odds = []
    for prior in (0.1, 0.5):
        probability = unknown_probability(evidence, objects, touch, prior)
        assert 0.0 < probability < 1.0
        odds.append(probability / (1.0 - probability))
    assert odds[1] / odds[0] == pytest.approx(9.0)
    assert unknown_probability(evidence, objects, touch, 0.0) == 0.0


def test_what_the_best_explains_makes_it_known_and_what_the_others_do_unknown() -> None:
    touch = some_touch()
    by_best = [unknown_probability([best, -22.0, -25.0], 20, touch, 0.3) for best in (-20.0, -15.0, -10.0, -5.0)]
    assert np.all(np.diff(by_best) < 0.0)
    by_others = [unknown_probability([-10.0, other, -30.0], 20, touch, 0.3) for other in (-30.0, -20.0, -12.0)]
    assert np.all(np.diff(by_others) > 0.0)
    # One that explains the touch says less of what might be held where a thousand do not.
    assert unknown_probability([-10.0, -12.0], 1000, touch, 0.3) < unknown_probability([-10.0, -12.0], 20, touch, 0.3)


def test_an_object_that_is_like_the_best_is_never_ruled_out() -> None:
    params = UnknownObjectParams()
    least = unknown_probability([1000.0, -20.0], 2, some_touch(), 0.5, params)
    assert least == pytest.approx(params.lookalikes / (1.0 + params.lookalikes))
    assert unknown_probability([-1000.0, -2000.0], 2, some_touch(), 0.5) == 1.0


@pytest.mark.parametrize(
    ("count", "has_normals", "beyond_one", "beyond_pose"),
    [(1, True, 0, 0), (2, True, 3, 0), (4, True, 9, 6), (7, False, 6, 1), (8, True, 21, 18)],
)
def test_each_number_beyond_those_of_one_contact_or_of_a_pose_must_tell_by_a_margin(
    count: int, has_normals: bool, beyond_one: int, beyond_pose: int
) -> None:
    params = UnknownObjectParams(trust=0.0, lookalikes=1e-9)
    told = some_touch(count)
    touch = told if has_normals else Contacts(told.p_PC, sigma_position=SIGMA)
    margin = max(params.least_surplus * beyond_one, params.surplus_beyond_pose * beyond_pose)
    assert unknown_probability([0.0], 1, touch, 0.5, params) == pytest.approx(1.0 / (1.0 + math.exp(-margin)))


def test_precise_normals_must_tell_by_more() -> None:
    params = UnknownObjectParams(trust=0.0, lookalikes=1e-9)

    def margin(sigma_normal: float) -> float:
        told = some_touch(3)
        touch = Contacts(told.p_PC, told.n_PC, sigma_position=SIGMA, sigma_normal=sigma_normal)
        unknown = unknown_probability([0.0], 1, touch, 0.5, params)
        return math.log(unknown / (1.0 - unknown))

    # Two numbers of each of the two normals beyond the first.
    assert margin(0.5 * TILT) - margin(TILT) == pytest.approx(4.0 * params.surplus_of_noise * math.log(2.0))
    points = Contacts(some_touch(3).p_PC, sigma_position=SIGMA)
    unknown = unknown_probability([0.0], 1, points, 0.5, params)
    assert margin(3.0) == pytest.approx(math.log(unknown / (1.0 - unknown)))


def test_normals_that_are_any_count_as_none() -> None:
    bare = Contacts(some_touch(7).p_PC, sigma_position=SIGMA)
    for normal in ([0.0, 0.0, 1.0], [1.0, 0.0, 0.0]):
        anyhow = Contacts(bare.p_PC, [normal] * 7, sigma_position=SIGMA, sigma_normal=1e3)
        assert log_evidence_of_any(anyhow) == pytest.approx(log_evidence_of_any(bare), abs=1e-9)
        assert unknown_probability([-40.0], 1, anyhow, 0.3) == pytest.approx(unknown_probability([-40.0], 1, bare, 0.3))
    # Beside others that say something, too, as contacts without normals beside a patch are.
    told, sigmas = some_touch(), np.array([1e3, 1e3, TILT, TILT, TILT])
    assert told.n_PC is not None
    found = []
    for normal in ([0.0, 0.0, 1.0], [1.0, 0.0, 0.0]):
        n_PC = np.concatenate([[normal] * 2, told.n_PC[2:]])
        mixed = Contacts(told.p_PC, n_PC, sigma_position=SIGMA, sigma_normal=sigmas)
        found.append((log_evidence_of_any(mixed), unknown_probability([-20.0], 1, mixed, 0.3)))
    np.testing.assert_allclose(found[0], found[1], atol=1e-9)


@pytest.mark.parametrize("objects", [2, 5])
def test_the_others_stand_for_what_might_be_held_by_their_mean(objects: int) -> None:
    """All but the best; of those that are ruled out, and left away, the evidence is nothing."""
    params = UnknownObjectParams(trust=1.0, least_surplus=0.0, surplus_beyond_pose=0.0, lookalikes=1e-12)
    touch = Contacts(0.03 * np.eye(3), np.eye(3))
    best, other = LOG_ROTATIONS + log_evidence_of_any(touch) + np.array([0.7, -1.3])
    share = params.library_share * (1.0 - 1.0 / objects)
    guess = (1.0 - share) * log_evidence_of_any(touch) + share * (other - LOG_ROTATIONS - np.log(objects - 1))
    found = unknown_probability([best, other], objects, touch, 0.5, params)
    assert np.log(found / (1.0 - found)) == pytest.approx(guess - (best - LOG_ROTATIONS), abs=1e-6)
