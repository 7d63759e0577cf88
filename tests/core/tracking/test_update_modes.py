import dataclasses
import math

import numpy as np
import pytest
import trimesh

from tactopose_drake.core.evidence.contact_reading import ErrorScales
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.poses import retract
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.contact_errors import BiasModel, as_doubted, averaged_variances, with_errors
from tactopose_drake.core.tracking.contact_update import (
    begin_modes,
    follow_lasting_errors,
    follow_roughness,
    limit_gain,
    only_as_told,
    touch_information,
    update_modes,
)
from tactopose_drake.core.tracking.tracked_modes import TrackedModes
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams
from tests.core.tracking.boxes import SIGMA_NORMAL, SIGMA_POSITION, make_box, n_OC, p_OC, read, touch
from tests.core.tracking.rough_modes import HAND, make_rough_modes

X_PO = np.eye(3, 4)


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    return make_box()


def make_modes(covariance: np.ndarray) -> TrackedModes:
    return TrackedModes.independent(np.tile(np.eye(3, 4), (len(covariance), 1, 1)), covariance, 6)


def told(box: ObjectModel, contacts: Contacts, count: int) -> np.ndarray:
    """The information of contacts at so many modes."""
    return SurfaceContact(box.grid, contacts).normal_equations(np.tile(X_PO, (count, 1, 1))).hessian


def update_often(box: ObjectModel, frames: int) -> TrackedModes:
    """Two modes, of which the second is right, after frames of a touch, 10 ms apart."""
    params, generator = PoseTrackerParams(), np.random.default_rng(0)
    X_start = np.stack([retract(X_PO, np.array([0, 0, 0, 0.004, 0, 0.0])), X_PO])
    covariance = np.tile(np.diag(np.repeat([0.02**2, 0.001**2], 3)), (2, 1, 1))
    modes = TrackedModes.independent(X_start, covariance, 6)
    for _ in range(frames):
        modes = update_modes(box, params, read(touch(X_PO, generator)), modes)
    return modes


def test_modes_keep_their_order(box: ObjectModel) -> None:
    modes = update_often(box, 1)
    assert np.linalg.norm(modes.X_PO[1, :, 3]) < np.linalg.norm(modes.X_PO[0, :, 3])


@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_a_direction_is_untold_from_a_share_of_the_object_s_size_on(box: ObjectModel, factor: float) -> None:
    """Of turns by the way of a point at half its size."""
    params, arm = PoseTrackerParams(), 0.5 * box.size
    units = np.repeat([1.0 / arm, 1.0], 3)
    for direction in range(6):
        sigma = np.full(6, 0.001)
        sigma[direction] = factor * params.untold_share * box.size
        information = np.diag(1.0 / np.square(sigma * units))
        before, after = np.diag(np.square(0.1 * units)), np.diag(np.square(0.01 * units))
        expected = after.copy()
        if factor > 1.0:
            expected[direction, direction] = before[direction, direction]
        found = only_as_told(box, params, information[None], before[None], after[None])[0]
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-15)


def test_what_is_left_of_a_surface_s_roughness_stays_where_the_hand_s_errors_seem_otherwise(box: ObjectModel) -> None:
    """What is doubted of a finger is taken off, and what is doubted from now on is added; never less than that."""
    params, generator = PoseTrackerParams(), np.random.default_rng(0)
    rough = 1e-7 * generator.uniform(size=(1, 6, 2))
    before, after = (
        with_errors(read(touch(X_PO, generator)), ErrorScales(dict.fromkeys("abcdef", doubt)), params)
        for doubt in (4.0, 2.0)
    )
    modes = make_modes(np.diag(np.repeat([1e-4, 1e-6], 3))[None])
    felt = dataclasses.replace(modes, roughness=before.parts.excess + rough)
    followed = follow_lasting_errors(felt, before, after, params)
    np.testing.assert_allclose(followed.roughness, after.parts.excess + rough, rtol=1e-9)
    smooth = dataclasses.replace(modes, roughness=0.5 * before.parts.excess[None])
    np.testing.assert_allclose(follow_lasting_errors(smooth, before, after, params).roughness[0], after.parts.excess)


