import numpy as np
import pytest

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.objectives.nearest_point_contact import NearestPointContact
from tactopose_drake.core.poses import exp_so3, make_poses, retract
from tactopose_drake.errors import InvalidInputError

# The corner of a box: the floor z = 0 and the wall x = 0, one point a centimetre.
GRID = np.array([[i / 100, j / 100] for i in range(1, 11) for j in range(1, 11)])
FLOOR, WALL = np.insert(GRID, 2, 0.0, axis=1), np.insert(GRID, 0, 0.0, axis=1)
POINTS = np.concatenate([FLOOR, WALL])
NORMALS = np.repeat([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]], 100, axis=0)
IDENTITY = np.eye(3, 4)


def cost(contacts: Contacts, X_PO: np.ndarray = IDENTITY, **options: float) -> float:
    return float(NearestPointContact(POINTS, NORMALS, contacts, **options).cost(X_PO[None])[0])  # type: ignore[arg-type]


def test_distances_and_angles_add_up() -> None:
    turned = np.array([0.0, np.sin(0.3), -np.cos(0.3)])
    contacts = Contacts(np.array([[0.053, 0.05, -0.004], [0.07, 0.07, 0.0]]), np.array([[0.0, 0.0, -1.0], turned]))
    assert cost(contacts, normal_weight=0.5) == pytest.approx(0.005 + 0.5 * (1.0 - np.cos(0.3)))


def test_the_normal_chooses_among_the_neighbours() -> None:
    # Nearest to the floor, but the normal is the wall's.
    contacts = Contacts(np.array([[0.011, 0.05, 0.006]]), np.array([[-1.0, 0.0, 0.0]]))
    assert cost(contacts) == pytest.approx(np.hypot(0.011, 0.004))
    assert cost(contacts, neighbours=1) == pytest.approx(np.hypot(0.001, 0.006) + 0.2)


def test_moving_everything_changes_nothing() -> None:
    generator = np.random.default_rng(0)
    n_PC = generator.normal(size=(4, 3))
    n_PC /= np.linalg.norm(n_PC, axis=1, keepdims=True)
    p_PC = generator.uniform(0.0, 0.1, size=(4, 3))
    X = make_poses(exp_so3(np.array([0.5, -1.0, 2.0])), np.array([0.1, 0.2, 0.3]))
    moved = Contacts(p_PC @ X[:, :3].T + X[:, 3], n_PC @ X[:, :3].T)
    assert cost(moved, X) == pytest.approx(cost(Contacts(p_PC, n_PC)))


def test_poses_come_in_batches() -> None:
    contacts = Contacts(np.array([[0.053, 0.05, -0.004], [0.0, 0.04, 0.02]]), np.eye(3)[[2, 0]])
    objective = NearestPointContact(POINTS, NORMALS, contacts)
    X_PO = retract(IDENTITY, np.random.default_rng(1).normal(size=(5, 6)) * 0.1)
    assert objective.residuals(X_PO).shape == (5, 2)
    np.testing.assert_allclose(objective.cost(X_PO), [objective.cost(X[None])[0] for X in X_PO])


def test_it_needs_normals() -> None:
    with pytest.raises(InvalidInputError, match="contacts must have normals n_PC"):
        cost(Contacts(np.zeros((1, 3))))
