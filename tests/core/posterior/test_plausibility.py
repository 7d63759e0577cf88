"""What explains a touch, and what may be touched."""

import numpy as np
import pytest
from scipy.stats import binom

from tactopose_drake.core.evidence.contact_doubt import ContactKinds
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.evidence.force_balance import ForceBalance
from tactopose_drake.core.evidence.plane_contact import PlaneContact
from tactopose_drake.core.objectives.contact_mixture import Judgement
from tactopose_drake.core.plain_values import copied
from tactopose_drake.core.poses import compose, exp_so3
from tactopose_drake.core.posterior.plausibility import (
    degrees_of_freedom,
    explain_touch,
    explain_with_doubt,
    is_at_rest,
    is_comfortable,
    lies_on_planes,
    may_be_touched,
    most_false_contacts,
)
from tactopose_drake.core.posterior.posterior_params import PlausibilityParams
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.searches.pose_problem import make_problem
from tactopose_drake.core.sensing.patches import describe_patch
from tactopose_drake.core.synthetic.synthetic_patch import flat_pad
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface
from tests.core.balanced_forces import balanced_forces
from tests.core.tracking.boxes import make_box, touch

EXACT = 1e-12 * np.eye(6)


@pytest.mark.parametrize("seed", range(5))
def test_an_object_may_be_what_is_touched_where_it_is_however_sure_one_is(seed: int) -> None:
    generator, box = np.random.default_rng(seed), make_box()
    X_PO = np.column_stack([exp_so3(generator.normal(size=3)), generator.normal(size=3)])
    assert may_be_touched(box, X_PO, EXACT, touch(X_PO, generator))


def test_it_may_not_be_metres_away_unless_it_is_known_to_metres_only() -> None:
    box, X_PO = make_box(), np.eye(3, 4)
    contacts = touch(X_PO, np.random.default_rng(0))
    off = np.array([2.0, 0.0, 0.0])
    away = np.column_stack([X_PO[:, :3], off])
    assert not may_be_touched(box, away, EXACT, contacts)
    assert may_be_touched(box, away, np.diag(np.repeat([1e-12, 0.4**2], 3)), contacts)
    # A turn about its own origin moves nothing farther than it is large.
    turned = np.diag(np.repeat([1.0, 1e-12], 3))
    near = np.column_stack([X_PO[:, :3], [4.0 * box.size, 0.0, 0.0]])
    assert may_be_touched(box, near, turned, contacts) > may_be_touched(box, near, EXACT, contacts)
    one_near = Contacts(np.concatenate([contacts.p_PC, contacts.p_PC[:1] + off]))
    assert may_be_touched(box, away, EXACT, one_near), "one contact within reach is enough"


def test_a_pose_lies_on_a_plane_but_for_its_noise() -> None:
    box, contacts = make_box(), touch(np.eye(3, 4), np.random.default_rng(0))
    lowest = np.array([0.0, 0.0, box.vertices[:, 2].min()])
    X_PO = np.tile(np.eye(3, 4), (5, 1, 1))
    X_PO[:, 2, 3] = 0.001 * np.array([-3.4, -3.2, 0.0, 3.2, 3.4])  # Beyond 3.29 lies one in a thousand.
    table = PlaneContact(lowest, np.array([0.0, 0.0, 1.0]), 0.001)
    expected = [False, True, True, True, False]
    assert lies_on_planes(box, Evidence(contacts=contacts, planes=(table,)), X_PO).tolist() == expected
    assert lies_on_planes(box, Evidence(contacts=contacts), X_PO).all()


def test_noise_as_large_as_is_allowed_is_of_an_object_at_rest_as_often_as_told() -> None:
    """Points and forces err three times as much as is told of them."""
    box, generator, X_PO = copied(make_box(), mass=0.4), np.random.default_rng(6), np.eye(3, 4)
    params = PlausibilityParams(most_noise=3.0, least_contact_chance=0.1)
    balance = ForceBalance(np.array([0.0, 5.886, -7.848]), sigma_torque=1e-9)
    told = touch(X_PO, generator)
    f_PC = balanced_forces(generator.normal(size=(6, 3)), told.p_PC, box.center_of_mass, 0.4 * balance.gravity_P)
    at_rest = []
    for _ in range(1000):
        p_PC = told.p_PC + params.most_noise * 0.001 * generator.normal(size=(6, 3))
        noisy = f_PC + params.most_noise * 0.05 * generator.normal(size=(6, 3))
        contacts = Contacts(p_PC, told.n_PC, noisy, sigma_position=0.001, sigma_force=0.05)
        at_rest += is_at_rest(box, Evidence(contacts, balance=balance), X_PO[None], params).tolist()
    assert np.mean(at_rest) == pytest.approx(1.0 - params.least_contact_chance, abs=0.04)


def test_a_felt_pad_measures_its_active_cells_and_two_angles_a_silent_one_its_cells() -> None:
    pressures = {"felt": np.full(24, 1e4), "silent": np.zeros(24)}
    for pressure in pressures.values():
        pressure[:3] = 0.0
    felt, silent = (describe_patch(flat_pad(), pressure, alpha=1e-7) for pressure in pressures.values())
    assert felt.is_felt
    assert not silent.is_felt
    none, points = Contacts.empty(), Contacts(np.zeros((4, 3)))
    assert degrees_of_freedom(Evidence(none, patches=(felt,))) == 21 + 2
    assert degrees_of_freedom(Evidence(none, patches=(felt, silent))) == 21 + 2
    assert degrees_of_freedom(Evidence(points, patches=(felt,))) == 4 + 21 + 2
    assert degrees_of_freedom(Evidence(Contacts(np.zeros((4, 3)), np.eye(4, 3)[[0, 1, 2, 2]]))) == 12


