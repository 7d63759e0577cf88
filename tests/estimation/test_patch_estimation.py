"""Estimates from what tactile arrays feel, alone and with contacts."""

import dataclasses
import math

import numpy as np
import pytest
import trimesh
from scipy.stats import chi2

import tactopose_drake as tp
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.poses import increments_between, make_poses, random_rotations, retract, transform_points
from tactopose_drake.core.posterior.modes import determined_part
from tactopose_drake.core.posterior.posterior import make_posterior
from tactopose_drake.core.searches.pair_search import PairSearch
from tactopose_drake.core.searches.pose_problem import make_problem
from tactopose_drake.core.synthetic.synthetic_patch import flat_pad, touch_with_pads
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface
from tactopose_drake.estimation.search_methods import GLOBAL_METHODS, METHODS
from tactopose_drake.resources import model_path
from tests.core.meshes import shape_poor_in_symmetry

ALPHA = 1e-7
NOTHING = tp.Contacts.empty()


@pytest.fixture(scope="module")
def model() -> tp.ObjectModel:
    return tp.ObjectModel.from_mesh(shape_poor_in_symmetry())


@pytest.fixture(scope="module")
def can() -> tp.ObjectModel:
    return tp.ObjectModel.from_mesh(trimesh.creation.cylinder(radius=0.033, height=0.115, sections=64))


@pytest.fixture(scope="module")
def chamfered_can() -> tp.ObjectModel:
    profile = [[0.0, 0.0], [0.033, 0.0], [0.033, 0.105], [0.023, 0.115], [0.0, 0.115]]
    mesh = trimesh.creation.revolve(np.array(profile), sections=64)
    return tp.ObjectModel.from_mesh(mesh.apply_translation([0.0, 0.0, -0.0575]))


def side_grip(can: tp.ObjectModel, seed: int) -> tuple[np.ndarray, tuple[tp.Patch, ...]]:
    """A can in a random pose, and pads on its side at different heights about its middle."""
    generator = np.random.default_rng(seed)
    X_PO, patches = random_pose(generator), []
    for angle, height in [(0.0, -0.004), (2.1, 0.004), (4.2, 0.0), (1.0, 0.008)]:
        z = np.array([-math.cos(angle), -math.sin(angle), 0.0])  # Out of the pad, into the can.
        R_OT = np.stack([np.cross([0.0, 0.0, 1.0], z), [0.0, 0.0, 1.0], z], axis=-1)
        cells = flat_pad() @ R_OT.T - (0.033 - 0.0012) * z + [0.0, 0.0, height]
        depth = np.maximum(0.033 - np.linalg.norm(cells[:, :2], axis=1), 0.0)
        n_PT = np.tile(X_PO[:, :3] @ z, (len(cells), 1))
        noise = 0.0005 * generator.normal(size=3)
        patches.append(tp.describe_patch(transform_points(X_PO, cells) + noise, depth / ALPHA, alpha=ALPHA, n_PT=n_PT))
    return X_PO, tuple(patches)


def random_pose(generator: np.random.Generator) -> np.ndarray:
    return make_poses(random_rotations(generator, 1), generator.normal(size=(1, 3)) * 0.05)[0]


def touch(model: tp.ObjectModel, seed: int, count: int = 4) -> tuple[np.ndarray, tuple[tp.Patch, ...]]:
    generator = np.random.default_rng(seed)
    X_PO = random_pose(generator)
    return X_PO, touch_with_pads(model, X_PO, count, generator)


def doubtful(X_PO: np.ndarray, seed: int) -> tp.PosePrior:
    """Off by up to 20 degrees and 10 mm about and along each axis."""
    w, v = np.random.default_rng(seed).uniform(-1.0, 1.0, (2, 3))
    off = np.concatenate([math.radians(20.0) * w, 0.01 * v])
    return tp.PosePrior(retract(X_PO, off), sigma_translation=0.006, sigma_rotation=math.radians(12.0))


def errors(estimate: tp.PoseEstimate, X_PO: np.ndarray) -> tuple[float, float]:
    """m and rad."""
    off = increments_between(estimate.best.X_PO.GetAsMatrix34(), X_PO)
    return float(np.linalg.norm(off[3:])), float(np.linalg.norm(off[:3]))


