"""The poses at which a contact lies on the object, by samples of them."""

import numpy as np
import pytest
import trimesh

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.poses import increments_between
from tactopose_drake.core.searches.touch_space import TouchSpace
from tactopose_drake.core.shape.object_model import ObjectModel
from tests.core.models import brick


def test_it_is_as_wide_as_its_samples_about_the_surface_s_middle() -> None:
    model, generator = brick(0.06, 0.09, 0.13), np.random.default_rng(0)
    assert np.linalg.norm(model.samples.points.mean(axis=0)) < 1e-3
    space = TouchSpace(model, Contacts(np.array([[0.1, -0.2, 0.3]])))
    u = increments_between(space.center, space.sample(generator, 20_000))
    np.testing.assert_allclose(np.mean(u**2, axis=0) * np.diag(space.information), np.ones(6), rtol=0.05)


@pytest.mark.parametrize("away", [0.0, 0.07])
def test_no_pose_that_touches_is_out_of_reach_and_some_are_nearly(away: float) -> None:
    mesh, generator = trimesh.creation.box((0.02, 0.02, 0.2)), np.random.default_rng(1)
    mesh.apply_translation([away, 0.0, 0.0])
    model = ObjectModel.from_mesh(mesh, cache=False)
    contacts = Contacts(0.02 * generator.normal(size=(4, 3)) + np.array([0.3, 0.0, 0.1]))
    space = TouchSpace(model, contacts)
    turn, way = space.reach
    u = increments_between(space.center, space.sample(generator, 20_000))
    farthest = np.linalg.norm(u[:, 3:], axis=1).max()
    assert turn == np.pi
    assert 0.8 * way < farthest <= way
