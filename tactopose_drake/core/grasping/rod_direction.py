"""The direction in which a rod must lie in a hand so that its fingers close on it from opposite sides."""

import itertools
from collections.abc import Mapping

import numpy as np

from tactopose_drake.core.grasping.finger_reach import FingerReach, alignment
from tactopose_drake.core.shape.sphere_packing import Spheres
from tactopose_drake.core.validation import FloatArray

_RADII = (0.012, 0.02, 0.03)  # of the rods that are tried, m
_HALF = 0.04  # half of their length, m
_NEAR = 0.006  # distance from a rod within which a fingertip counts as touching it, m
_CLEAR = 0.004  # least distance from the palm, m
_LEAST_ALIGNMENT = 0.75  # cosine between the normal and the motion of a fingertip that presses
_LEAST_OPPOSITION = 0.8  # negative cosine between the normals of two fingers that oppose each other
_SAMPLES = 600  # most samples of each fingertip's workspace
_PLACES = 3  # along each side of the grip region
_LEAST_SHARE = 0.5  # share of the best direction's value with which the first one is kept
_DIRECTIONS = np.array([d for d in itertools.product((-1.0, 0.0, 1.0), repeat=3) if d > (0.0, 0.0, 0.0)])


def rod_direction(
    first: FloatArray,
    fingers: Mapping[str, FingerReach],
    palm: Spheres,
    grip_low: FloatArray,
    grip_high: FloatArray,
) -> FloatArray:
    """A direction in P in which the hand holds rods, shape (3,): the first, unless another is far better.

    Args:
        first: the expected direction, unit length, shape (3,).
        fingers: by name.
        palm: centres (h, 3) and radii (h,) of spheres that fill the palm, m.
        grip_low: lower corner of the grip region, shape (3,), m.
        grip_high: its upper corner.
    """
    axes = [np.linspace(low, high, _PLACES) for low, high in zip(grip_low, grip_high, strict=True)]
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    directions = [first, *(_DIRECTIONS / np.linalg.norm(_DIRECTIONS, axis=1, keepdims=True))]
    worth = np.array(
        [
            sum(_closing(place, direction, radius, fingers, palm) for place in places for radius in _RADII)
            for direction in directions
        ]
    )
    chosen: FloatArray = directions[0 if worth[0] >= _LEAST_SHARE * worth.max() else int(np.argmax(worth))]
    return chosen


def _closing(
    place: FloatArray,
    direction: FloatArray,
    radius: float,
    fingers: Mapping[str, FingerReach],
    palm: Spheres,
) -> int:
    """How many fingers can press on a rod through a place; 0 if no two oppose each other or the palm is in the way."""
    across, along = _from_axis(palm[0] - place, direction)
    along = along - np.clip(along, -_HALF, _HALF)
    if np.min(np.hypot(np.linalg.norm(across, axis=1), along) - palm[1], initial=np.inf) < radius + _CLEAR:
        return 0
    normals = []
    for finger in fingers.values():
        step = max(1, len(finger.reached) // _SAMPLES)
        across, along = _from_axis(finger.reached[::step] - place, direction)
        distance = np.linalg.norm(across, axis=1)
        near = (np.abs(distance - radius - finger.geometry.tip_radius) < _NEAR) & (np.abs(along) < _HALF)
        normal = across[near] / distance[near, None]
        normal = normal[alignment(finger.compliance[::step][near], normal) > _LEAST_ALIGNMENT]
        if len(normal):
            normals.append(normal)
    opposed = any(float((a @ b.T).min()) < -_LEAST_OPPOSITION for a, b in itertools.combinations(normals, 2))
    return len(normals) if opposed else 0


def _from_axis(offset: FloatArray, direction: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Components of offsets (n, 3) across a direction, (n, 3), and along it, (n,)."""
    along = offset @ direction
    return offset - along[:, None] * direction, along
