"""Poses drawn from all that a single contact leaves, and the density that they have."""

import numpy as np
import pytest
import trimesh

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.poses import increments_between, make_poses, random_rotations, retract, right_jacobian
from tactopose_drake.core.posterior.posterior import make_posterior
from tactopose_drake.core.posterior.single_contact import SingleContact
from tactopose_drake.core.searches.pose_problem import make_problem
from tactopose_drake.core.shape.object_model import ObjectModel

EDGES = np.array([0.04, 0.03, 0.05])
CONTACT = Contacts([[0.1, -0.2, 0.05]], [[0.0, 0.6, 0.8]], sigma_position=0.002, sigma_normal=0.15)


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    return ObjectModel.from_mesh(trimesh.creation.box(EDGES), cache=False)


@pytest.fixture(scope="module")
def can() -> ObjectModel:
    return ObjectModel.from_mesh(trimesh.creation.cylinder(0.03, 0.1, sections=256), cache=False)


def anywhere(count: int, model: ObjectModel) -> tuple[np.ndarray, float]:
    """Poses (count, 3, 4) in any orientation that put the contact anywhere near an object, and the volume they fill."""
    generator, wide = np.random.default_rng(0), np.ptp(model.vertices, axis=0) + 0.025
    R_PO = random_rotations(generator, count)
    p_OC = wide * (generator.random((count, 3)) - 0.5)
    X_PO = make_poses(R_PO, CONTACT.p_PC - np.einsum("bij,bj->bi", R_PO, p_OC))
    return X_PO, 8.0 * np.pi**2 * float(np.prod(wide))


def test_the_density_is_that_of_the_draws(box: ObjectModel) -> None:
    contact = SingleContact(box, CONTACT)
    X_PO, volume = anywhere(400_000, box)
    density = contact.density(X_PO)
    assert density.mean() * volume == pytest.approx(1.0, rel=0.06)
    drawn, scale = contact.sample(20_000, np.random.default_rng(1))
    assert len(drawn) == scale == 20_000
    for power in (0.5, 1.0):
        expected = np.mean(density ** (1.0 + power)) * volume
        assert np.mean(contact.density(drawn) ** power) == pytest.approx(expected, rel=0.06)


def test_the_draws_touch_the_box_everywhere_and_in_any_spin(box: ObjectModel) -> None:
    X_PO, _ = SingleContact(box, CONTACT).sample(6000, np.random.default_rng(1))
    assert CONTACT.n_PC is not None
    n_OC = CONTACT.n_PC[0] @ X_PO[:, :, :3]
    face = 2 * np.abs(n_OC).argmax(axis=1) + (
        np.take_along_axis(n_OC, np.abs(n_OC).argmax(axis=1)[:, None], 1)[:, 0] > 0
    )
    area = np.repeat(np.prod(EDGES) / EDGES, 2)
    np.testing.assert_allclose(np.bincount(face) / 6000, area / area.sum(), atol=0.02)
    p_OC = np.einsum("bji,bj->bi", X_PO[:, :, :3], CONTACT.p_PC - X_PO[:, :, 3])
    distance = np.abs(box.grid.distance(p_OC))
    assert np.sqrt(np.mean(distance**2)) == pytest.approx(1.5 * 0.002, rel=0.1)
    # The turn about the normal, of the object's axes that lie most across it.
    across = np.cross(CONTACT.n_PC[0], [1.0, 0.0, 0.0])
    side = X_PO[face >= 2, :, 0]
    spin = np.arctan2(side @ across, side[:, 0])
    np.testing.assert_allclose(np.abs(np.mean(np.exp(1j * spin))), 0.0, atol=0.05)


def test_without_a_prior_the_density_is_integrated_over_turns_about_a_continuous_axis(can: ObjectModel) -> None:
    X_PO, volume = anywhere(200_000, can)
    density = SingleContact(can, CONTACT).density(X_PO)
    assert density.mean() * volume == pytest.approx(2.0 * np.pi, rel=0.06)
    with_turns = SingleContact(can, CONTACT, GaussianPrior(np.eye(3, 4), 100.0, 100.0)).density(X_PO)
    np.testing.assert_allclose(2.0 * np.pi * with_turns, density, rtol=2e-3)


def near_a_touch(box: ObjectModel, *, sigma_rotation: float = 0.3) -> GaussianPrior:
    """A prior whose mean is some 25 mm and 20 degrees off a pose that the contact allows."""
    X_PO, _ = SingleContact(box, CONTACT).sample(1, np.random.default_rng(3))
    mean = retract(X_PO[0], np.array([0.2, -0.25, 0.1, 0.02, -0.01, 0.01]))
    return GaussianPrior(mean, sigma_translation=0.02, sigma_rotation=sigma_rotation)


@pytest.mark.parametrize("sigma_rotation", [0.1, 0.3, 1.0])
def test_near_a_prior_the_draws_have_the_density_times_the_prior(box: ObjectModel, sigma_rotation: float) -> None:
    prior = near_a_touch(box, sigma_rotation=sigma_rotation)
    contact, anywhere = SingleContact(box, CONTACT, prior), SingleContact(box, CONTACT)
    drawn, scale = contact.sample(80_000, np.random.default_rng(1))
    assert len(drawn) == 10_000
    # Poses drawn from the prior alone, with their density with respect to the poses' volume.
    u = np.random.default_rng(0).normal(size=(400_000, 6)) * prior.sigmas
    u = u[np.linalg.norm(u[:, :3], axis=1) < np.pi]
    by_prior = retract(np.broadcast_to(prior.mean, (len(u), 3, 4)), u)
    volume = (2.0 * np.pi) ** 3 * np.prod(prior.sigmas) * np.linalg.det(right_jacobian(u[:, :3]))
    weight = anywhere.density(by_prior) * volume * len(u) / 400_000
    assert scale * np.mean(weight) == pytest.approx(len(drawn), rel=0.08)
    share = weight / weight.sum()
    expected, own = share @ u, increments_between(prior.mean, drawn)
    deviation = np.sqrt(share @ np.square(u - expected))
    np.testing.assert_allclose(own.mean(axis=0) / deviation, expected / deviation, atol=0.1)
    np.testing.assert_allclose(own.std(axis=0), deviation, rtol=0.1)


def test_there_are_no_draws_near_a_prior_that_the_contact_rules_out_or_that_is_narrower_than_its_noise(
    box: ObjectModel,
) -> None:
    near = near_a_touch(box)
    far = GaussianPrior(near.mean + 1.0 * np.eye(3, 4, 3), near.sigma_translation, near.sigma_rotation)
    narrow = GaussianPrior(near.mean, 1e-5, 1e-4)
    for prior in (far, narrow):
        contact = SingleContact(box, CONTACT, prior)
        drawn, scale = contact.sample(4096, np.random.default_rng(1))
        assert drawn.shape == (0, 3, 4)
        assert scale == 0.0


def test_only_a_single_contact_with_a_normal_is_drawn_from(box: ObjectModel) -> None:
    def is_drawn_from(evidence: Evidence, model: ObjectModel = box) -> bool:
        return make_posterior(model, evidence, make_problem(model, evidence)).single_contact is not None

    assert is_drawn_from(Evidence(CONTACT))
    assert not is_drawn_from(Evidence(Contacts(CONTACT.p_PC)))
    assert is_drawn_from(Evidence(CONTACT, prior=GaussianPrior(np.eye(3, 4))))
    two = Contacts([[0.1, -0.2, 0.05], [0.12, -0.2, 0.05]], [[0.0, 0.6, 0.8]] * 2)
    assert not is_drawn_from(Evidence(two))