def is_near(estimate: tp.PoseEstimate, X_PO: np.ndarray) -> bool:
    way, turn = errors(estimate, X_PO)
    return way < 0.01 and turn < math.radians(10.0)


def moved(patch: tp.Patch, X_QP: np.ndarray) -> tp.Patch:
    return tp.describe_patch(
        transform_points(X_QP, patch.p_PT), patch.pressure, alpha=patch.alpha, n_PT=patch.n_PT @ X_QP[:, :3].T
    )


def flat(p_PT: list[float], out: list[float], depth: float) -> tp.Patch:
    """A flat pad with its middle at p_PT and its long side along z, pressed in by `depth` everywhere."""
    z = np.asarray(out)
    R_PT = np.stack([np.eye(3)[2], np.cross(z, np.eye(3)[2]), z], axis=-1)
    cells = flat_pad() @ R_PT.T + np.asarray(p_PT)
    return tp.describe_patch(cells, np.full(len(cells), depth / ALPHA), alpha=ALPHA, n_PT=np.tile(z, (len(cells), 1)))


@pytest.mark.parametrize("has_prior", [True, False])
def test_patches_alone_find_the_pose(model: tp.ObjectModel, has_prior: bool) -> None:
    near = 0
    squares = []
    for seed in range(12):
        X_PO, patches = touch(model, seed)
        estimate = tp.estimate_pose(model, NOTHING, patches=patches, prior=doubtful(X_PO, seed) if has_prior else None)
        assert estimate.status in ("ok", "ambiguous")
        near += is_near(estimate, X_PO)
        off = increments_between(estimate.best.X_PO.GetAsMatrix34(), X_PO)
        squares.append(off @ np.linalg.solve(estimate.best.covariance, off))
    assert near >= (12 if has_prior else 10)
    # Six degrees of freedom have the median 5.3; a factor of two either way is a wrong covariance.
    assert 2.7 < np.median(squares) < 10.7


def test_contacts_and_patches_together_tell_more_than_either(model: tp.ObjectModel) -> None:
    squares = []
    for seed in range(10):
        X_PO, patches = touch(model, seed, 3)
        contacts = touch_surface(model, X_PO, 3, np.random.default_rng(seed))
        squares.append([])
        for some, others in ((contacts, ()), (NOTHING, patches), (contacts, patches)):
            X_hat = tp.estimate_pose(model, some, patches=others, prior=doubtful(X_PO, seed)).best.X_PO
            off = X_hat.multiply(model.samples.points.T).T - transform_points(X_PO, model.samples.points)
            squares[-1].append(np.mean(off**2))
    by_contacts, by_patches, by_both = np.mean(squares, axis=0)
    assert by_both < min(by_contacts, by_patches)


def test_contacts_without_normals_join_patches(model: tp.ObjectModel) -> None:
    near = 0
    for seed in range(6):
        X_PO, patches = touch(model, seed, 3)
        contacts = tp.Contacts(touch_surface(model, X_PO, 6, np.random.default_rng(seed)).p_PC)
        near += is_near(tp.estimate_pose(model, contacts, patches=patches), X_PO)
    assert near >= 5


@pytest.mark.parametrize("has_prior", [True, False])
def test_moving_the_palm_frame_moves_the_estimate(model: tp.ObjectModel, has_prior: bool) -> None:
    X_PO, patches = touch(model, 3)
    X_QP = random_pose(np.random.default_rng(30))
    X_QO = make_poses(X_QP[:, :3] @ X_PO[:, :3], transform_points(X_QP, X_PO[None, :, 3])[0])
    one = tp.estimate_pose(model, NOTHING, patches=patches, prior=doubtful(X_PO, 3) if has_prior else None)
    other = tp.estimate_pose(
        model,
        NOTHING,
        patches=[moved(patch, X_QP) for patch in patches],
        prior=doubtful(X_QO, 3) if has_prior else None,
    )
    np.testing.assert_allclose(
        transform_points(X_QP, one.best.X_PO.translation()[None])[0], other.best.X_PO.translation(), atol=1e-3
    )
    np.testing.assert_allclose(
        X_QP[:, :3] @ one.best.X_PO.rotation().matrix(), other.best.X_PO.rotation().matrix(), atol=0.02
    )


