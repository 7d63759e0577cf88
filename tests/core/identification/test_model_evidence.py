import math

import numpy as np
import pytest
import trimesh

from tactopose_drake.core.evidence.contact_doubt import USUAL
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.identification.model_evidence import log_evidence
from tactopose_drake.core.poses import random_rotations
from tactopose_drake.core.posterior.alike_modes import indistinct_images
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface
from tactopose_drake.estimation.estimate import estimate_pose
from tests.core.meshes import arrays, ball, shape_poor_in_symmetry

RADIUS, SIGMA = 0.04, 0.002
# What sampling leaves: a few standard deviations of its logarithm.
NOISE = 0.5


@pytest.fixture(scope="module")
def sphere() -> ObjectModel:
    return ObjectModel.from_mesh(ball(RADIUS, 4), spacing=0.002, cache=False)


@pytest.fixture(scope="module")
def cuboid() -> trimesh.Trimesh:
    return trimesh.creation.box((0.1, 0.06, 0.04))


def make(mesh: trimesh.Trimesh, **options: object) -> ObjectModel:
    return ObjectModel.from_mesh(mesh, spacing=0.002, cache=False, **options)  # type: ignore[arg-type]


def test_of_a_ball_it_is_the_integral_over_the_places_of_its_centre(sphere: ObjectModel) -> None:
    directions = np.array([[1, 0, 0], [0, 1, 0.2], [-0.5, -0.4, 0.8], [0.1, -0.9, -0.5], [-0.6, 0.5, -0.6]])
    p_PC = RADIUS * directions / np.linalg.norm(directions, axis=1, keepdims=True) + np.array([0.1, -0.2, 0.05])
    p_PC += np.random.default_rng(0).normal(size=p_PC.shape) * SIGMA
    # The integral knows no false contact, but noise that may be larger than told.
    found = estimate_pose(sphere, Contacts(p_PC, sigma_position=SIGMA), outlier_probability=0.0).log_evidence

    step = np.linspace(-0.012, 0.012, 49)
    centers = np.array([0.1, -0.2, 0.05]) + np.stack(np.meshgrid(step, step, step, indexing="ij"), axis=-1)
    distance = np.linalg.norm(p_PC - centers[..., None, :], axis=-1) - RADIUS
    energy = 0.5 * np.sum(distance**2, axis=-1) / SIGMA**2
    likelihood = sum(p * np.exp(-energy / 2.0**s) / 2.0 ** (0.5 * s * len(p_PC)) for s, _, p in USUAL.doublings)
    integral = likelihood.sum() * (step[1] - step[0]) ** 3 / USUAL.doublings[0][2]
    expected = np.log(8.0 * np.pi**2 * integral) - 5.0 * np.log(sphere.area)
    assert found == pytest.approx(expected, abs=NOISE)


def test_it_does_not_depend_on_whether_the_symmetries_are_known(cuboid: trimesh.Trimesh) -> None:
    known, unknown = make(cuboid), make(cuboid, symmetry="none")
    assert len(known.symmetry_poses) == 4
    differences = []
    for seed in range(4):
        generator = np.random.default_rng(seed)
        X_PO = np.column_stack([random_rotations(generator, 1)[0], [0.0, 0.1, 0.0]])
        contacts = touch_surface(known, X_PO, 6, generator)
        differences.append(estimate_pose(known, contacts).log_evidence - estimate_pose(unknown, contacts).log_evidence)
    # Were the images of one mode counted once, it would be log 4 off.
    assert abs(np.median(differences)) < NOISE


def test_images_that_the_touch_tells_apart_count_once() -> None:
    """A box that is a little narrower at its top looks about the same upside down, but not to sensors as exact."""
    tapered = trimesh.creation.box((0.16, 0.2, 0.25))
    vertices = np.array(tapered.vertices)
    vertices[vertices[:, 2] > 0.0, :2] *= 0.99
    mesh, sigma = trimesh.Trimesh(vertices, tapered.faces), 0.0002
    known, unknown = make(mesh), make(mesh, symmetry="none")
    assert len(indistinct_images(known, sigma)) == 2 < len(known.symmetry_poses)
    differences = []
    for seed in range(4):
        generator = np.random.default_rng(seed)
        X_PO = np.column_stack([random_rotations(generator, 1)[0], [0.0, 0.1, 0.0]])
        contacts = touch_surface(known, X_PO, 5, generator, spread=True, sigma_position=sigma)
        differences.append(estimate_pose(known, contacts).log_evidence - estimate_pose(unknown, contacts).log_evidence)
    # Were they counted once by what is found and once more by the symmetries, it would be log 2 off.
    assert abs(np.median(differences)) < 0.5 * math.log(2.0)


def test_moving_the_object_in_its_own_frame_leaves_it() -> None:
    mesh = shape_poor_in_symmetry()
    moved = mesh.copy()
    moved.apply_transform(trimesh.transformations.euler_matrix(0.4, -1.0, 2.0) + np.eye(4, k=3) * 0.3)
    a, b = make(mesh), make(moved)
    generator = np.random.default_rng(3)
    contacts = touch_surface(a, np.eye(3, 4), 6, generator)
    assert estimate_pose(a, contacts).log_evidence == pytest.approx(estimate_pose(b, contacts).log_evidence, abs=NOISE)


def test_each_contact_counts_by_the_area_that_it_could_have_been_on(sphere: ObjectModel) -> None:
    vertices, faces = arrays(ball(2.0 * RADIUS, 4))
    large = make(trimesh.Trimesh(vertices, faces, process=False))
    for count in (1, 4):
        evidence = Evidence(Contacts(np.random.default_rng(0).normal(size=(count, 3))))
        difference = log_evidence(sphere, evidence, 0.0) - log_evidence(large, evidence, 0.0)
        assert difference == pytest.approx(count * np.log(4.0), rel=1e-3)


def test_a_prior_tells_the_images_apart(cuboid: trimesh.Trimesh) -> None:
    model, contacts = make(cuboid), Contacts(np.zeros((1, 3)))
    without = log_evidence(model, Evidence(contacts), 0.0)
    prior = GaussianPrior(np.eye(3, 4), sigma_translation=0.03)
    assert without - log_evidence(model, Evidence(contacts, prior), 0.0) == pytest.approx(np.log(4.0))


def test_the_kept_hypotheses_have_their_share_of_it(cuboid: trimesh.Trimesh) -> None:
    model = make(cuboid, symmetry="none")
    contacts = touch_surface(model, np.eye(3, 4), 5, np.random.default_rng(1))
    estimate = estimate_pose(model, contacts)
    assert len(estimate.hypotheses) > 1
    kept = estimate.keep([i == 0 for i in range(len(estimate.hypotheses))])
    assert kept.log_evidence == pytest.approx(estimate.log_evidence + np.log(estimate.best.probability))
