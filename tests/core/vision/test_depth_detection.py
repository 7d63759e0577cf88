"""Finding an object in a depth image of which nothing is known beforehand."""

import numpy as np
import trimesh

from tactopose_drake.core.poses import increments_between, random_rotations
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.vision.depth_detection import find_poses
from tactopose_drake.core.vision.depth_pictures import DepthCameraModel
from tactopose_drake.core.vision.depth_tracking import DepthTrackerModel
from tests.core.vision.seen_scenes import NO_HAND, picture_of

CAMERA = DepthCameraModel(width=120, height=90, focal_length=110.0)


def wedge() -> ObjectModel:
    """Without any symmetry."""
    corners = np.array(
        [[0, 0, 0], [0.09, 0, 0], [0, 0.06, 0], [0.09, 0.03, 0], [0, 0, 0.12], [0.05, 0, 0.12], [0, 0.02, 0.1]]
    )
    return ObjectModel.from_mesh(trimesh.convex.convex_hull(corners), cache=False)


def test_it_finds_an_object_that_may_be_anyhow_and_partly_hidden() -> None:
    model, bar = wedge(), trimesh.creation.box([0.3, 0.02, 0.01])
    bar.apply_translation([0.0, 0.0, 0.4])
    finger = np.array(bar.vertices), np.array(bar.faces, dtype=np.int32)
    for seed, hand in ((0, NO_HAND), (1, NO_HAND), (2, finger)):
        generator = np.random.default_rng(seed)
        R_CO = random_rotations(generator, 1)[0]
        X_CO = np.column_stack([R_CO, np.array([0.01, 0.02, 0.5]) - R_CO @ model.vertices.mean(axis=0)])
        found = find_poses(picture_of(model, X_CO, hand, CAMERA, generator), model, DepthTrackerModel())
        error = increments_between(found[0].X_CO, X_CO)
        assert np.linalg.norm(error[3:]) < 0.008
        assert np.linalg.norm(error[:3]) < 0.1


def test_of_a_hidden_object_there_is_no_pose() -> None:
    model, wall = wedge(), trimesh.creation.box([0.5, 0.5, 0.01])
    wall.apply_translation([0.0, 0.0, 0.3])
    hand = np.array(wall.vertices), np.array(wall.faces, dtype=np.int32)
    X_CO = np.column_stack([np.eye(3), [0.0, 0.0, 0.5]])
    picture = picture_of(model, X_CO, hand, CAMERA, np.random.default_rng(0))
    assert not find_poses(picture, model, DepthTrackerModel())
