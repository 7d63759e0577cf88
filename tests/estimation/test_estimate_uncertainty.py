import math

import numpy as np
import pytest
import trimesh

import tactopose_drake as tp
from tactopose_drake.core.poses import make_poses, rotation_angles
from tactopose_drake.core.posterior.importance_sampling import weigh_modes
from tactopose_drake.core.posterior.modes import Modes, determined_part
from tactopose_drake.core.posterior.posterior import Posterior
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface
from tactopose_drake.estimation import inference
from tactopose_drake.resources import model_path
from tests.displaced_poses import displaced, error, random_pose


@pytest.fixture(scope="module")
def box() -> tp.ObjectModel:
    return tp.ObjectModel.from_mesh(trimesh.creation.box((0.06, 0.09, 0.14)).subdivide().subdivide())


@pytest.fixture(scope="module")
def can() -> tp.ObjectModel:
    return tp.ObjectModel.from_mesh(trimesh.creation.cylinder(radius=0.033, height=0.115, sections=64))


def test_the_covariance_covers_the_error(blob: tp.ObjectModel) -> None:
    squares = []
    for seed in range(40):
        X_PO = random_pose(seed)
        contacts = touch_surface(blob, X_PO, 10, np.random.default_rng(seed))
        estimate = tp.estimate_pose(blob, contacts, prior=tp.PosePrior(displaced(X_PO, seed, 0.005, 3.0)))
        off = error(estimate, X_PO)
        squares.append(off @ np.linalg.solve(estimate.best.covariance, off))
    # Six degrees of freedom: the mean of 40 is 6 +- 0.55; a factor of two either way is a wrong covariance.
    assert 3.0 < np.median(squares) < 12.0


def side_contacts(radius: float, angles: list[float], heights: list[float]) -> tp.Contacts:
    n_PC = np.array([[math.cos(a), math.sin(a), 0.0] for a in angles])
    return tp.Contacts(radius * n_PC + np.array([[0.0, 0.0, z] for z in heights]), n_PC)


def test_the_spin_and_slide_of_a_can_are_free(can: tp.ObjectModel) -> None:
    contacts = side_contacts(0.033, [0.0, 1.3, 2.9, 4.4], [0.02, -0.02, 0.01, -0.01])
    estimate = tp.estimate_pose(can, contacts, prior=tp.PosePrior(displaced(np.eye(3, 4), 1, 0.01, 5.0)))
    free = estimate.best.free_directions
    assert free.shape == (2, 6)
    np.testing.assert_allclose(free @ free.T, np.eye(2), atol=1e-9)
    # The spin about the can's axis, and the slide along it, lie in their span.
    for direction in (np.eye(6)[2], np.concatenate([np.zeros(3), estimate.best.X_PO.rotation().matrix()[:, 2]])):
        assert np.linalg.norm(determined_part(direction, free, can.size)) < 0.15


def test_the_slides_along_a_boxs_faces_are_free(box: tp.ObjectModel) -> None:
    # Two fingers on each of the faces +x and -x.
    p_PC = np.array([[0.03, 0.01, 0.02], [0.03, -0.02, -0.03], [-0.03, 0.02, 0.01], [-0.03, -0.01, -0.02]])
    n_PC = np.sign(p_PC[:, :1]) * np.eye(3)[:1]
    estimate = tp.estimate_pose(box, tp.Contacts(p_PC, n_PC), prior=tp.PosePrior(displaced(np.eye(3, 4), 2, 0.01, 5.0)))
    free = estimate.best.free_directions
    assert free.shape == (3, 6)
    R_PO = estimate.best.X_PO.rotation().matrix()
    for direction in (
        np.eye(6)[0],
        np.concatenate([np.zeros(3), R_PO[:, 1]]),
        np.concatenate([np.zeros(3), R_PO[:, 2]]),
    ):
        assert np.linalg.norm(determined_part(direction, free, box.size)) < 0.15


def test_nothing_is_free_where_the_pose_is_determined(blob: tp.ObjectModel) -> None:
    X_PO = random_pose(8)
    contacts = touch_surface(blob, X_PO, 12, np.random.default_rng(8))
    estimate = tp.estimate_pose(blob, contacts, prior=tp.PosePrior(displaced(X_PO, 8, 0.005, 3.0)))
    assert estimate.best.free_directions.shape == (0, 6)


