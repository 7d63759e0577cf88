import dataclasses

import numpy as np
import pytest
import trimesh
from scipy.stats import chi2

import tactopose_drake as tp
from tactopose_drake.core.poses import increments_between, retract
from tactopose_drake.core.posterior import importance_sampling
from tactopose_drake.core.posterior.doubted_spread_kernels import Lines, lay_lines, widen_modes
from tactopose_drake.core.posterior.posterior_params import DEFAULT_PARAMS
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface
from tactopose_drake.estimation import inference

SIZES = np.array([0.06, 0.09, 0.13])
SCALE = np.repeat([0.02, 0.001], 3)


def random_information(generator: np.random.Generator, count: int) -> np.ndarray:
    factors = generator.normal(size=(count, 12, 6)) / SCALE
    return np.einsum("zai,zaj->zij", factors, factors)


def lines_of(seed: int, kept: float) -> tuple[np.ndarray, np.ndarray, Lines]:
    """Information, one contact's row of it, and the lines that are laid if so much of that row is kept."""
    generator = np.random.default_rng(seed)
    others, J = random_information(generator, 1), generator.normal(size=6) / SCALE
    information = others + np.outer(J, J)
    left = (others + kept * np.outer(J, J))[None]
    lines = Lines.empty(1)
    return information[0], J, lines.first(lay_lines(np.eye(3, 4)[None], information, left, lines))


@pytest.mark.parametrize("seed", range(4))
def test_a_line_goes_where_one_contact_alone_holds_the_mode(seed: int) -> None:
    generator = np.random.default_rng(seed)
    J = generator.normal(size=6) / SCALE
    others = random_information(generator, 1)
    # The others know little of what this one tells.
    conjugate = np.linalg.solve(others[0], J)
    others -= 0.99 * np.outer(J, J) / (J @ conjugate)
    information, lines = others + np.outer(J, J), Lines.empty(1)
    assert lay_lines(np.eye(3, 4)[None], information, others[None], lines) == 1
    d = np.linalg.solve(information[0], J)
    d /= np.sqrt(d @ information[0] @ d)
    np.testing.assert_allclose(lines.direction[0] * np.sign(lines.direction[0] @ information[0] @ d), d, rtol=1e-6)
    wider = 1.0 / np.sqrt(d @ others[0] @ d)
    assert np.abs(lines.place).max() == pytest.approx(4.0 * wider)
    assert np.abs(lines.place).min() == 0.5
    increments = increments_between(np.eye(3, 4)[None], lines.X[0])
    np.testing.assert_allclose(increments / SCALE, lines.place[0, :, None] * lines.direction[0] / SCALE, rtol=1e-6)


def test_no_line_goes_where_other_contacts_hold_the_mode_too() -> None:
    _, _, lines = lines_of(0, 0.5)
    assert len(lines.mode) == 0
    generator = np.random.default_rng(1)
    information = random_information(generator, 1)
    unknown = Lines.empty(1)
    assert lay_lines(np.eye(3, 4)[None], information, information[None], unknown) == 0
    assert lay_lines(np.eye(3, 4)[None], np.full((1, 6, 6), np.nan), information[None], unknown) == 0


def shelf(t: np.ndarray, share: float, wider: float, shift: float) -> np.ndarray:
    """The density along a line of a mode that is as told, or with this share so many times as wide, and shifted."""
    return np.asarray(np.exp(-0.5 * t**2) + share * np.exp(-0.5 * ((t - shift) / wider) ** 2))


def one_line(wider: float) -> Lines:
    """Along the fourth coordinate, as far as a mode reaches that is so many times as wide as all contacts say."""
    place = np.concatenate([[0.5, 1.0], np.geomspace(1.5, 4.0 * wider, 10)])
    return Lines(
        np.zeros(1, dtype=np.int64), SCALE * np.eye(6)[[3]], np.r_[place, -place][None], np.empty((1, 24, 3, 4))
    )


@pytest.mark.parametrize(("share", "wider", "shift"), [(0.03, 12.0, 0.0), (0.01, 20.0, 0.0), (0.05, 6.0, 8.0)])
def test_a_mode_is_as_wide_as_its_density_along_a_line(share: float, wider: float, shift: float) -> None:
    information, lines = np.diag(1.0 / SCALE**2), one_line(wider)
    cost = -np.log(shelf(lines.place, share, wider, shift))
    covariance = np.diag(SCALE**2)[None]
    widen_modes(lines, np.zeros(1), cost, information[None], covariance)
    t = np.linspace(-100.0, 100.0, 200_001)
    expected = np.sum(t**2 * shelf(t, share, wider, shift)) / np.sum(shelf(t, share, wider, shift))
    assert expected > 3.0
    np.testing.assert_allclose(np.delete(np.diag(covariance[0]) / SCALE**2, 3), 1.0, rtol=1e-6)
    assert covariance[0, 3, 3] / SCALE[3] ** 2 == pytest.approx(expected, rel=0.1)
    wide = 100.0 * np.diag(SCALE**2)[None]
    widen_modes(lines, np.zeros(1), cost, information[None], wide)
    np.testing.assert_array_equal(wide[0], 100.0 * np.diag(SCALE**2))


