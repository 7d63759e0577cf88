import numpy as np
import pytest
import trimesh

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.poses import compose, exp_so3, identity_poses, make_poses, random_rotations, retract
from tactopose_drake.core.posterior.metrics import touch_errors, truth_errors
from tactopose_drake.core.shape.object_model import ObjectModel

EDGE = 0.08
# One point on each of three faces of a cube about the origin, 1 cm and more from its edges, and the normals there.
POINTS = np.array([[0.04, 0.01, -0.02], [-0.02, 0.04, 0.01], [0.01, -0.015, -0.04]])
NORMALS = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]])


@pytest.fixture(scope="module")
def cube() -> ObjectModel:
    return ObjectModel.from_mesh(trimesh.creation.box((EDGE, EDGE, EDGE)), symmetry="none", cache=False)


def some_pose(seed: int) -> np.ndarray:
    generator = np.random.default_rng(seed)
    return make_poses(random_rotations(generator, 1), generator.normal(size=(1, 3)))[0]


def touch(X_PO: np.ndarray) -> Contacts:
    return Contacts(POINTS @ X_PO[:, :3].T + X_PO[:, 3], NORMALS @ X_PO[:, :3].T)


def test_the_true_pose_has_no_error(cube: ObjectModel) -> None:
    X_PO = some_pose(1)
    MDTS, MATN = touch_errors(cube, touch(X_PO), X_PO[None])
    RME, MAE = truth_errors(POINTS, NORMALS, X_PO, X_PO[None])
    np.testing.assert_allclose([MDTS, RME], 0.0, atol=1e-7)
    np.testing.assert_allclose([MATN, MAE], 0.0, atol=1e-6)


def test_distances_are_means_over_the_contacts_whatever_their_side(cube: ObjectModel) -> None:
    # Moved by +2 mm along x: the contact on the +x face comes to lie 2 mm inside, the others slide along their faces.
    moved = retract(np.eye(3, 4), np.array([[0, 0, 0, 0.002, 0, 0], [0, 0, 0, -0.004, 0, 0]]))
    errors = touch_errors(cube, touch(np.eye(3, 4)), moved)
    np.testing.assert_allclose(errors.MDTS, [0.002 / 3, 0.004 / 3], atol=1e-7)
    np.testing.assert_allclose(errors.MATN, 0.0, atol=1e-6)
    truth = truth_errors(POINTS, NORMALS, np.eye(3, 4), moved)
    np.testing.assert_allclose(truth.RME, [0.002, 0.004], atol=1e-12)
    np.testing.assert_allclose(truth.MAE, 0.0, atol=1e-12)


@pytest.mark.parametrize("angle", [1e-6, 0.1])
def test_a_turn_tilts_the_normals_across_its_axis(cube: ObjectModel, angle: float) -> None:
    turned = retract(np.eye(3, 4), np.array([[angle, 0, 0, 0, 0, 0]]))
    errors = touch_errors(cube, touch(np.eye(3, 4)), turned)
    assert errors.MATN[0] == pytest.approx(2 * angle / 3, abs=1e-7)
    truth = truth_errors(POINTS, NORMALS, np.eye(3, 4), turned)
    assert truth.MAE[0] == pytest.approx(2 * angle / 3, rel=1e-9)
    ways = 2 * np.sin(angle / 2) * np.linalg.norm(POINTS[:, 1:], axis=1)
    assert truth.RME[0] == pytest.approx(ways.mean(), rel=1e-9)


def test_opposite_normals_are_half_a_turn_apart() -> None:
    half_turn = make_poses(exp_so3(np.array([[np.pi, 0.0, 0.0]])), np.zeros((1, 3)))
    truth = truth_errors(POINTS, NORMALS, np.eye(3, 4), half_turn)
    assert truth.MAE[0] == pytest.approx(2 * np.pi / 3)


def test_a_slid_contact_agrees_with_the_surface_but_not_with_the_truth(cube: ObjectModel) -> None:
    contacts = Contacts(POINTS[:1], NORMALS[:1])
    slid = retract(np.eye(3, 4), np.array([[0, 0, 0, 0, 0.01, 0]]))
    assert touch_errors(cube, contacts, slid).MDTS[0] == pytest.approx(0.0, abs=1e-7)
    assert truth_errors(POINTS[:1], NORMALS[:1], np.eye(3, 4), slid).RME[0] == pytest.approx(0.01)


def test_errors_are_the_same_in_any_palm_frame(cube: ObjectModel) -> None:
    X_PO, other_palm = some_pose(2), some_pose(3)
    guesses = retract(np.broadcast_to(X_PO, (4, 3, 4)), np.random.default_rng(0).normal(size=(4, 6)) * 0.02)
    there, there_true = compose(other_palm, guesses), compose(other_palm, X_PO)
    here_touch, there_touch = touch_errors(cube, touch(X_PO), guesses), touch_errors(cube, touch(there_true), there)
    np.testing.assert_allclose(here_touch, there_touch, atol=1e-9)
    here_truth = truth_errors(POINTS, NORMALS, X_PO, guesses)
    np.testing.assert_allclose(here_truth, truth_errors(POINTS, NORMALS, there_true, there), atol=1e-9)


def test_without_normals_there_is_no_angle_to_them(cube: ObjectModel) -> None:
    errors = touch_errors(cube, Contacts(POINTS), identity_poses(2))
    assert errors.MDTS.shape == (2,)
    assert np.isnan(errors.MATN).all()
