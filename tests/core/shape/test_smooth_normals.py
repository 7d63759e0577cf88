import math

import numpy as np
import trimesh

from tactopose_drake.core.shape.smooth_normals import corner_normals

CREASE = math.cos(math.radians(30.0))


def test_around_the_hub_of_a_wide_fan_normals_are_averaged_as_around_a_small_one() -> None:
    # All faces with all would be 4e8 pairs here, and an hour of work around a hub of a million.
    cone = trimesh.creation.cone(radius=0.03, height=0.1, sections=20_000)
    normals = corner_normals(cone.vertices, cone.faces.astype(np.int32), cone.face_normals, CREASE)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=2), 1.0, atol=1e-12)
    apex = np.argmax(cone.vertices[:, 2])
    face, corner = np.nonzero(cone.faces == apex)
    assert len(face) == 20_000
    # Faces turned by up to 30 degrees about the axis count, evenly to both sides: horizontally a corner's own remains,
    # but for the spacing of the thousand that are asked.
    own, mean = cone.face_normals[face], normals[face, corner]
    horizontal = np.einsum("fi,fi->f", own[:, :2], mean[:, :2])
    across = np.linalg.norm(own[:, :2], axis=1) * np.linalg.norm(mean[:, :2], axis=1)
    assert np.degrees(np.arccos(np.clip(horizontal / across, -1.0, 1.0))).max() < 360.0 / 1000
    assert np.ptp(mean[:, 2]) < 2e-3