def test_pads_on_the_side_of_a_can_leave_its_spin_and_slide_free(can: tp.ObjectModel) -> None:
    angles, heights = [0.0, 1.3, 2.9, 4.4], [0.02, -0.02, 0.01, -0.01]
    patches = []
    for angle, height in zip(angles, heights, strict=True):
        n = np.array([math.cos(angle), math.sin(angle), 0.0])
        patch = flat([*(0.032 * n[:2]), height], list(-n), 0.0)
        # The pad's middle is 1 mm in the can.
        depth = np.sqrt(np.maximum(0.033**2 - np.sum((patch.p_PT[:, :2] @ [-n[1], n[0]])[:, None] ** 2, axis=1), 0.0))
        depth = np.maximum(depth - patch.p_PT[:, :2] @ n[:2], 0.0)
        patches.append(tp.describe_patch(patch.p_PT, depth / ALPHA, alpha=ALPHA, n_PT=patch.n_PT))
    prior = tp.PosePrior(retract(np.eye(3, 4), np.array([0.05, -0.04, 0.1, 0.005, 0.004, -0.005])))
    best = tp.estimate_pose(can, NOTHING, patches=patches, prior=prior).best
    assert best.free_directions.shape == (2, 6)
    for direction in (np.eye(6)[2], np.concatenate([np.zeros(3), best.X_PO.rotation().matrix()[:, 2]])):
        assert np.linalg.norm(determined_part(direction, best.free_directions, can.size)) < 0.15


def test_the_other_end_up_is_a_hypothesis_where_it_costs_but_little_more(chamfered_can: tp.ObjectModel) -> None:
    # The pads feel the side alone; contacts at both ends tell them apart, but not for certain.
    at_ends = np.array([[0.028, 0.0, 0.0525], [0.010, 0.005, -0.0575]])
    for seed in range(3):
        X_PO, patches = side_grip(chamfered_can, seed)
        contacts = tp.Contacts(transform_points(X_PO, at_ends), sigma_position=0.0014)
        found = tp.estimate_pose(chamfered_can, contacts, patches=patches, seed=seed)
        up = [hypothesis.X_PO.rotation().matrix()[:, 2] @ X_PO[:, 2] for hypothesis in found]
        upright = sum(hypothesis.probability for hypothesis, way in zip(found, up, strict=True) if way > 0.9)
        upside_down = sum(hypothesis.probability for hypothesis, way in zip(found, up, strict=True) if way < -0.9)
        assert 0.5 < upright < 0.95
        assert upside_down > 0.05
        assert len(found) == 2  # A turn about its axis makes no other pose of a can.


def test_a_pad_that_feels_nothing_says_where_the_object_is_not(can: tp.ObjectModel) -> None:
    """Two pads hold a can by its sides, so that it may slide; a third one is in its way."""
    sides = [flat([0.032, 0.0, 0.0], [-1.0, 0.0, 0.0], 0.001), flat([-0.032, 0.0, 0.0], [1.0, 0.0, 0.0], 0.001)]
    silent = flat([0.0, 0.0, 0.050], [0.0, -1.0, 0.0], 0.0)
    prior = tp.PosePrior(np.eye(3, 4), sigma_translation=0.02, sigma_rotation=math.radians(5.0))
    held = tp.estimate_pose(can, NOTHING, patches=sides, prior=prior)
    kept_off = tp.estimate_pose(can, NOTHING, patches=[*sides, silent], prior=prior)
    depth = [
        -can.grid.distance((silent.p_PT - e.best.X_PO.translation()) @ e.best.X_PO.rotation().matrix()).min()
        for e in (held, kept_off)
    ]
    assert depth[0] > 0.005
    assert depth[1] < 0.002
    assert kept_off.status in ("ok", "ambiguous")


