"""From where a scene is best seen."""

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.core.vision.rasterizer import Camera, Surface, render
from tactopose_drake.visualization.scene import Scene, arrow_lengths

# The hand is of interest this far from the object, m.
_SURROUNDINGS = 0.05
# Azimuths and elevations among which the view is chosen.
_AZIMUTHS = np.radians(np.arange(0.0, 360.0, 30.0))
_ELEVATIONS = np.radians([12.0, 35.0])
_SIZE = (84, 74)  # of the small images that the views are judged by, pixels
_CONTACT_WEIGHT = 0.2


def points_of_interest(scene: Scene) -> FloatArray:
    """Points in P that a picture should hold: the object at all its poses, the touch, the hand near it, (n, 3), m."""
    poses = [pose for pose in (scene.prior, scene.estimate, scene.truth) if pose is not None]
    thing = [pose.multiply(scene.model.vertices.T).T for pose in poses]
    points = np.concatenate([scene.contacts.p_PC, _arrow_tips(scene), *thing])
    if scene.hand is None or not len(points):
        return points
    low, high = points.min(axis=0) - _SURROUNDINGS, points.max(axis=0) + _SURROUNDINGS
    near = np.all((scene.hand.vertices > low) & (scene.hand.vertices < high), axis=1)
    return np.concatenate([points, scene.hand.vertices[near]])


def choose_view(scene: Scene) -> FloatArray:
    """Of a ring of directions from the scene to the camera, the one that shows most of object and contacts, (3,)."""
    points = points_of_interest(scene)
    up = scene.up_P / np.linalg.norm(scene.up_P)
    side = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    side /= np.linalg.norm(side)
    ahead = np.cross(up, side)
    directions = [
        np.cos(elevation) * (np.cos(azimuth) * side + np.sin(azimuth) * ahead) + np.sin(elevation) * up
        for elevation in _ELEVATIONS
        for azimuth in _AZIMUTHS
    ]
    return max(
        directions, key=lambda direction: _shown(scene, Camera.framing(points, direction, up, *_SIZE), direction)
    )


def _shown(scene: Scene, camera: Camera, direction: FloatArray) -> float:
    """Share of a small image in which the object is seen past the hand, and the share of contacts on the near side."""
    share = contacts = 0.0
    pose = scene.estimate or scene.prior
    if pose is not None:
        seen = _inverse_depth(pose.multiply(scene.model.vertices.T).T, scene.model.faces, camera)
        if scene.hand is not None:
            seen = np.where(seen > _inverse_depth(scene.hand.vertices, scene.hand.faces, camera), seen, 0.0)
        share = float(np.mean(seen > 0.0))
    if scene.contacts.n_PC is not None and len(scene.contacts):
        contacts = float(np.mean(scene.contacts.n_PC @ direction > -0.2))
    return share + _CONTACT_WEIGHT * contacts


def _inverse_depth(vertices: FloatArray, faces: NDArray[np.int32], camera: Camera) -> NDArray[np.floating]:
    blank = np.zeros_like(vertices)
    return render(Surface(vertices, blank, faces, blank), camera).inverse_depth


def _arrow_tips(scene: Scene) -> FloatArray:
    contacts = scene.contacts
    if contacts.f_PC is None:
        return contacts.p_PC
    forces = np.linalg.norm(contacts.f_PC, axis=1, keepdims=True)
    tips: FloatArray = contacts.p_PC + arrow_lengths(contacts)[:, None] * contacts.f_PC / np.maximum(forces, 1e-12)
    return tips
