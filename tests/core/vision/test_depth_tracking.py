"""A tracker of a known object in depth images."""

import numpy as np
import pytest
import trimesh

from tactopose_drake.core.poses import exp_so3, increments_between, make_poses, retract, transform_points
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.vision.depth_tracking import DepthTrackerModel, TrackedPose, fit_pose, take_picture
from tactopose_drake.errors import InvalidInputError

X_CO = make_poses(exp_so3(np.array([2.0, 0.4, 0.3])), np.array([0.02, 0.03, 0.8]))
NO_HAND = np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int32)


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    """All of whose pose is seen from aslant."""
    return ObjectModel.from_mesh(trimesh.creation.box([0.06, 0.09, 0.13]), cache=False)


def slab(depth: float, width: float, across: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """A finger before the object: a slab at a depth."""
    mesh = trimesh.creation.box([0.3, width, 0.01])
    mesh.apply_translation([0.0, 0.03 + across, depth])
    return np.array(mesh.vertices), np.array(mesh.faces, dtype=np.int32)


def picture(box: ObjectModel, hand: tuple[np.ndarray, np.ndarray], model: DepthTrackerModel, seed: int = 0):
    vertices = transform_points(X_CO, box.vertices)
    return take_picture(vertices, box.faces, *hand, model, np.random.default_rng(seed))


def error(found: TrackedPose | None) -> np.ndarray:
    assert found is not None
    return np.asarray(increments_between(found.X_CO, X_CO))


def test_without_noise_the_points_are_on_the_object(box: ObjectModel) -> None:
    seen = picture(box, NO_HAND, DepthTrackerModel(depth_noise=0.0))
    assert len(seen.p_CQ) > 300
    assert seen.hidden_share == 0.0
    assert not seen.on_hand.any()
    distance = box.grid.distance((seen.p_CQ - X_CO[:, 3]) @ X_CO[:, :3])
    assert np.abs(distance).max() < 2e-3  # of the grid at edges; a pixel's ray is exact
    assert np.median(np.abs(distance)) < 1e-4


def test_what_is_before_the_object_hides_it(box: ObjectModel) -> None:
    model = DepthTrackerModel()
    shares = [picture(box, slab(0.6, width), model).hidden_share for width in (0.01, 0.03, 0.3)]
    assert 0.0 < shares[0] < shares[1] < shares[2]
    assert shares[2] == 1.0
    behind = picture(box, slab(1.2, 0.3), model)
    assert behind.hidden_share == 0.0
    assert 0 < behind.on_hand.sum() < len(behind.p_CQ)


def test_it_finds_the_pose_again(box: ObjectModel) -> None:
    model, generator = DepthTrackerModel(), np.random.default_rng(1)
    for hand in (NO_HAND, slab(0.65, 0.03)):
        errors = []
        for seed in range(8):
            start = retract(X_CO, generator.normal(size=6) * np.repeat([0.08, 0.012], 3))
            errors.append(error(fit_pose(picture(box, hand, model, seed), box, start, model)))
        assert np.linalg.norm(np.array(errors)[:, 3:], axis=1).max() < 0.005
        assert np.linalg.norm(np.array(errors)[:, :3], axis=1).max() < 0.05


def test_the_more_is_hidden_the_less_it_claims_to_know(box: ObjectModel) -> None:
    model = DepthTrackerModel()
    found = [fit_pose(picture(box, hand, model), box, X_CO, model) for hand in (NO_HAND, slab(0.65, 0.08, 0.04))]
    spread = [np.trace(pose.covariance[3:, 3:]) for pose in found if pose is not None]
    assert spread[1] > 1.2 * spread[0]
    assert found[0] is not None
    assert found[1] is not None
    assert found[1].points < found[0].points


def test_the_errors_are_no_larger_than_it_says(box: ObjectModel) -> None:
    model = DepthTrackerModel()
    squared = []
    for seed in range(20):
        found = fit_pose(picture(box, slab(0.65, 0.03), model, seed), box, X_CO, model)
        assert found is not None
        squared.append(error(found) @ np.linalg.solve(found.covariance, error(found)))
    assert np.mean(squared) < 6.0


def test_a_hand_that_it_does_not_know_pulls_the_pose_aside(box: ObjectModel) -> None:
    beside = slab(transform_points(X_CO, box.vertices)[:, 2].min() - 0.006, 0.03)
    errors = []
    for knows_hand in (True, False):
        model = DepthTrackerModel(knows_hand=knows_hand, depth_noise=1e-4)
        errors.append(np.linalg.norm(error(fit_pose(picture(box, beside, model), box, X_CO, model))[3:]))
    assert errors[1] > 3.0 * errors[0]


def test_too_little_is_no_answer(box: ObjectModel) -> None:
    model = DepthTrackerModel()
    assert fit_pose(picture(box, slab(0.6, 0.3), model), box, X_CO, model) is None
    far = retract(X_CO, np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0]))
    unknowing = DepthTrackerModel(knows_hand=False)
    assert fit_pose(picture(box, NO_HAND, unknowing), box, far, unknowing) is None


def test_the_fit_narrows_what_counts_step_by_step() -> None:
    widths = DepthTrackerModel(first_width=0.1, width_factor=0.5, narrowing_steps=3, last_steps=2).widths
    np.testing.assert_allclose(widths, [0.1, 0.05, 0.025, 0.0, 0.0])
    with pytest.raises(InvalidInputError, match=r"width_factor: is 1\.2; allowed is up to 1"):
        DepthTrackerModel(width_factor=1.2).validate()


def test_bad_parameters_are_named() -> None:
    with pytest.raises(InvalidInputError, match=r"DepthTrackerModel\.most_hidden: is 1\.5"):
        DepthTrackerModel(most_hidden=1.5).validate()
    with pytest.raises(InvalidInputError, match=r"DepthTrackerModel\.focal_length: is 0"):
        DepthTrackerModel(focal_length=0.0).validate()