def test_an_update_makes_a_mode_no_surer_than_it_was_or_than_the_touch_can(box: ObjectModel) -> None:
    face = p_OC[0] + 0.01 * np.array([[0, 1, 1], [0, -1, 1], [0, 0, -1.0]])
    contacts = Contacts(face, np.tile(n_OC[0], (3, 1)), sigma_position=SIGMA_POSITION, sigma_normal=SIGMA_NORMAL)
    params, modes = PoseTrackerParams(), make_modes(np.diag(np.repeat([0.2**2, 0.02**2], 3))[None])
    reading = read(contacts, np.arange(3))
    (one_frame,), most = touch_information(box, params, reading, modes)
    np.testing.assert_allclose(one_frame, told(box, contacts, 1)[0], rtol=0.01, atol=0.01 * one_frame.max())
    before = modes.covariance
    open_ones, felt = [0, 4, 5], [1, 2, 3]  # the turn about the face's normal, slides along it; the others
    # Of what is told more than half lasts: however many frames are averaged, they do not tell three times as much.
    gain = np.diag(most[0])[felt] / np.diag(one_frame)[felt]
    assert np.all((gain > 1.5) & (gain < 3.0))
    limit = np.diag(np.linalg.inv(most[0] + 1e-6 * np.eye(6)))
    for claimed in (1e-3, 0.5, 2.0):  # of the standard deviations before: what an update says
        after = limit_gain(before, most, claimed**2 * before)[0]
        assert np.linalg.eigvalsh(after).min() > 0.0
        shares = np.diag(after) / np.diag(before[0])
        np.testing.assert_allclose(shares[open_ones], max(claimed, 1.0) ** 2, rtol=0.01)
        expected = np.maximum(claimed**2, limit / np.diag(before[0]))
        np.testing.assert_allclose(shares[felt], expected[felt], rtol=0.1)
    sure = 1e-8 * before  # from elsewhere
    np.testing.assert_allclose(limit_gain(sure, most, 0.01 * sure), sure, rtol=1e-6, atol=1e-20)


def test_no_update_makes_a_mode_surer_than_the_last_search_left_it(box: ObjectModel) -> None:
    spread, reading = np.repeat([0.02, 0.002], 3), read(touch(X_PO, np.random.default_rng(0)))
    modes = make_modes(np.diag(spread**2)[None])
    bound = np.diag(spread**-2) * np.array([1.0, 9.0, 1.0, 1.0, 9.0, 1.0])[:, None]
    free = update_modes(box, PoseTrackerParams(), reading, modes).covariance[0]
    bounded = dataclasses.replace(modes, most_information=bound[None])
    after = update_modes(box, PoseTrackerParams(), reading, bounded).covariance[0]
    assert np.all(np.diag(free) < 0.95 * spread**2)
    assert np.linalg.eigvalsh(np.diag(1.0 / spread) @ (after - free) @ np.diag(1.0 / spread)).min() > -1e-6
    least = np.diag(after) / spread**2
    assert np.all(least[[0, 2, 3, 5]] > 0.99)
    assert np.all(least[[1, 4]] > 1.0 / 9.0 - 1e-6)


