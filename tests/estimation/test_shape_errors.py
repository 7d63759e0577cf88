"""What a mesh may be off counts along the normal, and how it bends where a point is off along it."""

import math

import numpy as np
import pytest

import tactopose_drake as tp
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.poses import make_poses, random_rotations, retract
from tactopose_drake.core.synthetic import touch_surface
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.estimation.identification import _approximate_evidence
from tactopose_drake.estimation.pickling import Sealed
from tactopose_drake.estimation.shape_errors import log_dilution, with_shape_errors

N = np.array([[0.0, 0.6, 0.8], [1.0, 0.0, 0.0]])
P = np.array([[0.0, 0.03, 0.04], [0.05, 0.0, 0.0]])


@pytest.fixture(scope="module")
def ball() -> tp.ObjectModel:
    return tp.ObjectModel.from_sphere(0.05, surface_sigma=0.001, scale_sigma=0.04)


def test_a_ball_of_another_size_is_off_by_its_radius(ball: tp.ObjectModel) -> None:
    contacts = tp.Contacts(P, N, sigma_position=0.001)
    wider = with_shape_errors(ball, contacts)
    np.testing.assert_allclose(wider.sigma_position, math.sqrt(0.001**2 + 0.001**2 + 0.002**2), rtol=1e-3)
    np.testing.assert_array_equal(wider.sigma_normal, contacts.sigma_normal)


def test_of_covariances_it_counts_along_the_normal() -> None:
    box = tp.ObjectModel.from_box([0.1, 0.1, 0.1], surface_sigma=0.003)
    covariance = np.tile(np.diag([1e-6] * 3 + [1e-3] * 3), (2, 1, 1))
    wider = with_shape_errors(box, tp.Contacts(P, N, covariance=covariance))
    np.testing.assert_allclose(wider.sigma_position, math.sqrt(1e-6 + 9e-6))
    assert wider.covariance is not None
    added = wider.covariance - covariance
    np.testing.assert_allclose(added[:, :3, :3], 9e-6 * N[:, :, None] * N[:, None, :], atol=1e-12)
    np.testing.assert_allclose(added[:, 3:, 3:], 0.0, atol=1e-9)  # A box is flat.


def test_a_point_off_along_a_ball_may_have_touched_where_it_is_turned(ball: tp.ObjectModel) -> None:
    along = 0.004**2 * (np.eye(3) - N[:, :, None] * N[:, None, :])
    covariance = np.zeros((2, 6, 6))
    covariance[:, :3, :3] = along + 1e-8 * np.eye(3)
    covariance[:, 3:, 3:] = 1e-8 * np.eye(3)
    wider = with_shape_errors(tp.ObjectModel.from_sphere(0.05), tp.Contacts(P, N, covariance=covariance))
    np.testing.assert_allclose(wider.sigma_normal, 0.004 / 0.05, rtol=0.15)


def test_the_normal_of_a_point_known_to_millimetres_is_of_another_place() -> None:
    ball = tp.ObjectModel.from_sphere(0.05)
    wider = with_shape_errors(ball, tp.Contacts(P, N, sigma_position=[0.0009, 0.005], sigma_normal=0.01))
    np.testing.assert_allclose(wider.sigma_normal, [0.01, math.hypot(0.01, math.sqrt(24e-6) / 0.05)], rtol=0.1)
    assert wider.sigma_position[0] == 0.0009
    assert 0.005 < wider.sigma_position[1] < 0.0055


def test_an_object_of_another_size_has_its_places_elsewhere_along_the_surface_too() -> None:
    # About the place by which it grows, 30 mm off its middle, places move by 0.03 / sqrt(3) along each tangent, rms.
    ball = tp.ObjectModel.from_sphere(0.05, scale_sigma=0.2, center_of_mass=[0.0, 0.0, 0.03])
    covariance = np.tile(1e-8 * np.eye(6), (2, 1, 1))
    wider = with_shape_errors(ball, tp.Contacts(P, N, covariance=covariance))
    np.testing.assert_allclose(wider.sigma_normal, 0.2 * 0.03 / math.sqrt(3.0) / 0.05, rtol=0.15)


def test_without_any_contacts_stay_the_same() -> None:
    ball = tp.ObjectModel.from_sphere(0.05)
    contacts = tp.Contacts(P, N)
    assert with_shape_errors(ball, contacts) is contacts
    assert with_shape_errors(ball, tp.Contacts.empty()).p_PC.shape == (0, 3)


def test_an_object_that_is_larger_and_says_so_is_less_sure() -> None:
    """Touches of an object 5 % larger than its mesh: told, the truth is within the covariance."""
    squares = {}
    for scale_sigma in (0.0, 0.05):
        model = tp.ObjectModel.from_box([0.06, 0.09, 0.14], symmetry="none", scale_sigma=scale_sigma)
        squares[scale_sigma] = [_square(model, seed) for seed in range(24)]
    assert np.median(squares[0.05]) < 12.6  # 95 % of six degrees of freedom
    assert np.median(squares[0.05]) < 0.5 * np.median(squares[0.0])


