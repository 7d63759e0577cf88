"""A tracker of a known object in depth images."""

import numpy as np
import pytest
import trimesh

from tactopose_drake.core.poses import exp_so3, increments_between, make_poses, retract, transform_points
from tactopose_drake.core.posterior.moved_origin import move_measurement
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.vision.depth_pictures import DepthCameraModel, DepthPicture, fit_to_picture
from tactopose_drake.core.vision.depth_tracking import DepthTrackerModel, TrackedPose, fit_pose, residuals
from tactopose_drake.errors import InvalidInputError
from tests.core.models import brick
from tests.core.vision.seen_scenes import NO_HAND, picture_of

X_CO = make_poses(exp_so3(np.array([2.0, 0.4, 0.3])), np.array([0.02, 0.03, 0.8]))
BEFORE = np.diag(np.repeat([0.1, 0.02], 3) ** 2)  # covariance of where it was


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    """All of whose pose is seen from aslant."""
    return brick(0.06, 0.09, 0.13)


def slab(depth: float, width: float, across: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """A finger before the object: a slab at a depth."""
    mesh = trimesh.creation.box([0.3, width, 0.01])
    mesh.apply_translation([0.0, 0.03 + across, depth])
    return np.array(mesh.vertices), np.array(mesh.faces, dtype=np.int32)


def picture(
    box: ObjectModel,
    hand: tuple[np.ndarray, np.ndarray],
    camera: DepthCameraModel | None = None,
    seed: int = 0,
    knows_hand: bool = True,
) -> DepthPicture:
    return picture_of(box, X_CO, hand, camera or DepthCameraModel(), np.random.default_rng(seed), knows_hand)


def error(found: TrackedPose | None) -> np.ndarray:
    assert found is not None
    return np.asarray(increments_between(found.X_CO, X_CO))


def test_without_noise_the_points_are_on_the_object(box: ObjectModel) -> None:
    seen = picture(box, NO_HAND, DepthCameraModel(depth_noise=0.0))
    points = seen.points(without_hand=True)
    assert len(points) > 300
    assert not seen.hand.any()
    distance = box.grid.distance((points - X_CO[:, 3]) @ X_CO[:, :3])
    assert np.abs(distance).max() < 2e-3  # of the grid at edges; a pixel's ray is exact
    assert np.median(np.abs(distance)) < 1e-4


def test_what_is_before_the_object_hides_it(box: ObjectModel) -> None:
    shares = [fit_to_picture(picture(box, slab(0.6, width)), box, X_CO).hidden_share for width in (0.01, 0.03, 0.3)]
    assert 0.0 < shares[0] < shares[1] < shares[2]
    assert shares[2] == 1.0
    behind = picture(box, slab(1.2, 0.3))
    assert fit_to_picture(behind, box, X_CO).hidden_share < 0.05
    assert 0 < behind.hand.sum() < np.isfinite(behind.depth).sum()


def test_an_object_that_is_elsewhere_is_seen_through(box: ObjectModel) -> None:
    seen = picture(box, NO_HAND)
    aside = retract(X_CO, np.array([0.0, 0.0, 0.0, 0.15, 0.0, 0.0]))
    here, beside = (fit_to_picture(seen, box, pose) for pose in (X_CO, aside))
    assert here.seen_through < 0.02
    assert here.misfit < 0.004
    assert beside.seen_through > 0.9
    assert beside.misfit > 0.05


def test_what_its_points_have_in_common_counts_as_one_of_them(box: ObjectModel) -> None:
    """With no other error, n points tell as much as one; the noise itself is that of no picture here."""
    depth = picture(box, NO_HAND, DepthCameraModel(depth_noise=0.0)).depth
    model, found = DepthTrackerModel(), []
    for share in (0.0, 1.0):
        seen = DepthPicture(depth, np.zeros(depth.shape, dtype=np.bool_), DepthCameraModel(common_share=share))
        fit = fit_pose(seen, box, X_CO, BEFORE, model)
        assert fit is not None
        found.append((np.linalg.inv(fit.covariance) - np.linalg.inv(BEFORE + model.motion), fit.points))
    (apart, count), (in_common, _) = found
    np.testing.assert_allclose(in_common * (1.0 + count), apart, rtol=1e-3, atol=1e-3 * np.abs(apart).max())


@pytest.mark.parametrize("is_beyond", [False, True])
def test_no_point_is_surer_than_what_the_pose_leaves_over_or_what_is_seen_beyond_it(
    box: ObjectModel, is_beyond: bool
) -> None:
    """Whichever is larger, where every tenth pixel sees something nearer than the object, or something far behind."""
    depth, generator = picture(box, NO_HAND, DepthCameraModel(depth_noise=0.0)).depth, np.random.default_rng(0)
    wrong = np.isfinite(depth) & (generator.uniform(size=depth.shape) < 0.1)
    depth = np.where(wrong, depth + (0.06 if is_beyond else -0.004), depth)
    camera, model = DepthCameraModel(depth_noise=0.0, common_share=0.0), DepthTrackerModel()
    seen = DepthPicture(depth, np.zeros(depth.shape, dtype=np.bool_), camera)
    fit = fit_pose(seen, box, X_CO, BEFORE, model)
    assert fit is not None
    distance, J = residuals(seen.points(without_hand=True), box, fit.X_CO)
    near = np.abs(distance) < model.gate
    told = np.linalg.inv(fit.covariance) - np.linalg.inv(BEFORE + model.motion)
    misfit = fit_to_picture(seen, box, fit.X_CO).misfit
    assert (misfit > 2.0 * fit.residual) == is_beyond
    assert (fit.residual > 1.2 * misfit) != is_beyond
    scale = max(misfit, fit.residual)
    np.testing.assert_allclose(scale**2 * told, J[near].T @ J[near], rtol=1e-6, atol=1e-6 * near.sum())


def test_what_is_not_seen_is_as_uncertain_as_before_and_by_its_motion() -> None:
    ball = ObjectModel.from_mesh(trimesh.creation.icosphere(4, 0.05), symmetry="none", cache=False)
    before, model = np.diag(np.repeat([1e-3, 0.02], 3) ** 2), DepthTrackerModel(sigma_rotation_deg=1.0)
    fit = fit_pose(
        picture_of(ball, X_CO, NO_HAND, DepthCameraModel(), np.random.default_rng(0)), ball, X_CO, before, model
    )
    assert fit is not None
    np.testing.assert_allclose(np.diag(fit.covariance)[:3], 1e-6 + np.radians(1.0) ** 2, rtol=0.05)
    assert np.sqrt(np.diag(fit.covariance)[3:]).max() < 0.003


def test_it_finds_the_pose_again(box: ObjectModel) -> None:
    model, generator = DepthTrackerModel(), np.random.default_rng(1)
    for hand in (NO_HAND, slab(0.65, 0.03)):
        errors = []
        for seed in range(8):
            start = retract(X_CO, generator.normal(size=6) * np.repeat([0.08, 0.012], 3))
            errors.append(error(fit_pose(picture(box, hand, seed=seed), box, start, BEFORE, model)))
        assert np.linalg.norm(np.array(errors)[:, 3:], axis=1).max() < 0.005
        assert np.linalg.norm(np.array(errors)[:, :3], axis=1).max() < 0.05


def test_the_more_is_hidden_the_less_it_claims_to_know(box: ObjectModel) -> None:
    model = DepthTrackerModel()
    found = [fit_pose(picture(box, hand), box, X_CO, BEFORE, model) for hand in (NO_HAND, slab(0.65, 0.08, 0.04))]
    spread = [np.trace(pose.covariance[3:, 3:]) for pose in found if pose is not None]
    assert spread[1] > 1.2 * spread[0]
    assert found[0] is not None
    assert found[1] is not None
    assert found[1].points < found[0].points
    assert found[1].hidden_share > 0.2 > found[0].hidden_share


def test_the_errors_are_no_larger_than_it_says(box: ObjectModel) -> None:
    squared = []
    for seed in range(20):
        found = fit_pose(picture(box, slab(0.65, 0.03), seed=seed), box, X_CO, BEFORE, DepthTrackerModel())
        assert found is not None
        squared.append(error(found) @ np.linalg.solve(found.covariance, error(found)))
    assert np.mean(squared) < 6.0


def test_a_hand_that_it_does_not_know_pulls_the_pose_aside_and_it_says_so(box: ObjectModel) -> None:
    beside = slab(transform_points(X_CO, box.vertices)[:, 2].min() - 0.006, 0.03)
    camera, found = DepthCameraModel(depth_noise=1e-4), []
    for knows_hand in (True, False):
        seen = picture(box, beside, camera, knows_hand=knows_hand)
        model = DepthTrackerModel(knows_hand=knows_hand, most_hidden=1.0, most_seen_through=1.0)
        found.append(fit_pose(seen, box, X_CO, BEFORE, model))
    errors = [np.linalg.norm(error(pose)[3:]) for pose in found]
    assert errors[1] > 3.0 * errors[0]
    assert found[0] is not None
    assert found[1] is not None
    assert np.trace(found[1].covariance[3:, 3:]) > 10.0 * np.trace(found[0].covariance[3:, 3:])
    assert error(found[1]) @ np.linalg.solve(found[1].covariance, error(found[1])) < 12.6


def test_too_little_is_no_answer(box: ObjectModel) -> None:
    model = DepthTrackerModel()
    assert fit_pose(picture(box, slab(0.6, 0.3)), box, X_CO, BEFORE, model) is None
    far = retract(X_CO, np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0]))
    unknowing = DepthTrackerModel(knows_hand=False)
    assert fit_pose(picture(box, NO_HAND), box, far, BEFORE, unknowing) is None