@pytest.mark.parametrize("method", sorted(GLOBAL_METHODS))
def test_every_global_method_takes_patches(model: tp.ObjectModel, method: str) -> None:
    X_PO, patches = touch(model, 5)
    prior = doubtful(X_PO, 5)
    estimate = tp.estimate_pose(model, NOTHING, patches=patches, prior=prior, method=method, time_limit=120.0)
    assert estimate.best.explains_touch
    before = np.linalg.norm(increments_between(prior.mean, X_PO)[:3])
    assert errors(estimate, X_PO)[1] < 0.5 * before


def test_one_pad_leaves_many_poses(model: tp.ObjectModel) -> None:
    one, two = (touch_with_pads(model, np.eye(3, 4), count, np.random.default_rng(0)) for count in (1, 2))
    wide, usual = (METHODS["pair_search"](model, Evidence(NOTHING, patches=pads)) for pads in (one, two))
    assert isinstance(wide, PairSearch)
    assert isinstance(usual, PairSearch)
    assert wide.start.samples >= 4 * usual.start.samples
    assert wide.on_the_way.kept > usual.on_the_way.kept


def test_the_set_of_one_pad_holds_the_poses_that_it_leaves() -> None:
    """It is felt by a whole surface and in any spin; a search finds only a part of these poses."""
    model, shares = tp.ObjectModel.from_mesh(model_path("objects", "spray_bottle.obj")), []
    for seed in range(4):
        generator = np.random.default_rng(seed)
        patches = touch_with_pads(model, random_pose(generator), 1, generator)
        evidence = Evidence(NOTHING, patches=patches)
        posterior = make_posterior(model, evidence, make_problem(model, evidence))
        assert posterior.single_contact is not None
        X_PO = posterior.single_contact.sample(6000, generator).X_PO
        cost, density = posterior.exact_cost(X_PO), posterior.single_contact.density(X_PO)
        weights = np.where(density > 0.0, np.exp(cost.min() - cost) / np.maximum(density, 1e-300), 0.0)
        held, before = np.zeros(len(X_PO), dtype=np.bool_), 0.0
        for hypothesis in tp.estimate_pose(model, NOTHING, patches=patches).hypotheses:
            u = increments_between(hypothesis.X_PO.GetAsMatrix34(), X_PO)
            square = np.einsum("bi,bi->b", u, np.linalg.solve(hypothesis.covariance, u.T).T)
            held |= (square < chi2.ppf(0.95, 6)) & (before < 0.95)
            before += hypothesis.probability
        shares.append(weights[held].sum() / weights.sum())
    assert np.mean(shares) > 0.8


def test_three_touches_and_no_fewer_may_tell_the_pose_of_a_ball() -> None:
    ball = tp.ObjectModel.from_mesh(trimesh.creation.icosphere(subdivisions=4, radius=0.03))
    patches = touch_with_pads(ball, np.eye(3, 4), 3, np.random.default_rng(0))
    statuses = [tp.estimate_pose(ball, NOTHING, patches=patches[:count]).status for count in (1, 2, 3)]
    assert statuses == ["ambiguous", "ambiguous", "ok"]


@pytest.mark.parametrize("has_contacts", [True, False])
def test_a_pad_far_from_the_others_has_no_solution(model: tp.ObjectModel, has_contacts: bool) -> None:
    X_PO, patches = touch(model, 7)
    contacts = touch_surface(model, X_PO, 5, np.random.default_rng(7)) if has_contacts else NOTHING
    away = moved(patches[0], make_poses(np.eye(3), np.array([0.5, 0.0, 0.0])))
    for share, status in ((0.02, ("ok", "ambiguous")), (0.0, ("no_solution",))):
        options = {"outlier_probability": share}
        assert tp.estimate_pose(model, contacts, patches=patches, **options).status in ("ok", "ambiguous")
        assert tp.estimate_pose(model, contacts, patches=[away, *patches[1:]], **options).status in status
    nowhere = [moved(patch, make_poses(np.eye(3), np.array([0.5 + i, 0.0, 0.0]))) for i, patch in enumerate(patches)]
    # Of four pads one may be false, of nine contacts and pads two.
    few, many = (2, 3) if has_contacts else (1, 2)
    found = tp.estimate_pose(model, contacts, patches=nowhere[:few] + list(patches[few:]))
    assert found.status == "ok"
    assert np.linalg.norm(found.best.X_PO.translation() - X_PO[:, 3]) < 0.003
    of_pads = found.best.inlier_probability[len(contacts) :]
    assert np.all(of_pads[:few] < 0.01)
    assert np.all(of_pads[few:] > 0.99)
    assert tp.estimate_pose(model, contacts, patches=nowhere[:many] + list(patches[many:])).status == "no_solution"


