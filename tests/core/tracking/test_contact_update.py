import dataclasses
import math

import numpy as np
import pytest
import trimesh

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.poses import exp_so3, increments_between, make_poses, random_rotations, retract
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.contact_errors import BiasModel
from tactopose_drake.core.tracking.contact_update import ContactUpdate, update_with_contacts
from tactopose_drake.core.tracking.tracked_modes import TrackedModes
from tactopose_drake.core.tracking.tracker_params import ContactUpdateParams, PoseTrackerParams
from tests.core.tracking.boxes import SIGMA_NORMAL, SIGMA_POSITION, draw_biases, make_box, n_OC, p_OC, read, touch

CALIBRATION = BiasModel((0.0005, math.radians(2.5)), (0.0, 0.0))
NOISE_ALONE = BiasModel((1e-6, 1e-6), (0.0, 0.0))
FRAMES = 60
EVEN = np.zeros((1, 6, 2))  # surfaces without roughness


def update_modes(model, contacts, source, bias, X, P, C, roughness) -> ContactUpdate:  # type: ignore[no-untyped-def]
    """Modes at X of covariances P and C, updated with contacts whose biases are as told."""
    params = PoseTrackerParams(
        calibration_position=bias.calibration[0],
        calibration_normal_deg=math.degrees(bias.calibration[1]),
        surface_position=bias.surface[0],
        surface_normal_deg=math.degrees(bias.surface[1]),
    )
    modes = TrackedModes.independent(X, P, roughness.shape[1])
    modes = dataclasses.replace(modes, cross_covariance=C, roughness=roughness)
    names = tuple(map(str, range(roughness.shape[1])))
    return update_with_contacts(model, params, read(contacts, source, names, params), modes)


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    return make_box()


def filter_frames(box, generator, X_PO, bias, bias_model=CALIBRATION, frames=FRAMES):  # type: ignore[no-untyped-def]
    """The pose and covariance after frames of one grasp, from a guess a few millimetres off."""
    X = retract(X_PO, generator.normal(size=(1, 6)) * np.repeat([0.05, 0.005], 3))
    P, C = np.diag(np.repeat([0.05**2, 0.005**2], 3))[None], np.zeros((1, 6, 36))
    source = np.arange(6)
    for _ in range(frames):
        update = update_modes(
            box, touch(X_PO, generator, bias, bias_model.calibration), source, bias_model, X, P, C, EVEN
        )
        X, P, C = update.X_PO, update.covariance, update.cross_covariance
    return X[0], P[0]


def expected_covariance(frames: int, bias_model: BiasModel) -> np.ndarray:
    """From nothing known: that of least squares with contacts of covariance B + R / N, at the identity."""
    information = np.zeros((6, 6))
    for p, n in zip(p_OC, n_OC, strict=True):
        row = -np.concatenate([np.cross(p, n), n])  # of the distance; the bias moves the contact as the object does
        across = np.cross(np.eye(3), n)
        variances = [
            part**2 + (total**2 - part**2) / frames
            for part, total in zip(bias_model.calibration, (SIGMA_POSITION, SIGMA_NORMAL), strict=True)
        ]
        information += np.outer(row, row) / variances[0]
        information[:3, :3] += across @ across.T / variances[1]
    return np.linalg.inv(information)


@pytest.mark.parametrize("frames", [10, 60])
@pytest.mark.parametrize("bias_model", [CALIBRATION, NOISE_ALONE], ids=["calibration", "noise alone"])
def test_frames_of_one_grasp_leave_the_lasting_part(box: ObjectModel, frames: int, bias_model: BiasModel) -> None:
    contacts = Contacts(p_OC, n_OC, sigma_position=SIGMA_POSITION, sigma_normal=SIGMA_NORMAL)
    X, P, C = np.eye(3, 4)[None], np.diag(np.repeat([0.5**2, 0.05**2], 3))[None], np.zeros((1, 6, 36))
    for _ in range(frames):
        update = update_modes(box, contacts, np.arange(6), bias_model, X, P, C, EVEN)
        X, P, C = update.X_PO, update.covariance, update.cross_covariance
    expected = expected_covariance(frames, bias_model)
    scale = np.sqrt(np.diag(expected))
    # The guess, and what the box's edges leave of a regression, are a few per cent.
    np.testing.assert_allclose(np.sqrt(np.diag(P[0])), scale, rtol=0.1)
    np.testing.assert_allclose(P[0] / np.outer(scale, scale), expected / np.outer(scale, scale), atol=0.2)


