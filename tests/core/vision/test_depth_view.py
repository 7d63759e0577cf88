"""Depth images of an object alone."""

import numpy as np
import pytest

from tactopose_drake.core.poses import exp_so3, inverse, make_poses, transform_points
from tactopose_drake.core.vision.depth_pictures import DepthCameraModel
from tactopose_drake.core.vision.depth_view import DepthView
from tactopose_drake.errors import InvalidInputError
from tests.core.models import brick
from tests.core.vision.seen_scenes import views_of


def test_depths_are_told_from_what_is_none() -> None:
    """Cameras write 0 where they have no answer, which would be a point in the camera."""
    view = views_of(brick(0.06, 0.08, 0.1), 120.0)[0]
    row, column = np.argwhere(np.isfinite(view.depth))[0]
    for wrong in (0.0, -0.1):
        depth = np.where(np.isfinite(view.depth), view.depth, wrong)
        with pytest.raises(
            InvalidInputError, match=rf"^DepthView\.depth\[0, 0\] must be a number > 0, .*, not {wrong:g}"
        ):
            DepthView(depth, view.X_CO, view.camera)
    with pytest.raises(InvalidInputError, match=r"^DepthView\.depth must have the camera's shape, .*, not \(2, 2\)"):
        DepthView(view.depth[:2, :2], view.X_CO, view.camera)
    with pytest.raises(InvalidInputError, match=r"^DepthView\.depth must be in metres, but .* what is in millimetres"):
        DepthView(1e3 * view.depth, view.X_CO, view.camera)
    with pytest.raises(InvalidInputError, match=r"^DepthView\.X_CO must have a rotation matrix"):
        DepthView(view.depth, 2.0 * view.X_CO, view.camera)
    depth = view.depth.astype(np.float32)
    depth[row, column] = np.nan
    unknown = DepthView(depth.tolist(), np.vstack([view.X_CO, [0.0, 0.0, 0.0, 1.0]]), view.camera)  # type: ignore[arg-type]
    np.testing.assert_allclose(unknown.p_OQ, view.p_OQ[1:], atol=1e-6)
    assert np.isnan(unknown.depth_behind(view.p_OQ[:1])).all()


def test_a_pixel_is_a_point_on_its_ray_and_what_lies_on_the_ray_is_before_or_behind_it() -> None:
    """Of a camera as OpenCV tells it: where its axis meets the image, counted from the first pixel's middle."""
    camera = DepthCameraModel(width=4, height=3, focal_length=2.0, center_x=1.0, center_y=2.0)
    depth = np.full((3, 4), np.inf)
    depth[0, 3] = 0.5  # two to the right of the axis, and two above it
    X_CO = make_poses(exp_so3(np.array([0.3, -0.4, 0.2])), np.array([0.1, 0.2, 0.6]))
    view, X_OC = DepthView(depth, X_CO, camera), inverse(X_CO)
    np.testing.assert_allclose(view.p_OQ, transform_points(X_OC, np.array([[0.5, -0.5, 0.5]])), atol=1e-12)
    expected = {
        (1.0, -1.0): 0.1,
        (1.2, -1.2): 0.1,  # in the same pixel
        (0.5, -1.0): np.inf,
        (-0.5, 0.0): np.inf,  # in the first column and the last row
        (1.5, -1.0): np.nan,
        (-1.0, -1.0): np.nan,
        (1.0, -1.5): np.nan,
        (1.0, 0.5): np.nan,
    }
    p_CQ = 0.4 * np.insert(list(expected), 2, 1.0, axis=1)
    behind = view.depth_behind(transform_points(X_OC, p_CQ))
    np.testing.assert_allclose(behind, list(expected.values()), atol=1e-12)
    assert view.depth_behind(transform_points(X_OC, 2.0 * p_CQ[:1])) == pytest.approx(-0.3)
