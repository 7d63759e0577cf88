"""Depth images fused into distances on a grid."""

import numpy as np

from tactopose_drake.core.vision.depth_fusion import FusedVolume, FusionParams
from tests.core.models import brick
from tests.core.vision.seen_scenes import views_of


def test_what_lies_behind_a_surface_is_known_as_deep_as_distances_are() -> None:
    """Of one image; deeper, and where it sees nothing, all is as solid as can be."""
    view, params = views_of(brick(0.06, 0.08, 0.1), 120.0)[0], FusionParams()
    volume = FusedVolume.of([view], params, np.array([[-0.1] * 3, [0.1] * 3]))
    axes = [volume.origin[i] + volume.spacing * np.arange(volume.values.shape[i]) for i in range(3)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    within = np.abs(points).max(axis=3) < 0.1 - params.truncation
    behind = view.depth_behind(points[within])
    expected = np.where(np.isnan(behind), -params.truncation, np.clip(behind, -params.truncation, params.truncation))
    assert np.count_nonzero((behind > -0.9 * params.truncation) & (behind < -0.6 * params.truncation)) > 100
    np.testing.assert_allclose(volume.values[within], expected, atol=1e-12)