def test_frames_of_one_touch_do_not_tell_its_lasting_errors_from_the_pose() -> None:
    """Four fingers along a cylinder, whose slopes differ from frame to frame: who trusts them grows too sure."""
    model = ObjectModel.from_mesh(trimesh.creation.cylinder(0.03, 0.12, sections=64), cache=False, symmetry="none")
    params = PoseTrackerParams(calibration_position=0.002, calibration_normal_deg=10.0)
    sigma_position, sigma_normal = math.hypot(0.002, 0.00075), math.radians(math.hypot(10.0, 4.3))
    ratios = []
    for seed in range(5):
        generator = np.random.default_rng(seed)
        angles = np.array([0.0, np.pi, 0.3, -0.3]) + 0.1 * generator.normal(size=4)
        n_OC = np.stack([np.cos(angles), np.sin(angles), np.zeros(4)], axis=1)
        p_OC = 0.03 * n_OC + np.array([[0, 0, z] for z in (-0.045, -0.015, 0.02, 0.045)])
        p_OC += 0.002 * generator.normal(size=(4, 3))
        n_OC += math.radians(10.0) * generator.normal(size=(4, 3))
        modes = TrackedModes.independent(X_PO[None], np.diag(np.repeat([0.28**2, 0.033**2], 3))[None], 4)
        for _ in range(60):
            n_PC = n_OC + math.radians(4.3) * generator.normal(size=(4, 3))
            n_PC /= np.linalg.norm(n_PC, axis=1, keepdims=True)
            p_PC = p_OC + 0.00075 * generator.normal(size=(4, 3))
            felt = Contacts(p_PC, n_PC, sigma_position=sigma_position, sigma_normal=sigma_normal)
            modes = update_modes(model, params, read(felt, sources=tuple("abcd")), modes)
        # The tilts, which the touch determines, against what an estimate by one touch without new noise knows of them.
        n_PC = n_OC / np.linalg.norm(n_OC, axis=1, keepdims=True)
        lasting = Contacts(p_OC, n_PC, sigma_position=0.002, sigma_normal=math.radians(10.0))
        one_touch = np.linalg.inv(told(model, lasting, 1)[0] + np.diag(np.repeat([0.28**-2, 0.033**-2], 3)))
        # The spin, which nothing determines, takes the object's axes along: the tilts are those about P's.
        R_PO = modes.X_PO[0, :, :3]
        ratios.append(np.diag(R_PO @ modes.covariance[0, :3, :3] @ R_PO.T)[:2] / np.diag(one_touch)[:2])
    assert np.sqrt(np.min(ratios)) > 0.55, np.sqrt(ratios).round(2).tolist()


def test_where_the_touch_tells_nothing_an_update_leaves_the_covariance_as_it_was(box: ObjectModel) -> None:
    face = p_OC[0] + 0.01 * np.array([[0, 1, 1], [0, -1, 1], [0, 0, -1.0]])
    contacts = Contacts(face, np.tile(n_OC[0], (3, 1)), sigma_position=SIGMA_POSITION, sigma_normal=SIGMA_NORMAL)
    before = np.diag(np.repeat([0.2**2, 0.02**2], 3))
    for share in (0.01, 2.0):  # of the standard deviations before: what an update claims to know
        after = only_as_told(box, PoseTrackerParams(), told(box, contacts, 1), before[None], share**2 * before[None])[0]
        assert np.linalg.eigvalsh(after).min() > 0.0
        sigmas = np.sqrt(np.diag(after) / np.diag(before))
        open_ones = [0, 4, 5]  # the turn about the face's normal, and slides along it
        np.testing.assert_allclose(sigmas[open_ones], max(share, 1.0), rtol=1e-6)
        np.testing.assert_allclose(sigmas[[1, 2, 3]], share, rtol=0.1)


def joint_covariance(modes: TrackedModes) -> np.ndarray:
    own = np.repeat(HAND + modes.roughness, 3, axis=2).reshape(len(modes), -1)
    joint = np.zeros((len(modes), 6 + own.shape[1], 6 + own.shape[1]))
    joint[:, :6, :6], joint[:, :6, 6:] = modes.covariance, modes.cross_covariance
    joint[:, 6:, :6] = np.swapaxes(modes.cross_covariance, 1, 2)
    joint[:, 6:, 6:] += own[:, :, None] * np.eye(own.shape[1])
    return joint


@pytest.mark.parametrize(("before", "felt"), [(0.0, 30.0), (30.0, 0.0), (1.0, 1.0)])
def test_biases_follow_the_roughness_and_the_covariance_stays_one(before: float, felt: float) -> None:
    modes = make_rough_modes(before)
    touched = np.array([0, 2])
    params = PoseTrackerParams(
        calibration_position=math.sqrt(HAND[0]),
        calibration_normal_deg=math.degrees(math.sqrt(HAND[1])),
        surface_position=0.0,
        surface_normal_deg=0.0,
    )
    reading = read(Contacts(np.zeros((2, 3))), touched, tuple("abc"))
    after = follow_roughness(modes, reading, np.tile(felt * HAND, (2, 2, 1)), params)
    assert np.linalg.eigvalsh(joint_covariance(modes)).min() > 0.0
    assert np.linalg.eigvalsh(joint_covariance(after)).min() > 0.0
    share = after.roughness[:, touched] / HAND
    assert np.all(np.abs(share - felt) <= np.abs(before - felt))
    expected = min(1.0, (1.0 + share[0, 0, 0]) / (1.0 + before))
    np.testing.assert_allclose(after.cross_covariance[:, :, :6], expected * modes.cross_covariance[:, :, :6])
    # Of a source that touches nothing nothing is new.
    np.testing.assert_array_equal(after.cross_covariance[:, :, 6:12], modes.cross_covariance[:, :, 6:12])