@pytest.mark.parametrize("has_contacts", [True, False])
def test_a_pad_that_feels_something_else_is_named_and_leads_nobody_astray(
    model: tp.ObjectModel, has_contacts: bool
) -> None:
    near, named = 0, 0
    for seed in range(4):
        X_PO, patches = touch(model, 20 + seed, count=5)
        contacts = touch_surface(model, X_PO, 3, np.random.default_rng(seed)) if has_contacts else NOTHING
        # Elsewhere by 25 mm along its normal: another object is between.
        off = make_poses(np.eye(3), 0.025 * -patches[2].n_PT.mean(axis=0))
        several = [*patches[:2], moved(patches[2], off), *patches[3:]]
        found = tp.estimate_pose(model, contacts, patches=several)
        inlier = found.best.inlier_probability
        assert inlier.shape == (len(contacts) + 5,)
        named += bool(np.flatnonzero(inlier < 0.5).tolist() == [len(contacts) + 2])
        near += is_near(found, X_PO)
        if seed == 0:
            told = tp.estimate_pose(model, contacts, patches=several, outlier_probability=0.0)
            np.testing.assert_allclose(told.best.inlier_probability, 1.0, atol=1e-9)
    assert named >= 3
    assert near >= 3


def test_pads_as_told_are_not_doubted_and_silent_ones_never(model: tp.ObjectModel) -> None:
    for seed in range(3):
        _, patches = touch(model, 30 + seed)
        silent = dataclasses.replace(patches[0], pressure=np.zeros(24), status="no_contact")
        silent = moved(silent, make_poses(np.eye(3), np.array([1.0, 0.0, 0.0])))
        found = tp.estimate_pose(model, NOTHING, patches=[silent, *patches])
        assert found.best.inlier_probability[0] == 1.0
        assert 0.5 < found.best.inlier_probability[1:].min() < 1.0


@pytest.mark.parametrize(
    ("patches", "message"),
    [
        ((), "contacts must be at least 1 if no patch is felt, not 0"),
        ((flat([0.0, 0.0, 0.0], [1.0, 0.0, 0.0], 0.0),), "contacts must be at least 1 if no patch is felt, not 0"),
        (flat([0.0, 0.0, 0.0], [1.0, 0.0, 0.0], 0.001), "patches must be a sequence of Patch, not a Patch"),
        ((np.zeros(3),), r"patches\[0\] must be a Patch, not an ndarray"),
    ],
)
def test_bad_patches_are_named(model: tp.ObjectModel, patches: object, message: str) -> None:
    with pytest.raises(tp.TactoposeError, match=message):
        tp.estimate_pose(model, NOTHING, patches=patches)  # type: ignore[arg-type]


def test_only_contacts_give_what_they_gave(model: tp.ObjectModel) -> None:
    X_PO, patches = touch(model, 8)
    contacts = touch_surface(model, X_PO, 5, np.random.default_rng(8))
    one, other = (tp.estimate_pose(model, contacts, patches=p) for p in ((), []))
    np.testing.assert_array_equal(one.best.X_PO.GetAsMatrix34(), other.best.X_PO.GetAsMatrix34())
    dead = [dataclasses.replace(patch, pressure=np.zeros(24), status="no_contact") for patch in patches]
    silent = [moved(patch, make_poses(np.eye(3), np.array([1.0, 0.0, 0.0]))) for patch in dead]
    far = tp.estimate_pose(model, contacts, patches=silent)
    assert far.best.cost == pytest.approx(one.best.cost, abs=1e-6)
