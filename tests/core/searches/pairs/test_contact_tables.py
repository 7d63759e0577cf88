"""What the coarse judgement of poses knows of a contact's errors."""

import numpy as np
import pytest

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.searches.pairs.contact_tables import contact_table
from tests.core.models import brick


@pytest.mark.parametrize("has_normals", [True, False])
def test_a_contact_is_as_unsure_as_its_sensor_the_poses_and_the_voxel_that_stands_for_its_place(
    has_normals: bool,
) -> None:
    """A distance in steps, by the middle of the voxel in which the contact is; normals by themselves."""
    field, generator = brick(0.06, 0.09, 0.13).coarse_field, np.random.default_rng(0)
    p_PC, n_PC = generator.normal(size=(3, 3)), np.array([[1.0, 0.0, 0.0], [0.0, 0.6, 0.8], [0.48, 0.64, 0.6]])
    sigmas, turns = np.array([0.0009, 0.002, 0.004]), np.array([0.05, 0.1, 0.2])
    contacts = Contacts(p_PC, n_PC if has_normals else None, sigma_position=sigmas, sigma_normal=turns)
    table = contact_table(field, contacts, 0.003, 0.15)
    np.testing.assert_array_equal(table[:, :3], p_PC)
    by_voxel = np.mean((n_PC @ generator.uniform(-0.5, 0.5, (3, 200_000)) * field.spacing) ** 2, axis=1)
    variance = sigmas**2 + 0.003**2 + by_voxel
    np.testing.assert_allclose(table[:, 6] * (0.001 / field.step) ** 2, 0.001**2 / variance, rtol=0.01)
    np.testing.assert_allclose(table[:, 7], has_normals / (turns**2 + 0.15**2))
    np.testing.assert_array_equal(table[:, 3:6], n_PC if has_normals else np.zeros((3, 3)))