def test_a_new_mode_shares_less_with_biases_that_seem_smaller_than_told(box: ObjectModel) -> None:
    """Of the hand's part of a bias a half or a quarter is left, and of what the pose shares with it as much less."""
    params, covariance = PoseTrackerParams(), np.diag(np.repeat([0.02**2, 0.001**2], 3))[None]
    as_told = read(touch(X_PO, np.random.default_rng(1)))
    better = with_errors(as_told, ErrorScales(calibration=np.array([0.5, 0.25])), params)
    before, after = (begin_modes(box, params, reading, None, X_PO[None], covariance) for reading in (as_told, better))
    assert np.abs(before.cross_covariance).max() > 1e-9
    bias = BiasModel.from_params(params)
    np.testing.assert_allclose(
        before.roughness - after.roughness, np.tile([0.5, 0.75] * bias.of_calibration, (1, 6, 1))
    )
    left = np.minimum(1.0 + after.roughness / bias.variances, 1.0)
    assert left.max() < 0.9
    by_bias = np.repeat(left, 3, axis=2).reshape(1, 1, 36)
    np.testing.assert_allclose(after.cross_covariance, by_bias * before.cross_covariance, rtol=1e-6, atol=1e-15)


def test_modes_that_hardly_count_wait_for_a_search(box: ObjectModel) -> None:
    covariance = np.tile(np.diag(np.repeat([0.02**2, 0.001**2], 3)), (3, 1, 1))
    modes = dataclasses.replace(make_modes(covariance), log_weight=np.array([0.0, -1.0, -20.0]))
    after = update_modes(box, PoseTrackerParams(), read(touch(X_PO, np.random.default_rng(0))), modes)
    assert np.all(np.abs(after.X_PO[:2] - modes.X_PO[:2]).max(axis=(1, 2)) > 1e-6)
    np.testing.assert_array_equal(after.X_PO[2], modes.X_PO[2])
    np.testing.assert_array_equal(after.log_weight, modes.log_weight)


def test_a_doubted_finger_counts_for_less_and_so_does_what_a_hand_declares(box: ObjectModel) -> None:
    contacts, params = touch(X_PO, np.random.default_rng(0)), PoseTrackerParams()
    doubted = with_errors(read(contacts), ErrorScales(doubt={"a": 16.0}), params)
    mean = averaged_variances(contacts, params, params.window.max_frames)[0]
    np.testing.assert_allclose(doubted.parts.excess[0], 15.0 * mean)
    seems = as_doubted(doubted).evidence.contacts
    np.testing.assert_allclose(seems.sigma_position[:2] ** 2, SIGMA_POSITION**2 + np.array([15.0 * mean[0], 0.0]))
    assert as_doubted(read(contacts)).evidence.contacts is contacts
    np.testing.assert_array_equal(doubted.parts.excess[1:], np.zeros((5, 2)))
    declared = Contacts(contacts.p_PC, contacts.n_PC, covariance=np.tile(np.diag([4e-6] * 3 + [0.04] * 3), (6, 1, 1)))
    excess = read(declared).parts.excess
    sensors = np.square([params.frame_position, math.radians(params.frame_normal_deg)])
    hand = np.square([params.calibration_position, math.radians(params.calibration_normal_deg)])
    np.testing.assert_allclose(excess, np.tile([4e-6, 0.04] - sensors - hand, (6, 1)), rtol=1e-9)
    modes = make_modes(np.diag(np.repeat([0.02**2, 0.001**2], 3))[None])
    spread = []
    for reading in (read(contacts), doubted):
        after = modes
        for _ in range(30):
            after = update_modes(box, params, reading, after)
        spread.append(np.trace(after.covariance[0][3:, 3:]))
    assert spread[1] > 1.05 * spread[0]
