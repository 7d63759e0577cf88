"""Depth images of an object alone."""

import numpy as np
import pytest

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
    with pytest.raises(InvalidInputError, match=r"^DepthView\.depth must have the shape .*, not \(2, 2\)"):
        DepthView(view.depth[:2, :2], view.X_CO, view.camera)
    with pytest.raises(InvalidInputError, match=r"^DepthView\.X_CO must have a rotation matrix"):
        DepthView(view.depth, 2.0 * view.X_CO, view.camera)
    depth = view.depth.astype(np.float32)
    depth[row, column] = np.nan
    unknown = DepthView(depth.tolist(), np.vstack([view.X_CO, [0.0, 0.0, 0.0, 1.0]]), view.camera)  # type: ignore[arg-type]
    np.testing.assert_allclose(unknown.p_OQ, view.p_OQ[1:], atol=1e-6)
    assert np.isnan(unknown.depth_behind(view.p_OQ[:1])).all()
