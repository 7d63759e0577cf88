import numpy as np
import pytest

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.objectives.point_cloud_contact import PointCloudContact
from tactopose_drake.core.poses import retract
from tactopose_drake.errors import InvalidInputError

# The floor z = 0 of a box, one point a centimetre, and its side x = 0.
FLOOR = np.array([[i / 100, j / 100, 0.0] for i in range(1, 11) for j in range(1, 11)])
SIDE = np.array([[0.0, j / 100, k / 100] for j in range(1, 11) for k in range(1, 11)])
POINTS = np.concatenate([FLOOR, SIDE])
NORMALS = np.concatenate([np.tile([0.0, 0.0, -1.0], (100, 1)), np.tile([-1.0, 0.0, 0.0], (100, 1))])
IDENTITY = np.eye(3, 4)


def test_the_distance_is_squared_to_the_nearest_point() -> None:
    contacts = Contacts([[0.053, 0.05, -0.004]])
    objective = PointCloudContact(POINTS, NORMALS, contacts, IDENTITY)
    assert objective.residuals(IDENTITY[None])[0, 0] == pytest.approx(0.003**2 + 0.004**2)


def test_the_normal_chooses_the_face() -> None:
    # Nearest to the floor, but the normal is the side's.
    contacts = Contacts([[0.011, 0.05, 0.006]], [[-1.0, 0.0, 0.0]])
    weight = 20e-4
    with_normal = PointCloudContact(POINTS, NORMALS, contacts, IDENTITY, normal_weight=weight)
    assert with_normal.residuals(IDENTITY[None])[0, 0] == pytest.approx(0.011**2 + 0.004**2)
    only_distance = PointCloudContact(POINTS, NORMALS, contacts, IDENTITY)
    assert only_distance.residuals(IDENTITY[None])[0, 0] == pytest.approx(0.001**2 + 0.006**2)


def test_only_the_neighbourhood_of_the_guess_counts() -> None:
    contacts = Contacts([[0.1, 0.1, -0.01]])
    guess = retract(IDENTITY, np.array([0.0, 0.0, 0.0, 0.09, 0.09, 0.0]))
    objective = PointCloudContact(POINTS, NORMALS, contacts, guess, neighbours=4)
    # At the identity the contact is at the far corner, but its points are those near the first guess.
    assert np.sqrt(objective.residuals(IDENTITY[None])[0, 0]) > 0.1


def test_the_forward_difference_is_the_derivative() -> None:
    contacts = Contacts([[0.052, 0.05, -0.01], [0.031, 0.022, -0.02]], [[0.0, 0.0, -1.0], [0.0, 0.6, -0.8]])
    objective = PointCloudContact(POINTS, NORMALS, contacts, IDENTITY, normal_weight=20e-4)
    _, jacobian = objective.residuals_and_jacobian(IDENTITY[None])
    # d ||q - s||^2 / dv_z = -2 (q - s)_z for a motion of the object along z.
    np.testing.assert_allclose(jacobian[0, :, 5], [0.02, 0.04], atol=1e-5)
    assert objective.cost(IDENTITY[None])[0] == pytest.approx(0.5 * np.sum(objective.residuals(IDENTITY[None]) ** 2))


def test_a_normal_weight_needs_normals() -> None:
    with pytest.raises(InvalidInputError, match="contacts must have normals n_PC"):
        PointCloudContact(POINTS, NORMALS, Contacts([[0.0, 0.0, 0.0]]), IDENTITY, normal_weight=1.0)
