import dataclasses
import math

import numpy as np
import pytest
import trimesh

from tactopose_drake.core.evidence.contact_doubt import ContactDoubt, ContactKinds
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.objectives.contact_mixture import ContactMixture
from tactopose_drake.core.objectives.pose_prior import PriorObjective
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.poses import exp_so3, make_poses, random_rotations, retract
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface

FLIPPED, LOST = 3.0, 4.0
MOST_NOISE = 0.0006, math.radians(4.0)
DOUBT = ContactDoubt(kinds=ContactKinds(flipped=FLIPPED, lost=LOST), most_noise=MOST_NOISE)
OF_ONE = ContactKinds(flipped=2.0, turned=5.0, displaced=30.0, lost=200.0)
SCEPTIC = dataclasses.replace(DOUBT, of_one=OF_ONE)


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    return ObjectModel.from_mesh(trimesh.creation.box((0.06, 0.09, 0.13)))


def pose(seed: int) -> np.ndarray:
    generator = np.random.default_rng(seed)
    return make_poses(random_rotations(generator, 1), 0.05 * generator.normal(size=(1, 3)))


def touch(model: ObjectModel, X_PO: np.ndarray, seed: int, noise: float = 1.0, count: int = 6) -> Contacts:
    told = {"sigma_position": 0.0009, "sigma_normal": math.radians(5.0)}
    sigmas = {name: noise * sigma for name, sigma in told.items()}
    felt = touch_surface(model, X_PO[0], count, np.random.default_rng(seed), spread=True, **sigmas)
    return Contacts(felt.p_PC, felt.n_PC, **told)


def odds(share: float, has_normals: bool) -> tuple[float, float, float, float, float]:
    """Of contacts with a flipped normal, any, displaced, of something else and lost, over those as told."""
    w = share / (1.0 - share)  # Of something else, over contacts of the object: 1 : 3 w : w : 6 w : 4 w are what.
    told = 1.0 if has_normals else 1.0 + (FLIPPED + 1.0) * w
    other = w * (1.0 + (FLIPPED + 7.0 + LOST) * w) / told
    return FLIPPED * w * has_normals, w * has_normals, 6.0 * w / told, other, LOST * w / told


