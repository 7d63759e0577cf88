"""Where in a hand things can be held: where its fingertips come together."""

from collections.abc import Mapping, Sequence

import numpy as np

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.errors import InvalidInputError

_NEAR = 0.04  # from a fingertip to the middle of what it holds, m
_CLEAR = 0.025  # of the palm from there, m
_STEP = 0.015  # of the grid of places that are tried, m
_MOST_ONESIDED = 0.8  # length of the mean direction of two fingertips, seen from between them
_TOLERANCE = 0.15  # share of a place's value below the best
_SAMPLES = 600  # of each fingertip's places that are looked at
_LEAST_SIDE = 0.01  # of the box, m
_SHARE = 0.2  # of the places along each axis that are left out at either end


def find_grip_region(
    reached: Mapping[str, FloatArray], palm: tuple[FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """A box in P where as many fingertips as possible come near to one place, from all sides, clear of the palm.

    Args:
        reached: samples of where each finger's tip can be, shape (n, 3), m, by finger.
        palm: centres (h, 3) and radii (h,) of spheres that fill the palm, m.

    Returns:
        Its lower and upper corners, shape (3,), m.

    Raises:
        InvalidInputError: if no place is between two fingertips.
    """
    some = [tips[:: max(1, len(tips) // _SAMPLES)] for tips in reached.values()]
    points = np.concatenate(some)
    axes = [
        np.arange(low, high + _STEP, _STEP) for low, high in zip(points.min(axis=0), points.max(axis=0), strict=True)
    ]
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    if len(palm[1]):
        gap = np.min([np.linalg.norm(places - p, axis=1) - r for p, r in zip(*palm, strict=True)], axis=0)
        places = places[gap > _CLEAR]
    value = np.array([_togetherness(place, some) for place in places])
    if value.max(initial=0.0) < 2.0 * (1.0 - _MOST_ONESIDED):
        raise InvalidInputError(
            "HandConfig.grip_low, grip_high: are empty, and no place beside the palm is between two fingertips; "
            "the hand's joint limits or frames are not what they should be."
        )
    best = places[value > (1.0 - _TOLERANCE) * value.max()]
    low, high = np.quantile(best, _SHARE, axis=0), np.quantile(best, 1.0 - _SHARE, axis=0)
    widen = np.maximum(0.5 * (_LEAST_SIDE - (high - low)), 0.0)
    return low - widen, high + widen


def _togetherness(place: FloatArray, reached: Sequence[FloatArray]) -> float:
    """The number of fingertips that come near a place, times how little they come from the same side."""
    sides = []
    for tips in reached:
        offset = tips - place
        near = offset[np.einsum("ni,ni->n", offset, offset) < _NEAR**2]
        if len(near):
            mean = near.mean(axis=0)
            sides.append(mean / max(np.linalg.norm(mean), 1e-9))
    return len(sides) * (1.0 - float(np.linalg.norm(np.mean(sides, axis=0)))) if sides else 0.0
