"""The viewpoint of a scene."""

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.poses import axes_across
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.core.vision.rasterizer import Camera, DrawnSurface, render
from tactopose_drake.visualization.scene import Scene, arrow_lengths
from tactopose_drake.visualization.uncertainty import ellipsoids, free_arrows, shown_points

# Minimum probability of a hypothesis beside the best that the view must hold.
_LEAST_FRAMED = 0.1
# The view holds the hand up to this distance from the object, m.
_SURROUNDINGS = 0.05
# Candidate azimuths and elevations of the view.
_AZIMUTHS = np.radians(np.arange(0.0, 360.0, 30.0))
_ELEVATIONS = np.radians([15.0, 38.0])
_SIZE = (84, 74)  # of the small images by which views are compared, pixels
_CONTACT_WEIGHT = 0.6  # of the share of visible contacts, against the object's relative visible area
_STANDS_OFF = 0.005  # a contact is visible if a point this far along its normal is, m


def points_of_interest(scene: Scene) -> FloatArray:
    """Points in P that a picture should hold: the object at all its poses, the touch, the hand near it, (n, 3), m."""
    others = [other.X_PO for other in scene.alternatives if other.probability >= _LEAST_FRAMED]
    poses = [pose for pose in (scene.prior, scene.estimate, scene.truth, *others) if pose is not None]
    arrows = free_arrows(scene.model, scene.hypotheses[0]) if scene.hypotheses else []
    thing = [pose.multiply(scene.model.vertices.T).T for pose in poses]
    marks = [*(arrow.p_PQ for arrow in arrows), *_region_ends(scene)]
    points = np.concatenate([scene.contacts.p_PC, _arrow_tips(scene), *thing, *marks])
    if scene.hand is None or not len(points):
        return points
    low, high = points.min(axis=0) - _SURROUNDINGS, points.max(axis=0) + _SURROUNDINGS
    near = np.all((scene.hand.vertices > low) & (scene.hand.vertices < high), axis=1)
    return np.concatenate([points, scene.hand.vertices[near]])


def choose_view(scene: Scene) -> FloatArray:
    """The direction to the camera, of several candidates, that shows most of the object and its contacts, (3,)."""
    points = points_of_interest(scene)
    up = scene.up_P / np.linalg.norm(scene.up_P)
    side, ahead = axes_across(up)
    directions = np.array(
        [
            np.cos(elevation) * (np.cos(azimuth) * side + np.sin(azimuth) * ahead) + np.sin(elevation) * up
            for elevation in _ELEVATIONS
            for azimuth in _AZIMUTHS
        ]
    )
    seen = np.array([_seen(scene, Camera.framing(points, direction, up, *_SIZE)) for direction in directions])
    scores = seen[:, 0] / max(float(seen[:, 0].max()), 1e-12) + _CONTACT_WEIGHT * seen[:, 1]
    best: FloatArray = directions[int(np.argmax(scores))]
    return best


def _seen(scene: Scene, camera: Camera) -> tuple[float, float]:
    """The object's visible area, m^2, and the share of contacts that neither object nor hand hides."""
    nearest: NDArray[np.floating] = np.zeros((camera.height, camera.width))
    pose = scene.estimate or scene.prior or scene.truth
    if pose is not None:
        nearest = _inverse_depth(pose.multiply(scene.model.vertices.T).T, scene.model.faces, camera)
    if scene.hand is not None:
        hand = _inverse_depth(scene.hand.vertices, scene.hand.faces, camera)
        shown, nearest = nearest > hand, np.maximum(nearest, hand)
    else:
        shown = nearest > 0.0
    # A pixel covers a larger area at a larger distance.
    area = float(np.sum(1.0 / nearest[shown] ** 2)) / camera.focal_length**2
    contacts = scene.contacts
    if contacts.n_PC is None or not len(contacts):
        return area, 0.0
    p_C = (contacts.p_PC + _STANDS_OFF * contacts.n_PC) @ camera.X_CP[:, :3].T + camera.X_CP[:, 3]
    pixel = camera.focal_length * p_C[:, :2] / p_C[:, 2:] + camera.center
    column, row = np.clip(pixel, 0, [camera.width - 1, camera.height - 1]).astype(int).T
    return area, float(np.mean(1.0 / p_C[:, 2] >= nearest[row, column]))


def _inverse_depth(vertices: FloatArray, faces: NDArray[np.int32], camera: Camera) -> NDArray[np.floating]:
    blank = np.zeros_like(vertices)
    return render(DrawnSurface(vertices, blank, faces, blank), camera).inverse_depth


def _arrow_tips(scene: Scene) -> FloatArray:
    contacts = scene.contacts
    if contacts.f_PC is None:
        return contacts.p_PC
    forces = np.linalg.norm(contacts.f_PC, axis=1, keepdims=True)
    tips: FloatArray = contacts.p_PC + arrow_lengths(contacts)[:, None] * contacts.f_PC / np.maximum(forces, 1e-12)
    return tips


def _region_ends(scene: Scene) -> list[FloatArray]:
    """The ends of the axes of each 95 % region of the best hypothesis, in P, each (6, 3), m."""
    if not scene.hypotheses:
        return []
    best = scene.hypotheses[0]
    return [
        (best.X_PO @ found.X_OE).multiply(np.hstack([np.diag(found.radii), -np.diag(found.radii)])).T
        for found in ellipsoids(scene.model, best, shown_points(scene.model))
    ]
