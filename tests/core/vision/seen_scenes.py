"""Depth images of an object and a hand, rendered without Drake."""

import numpy as np

from tactopose_drake.core.poses import transform_points
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.vision.depth_pictures import DepthCameraModel, DepthPicture, noisy_depth, take_picture
from tactopose_drake.core.vision.rasterizer import inverse_depths

NO_HAND = np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int32)


def depth_of_scene(
    model: ObjectModel, X_CO: np.ndarray, hand: tuple[np.ndarray, np.ndarray], camera: DepthCameraModel
) -> np.ndarray:
    """The depths (height, width) of an object at X_CO (3, 4) and a hand's vertices and faces; infinite beside them."""
    of_object = inverse_depths(transform_points(X_CO, model.vertices), model.faces, camera.at_origin)
    nearest = np.maximum(of_object, inverse_depths(*hand, camera.at_origin)).astype(np.float64)
    return np.divide(1.0, nearest, out=np.full_like(nearest, np.inf), where=nearest > 0.0)


def picture_of(
    model: ObjectModel,
    X_CO: np.ndarray,
    hand: tuple[np.ndarray, np.ndarray],
    camera: DepthCameraModel,
    generator: np.random.Generator,
    knows_hand: bool = True,
) -> DepthPicture:
    """A noisy picture, in which the hand is known or not."""
    depth = noisy_depth(depth_of_scene(model, X_CO, hand, camera), camera, generator)
    return take_picture(depth, *(hand if knows_hand else NO_HAND), camera)
