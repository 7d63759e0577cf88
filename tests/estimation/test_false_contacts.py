"""Contacts that are not what they seem, and noise that is not as told."""

import math

import numpy as np
import pytest
import trimesh

import tactopose_drake as tp
from tactopose_drake.core.poses import increments_between, make_poses, random_rotations, retract
from tactopose_drake.core.synthetic import touch_surface
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.resources import model_path

NOISE = {"sigma_position": 0.0009, "sigma_normal": math.radians(5.0)}


def touched(model: tp.ObjectModel, seed: int, count: int = 7, noise: float = 1.0) -> tuple[np.ndarray, tp.Contacts]:
    generator = np.random.default_rng(seed)
    X_PO = make_poses(random_rotations(generator, 1), 0.05 * generator.normal(size=(1, 3)))[0]
    sigmas = {name: noise * sigma for name, sigma in NOISE.items()}
    felt = touch_surface(model, X_PO, count, generator, spread=True, **sigmas)
    return X_PO, tp.Contacts(felt.p_PC, felt.n_PC, **NOISE)


def near(X_PO: np.ndarray, seed: int) -> tp.PosePrior:
    prior = tp.PosePrior(X_PO)
    return tp.PosePrior(retract(X_PO, np.random.default_rng(seed).normal(size=6) * prior.sigmas))


def is_right(X_PO: np.ndarray, estimate: tp.PoseEstimate) -> bool:
    error = increments_between(X_PO, estimate.best.X_PO.GetAsMatrix34()[None])[0]
    return bool(np.linalg.norm(error[3:]) < 0.010 and np.linalg.norm(error[:3]) < math.radians(15.0))


def test_a_contact_far_off_is_named_and_leads_nobody_astray(blob: tp.ObjectModel) -> None:
    right, named, astray = 0, 0, 0
    for seed in range(20):
        X_PO, contacts = touched(blob, seed)
        p_PC = contacts.p_PC.copy()
        p_PC[2] += 0.02 * contacts.n_PC[2]
        false = tp.Contacts(p_PC, contacts.n_PC, **NOISE)
        estimate = tp.estimate_pose(blob, false, prior=near(X_PO, seed))
        right += is_right(X_PO, estimate)
        named += int(np.argmin(estimate.best.inlier_probability)) == 2 and estimate.best.inlier_probability[2] < 0.1
        told = tp.estimate_pose(blob, false, prior=near(X_PO, seed), outlier_probability=0.0)
        np.testing.assert_allclose(told.best.inlier_probability, 1.0, rtol=1e-5)
        astray += not is_right(X_PO, told) or told.status == "no_solution"
    assert right >= 18
    assert named >= 17
    assert astray > 20 - right


@pytest.mark.parametrize("count", [5, 6])
def test_a_normal_the_wrong_way_round_is_no_normal_of_the_object(count: int) -> None:
    half = np.array([0.025, 0.035, 0.055])
    box = tp.ObjectModel.from_mesh(trimesh.creation.box(2.0 * half), max_grid_bytes=200_000)
    for seed in range(10):
        rng = np.random.default_rng(seed)
        n_PC = rng.permutation(np.concatenate([np.eye(3), -np.eye(3)]))[:count]
        p_PC = np.where(n_PC == 0.0, rng.uniform(-0.7, 0.7, n_PC.shape), n_PC) * half
        p_PC += rng.normal(scale=5e-4, size=p_PC.shape)
        turned = n_PC.copy()
        turned[0] *= -1.0
        false, true = (
            tp.estimate_pose(box, tp.Contacts(p_PC, normals, sigma_position=5e-4)) for normals in (turned, n_PC)
        )
        assert true.best.inlier_probability.min() > 0.9
        named = int(np.argmin(false.best.inlier_probability)) == 0 and false.best.inlier_probability[0] < 0.1
        assert named or not false.best.explains_touch, f"{seed}: {false}, {false.best.inlier_probability}"


def test_a_touch_as_told_is_taken_at_its_word(blob: tp.ObjectModel) -> None:
    scales = []
    for seed in range(20):
        X_PO, contacts = touched(blob, 100 + seed)
        estimate = tp.estimate_pose(blob, contacts, prior=near(X_PO, seed))
        assert estimate.status != "no_solution"
        assert is_right(X_PO, estimate)
        assert estimate.best.inlier_probability.shape == (7,)
        scales.append(estimate.noise_scale)
    assert np.median(scales) < 1.3


def test_larger_noise_is_noticed_and_makes_the_belief_wider(blob: tp.ObjectModel) -> None:
    scales, wider = [], []
    for seed in range(12):
        X_PO, contacts = touched(blob, 200 + seed, count=10, noise=2.5)
        estimate = tp.estimate_pose(blob, contacts, prior=near(X_PO, seed))
        _, as_told = touched(blob, 200 + seed, count=10)
        exact = tp.estimate_pose(blob, as_told, prior=near(X_PO, seed))
        scales.append(estimate.noise_scale)
        wider.append(np.trace(estimate.best.covariance[3:, 3:]) / np.trace(exact.best.covariance[3:, 3:]))
    assert np.median(scales) > 1.6
    assert np.median(wider) > 2.0


