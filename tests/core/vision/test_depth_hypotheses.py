"""What depth images leave open of an object's pose is followed, and said."""

import functools

import numpy as np
import trimesh

from tactopose_drake.core.poses import increments_between, make_poses
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.vision.depth_hypotheses import TrackedPoses, track_poses
from tactopose_drake.core.vision.depth_pictures import DepthCameraModel, DepthPicture
from tactopose_drake.core.vision.depth_tracking import DepthTrackerModel
from tests.core.vision.seen_scenes import NO_HAND, picture_of

CAMERA = DepthCameraModel(width=120, height=90, focal_length=110.0)
MODEL = DepthTrackerModel()
INSIDE, BEYOND = 12.59, 22.46  # squared Mahalanobis distances in six dimensions of 95 and 99.9 %


@functools.cache
def cup() -> ObjectModel:
    """A cylinder with a handle in the middle of its height: upside down the handle is on the other side."""
    body, handle = trimesh.creation.cylinder(0.04, 0.1, sections=48), trimesh.creation.box([0.03, 0.012, 0.06])
    handle.apply_translation([0.05, 0.0, 0.008])
    return ObjectModel.from_mesh(trimesh.boolean.union([body, handle], engine="manifold"), cache=False)


def seen(model: ObjectModel, angle: float, seed: int) -> tuple[DepthPicture, np.ndarray]:
    """A picture of an object that stands across the view, turned about its axis, and its pose."""
    c, s = np.cos(angle), np.sin(angle)
    across = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    X_CO = make_poses(across @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.array([0.0, 0.01, 0.6]))
    return picture_of(model, X_CO, NO_HAND, CAMERA, np.random.default_rng(seed)), X_CO


def squared(error: np.ndarray, covariance: np.ndarray) -> float:
    """In units of a covariance."""
    return float(error @ np.linalg.solve(covariance, error))


def test_where_the_handle_is_hidden_the_covariance_reaches_wherever_it_may_be() -> None:
    model, alone = cup(), []
    for seed in (0, 2):
        picture, X_CO = seen(model, np.radians(105.0), seed=seed)  # behind the body
        tracked = None
        for _ in range(2):  # in the second picture, too, which it follows
            tracked = track_poses(picture, model, tracked, MODEL)
            assert tracked is not None
            error = increments_between(tracked.best.X_CO, X_CO)
            assert squared(error, tracked.covariance) < INSIDE
            alone.append(squared(error, tracked.best.covariance))
    # Which of the two that look alike is the best one is chance; upside down, that fit knows nothing of the other.
    assert max(alone) > BEYOND


def test_where_the_handle_is_seen_one_pose_is_left() -> None:
    picture, X_CO = seen(cup(), np.radians(150.0), seed=1)
    tracked = track_poses(picture, cup(), None, MODEL)
    assert tracked is not None
    assert len(tracked.found) == 1
    error = increments_between(tracked.best.X_CO, X_CO)
    assert np.linalg.norm(error[3:]) < 0.004
    assert np.linalg.norm(error[:3]) < 0.1


def test_poses_that_look_the_same_are_one() -> None:
    model = ObjectModel.from_mesh(trimesh.creation.cylinder(0.03, 0.11), cache=False)
    picture, _ = seen(model, 0.4, seed=0)
    tracked = track_poses(picture, model, None, MODEL)
    assert tracked is not None
    assert len(tracked.found) == 1


def test_an_object_far_from_its_frame_s_origin_is_tracked_like_one_about_it() -> None:
    near = cup().about_middle
    p_OM = np.array([0.8, -0.5, 0.3])
    far = ObjectModel.from_mesh(trimesh.Trimesh(near.vertices + p_OM, near.faces), cache=False)
    tracked: list[TrackedPoses | None] = [None, None]
    for angle in (150.0, 175.0):  # more than a standard deviation of the motion between pictures
        picture, _ = seen(near, np.radians(angle), seed=1)
        of_near, of_far = (
            track_poses(picture, model, before, MODEL) for model, before in zip((near, far), tracked, strict=True)
        )
        assert of_near is not None
        assert of_far is not None
        at_middle, tracked = of_far.of_frame_at(p_OM), [of_near, of_far]
        np.testing.assert_allclose(at_middle.best.X_CO, of_near.best.X_CO, atol=1e-4)
        np.testing.assert_allclose(at_middle.covariance, of_near.covariance, rtol=0.05, atol=1e-6)
