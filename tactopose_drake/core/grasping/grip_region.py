"""The region of a hand in which things can be held: where its fingertips press on one place from all sides."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from tactopose_drake.core.grasping.finger_reach import FingerReach, ReachParams, alignment
from tactopose_drake.core.shape.sphere_packing import Spheres
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.errors import InvalidInputError

_NEAR, _FAR = 0.012, 0.04  # range of distances from the centre of a held thing to that of a fingertip, m
_CLEAR = 0.025  # least distance of such a centre from the palm, m
_STEP = 0.015  # spacing of the grid of places, m
_BEHIND = 0.3  # cosine by which a fingertip that presses may face backwards
_EVENLY = 0.33  # power of how often a fingertip presses there: several that do so sometimes are better than one
_MOST_ONESIDED = 0.8  # length of the mean direction of two fingertips, seen from between them
_SHARPNESS = 8  # power of a place's value that gives its weight
_SAMPLES = 1500  # most samples of each fingertip's workspace
_LEAST_SIDE = 0.01  # of the box, m
_SHARE = 0.25  # quantile of the weight along each axis that is cut off at either end


def find_grip_region(
    fingers: Mapping[str, FingerReach], palm: Spheres, params: ReachParams
) -> tuple[FloatArray, FloatArray]:
    """Finds a box in P where as many fingertips as possible can press on one place, from all sides, clear of the palm.

    Args:
        fingers: workspace of each finger's tip, by finger.
        palm: centres (h, 3) and radii (h,) of spheres that fill the palm, m.
        params: what counts as a clean touch.

    Returns:
        The box's lower and upper corners, shape (3,), m.

    Raises:
        InvalidInputError: if no place is between two fingertips.
    """
    tips = [_Tips.of(finger) for finger in fingers.values()]
    axes = _grid(np.concatenate([each.p_PT for each in tips]))
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    clear = np.ones(places.shape[:3], dtype=np.bool_)
    for centre, radius in zip(*palm, strict=True):
        clear &= np.linalg.norm(places - centre, axis=-1) - radius > _CLEAR
    value, least = np.zeros(clear.shape), 2.0 * (1.0 - _MOST_ONESIDED)
    value[clear] = _togetherness(places[clear], tips, params)
    if value.max(initial=0.0) < least:
        # If sensors are elsewhere on the finger, the axis from there does not tell how the fingertip faces.
        value[clear] = _togetherness(places[clear], [replace(each, axis=None) for each in tips], params)
    if value.max(initial=0.0) < least:
        raise InvalidInputError(
            "HandConfig.grip_low and grip_high must be given, as no place beside the palm is between two fingertips. "
            "Check the hand's joint limits and frames."
        )
    corners = np.array([_middle(axis, value**_SHARPNESS, along) for along, axis in enumerate(axes)])
    widen = np.maximum(0.5 * (_LEAST_SIDE - (corners[:, 1] - corners[:, 0])), 0.0)
    return corners[:, 0] - widen, corners[:, 1] + widen


@dataclass(frozen=True, eq=False)
class _Tips:
    """Samples of a fingertip's position (n, 3), with its compliance (n, 3, 3) and axis (n, 3), if it has one."""

    p_PT: FloatArray
    compliance: FloatArray
    axis: FloatArray | None

    @classmethod
    def of(cls, finger: FingerReach) -> Self:
        some, axis = slice(None, None, max(1, len(finger.reached) // _SAMPLES)), finger.axis
        return cls(finger.reached[some], finger.compliance[some], None if axis is None else axis[some])

    def pressing(self, place: FloatArray, params: ReachParams) -> tuple[float, FloatArray]:
        """Share of samples that press on a small thing at a place, and their mean direction from there, shape (3,)."""
        offset = self.p_PT - place
        distance = np.linalg.norm(offset, axis=1)
        near = np.flatnonzero((distance > _NEAR) & (distance < _FAR))
        outward = offset[near] / distance[near, None]
        presses = alignment(self.compliance[near], outward) > params.least_alignment
        if self.axis is not None:
            presses &= np.einsum("ni,ni->n", self.axis[near], outward) < _BEHIND
        total = outward[presses].sum(axis=0)
        return np.count_nonzero(presses) / len(offset), total / max(float(np.linalg.norm(total)), 1e-9)


def _grid(points: FloatArray) -> list[FloatArray]:
    """Grid coordinates along each axis that cover points (n, 3): multiples of the step, so that P is on the grid."""
    ends = zip(np.floor(points.min(axis=0) / _STEP), np.ceil(points.max(axis=0) / _STEP), strict=True)
    return [_STEP * np.arange(low, high + 1.0) for low, high in ends]


def _togetherness(places: FloatArray, tips: list[_Tips], params: ReachParams) -> FloatArray:
    """Number of fingertips that press on places (n, 3), minus how one-sided their directions are, shape (n,)."""
    often, direction = np.empty((len(places), len(tips))), np.empty((len(places), len(tips), 3))
    for i, place in enumerate(places):
        for j, each in enumerate(tips):
            often[i, j], direction[i, j] = each.pressing(place, params)
    weight = (often / np.maximum(often.max(axis=0, initial=0.0), 1e-9)) ** _EVENLY
    onesided = np.linalg.norm(np.einsum("nf,nfi->ni", weight, direction), axis=1)
    together: FloatArray = weight.sum(axis=1) - onesided
    return together


def _middle(axis: FloatArray, weight: FloatArray, along: int) -> tuple[float, float]:
    """Quantiles of the weight of a grid (n, m, k) along an axis, at `_SHARE` from either end."""
    others = tuple(other for other in range(3) if other != along)
    below = np.append(0.0, np.cumsum(weight.sum(axis=others)))
    edges = np.append(axis - 0.5 * _STEP, axis[-1] + 0.5 * _STEP)
    low, high = np.interp([_SHARE, 1.0 - _SHARE], below / below[-1], edges)
    return float(low), float(high)