@pytest.mark.parametrize("bias_model", [CALIBRATION, NOISE_ALONE], ids=["calibration", "noise alone"])
def test_the_errors_are_those_that_the_covariance_says(box: ObjectModel, bias_model: BiasModel) -> None:
    squares, errors, said = [], [], []
    for seed in range(40):
        generator = np.random.default_rng(seed)
        X_PO = make_poses(random_rotations(generator, 1), 0.05 * generator.normal(size=(1, 3)))[0]
        X, P = filter_frames(box, generator, X_PO, draw_biases(generator, *bias_model.calibration), bias_model, 30)
        u = increments_between(X, X_PO)
        squares.append(u @ np.linalg.solve(P, u))
        errors.append(u[3:] @ u[3:])
        said.append(np.trace(P[3:, 3:]))
    # The mean of 40 chi-squares of six dimensions is 6 with a standard deviation of 0.55.
    assert 4.2 < np.mean(squares) < 7.8
    assert np.sqrt(np.mean(errors)) == pytest.approx(np.sqrt(np.mean(said)), rel=0.25)


def test_taking_the_calibration_for_noise_would_be_overconfident(box: ObjectModel) -> None:
    """What the biases are for: without them the same frames promise far too much."""
    squares = []
    for seed in range(10):
        generator = np.random.default_rng(seed)
        X_PO = make_poses(random_rotations(generator, 1), np.zeros((1, 3)))[0]
        bias = draw_biases(generator, *CALIBRATION.calibration)
        X = retract(X_PO, np.zeros((1, 6)))
        P, C = np.diag(np.repeat([0.05**2, 0.005**2], 3))[None], np.zeros((1, 6, 36))
        for _ in range(40):
            contacts = touch(X_PO, generator, bias, CALIBRATION.calibration)
            update = update_modes(box, contacts, np.arange(6), NOISE_ALONE, X, P, C, EVEN)
            X, P, C = update.X_PO, update.covariance, update.cross_covariance
        u = increments_between(X[0], X_PO)
        squares.append(u @ np.linalg.solve(P[0], u))
    assert np.mean(squares) > 30.0


def test_another_order_of_the_contacts_changes_nothing(box: ObjectModel) -> None:
    generator = np.random.default_rng(3)
    X_PO = make_poses(random_rotations(generator, 1), np.zeros((1, 3)))
    contacts = touch(X_PO[0], generator)
    P, C = np.diag(np.repeat([0.05**2, 0.005**2], 3))[None], np.zeros((1, 6, 36))
    order = generator.permutation(6)
    swapped = Contacts(
        contacts.p_PC[order], contacts.n_PC[order], sigma_position=SIGMA_POSITION, sigma_normal=SIGMA_NORMAL
    )
    one = update_modes(box, contacts, np.arange(6), CALIBRATION, X_PO, P, C, EVEN)
    other = update_modes(box, swapped, order, CALIBRATION, X_PO, P, C, EVEN)
    np.testing.assert_allclose(one.X_PO, other.X_PO, atol=1e-9)
    np.testing.assert_allclose(one.cross_covariance, other.cross_covariance, rtol=1e-5, atol=1e-10)


@pytest.mark.parametrize("seed", [0, 4, 7])
def test_what_is_regressed_beside_the_surface_gives_way_to_the_minimum(box: ObjectModel, seed: int) -> None:
    """Contacts 1.5 mm from edges, over which the spread of the guess reaches."""
    points = p_OC.copy()
    points[2:, 0] = [0.0285, -0.0285, 0.0285, 0.0285]
    contacts = Contacts(points, n_OC, sigma_position=SIGMA_POSITION, sigma_normal=SIGMA_NORMAL)
    spread = np.repeat([0.1, 0.008], 3)
    X = retract(np.eye(3, 4)[None], 0.5 * spread * np.random.default_rng(seed).normal(size=(1, 6)))
    modes, cost = TrackedModes.independent(X, np.diag(spread**2)[None], 6), {}
    for as_good in (1e-9, 0.3, 1e9):
        params = PoseTrackerParams(contact_update=ContactUpdateParams(as_good=as_good))
        update = update_with_contacts(box, params, read(contacts, params=params), modes)
        cost[as_good] = SurfaceContact(box.grid, contacts).cost(update.X_PO)[0]
    assert cost[1e9] > cost[0.3] + 1.0
    assert cost[0.3] == cost[1e-9]


def test_what_is_regressed_on_the_surface_stands(box: ObjectModel) -> None:
    contacts, spread = touch(np.eye(3, 4), np.random.default_rng(0)), np.repeat([0.3, 0.01], 3)
    modes, found = TrackedModes.independent(np.eye(3, 4)[None], np.diag(spread**2)[None], 6), []
    for as_good in (1e-9, 0.3, 1e9):
        params = PoseTrackerParams(contact_update=ContactUpdateParams(as_good=as_good))
        found.append(update_with_contacts(box, params, read(contacts, params=params), modes).X_PO)
    np.testing.assert_array_equal(found[1], found[2])
    assert np.abs(found[0] - found[1]).max() > 1e-6


