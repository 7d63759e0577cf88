import math

import numpy as np
import pytest
import trimesh

from tactopose_drake.core.poses import compose, increments_between, make_poses, random_rotations, retract
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.frame import PoseMeasurement
from tactopose_drake.core.tracking.motion_prediction import MotionHistory
from tactopose_drake.core.tracking.pose_belief import VisionRecord
from tactopose_drake.core.tracking.tracked_modes import TrackedModes
from tactopose_drake.core.tracking.tracker_params import VisionParams
from tactopose_drake.core.tracking.vision_update import Sighting, fuse, read_vision, update_with_pose

X_PO = make_poses(random_rotations(np.random.default_rng(0), 1), np.array([[0.02, 0.0, 0.1]]))[0]
SEEN = np.diag(np.repeat([math.radians(5.0), 0.01], 3) ** 2)
LOG_OUTLIER = math.log(0.05 / (8.0 * math.pi**2))


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    return ObjectModel.from_mesh(trimesh.creation.box((0.05, 0.08, 0.11)), cache=False)


def mode(sigma: float) -> TrackedModes:
    return TrackedModes.independent(X_PO[None], np.diag(np.repeat([10.0 * sigma, sigma], 3) ** 2)[None], 1)


def seen(way: float, share: float) -> Sighting:
    return Sighting(PoseMeasurement(0.0, retract(X_PO, np.array([0, 0, 0, way, 0, 0])), SEEN), share)


@pytest.mark.parametrize("share", [1.0, 1.0 / 15.0, 1e-3])
def test_what_is_an_outlier_is_one_however_often_pictures_come(box: ObjectModel, share: float) -> None:
    after, is_inlier = update_with_pose(box, mode(0.003), seen(0.1, share), LOG_OUTLIER)
    assert not is_inlier[0]
    np.testing.assert_array_equal(after.X_PO[0], X_PO)
    np.testing.assert_allclose(after.log_weight, share * LOG_OUTLIER)


def test_vision_that_shows_the_object_turned_into_itself_is_believed(box: ObjectModel) -> None:
    turned = Sighting(PoseMeasurement(0.0, compose(X_PO, box.symmetry_poses[-1]), SEEN), 1.0)
    after, is_inlier = update_with_pose(box, mode(0.003), turned, LOG_OUTLIER)
    assert len(box.symmetry_poses) == 4
    assert is_inlier[0]
    np.testing.assert_allclose(after.X_PO[0], X_PO, atol=1e-9)


def test_pictures_of_one_correlation_time_are_as_one_measurement(box: ObjectModel) -> None:
    once, _ = update_with_pose(box, mode(0.01), seen(0.005, 1.0), LOG_OUTLIER)
    often = mode(0.01)
    for _ in range(15):
        often, is_inlier = update_with_pose(box, often, seen(0.005, 1.0 / 15.0), LOG_OUTLIER)
        assert is_inlier[0]
    np.testing.assert_allclose(often.covariance, once.covariance, atol=1e-9)
    np.testing.assert_allclose(often.X_PO, once.X_PO, atol=1e-9)


def test_what_stands_is_known_as_well_by_many_pictures_as_by_one_of_their_time() -> None:
    standing = PoseMeasurement(0.0, X_PO, SEEN)
    once, often = fuse(standing, seen(0.005, 1.0), VisionParams()), standing
    for _ in range(15):
        often = fuse(often, seen(0.005, 1.0 / 15.0), VisionParams())
    np.testing.assert_allclose(often.covariance, once.covariance, atol=1e-9)
    np.testing.assert_allclose(often.X_PO, once.X_PO, atol=1e-9)


def test_a_picture_counts_as_the_share_of_the_correlation_time_since_the_last() -> None:
    record, shares = VisionRecord(), []
    generator, params = np.random.default_rng(0), VisionParams(correlation_time=0.5)
    for time in (0.0, 0.05, 0.15, 1.15):
        X = retract(X_PO, 1e-3 * generator.normal(size=6))
        sighting, record = read_vision(record, PoseMeasurement(time, X, SEEN), MotionHistory((time,)), time, params)
        assert sighting is not None
        assert np.abs(increments_between(sighting.pose.X_PO, X)).max() < 1e-9
        shares.append(sighting.share)
    np.testing.assert_allclose(shares, [1.0, 0.1, 0.2, 1.0])
