"""Depth images of an object and a hand, rendered without Drake."""

import math

import numpy as np

from tactopose_drake.core.poses import transform_points
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.vision.depth_pictures import DepthCameraModel, DepthPicture, noisy_depth, take_picture
from tactopose_drake.core.vision.depth_view import DepthView
from tactopose_drake.core.vision.rasterizer import inverse_depths

NO_HAND = np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int32)
VIEW_CAMERA = DepthCameraModel(width=200, height=150, focal_length=220.0)


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


def views_of(model: ObjectModel, apart: float, count: int = 3) -> list[DepthView]:
    """From 0.5 m and 30 degrees above, about z."""
    found = []
    for i in range(count):
        angle = math.radians(apart * (i - 1) + 20.0)
        forward = -np.array([math.cos(angle) * math.sqrt(0.75), math.sin(angle) * math.sqrt(0.75), 0.5])
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        R_CO = np.stack([right, np.cross(forward, right), forward])
        X_CO = np.column_stack([R_CO, [0.0, 0.0, 0.5]])
        depth = noisy_depth(depth_of_scene(model, X_CO, NO_HAND, VIEW_CAMERA), VIEW_CAMERA, np.random.default_rng(i))
        found.append(DepthView(depth, X_CO, VIEW_CAMERA))
    return found