def densities(
    model: ObjectModel, contacts: Contacts, X_PO: np.ndarray, share: float, doubled: int, doubled_n: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of contacts (k,) as told, of each as it may be by itself, and of each as the one false of all, written out."""
    rows = SurfaceContact(model.grid, contacts).residuals(X_PO).reshape(len(contacts), -1)
    d, has_normals = 0.5 * rows[:, 0] ** 2, contacts.n_PC is not None
    n = m = np.zeros(len(contacts))
    if contacts.n_PC is not None:
        opposite = dataclasses.replace(contacts, n_PC=-contacts.n_PC)
        rows_m = SurfaceContact(model.grid, opposite).residuals(X_PO).reshape(len(contacts), -1)
        n, m = 0.5 * np.sum(rows[:, 1:] ** 2, axis=1), 0.5 * np.sum(rows_m[:, 1:] ** 2, axis=1)
    sigma_p, sigma_n = np.asarray(contacts.sigma_position), np.asarray(contacts.sigma_normal)
    volume = np.prod(model.grid.upper - model.grid.origin + 2.0 * DOUBT.surroundings)
    any_point = model.area * math.sqrt(2.0 * math.pi) * sigma_p / volume
    any_normal = 0.5 * sigma_n**2 if has_normals else np.ones(len(contacts))
    lost_point = any_point * MOST_NOISE[0] / sigma_p
    lost_normal = 0.5 * MOST_NOISE[1] ** 2 if has_normals else 1.0
    ratio = sigma_p / DOUBT.displacement
    point = np.exp(-d / 2.0**doubled) / math.sqrt(2.0**doubled)
    turn = np.exp(-n / 2.0**doubled_n) / 2.0**doubled_n if has_normals else np.ones(len(contacts))
    displaced = ratio * np.exp(-(ratio**2) * d) * turn
    back = np.exp(-m / 2.0**doubled_n) / 2.0**doubled_n
    flipped, turned, moved, other, lost = odds(share, has_normals)
    nothing = other * any_point * any_normal + lost * lost_point * lost_normal
    own = point * (turn + flipped * back + turned * any_normal) + moved * displaced + nothing
    w = share / (1.0 - share)
    told = 1.0 if has_normals else 1.0 + (OF_ONE.flipped + OF_ONE.turned) * w
    as_the_one = OF_ONE.displaced * displaced + OF_ONE.lost * lost_point * lost_normal
    if has_normals:
        as_the_one = as_the_one + point * (OF_ONE.flipped * back + OF_ONE.turned * any_normal)
    return point * turn, own, w / told * as_the_one


def formula(model: ObjectModel, contacts: Contacts, X_PO: np.ndarray, share: float, doubt: ContactDoubt) -> float:
    """The negative logarithm of the mixture, written out, at one pose."""
    total = 0.0
    for doubled, doubled_n, probability in doubt.doublings:
        _, own, one = densities(model, contacts, X_PO, share, doubled, doubled_n)
        which = [np.prod(np.where(np.arange(len(own)) == i, one, own)) for i in range(len(own))]
        total += probability * float(np.prod(own) + (sum(which) if doubt.of_one else 0.0))
    return -math.log(total / doubt.doublings[0][2])


@pytest.mark.parametrize("doubt", [DOUBT, SCEPTIC])
@pytest.mark.parametrize("with_normals", [True, False])
@pytest.mark.parametrize("share", [0.02, 0.2])
def test_the_cost_is_the_mixture_written_out(
    blob: ObjectModel, with_normals: bool, share: float, doubt: ContactDoubt
) -> None:
    X_PO = pose(0)
    contacts = touch(blob, X_PO, 0, noise=1.5)
    contacts = Contacts(contacts.p_PC, contacts.n_PC * np.array([-1.0, 1, 1, -1, 1, 1])[:, None])
    if not with_normals:
        contacts = Contacts(contacts.p_PC, sigma_position=0.0009)
    mixture = ContactMixture(blob, contacts, share, doubt)
    for step in np.random.default_rng(1).normal(size=(5, 6)) * np.repeat([0.05, 0.003], 3):
        X = retract(X_PO, step)
        assert mixture.cost(X)[0] == pytest.approx(formula(blob, contacts, X, share, doubt), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("with_normals", [True, False])
def test_off_edges_and_corners_the_exact_cost_is_that_of_the_exact_surface(
    box: ObjectModel, with_normals: bool
) -> None:
    X_PO = pose(5)
    p_OC = np.array([[0.0306, 0.0, 0.0656], [0.0306, 0.0456, 0.0], [0.0306, 0.0456, 0.0656]])
    n_PC = np.tile(X_PO[0, :, 0], (3, 1)) if with_normals else None
    contacts = Contacts(p_OC @ X_PO[0, :, :3].T + X_PO[0, :, 3], n_PC, sigma_position=0.0009)
    mixture = ContactMixture(box, contacts, 1e-12, dataclasses.replace(DOUBT, doublings=((0, 0, 1.0),)))
    density = mixture.density.densities(X_PO)
    assert density.min() > math.exp(-DOUBT.reached)
    assert mixture.exact_cost(X_PO)[0] == pytest.approx(-np.log(density).sum(), abs=1e-6)


def test_a_contact_is_as_told_by_itself_or_beside_the_one_that_is_not(box: ObjectModel) -> None:
    X_PO = pose(1)
    contacts = touch(box, X_PO, 1, noise=1.5)
    away = contacts.p_PC.copy()
    away[4] += 0.008 * contacts.n_PC[4]
    contacts = Contacts(away, contacts.n_PC)
    doubt = dataclasses.replace(SCEPTIC, doublings=((0, 0, 1.0),), reached=-math.inf)  # The field's energies count.
    judged = ContactMixture(box, contacts, 0.02, doubt)._judge(X_PO, np.zeros((1, 6)), -math.inf, whole=True)
    told, own, one = densities(box, contacts, X_PO, 0.02, 0, 0)
    for i in range(6):
        others, others_one = np.delete(own, i), np.delete(one, i)
        beside = np.prod(others) * (1.0 + np.sum(others_one / others))
        total = own[i] * beside + one[i] * np.prod(others)
        assert judged.inlier_probability[0, i] == pytest.approx(told[i] * beside / total, rel=1e-6, abs=1e-12)


@pytest.mark.parametrize("doubt", [DOUBT, SCEPTIC])
def test_a_contact_is_false_that_is_less_than_half_as_sure_as_an_exact_one(
    box: ObjectModel, doubt: ContactDoubt
) -> None:
    X_PO = pose(2)
    exact = touch(box, X_PO, 2, noise=0.0)
    doubt = dataclasses.replace(doubt, doublings=((0, 0, 1.0),), kinds=ContactKinds(displaced=30.0))
    sure = ContactMixture(box, exact, 0.2, doubt).judge(X_PO).inlier_probability[0, 3]
    assert sure < 0.99
    shares = []
    for way in np.linspace(0.0, 0.006, 61):
        points = exact.p_PC.copy()
        points[3] += way * exact.n_PC[3]
        judged = ContactMixture(box, Contacts(points, exact.n_PC), 0.2, doubt).judge(X_PO)
        shares.append(judged.inlier_probability[0, 3] / sure)
        assert judged.is_false[0, 3] == (shares[-1] < 0.5) or abs(shares[-1] - 0.5) < 0.03
        assert not judged.is_false[0, :3].any()
    assert np.count_nonzero((np.array(shares) > 0.55) & (np.array(shares) < 0.9)) >= 3
    assert min(shares) < 0.1


def test_two_false_contacts_are_less_likely_than_one_by_the_doubt_of_one(box: ObjectModel) -> None:
    X_PO = pose(4)
    contacts = touch(box, X_PO, 4)
    costs = []
    for false in (0, 1, 2):
        away = contacts.p_PC.copy()
        away[:false] += 0.03 * contacts.n_PC[:false]
        costs.append(ContactMixture(box, Contacts(away, contacts.n_PC), 0.02, SCEPTIC).judge(X_PO).cost[0])
    # The first costs what the sceptic takes it for, the second what it costs anybody.
    assert costs[1] - costs[0] < costs[2] - costs[1] - 0.5


@pytest.mark.parametrize("doubt", [DOUBT, SCEPTIC])
@pytest.mark.parametrize("signs", [(1.0, 1, 1, 1, 1, 1), (1.0, -1, 1, 1, 1, -1)])
def test_the_gradient_is_the_central_difference(
    blob: ObjectModel, signs: tuple[float, ...], doubt: ContactDoubt
) -> None:
    X_PO = pose(2)
    felt = touch(blob, X_PO, 2, noise=2.0)
    mixture = ContactMixture(blob, Contacts(felt.p_PC, felt.n_PC * np.array(signs)[:, None]), 0.02, doubt)
    X = retract(X_PO, np.array([0.02, -0.03, 0.01, 0.002, -0.001, 0.003]))
    gradient = mixture.normal_equations(X).gradient[0]
    for k, step in enumerate(1e-8 * np.eye(6)):
        difference = (mixture.cost(retract(X, step)) - mixture.cost(retract(X, -step)))[0] / 2e-8
        assert gradient[k] == pytest.approx(difference, rel=1e-3, abs=1e-3 * np.abs(gradient).max())


def test_a_contact_far_off_is_given_up_and_the_others_count_as_before(box: ObjectModel) -> None:
    X_PO = pose(3)
    contacts = touch(box, X_PO, 3)
    away = contacts.p_PC.copy()
    away[2] += 0.03 * contacts.n_PC[2]
    judged = ContactMixture(box, Contacts(away, contacts.n_PC), 0.02).judge(X_PO)
    assert judged.inlier_probability[0, 2] < 0.01
    assert np.all(np.delete(judged.inlier_probability[0], 2) > 0.9)
    # It costs what false contacts cost, and not what its 33 standard deviations would.
    as_told = ContactMixture(box, contacts, 0.02).judge(X_PO)
    assert judged.cost[0] - as_told.cost[0] < 12.0
    assert ContactMixture(box, contacts, 0.02).exact_cost(X_PO)[0] == as_told.cost[0]
    assert SurfaceContact(box.grid, Contacts(away, contacts.n_PC)).cost(X_PO)[0] > 400.0


def test_a_flipped_normal_is_given_up_and_its_point_counts(box: ObjectModel) -> None:
    X_PO = pose(4)
    contacts = touch(box, X_PO, 4)
    turned = contacts.n_PC.copy()
    turned[1] *= -1.0
    mixture = ContactMixture(box, Contacts(contacts.p_PC, turned), 0.02)
    assert mixture.judge(X_PO).inlier_probability[0, 1] < 0.01
    # Without the point of that contact, the curvature across its face would be another.
    hessian = mixture.normal_equations(X_PO).hessian[0, 3:, 3:]
    across = contacts.n_PC[1] @ hessian @ contacts.n_PC[1]
    kept = Contacts(np.delete(contacts.p_PC, 1, axis=0), np.delete(contacts.n_PC, 1, axis=0))
    without = ContactMixture(box, kept, 0.02).normal_equations(X_PO).hessian[0, 3:, 3:]
    assert across - contacts.n_PC[1] @ without @ contacts.n_PC[1] > 0.3 / 0.0009**2


def test_a_normal_that_may_be_flipped_tells_as_much_when_it_is(box: ObjectModel) -> None:
    doubt = dataclasses.replace(DOUBT, doublings=((0, 0, 1.0),))
    X_PO, contacts = pose(4), touch(box, pose(4), 4)
    signs = np.array([1.0, -1, 1, 1, 1, 1])[:, None]
    told, flipped = (
        ContactMixture(box, Contacts(contacts.p_PC, n_PC), 1e-4, doubt)
        for n_PC in (contacts.n_PC, signs * contacts.n_PC)
    )
    judged = flipped.judge(X_PO)
    assert judged.inlier_probability[0, 1] < 0.01
    assert judged.is_false[0].tolist() == [False, True, False, False, False, False]
    # It costs no more than that it is rare, where one with any normal would cost what that normal tells, too.
    assert judged.cost[0] - told.judge(X_PO).cost[0] == pytest.approx(-math.log(FLIPPED * 1e-4), abs=0.5)
    hessian = flipped.normal_equations(X_PO).hessian
    np.testing.assert_allclose(hessian, told.normal_equations(X_PO).hessian, rtol=0.01, atol=1e-3 * hessian.max())
    left = flipped.alternatives(X_PO, hessian)
    np.testing.assert_allclose(
        left, told.alternatives(X_PO, told.normal_equations(X_PO).hessian), rtol=0.02, atol=2e-3 * hessian.max()
    )


def test_the_noise_scale_is_found(box: ObjectModel) -> None:
    X_PO = pose(5)
    scales = {
        noise: [
            float(ContactMixture(box, touch(box, X_PO, seed, noise, 12), 0.0).judge(X_PO).noise_scale[0])
            for seed in range(20)
        ]
        for noise in (1.0, 2.0)
    }
    assert np.median(scales[1.0]) < 1.2
    assert 1.6 < np.median(scales[2.0]) < 2.4


def test_nothing_is_false_where_nothing_may_be(box: ObjectModel) -> None:
    X_PO = pose(6)
    contacts = touch(box, X_PO, 6)
    away = contacts.p_PC.copy()
    away[0] += 0.01 * contacts.n_PC[0]
    judged = ContactMixture(box, Contacts(away, contacts.n_PC), 0.0).judge(X_PO)
    np.testing.assert_allclose(judged.inlier_probability, 1.0, rtol=1e-5)
    far = ContactMixture(box, contacts, 0.0).judge(retract(X_PO, np.array([0.0, 0, 0, 0.5, 0.5, 0.5])))
    assert np.isfinite(far.cost).all()


def test_what_is_left_without_a_contact_is_less_and_never_negative(box: ObjectModel) -> None:
    X_PO = np.concatenate([pose(7), retract(pose(7), np.array([0.1, 0.0, -0.1, 0.004, 0.0, 0.002]))])
    mixture = ContactMixture(box, touch(box, pose(7), 7, noise=2.0), 0.02)
    hessian = mixture.normal_equations(X_PO).hessian
    left = mixture.alternatives(X_PO, hessian)
    assert left.shape == (2, 12, 6, 6)
    scale = np.outer(*[np.repeat([0.05, 1.0], 3)] * 2) * 1e-6
    for information, whole in zip(left, hessian, strict=True):
        assert np.linalg.eigvalsh(information / scale).min() > -1e-6 * np.linalg.eigvalsh(whole / scale).max()
        assert np.linalg.eigvalsh((whole - information) / scale).min() > -1e-6 * np.linalg.eigvalsh(whole / scale).max()
        assert np.all(np.trace((whole - information) / scale, axis1=1, axis2=2) > 0.0)


@pytest.mark.parametrize(("kind", "changed"), [(0, {"sigma_position": 0.015}), (1, {"sigma_normal": 1e6})])
def test_a_false_contact_is_one_that_hardly_tells(box: ObjectModel, kind: int, changed: dict[str, float]) -> None:
    as_told = ContactDoubt(doublings=((0, 0, 1.0),))
    X_PO, contacts, k = pose(7), touch(box, pose(7), 7), 6
    hessian = ContactMixture(box, contacts, 1e-7, as_told).normal_equations(X_PO).hessian
    left = ContactMixture(box, contacts, 1e-7, as_told).alternatives(X_PO, hessian)
    for i in range(k):
        told = {name: np.full(k, getattr(contacts, name)) for name in ("sigma_position", "sigma_normal")}
        for name, sigma in changed.items():
            told[name][i] = sigma
        one_less = ContactMixture(box, Contacts(contacts.p_PC, contacts.n_PC, **told), 0.0, as_told)
        expected = one_less.normal_equations(X_PO).hessian[0]
        np.testing.assert_allclose(left[0, kind * k + i], expected, rtol=1e-3, atol=1e-5 * hessian.max())


@pytest.mark.parametrize(("sigma", "outlier_probability"), [(0.0009, 0.02), (0.02, 0.99)])
def test_many_contacts_are_no_matter(box: ObjectModel, sigma: float, outlier_probability: float) -> None:
    X_PO = pose(8)
    felt = touch_surface(box, X_PO[0], 400, np.random.default_rng(8))
    away = retract(X_PO, np.array([0.0, 0.0, 0.0, 0.02, 0.01, 0.0]))
    mixture = ContactMixture(box, Contacts(felt.p_PC, felt.n_PC, sigma_position=sigma), outlier_probability)
    cost = mixture.cost(np.concatenate([X_PO, away]))
    assert np.isfinite(cost).all()
    assert cost[0] < cost[1]


def test_a_turn_of_everything_changes_nothing(box: ObjectModel) -> None:
    X_PO = pose(9)
    contacts = touch(box, X_PO, 9)
    R, X_off = exp_so3(np.array([0.3, -0.2, 0.9])), retract(X_PO, np.array([0.02, 0, 0, 0, 0.002, 0]))
    turned = Contacts(contacts.p_PC @ R.T, contacts.n_PC @ R.T)
    cost = ContactMixture(box, contacts, 0.02).cost(X_off)
    assert ContactMixture(box, turned, 0.02).cost(R @ X_off)[0] == pytest.approx(cost[0], rel=1e-6)


def test_with_a_prior_it_is_the_sum_of_both(blob: ObjectModel) -> None:
    X_PO = pose(3)
    mixture, prior = (
        ContactMixture(blob, touch(blob, X_PO, 3, noise=2.0), 0.02),
        PriorObjective(GaussianPrior(X_PO[0], 0.1, 0.01)),
    )
    both = mixture.with_prior(prior)
    around = retract(X_PO, np.random.default_rng(0).normal(size=(20, 6)) * 0.02)
    for found, of_touch, of_prior in zip(
        both.normal_equations(around), mixture.normal_equations(around), prior.normal_equations(around), strict=True
    ):
        np.testing.assert_allclose(found, of_touch + of_prior, rtol=1e-9, atol=1e-9 * np.abs(found).max())
    np.testing.assert_allclose(both.cost(around), mixture.cost(around) + prior.cost(around))
    np.testing.assert_allclose(both.cost(around), both.normal_equations(around).cost)
    np.testing.assert_allclose(both.exact_cost(around), mixture.exact_cost(around) + prior.cost(around))