def _square(model: tp.ObjectModel, seed: int) -> float:
    """The squared error of an estimate in units of its covariance."""
    generator = np.random.default_rng(seed)
    X_PO = make_poses(random_rotations(generator, 1), np.zeros((1, 3)))[0]
    felt = touch_surface(model, X_PO, 6, generator, spread=True, sigma_position=0.0003, sigma_normal=math.radians(2.0))
    prior = tp.PosePrior(retract(X_PO, 0.01 * generator.normal(size=6)), sigma_translation=0.01, sigma_rotation=0.01)
    contacts = tp.Contacts(1.05 * felt.p_PC, felt.n_PC, sigma_position=0.0003, sigma_normal=math.radians(2.0))
    best = tp.estimate_pose(model, contacts, prior=prior, outlier_probability=0.0).best
    turned = best.X_PO.rotation().matrix().T @ X_PO[:, :3]
    w = 0.5 * np.array([turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1]])
    error = np.concatenate([w, X_PO[:, 3] - best.X_PO.translation()])
    return float(error @ np.linalg.solve(best.covariance, error))


@pytest.mark.parametrize("told", [{"surface_sigma": 0.004}, {"scale_sigma": 0.05}])
def test_what_is_less_sure_of_its_surface_explains_one_contact_no_better(told: dict[str, float]) -> None:
    """One contact lies on any object as well, however exactly that is known, if it is flat within its uncertainty."""
    exact, unsure = tp.ObjectModel.from_sphere(0.06), tp.ObjectModel.from_sphere(0.06, **told)
    better = []
    for seed in range(16):
        n_PC = np.random.default_rng(seed).normal(size=(1, 3))
        n_PC /= np.linalg.norm(n_PC)
        contact = tp.Contacts(0.06 * n_PC, n_PC)
        evidence = [tp.estimate_pose(model, contact, outlier_probability=0.0).log_evidence for model in (exact, unsure)]
        better.append(evidence[1] - evidence[0])
    assert np.mean(better) == pytest.approx(0.0, abs=0.1)


def test_nor_does_it_by_the_quick_evidence_that_chooses_candidates() -> None:
    """Of one contact Laplace's approximation differs by nothing else than how sure it is."""
    exact, unsure = tp.ObjectModel.from_sphere(0.03), tp.ObjectModel.from_sphere(0.03, surface_sigma=0.004)
    n_PC = np.array([[0.6, 0.0, 0.8]])
    evidence = Sealed(Evidence(tp.Contacts(0.03 * n_PC, n_PC)))
    found = [_approximate_evidence(Sealed(model), evidence, 0) for model in (exact, unsure)]
    assert found[1] == pytest.approx(found[0], abs=0.02)


@pytest.mark.parametrize(("sigma_normal", "of_directions"), [(0.1, 4.0), (1.0, 2.0), (2.0, 1.0)])
def test_contacts_are_as_much_less_dense_as_their_errors_take_more_room(
    sigma_normal: float, of_directions: float
) -> None:
    """A Gaussian of normals has the density 1 / (2 pi sigma^2), and none is below that of any, 1 / (4 pi)."""
    told = [tp.Contacts(P, n_PC, sigma_position=0.001, sigma_normal=sigma_normal) for n_PC in (N, None)]
    felt = [tp.Contacts(P, n_PC, sigma_position=0.003, sigma_normal=2.0 * sigma_normal) for n_PC in (N, None)]
    dilutions = [log_dilution(*both) for both in zip(told, felt, strict=True)]
    np.testing.assert_allclose(dilutions, [2.0 * math.log(3.0 * of_directions), 2.0 * math.log(3.0)])


def test_a_box_that_is_unsure_of_its_surface_is_not_named_for_the_exact_one() -> None:
    box = tp.ObjectModel.from_box([0.06, 0.04, 0.03])
    other = tp.ObjectModel.from_box([0.062, 0.041, 0.031], surface_sigma=0.005)
    for seed in range(4):
        touch = touch_surface(box, np.eye(3, 4), 6, np.random.default_rng(seed), spread=True)
        found = tp.identify([box, other], touch, unknown_prior=0.0)
        assert found.best.index == 0
        told = tp.Contacts(touch.p_PC, touch.n_PC, covariance=np.tile(np.diag([1e-6] * 3 + [7e-3] * 3), (6, 1, 1)))
        assert tp.identify([box, other], told, unknown_prior=0.0).best.index == 0


@pytest.mark.parametrize("wrong", [{"surface_sigma": -1.0}, {"scale_sigma": 0.6}, {"scale_sigma": math.nan}])
def test_what_no_mesh_is_off_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(InvalidInputError, match=next(iter(wrong))):
        tp.ObjectModel.from_sphere(0.05, **wrong)