def test_a_spin_that_changes_nothing_is_not_uncertain() -> None:
    can = ObjectModel.from_cylinder(0.03, 0.12, cache=False)
    seen = picture_of(can, X_CO, NO_HAND, DepthCameraModel(), np.random.default_rng(0))
    found = fit_pose(seen, can, X_CO, np.diag(np.repeat([3.0, 0.02], 3) ** 2), DepthTrackerModel())
    assert found is not None
    assert np.sqrt(np.diag(found.covariance)[:3]).max() < 0.1


def test_the_fit_narrows_what_counts_step_by_step() -> None:
    widths = DepthTrackerModel(first_width=0.1, width_factor=0.5, narrowing_steps=3, last_steps=2).widths
    np.testing.assert_allclose(widths, [0.1, 0.05, 0.025, 0.0, 0.0])
    with pytest.raises(InvalidInputError, match=r"width_factor must be a number from 0 to 1, not 1\.2"):
        DepthTrackerModel(width_factor=1.2).validate()


def test_bad_parameters_are_named() -> None:
    with pytest.raises(InvalidInputError, match=r"DepthTrackerModel\.most_hidden must be .*, not 1\.5"):
        DepthTrackerModel(most_hidden=1.5).validate()
    with pytest.raises(InvalidInputError, match=r"DepthCameraModel\.focal_length must be .*, not 0"):
        DepthCameraModel(focal_length=0.0).validate()
    with pytest.raises(InvalidInputError, match=r"DepthCameraModel\.center_x must be a finite number, not nan"):
        DepthCameraModel(center_x=float("nan")).validate()
    with pytest.raises(InvalidInputError, match=r"DepthCameraModel\.nearest must be less than .*, not 5 m"):
        DepthCameraModel(nearest=5.0).validate()
    with pytest.raises(InvalidInputError, match=r"DepthCameraModel\.width must be an integer .*, not 240\.5"):
        DepthCameraModel(width=240.5).validate()  # type: ignore[arg-type]
    with pytest.raises(InvalidInputError, match=r"DepthTrackerModel\.knows_hand must be .*, not 'no'"):
        DepthTrackerModel(knows_hand="no").validate()  # type: ignore[arg-type]


def test_a_turn_about_the_middle_is_followed_wherever_the_frame_s_origin_is(box: ObjectModel) -> None:
    p_OM = np.array([0.8, -0.5, 0.3])
    far = ObjectModel.from_mesh(trimesh.Trimesh(box.vertices + p_OM, box.faces), cache=False)
    seen = picture(box, NO_HAND)
    start = retract(X_CO, np.array([0.2, -0.15, 0.2, 0.01, 0.0, -0.01]))
    start_far, before_far = move_measurement(start, BEFORE, -p_OM)
    near_fit = fit_pose(seen, box, start, BEFORE, DepthTrackerModel())
    far_fit = fit_pose(seen, far, start_far, before_far, DepthTrackerModel())
    assert near_fit is not None
    assert far_fit is not None
    X_CM, covariance = move_measurement(far_fit.X_CO, far_fit.covariance, p_OM)
    np.testing.assert_allclose(X_CM, near_fit.X_CO, atol=1e-4)
    np.testing.assert_allclose(covariance, near_fit.covariance, rtol=0.01, atol=1e-8)