def test_one_contact_is_enough_for_a_prior(blob: tp.ObjectModel) -> None:
    X_PO = random_pose(9)
    contacts = touch_surface(blob, X_PO, 1, np.random.default_rng(9))
    estimate = tp.estimate_pose(blob, contacts, prior=tp.PosePrior(displaced(X_PO, 9, 0.005, 3.0)))
    assert len(estimate.best.free_directions) >= 3
    assert rotation_angles(estimate.best.X_PO.rotation().matrix(), X_PO[:, :3]) < math.radians(20)


@pytest.mark.parametrize("with_prior", [True, False])
def test_nothing_hangs_on_the_last_digits_of_a_touch(blob: tp.ObjectModel, with_prior: bool) -> None:
    for seed in range(10):
        X_PO = random_pose(seed)
        generator = np.random.default_rng(seed)
        contacts = touch_surface(blob, X_PO, 3, generator)
        # In the middle of the steps that coordinates count in, so that the moved ones are in the same step.
        p_PC = np.round(contacts.p_PC * 2.0**30) / 2.0**30
        moved = p_PC + 1e-10 * generator.uniform(-1.0, 1.0, size=p_PC.shape)
        prior = tp.PosePrior(displaced(X_PO, seed, 0.005, 3.0)) if with_prior else None
        answers = [
            tp.estimate_pose(blob, tp.Contacts(p, contacts.n_PC), prior=prior).best.to_dict() for p in (p_PC, moved)
        ]
        assert answers[0] == answers[1]


def test_another_seed_weighs_the_same_modes_by_the_same_samples() -> None:
    """A pencil by three contacts, without a guess, has two ends: each seed of the search finds both."""
    pencil, changes = tp.ObjectModel.from_mesh(model_path("objects", "pencil.obj")), []
    for seed in range(5):
        contacts = touch_surface(pencil, random_pose(seed), 3, np.random.default_rng(seed))
        first, other = (tp.estimate_pose(pencil, contacts, seed=of_search) for of_search in (0, 1))
        changes.append(abs(first.best.probability - other.best.probability))
    assert np.count_nonzero(np.array(changes) < 0.001) >= 4


@pytest.mark.parametrize("sections", [16, 32])
def test_a_cylinder_of_few_faces_is_unsure_of_its_spin_alone(sections: int) -> None:
    """Its axis is found a little tilted; upside down it is the same pose all the same."""
    mesh = trimesh.creation.cylinder(0.034, 0.1, sections=sections)
    model = tp.ObjectModel.from_mesh(mesh, cache=False)
    assert sorted(symmetry.order for symmetry in model.symmetries) == [0, 2]
    for seed in range(6):
        p_OC, face = trimesh.sample.sample_surface(mesh, 8, seed=seed)
        best = tp.estimate_pose(model, tp.Contacts(p_OC, mesh.face_normals[face])).best
        assert len(best.free_directions) == 1
        assert abs(best.free_directions[0][2]) > 0.99
        assert np.sqrt(np.diag(best.covariance)[:2]).max() < 0.1


def test_contacts_that_must_be_as_told_and_fit_nowhere_are_not_explained() -> None:
    """Noise may seem larger than told, but not without end."""
    model, generator = tp.ObjectModel.from_mesh(model_path("objects", "spray_bottle.obj")), np.random.default_rng(0)
    told, statuses = [], []
    for seed in range(8):
        contacts = touch_surface(model, random_pose(seed), 6, np.random.default_rng(seed))
        told.append(tp.estimate_pose(model, contacts, outlier_probability=0.0))
        n_PC = generator.normal(size=(6, 3))
        nonsense = tp.Contacts(contacts.p_PC, n_PC / np.linalg.norm(n_PC, axis=1)[:, None])
        statuses.append(tp.estimate_pose(model, nonsense, outlier_probability=0.0).status)
    assert all(estimate.status != "no_solution" and estimate.noise_scale < 2.0 for estimate in told)
    assert statuses.count("no_solution") >= 7