def test_poses_and_biases_are_correlated_as_by_least_squares(box: ObjectModel) -> None:
    """With biases of positions and of normals: the next frame relies on the signs."""
    contacts = Contacts(p_OC, n_OC, sigma_position=SIGMA_POSITION, sigma_normal=SIGMA_NORMAL)
    P = np.diag(np.repeat([0.03**2, 0.002**2], 3))
    information = np.zeros((42, 42))
    information[:6, :6] = np.linalg.inv(P)
    information[6:, 6:] = np.diag(np.tile(np.repeat(np.square(CALIBRATION.calibration), 3) ** -1.0, 6))
    for i, (p, n) in enumerate(zip(p_OC, n_OC, strict=True)):
        rows, at = np.zeros((4, 42)), 6 + 6 * i
        rows[0, :6], rows[0, at : at + 3] = -np.concatenate([np.cross(p, n), n]), -n
        # The object's turn moves the expected normal, and the bias the measured one, from which it is removed.
        rows[1:, :3] = rows[1:, at + 3 : at + 6] = np.cross(np.eye(3), n).T
        new = np.square([SIGMA_POSITION, SIGMA_NORMAL]) - np.square(CALIBRATION.calibration)
        information += (rows.T / np.repeat(new, [1, 3])) @ rows
    expected = np.linalg.inv(information)
    X = np.eye(3, 4)[None]
    update = update_modes(box, contacts, np.arange(6), CALIBRATION, X, P[None], np.zeros((1, 6, 36)), EVEN)
    scale = np.sqrt(np.diag(expected))
    scales = np.outer(scale[:6], scale[6:])
    np.testing.assert_allclose(update.cross_covariance[0] / scales, expected[:6, 6:] / scales, atol=0.02)


def test_contacts_without_normals_say_their_distance_alone(box: ObjectModel) -> None:
    contacts = Contacts(p_OC, sigma_position=SIGMA_POSITION)
    P = np.diag(np.repeat([1e-9, 0.05**2], 3))[None]
    update = update_modes(box, contacts, np.arange(6), NOISE_ALONE, np.eye(3, 4)[None], P, np.zeros((1, 6, 36)), EVEN)
    # Two contacts across each axis.
    np.testing.assert_allclose(np.diag(update.covariance[0])[3:], SIGMA_POSITION**2 / 2.0, rtol=0.02)


def test_noise_of_normals_tells_nothing_of_a_spin_that_changes_nothing() -> None:
    """Each frame's noise has a slope by the spin, but no two the same: their squares must not add up."""
    cylinder = ObjectModel.from_mesh(trimesh.creation.cylinder(0.03, 0.12, sections=64), cache=False)
    angles, heights = np.array([0.1, 1.5, 2.4, 3.6, 5.2]), np.array([0.03, -0.02, 0.01, 0.035, -0.03])
    n_PC = np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1)
    p_PC = 0.03 * n_PC + heights[:, None] * [0.0, 0.0, 1.0]
    generator = np.random.default_rng(0)
    X, P, C = np.eye(3, 4)[None], np.diag([0.05, 0.05, 0.3, 0.003, 0.003, 0.003])[None] ** 2, np.zeros((1, 6, 30))
    for _ in range(100):
        turn = exp_so3(SIGMA_NORMAL * generator.normal(size=(5, 3)))
        contacts = Contacts(
            p_PC + SIGMA_POSITION * generator.normal(size=(5, 3)),
            (turn @ n_PC[..., None])[..., 0],
            sigma_position=SIGMA_POSITION,
            sigma_normal=SIGMA_NORMAL,
        )
        update = update_modes(cylinder, contacts, np.arange(5), CALIBRATION, X, P, C, EVEN[:, :5])
        X, P, C = update.X_PO, update.covariance, update.cross_covariance
    assert np.sqrt(P[0, 2, 2]) > 0.2
    assert np.sqrt(P[0, 0, 0]) < 0.02


def test_a_surface_is_rough_at_its_edges_and_even_on_its_faces(box: ObjectModel) -> None:
    generator = np.random.default_rng(0)
    contacts = touch(np.eye(3, 4), generator)
    at_edge = contacts.p_PC.copy()
    at_edge[0] = [0.03, 0.05, 0.03]
    contacts = Contacts(at_edge, contacts.n_PC, sigma_position=SIGMA_POSITION, sigma_normal=SIGMA_NORMAL)
    P = np.diag(np.repeat([0.01**2, 0.0005**2], 3))[None]
    roughness = update_modes(
        box, contacts, np.arange(6), CALIBRATION, np.eye(3, 4)[None], P, np.zeros((1, 6, 36)), EVEN
    ).roughness[0]
    assert np.sqrt(roughness[0, 1]) > math.radians(10.0)
    assert np.all(np.sqrt(roughness[1:, 1]) < math.radians(2.0))
    assert np.all(np.sqrt(roughness[1:, 0]) < 1e-4)