@pytest.mark.parametrize(("count", "has_normals"), [(5, True), (16, False)])
def test_a_pose_that_fits_well_does_not_hide_the_noise(blob: tp.ObjectModel, count: int, has_normals: bool) -> None:
    """Six of the measured numbers go into the pose, so that what is left of the noise is less than the noise."""
    scales = []
    for noise in (1.0, 3.0):
        for seed in range(16):
            X_PO, contacts = touched(blob, 600 + seed, count, noise)
            felt = tp.Contacts(contacts.p_PC, contacts.n_PC if has_normals else None, **NOISE)
            scales.append(tp.estimate_pose(blob, felt, prior=near(X_PO, seed)).noise_scale)
    assert np.median(scales[:16]) < 1.4
    assert np.median(scales[16:]) > 2.0


def test_doubt_at_either_end_gives_sensible_odds(blob: tp.ObjectModel) -> None:
    X_PO, contacts = touched(blob, 400, count=5)
    least = []
    for share in (1e-12, 1e-3, 0.02, 0.3, 0.99):
        estimate = tp.estimate_pose(blob, contacts, prior=near(X_PO, 0), outlier_probability=share)
        assert np.isfinite(estimate.best.cost)
        least.append(estimate.best.inlier_probability.min())
    assert np.all(np.diff(least) < 0.0)
    assert least[0] > 1.0 - 1e-6
    assert least[-1] < 0.1


@pytest.mark.parametrize("share", [0.02, 0.3, 0.6, 0.9])
def test_who_doubts_more_still_finds_an_exact_touch_explained(blob: tp.ObjectModel, share: float) -> None:
    X_PO, _ = touched(blob, 0)
    exact = touch_surface(blob, X_PO, 6, np.random.default_rng(1), sigma_position=0.0, sigma_normal=0.0)
    contacts = tp.Contacts(exact.p_PC, exact.n_PC, **NOISE)
    estimate = tp.estimate_pose(blob, contacts, prior=tp.PosePrior(X_PO), outlier_probability=share)
    assert estimate.best.explains_touch
    assert estimate.status == "ok"


def test_hundreds_of_contacts_are_explained_as_few_are_and_only_by_what_they_are_of() -> None:
    """The noise of a curved object is a little more than told, for what is felt beside a place is another place."""
    bottle, bulb = (
        tp.ObjectModel.from_mesh(model_path("objects", f"{name}.obj")) for name in ("spray_bottle", "light_bulb")
    )
    for model, other in ((bottle, bulb), (bulb, bottle)):
        for seed in range(4):
            generator = np.random.default_rng(seed)
            X_PO = make_poses(random_rotations(generator, 1), 0.05 * generator.normal(size=(1, 3)))[0]
            felt = touch_surface(model, X_PO, 300, generator, **NOISE)
            contacts = tp.Contacts(felt.p_PC, felt.n_PC, **NOISE)
            assert tp.estimate_pose(model, contacts, prior=tp.PosePrior(X_PO)).status == "ok"
            assert tp.estimate_pose(other, contacts).status == "no_solution"


def test_the_standard_error_is_stated(blob: tp.ObjectModel) -> None:
    X_PO, contacts = touched(blob, 300, count=4)
    assert 0.0 <= tp.estimate_pose(blob, contacts).standard_error <= 0.05
    out_of_time = tp.estimate_pose(blob, contacts, prior=near(X_PO, 0), time_limit=1e-9)
    assert out_of_time.standard_error == math.inf
    assert not out_of_time.finished


@pytest.mark.parametrize("share", [-0.1, 1.0, 1.5, math.nan, "0.02", None])
def test_a_share_of_false_contacts_that_is_none_is_refused(blob: tp.ObjectModel, share: object) -> None:
    _, contacts = touched(blob, 0)
    with pytest.raises(tp.TactoposeError, match="outlier_probability"):
        tp.estimate_pose(blob, contacts, outlier_probability=share)  # type: ignore[arg-type]


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_forces_that_pull_are_refused_unless_few_do(blob: tp.ObjectModel, sign: float) -> None:
    X_PO, contacts = touched(blob, 0)
    n_PC, p_PC = sign * contacts.n_PC, contacts.p_PC
    with pytest.raises(
        InvalidInputError,
        match=r"^contacts must have forces f_PC .*, not against them as in 0, 1, .* pull at the object",
    ):
        tp.estimate_pose(blob, tp.Contacts(p_PC, n_PC, -2.0 * n_PC, **NOISE), prior=near(X_PO, 0))
    with pytest.raises(InvalidInputError, match=r"^contacts must have forces f_PC .*, not against them"):
        tp.identify([blob], tp.Contacts(p_PC, n_PC, -2.0 * n_PC, **NOISE))
    # One of them may be false; and where nothing presses, noise points anywhere.
    f_PC = 2.0 * contacts.n_PC
    f_PC[0] *= -1.0
    one = tp.estimate_pose(blob, tp.Contacts(p_PC, contacts.n_PC, f_PC, **NOISE), prior=near(X_PO, 0))
    assert is_right(X_PO, one)
    silent = tp.Contacts(p_PC, contacts.n_PC, -0.05 * contacts.n_PC, **NOISE)
    assert is_right(X_PO, tp.estimate_pose(blob, silent, prior=near(X_PO, 0)))