def test_what_only_the_prior_says_is_as_sure_as_the_prior(blob: tp.ObjectModel) -> None:
    """Contacts say nothing of where an object is within ten micrometres."""
    contacts = touch_surface(blob, np.eye(3, 4), 5, np.random.default_rng(0))
    prior = tp.PosePrior(np.eye(3, 4), sigma_translation=1e-5, sigma_rotation=1e-4)
    best = tp.estimate_pose(blob, contacts, prior=prior).best
    variances = np.linalg.eigvalsh(best.covariance / np.outer(prior.sigmas, prior.sigmas))
    assert variances.min() > 0.65
    assert variances.max() < 1.5


def test_what_a_single_contact_says_of_an_object_does_not_depend_on_where_it_is(can: tp.ObjectModel) -> None:
    """Any place of any object may be touched: all of these poses must be found, and none that is out of touch."""
    for model in (can, *(tp.ObjectModel.from_mesh(model_path("objects", name)) for name in ("bust.obj", "mug.obj"))):
        touches = [touch_surface(model, random_pose(seed), 1, np.random.default_rng(seed)) for seed in range(16)]
        evidence = [tp.estimate_pose(model, contacts).log_evidence for contacts in touches]
        assert np.std(evidence) < 0.2


@pytest.mark.parametrize("surface_sigma", [0.0, 0.004])
def test_the_mass_of_one_contact_on_a_ball_is_that_of_an_integral_over_all_places(
    surface_sigma: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only the place of the ball's centre matters: its distance from the contact, and how far the normal is off."""
    radius, n_PC = 0.03, np.array([0.6, 0.0, 0.8])
    weighed: list[tuple[Posterior, float]] = []

    def weigh(modes: Modes, posterior: Posterior, generator: np.random.Generator) -> Modes:
        found = weigh_modes(modes, posterior, generator)
        weighed.append((posterior, found.log_mass))
        return found

    monkeypatch.setattr(inference, "weigh_modes", weigh)
    ball = tp.ObjectModel.from_sphere(radius, surface_sigma=surface_sigma)
    tp.estimate_pose(ball, tp.Contacts(radius * n_PC[None], n_PC[None]), outlier_probability=0.0)
    [(posterior, log_mass)] = weighed
    distance, angle = (np.linspace(0.0, most, 301)[1:] for most in (radius + 20.0 * posterior.sigma, np.pi))
    density = np.zeros((300, 300))
    for azimuth in np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False):
        across = np.cos(azimuth) * np.array([0.8, 0.0, -0.6]) + np.sin(azimuth) * np.array([0.0, 1.0, 0.0])
        inward = np.cos(angle)[:, None] * -n_PC + np.sin(angle)[:, None] * across
        p_PO = radius * n_PC + distance[:, None, None] * inward
        X_PO = make_poses(np.tile(np.eye(3), (p_PO.size // 3, 1, 1)), p_PO.reshape(-1, 3))
        cost = posterior.exact_cost(X_PO).reshape(300, 300)
        density += np.where(cost < cost.min() + posterior.params.sampling.most_excess_cost, np.exp(-cost), 0.0) / 8
    volume = 2.0 * np.pi * distance[:, None] ** 2 * np.sin(angle) * distance[0] * angle[0]
    # The ball's rotations change nothing; their volume is 8 pi^2.
    assert log_mass == pytest.approx(math.log(float((density * volume).sum()) * 8.0 * np.pi**2), abs=0.07)


@pytest.mark.parametrize("sigma_rotation", [0.1, 1000.0])
def test_a_prior_that_does_not_know_the_position_leaves_it_to_the_touch(sigma_rotation: float) -> None:
    """A pose that no contact holds would otherwise win by the volume that such a prior leaves it."""
    mug = tp.ObjectModel.from_mesh(model_path("objects", "mug.obj"))
    for seed in range(12):
        X_PO, generator = random_pose(seed), np.random.default_rng(seed)
        contacts = touch_surface(mug, X_PO, 1 + seed % 3, generator)
        hand = tp.HandGeometry(contacts.p_PC + 0.012 * contacts.n_PC, np.full(len(contacts), 0.009))
        prior = tp.PosePrior(displaced(X_PO, seed, 0.03, 5.0), 1000.0, sigma_rotation)
        estimate = tp.estimate_pose(mug, contacts, prior=prior, hand=hand)
        assert estimate.status != "no_solution"
        for hypothesis in estimate.hypotheses:
            assert np.abs(hypothesis.X_PO.translation() - X_PO[:, 3]).max() < 2.0 * mug.size