def test_another_mode_on_the_line_does_not_count_for_more_than_a_shelf() -> None:
    lines = one_line(12.0)
    cost = np.where(np.abs(lines.place) > 30.0, -20.0, 0.5 * lines.place**2)
    level = np.where(np.abs(lines.place) > 30.0, 0.0, 0.5 * lines.place**2)
    covariance, expected = np.diag(SCALE**2)[None], np.diag(SCALE**2)[None]
    widen_modes(lines, np.zeros(1), cost, np.diag(1.0 / SCALE**2)[None], covariance)
    widen_modes(lines, np.zeros(1), level, np.diag(1.0 / SCALE**2)[None], expected)
    np.testing.assert_array_equal(covariance, expected)


def test_a_gaussian_mode_is_no_wider_than_it_is() -> None:
    information, lines = random_information(np.random.default_rng(3), 1), one_line(12.0)
    d = np.linalg.solve(information[0], np.eye(6)[3])
    lines.direction[0] = d / np.sqrt(d @ information[0] @ d)
    covariance = np.linalg.inv(information)
    widened = covariance.copy()
    widen_modes(lines, np.zeros(1), 0.5 * lines.place**2, information, widened)
    np.testing.assert_allclose(widened / np.outer(SCALE, SCALE), covariance / np.outer(SCALE, SCALE), rtol=0.1)


BOX = tp.ObjectModel.from_mesh(trimesh.creation.box((0.06, 0.04, 0.10)))


def on_the_box(seed: int, count: int) -> tp.Contacts:
    return touch_surface(BOX, np.eye(3, 4), count, np.random.default_rng(seed))


def test_covariances_are_those_of_many_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    sampling = dataclasses.replace(DEFAULT_PARAMS.sampling, samples=40_000, most_samples=40_000, most_densities=10**7)
    ratios = []
    for seed in range(8):
        prior = tp.PosePrior(retract(np.eye(3, 4), 0.1 * SCALE * np.random.default_rng(seed).normal(size=6)))
        stated = tp.estimate_pose(BOX, on_the_box(seed, 5), prior=prior).best.covariance
        with monkeypatch.context() as patch:
            patch.setattr(inference, "DEFAULT_PARAMS", dataclasses.replace(DEFAULT_PARAMS, sampling=sampling))
            patch.setattr(importance_sampling, "widen_by_doubt", lambda modes, posterior: modes)
            sampled = tp.estimate_pose(BOX, on_the_box(seed, 5), prior=prior).best.covariance
        ratios += [np.sqrt(np.trace(stated[i, i]) / np.trace(sampled[i, i])) for i in (slice(3), slice(3, None))]
    assert min(ratios) > 0.5
    assert max(ratios) < 3.0
    assert 0.8 < np.median(ratios) < 1.25


def test_exact_contacts_are_no_less_sure_than_the_guess_and_their_order_does_not_matter() -> None:
    """Edges of a box make gradients that lead nowhere."""
    for seed in range(20):
        exact = on_the_box(seed, 6)
        estimates = [
            tp.estimate_pose(BOX, tp.Contacts(exact.p_PC[order], exact.n_PC[order]), prior=tp.PosePrior(np.eye(3, 4)))
            for order in (np.arange(6), np.arange(6)[::-1])
        ]
        one, other = (np.sqrt(np.diag(each.best.covariance)) for each in estimates)
        assert one[3:].max() < 0.033
        assert 0.5 < np.linalg.norm(one[3:]) / np.linalg.norm(other[3:]) < 2.0


def test_a_pose_that_hangs_on_one_contact_may_be_off_as_far_as_that_may_be_displaced() -> None:
    model = tp.ObjectModel.from_mesh(trimesh.creation.box(SIZES))
    on_faces = np.array(
        [[1, 0.1, 0.1], [0.2, 1, 0.7], [-0.2, 1, -0.6], [0.7, 0.6, 1], [-0.6, 0.5, 1], [0.1, -0.7, 1]], dtype=float
    )
    p, n = 0.5 * SIZES * on_faces, np.eye(3)[[0, 1, 1, 2, 2, 2]]
    away = p.copy()
    away[0, 0] += 0.012  # The only contact that tells where the box is along x.
    prior = tp.PosePrior(retract(np.eye(3, 4), np.array([0.02, -0.03, 0.01, 0.004, -0.006, 0.003])))
    off = tp.estimate_pose(model, tp.Contacts(away, n), prior=prior).best
    error = increments_between(off.X_PO.GetAsMatrix34()[None], np.eye(3, 4)[None])[0]
    assert off.inlier_probability.min() > 0.5  # All fit where the box is not.
    assert abs(error[3]) > 0.008
    assert error @ np.linalg.solve(off.covariance, error) < chi2.ppf(0.999, 6)
    sure = tp.estimate_pose(model, tp.Contacts(away, n), prior=prior, outlier_probability=0.0).best
    assert np.sqrt(off.covariance[3, 3]) > 2.5 * np.sqrt(sure.covariance[3, 3])