def test_the_answer_moves_with_the_frame() -> None:
    box, generator = make_box(), np.random.default_rng(1)
    for distance in (0.1, 0.2, 0.25, 0.3, 0.4, 1.0):
        X_PO = np.column_stack([np.eye(3), [0.0, 0.0, 0.0]])
        contacts = touch(X_PO, generator)
        shifted = np.column_stack([np.eye(3), [distance, 0.0, 0.0]])
        move = np.column_stack([exp_so3(generator.normal(size=3)), generator.normal(size=3)])
        moved = Contacts(contacts.p_PC @ move[:, :3].T + move[:, 3])
        answers = [may_be_touched(box, X, EXACT, c) for X, c in ((shifted, contacts), (compose(move, shifted), moved))]
        assert answers[0] == answers[1]


def test_many_contacts_are_explained_up_to_the_middle_between_two_scales_of_the_noise() -> None:
    """The next scale has twice the variance; few contacts leave more than that by chance."""
    box, X_PO, generator = make_box(), np.eye(3, 4)[None], np.random.default_rng(0)
    for touches, expected in ((30, [True, True, False]), (1, [True, True, True])):
        contacts = touch(X_PO[0], generator)
        for _ in range(touches - 1):
            contacts = contacts.joined(touch(X_PO[0], generator))
        freedom, told = 3 * len(contacts), []
        for ratio in (1.2, 1.4, 1.45):
            cost, inlier = np.zeros(1), np.ones((1, len(contacts)))
            misfit, factors = np.array([0.5 * ratio * freedom]), np.ones((1, 1))
            judged = Judgement(cost, inlier, np.ones(1), misfit, factors, inlier < 0.5)
            told.append(bool(explain_with_doubt(box, Evidence(contacts), judged, X_PO)[0]))
        assert told == expected


@pytest.mark.parametrize("count", [5, 10])
def test_one_impossible_normal_is_not_explained(count: int) -> None:
    """However exactly the other contacts lie on the surface, and all the points."""
    box, X_PO, generator = make_box(), np.eye(3, 4), np.random.default_rng(2)
    felt = touch_surface(box, X_PO, count, generator, sigma_position=0.0, sigma_normal=0.0)
    assert felt.n_PC is not None
    told = Contacts(felt.p_PC, felt.n_PC)
    turned = np.copy(felt.n_PC)
    turned[0] *= -1.0
    assert explain_touch(box, Evidence(told), X_PO[None]).all()
    assert not explain_touch(box, Evidence(Contacts(felt.p_PC, turned)), X_PO[None]).any()


def test_noise_as_told_is_explained_at_edges_too() -> None:
    """As often as it should be: the true pose is not fitted to the noise."""
    box, X_PO, generator = make_box(), np.eye(3, 4), np.random.default_rng(3)
    touches = [touch_surface(box, X_PO, 5, generator) for _ in range(500)]
    explained = [bool(explain_touch(box, Evidence(contacts), X_PO[None])[0]) for contacts in touches]
    assert np.count_nonzero(explained) >= 495


def test_a_contact_beside_the_object_is_not_explained() -> None:
    box, X_PO, generator = make_box(), np.eye(3, 4), np.random.default_rng(4)
    felt = touch_surface(box, X_PO, 5, generator)
    away = np.copy(felt.p_PC)
    away[0] += 0.05 * away[0] / np.linalg.norm(away[0])
    assert not explain_touch(box, Evidence(Contacts(away, felt.n_PC)), X_PO[None]).any()


@pytest.mark.parametrize("share", [0.0, 0.02, 0.3])
@pytest.mark.parametrize("count", [1, 3, 4, 5, 20, 400, 5000])
def test_as_many_contacts_may_be_false_as_the_binomial_distribution_says_and_three_stay(
    count: int, share: float
) -> None:
    allowed = min(int(binom.ppf(0.8, count, share)), max(count - 3, 0))
    assert most_false_contacts(count, share, 0.8) == allowed


@pytest.mark.parametrize(("count", "allowed"), [(3, 0), (4, 1), (5, 1), (6, 2), (10, 2), (20, 4)])
def test_by_default_one_contact_of_five_may_be_false_and_two_of_ten(count: int, allowed: int) -> None:
    share = ContactKinds().shares(Evidence(Contacts(np.zeros((1, 3)))).outlier_probability).false
    assert most_false_contacts(count, share, PlausibilityParams().usual_false_contacts) == allowed


@pytest.mark.parametrize("count", [5, 10, 20])
def test_noise_calls_for_doubt_seldom_however_many_contacts_there_are_and_a_false_contact_often(count: int) -> None:
    """At the pose next to the true one that suits the contacts best.

    The exact density has a floor, so one false contact costs no more however far it is off.
    """
    box, X_PO, generator = make_box(), np.eye(3, 4), np.random.default_rng(5)
    calls = np.zeros(2)
    for _ in range(100):
        felt = touch_surface(box, X_PO, count, generator)
        away = np.copy(felt.p_PC)
        away[0] += 0.03 * away[0] / np.linalg.norm(away[0])
        for i, p_PC in enumerate((felt.p_PC, away)):
            evidence = Evidence(Contacts(p_PC, felt.n_PC))
            problem = make_problem(box, evidence)
            best = LevenbergMarquardt().refine(problem.touch, X_PO[None]).X_PO
            calls[i] += not is_comfortable(box, evidence, problem, best)
    assert calls[0] <= 20
    assert calls[1] >= 95
