"""Detects the rotations that leave an object unchanged, from its shape.

A rotation about an axis through the centroid is a symmetry if the rotated surface samples lie on the surface again, and
their normals agree. The inertia tells where axes can be: an axis of symmetry is a principal axis, and one of order
three or more makes the two other principal moments equal. So distinct moments leave three candidates; two equal ones
add every direction of a plane (order two only); three equal ones add every direction. Each candidate is refined by
Gauss-Newton on the distances before it is tested.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.poses import identity_poses
from tactopose_drake.core.shape.symmetry import CONTINUOUS, RotationalSymmetry, symmetry_group
from tactopose_drake.core.shape.symmetry_judge import JudgedShape, SymmetryDetectionParams, SymmetryJudge
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.errors import InvalidInputError

_USUAL = SymmetryDetectionParams()
# Thresholds of near symmetries, such as those of a scanned can: shares of the size and of the mean distance from the
# longest axis, and the largest distance over the first.
_NEAR_TOLERANCE, _NEAR_RADIUS_SHARE, _NEAR_OUTLIER_FACTOR = 0.025, 0.1, 2.0
# Thresholds of likenesses. These are only tried, so they may be wide; noise of a scan tilts its faces by tens of
# degrees.
_ROUGHLY = SymmetryDetectionParams(
    tolerance=0.04,
    radius_share=0.15,
    normal_angle=np.radians(45.0),
    continuous_normal_angle=np.radians(45.0),
    equal_moments=0.1,
)
_CUBE_S_GROUP = 24  # number of rotations that leave a cube unchanged
# Orders that are tried for a body with three equal moments; the others are multiples. The finite rotation groups have
# orders up to 5, but a prism about as high as it is wide has such moments too.
_ORDERS_OF_THREE_EQUAL = (5, 4, 3, 2, 7, 11, 13, 17, 19, 23, 29)


def detect_symmetries(shape: JudgedShape, params: SymmetryDetectionParams = _USUAL) -> tuple[RotationalSymmetry, ...]:
    """The axes about which the object may be turned without a change, highest order first, continuous before all.

    A rotation is a symmetry if the 95th percentile of the rotated samples' distances is at most the tolerance times the
    size (and 5 % of the samples' mean distance from the longest axis, or the error of the grid itself), the largest
    three times that, and the median angle between the normals 5 degrees (7.5 for a continuous axis; the grid's normals
    are smooth across edges below 30 degrees, so a prism of 16 sides and more counts as a cylinder). A cylinder's flips,
    about any axis across the first, are represented by one of order two; a sphere by three continuous axes.

    Args:
        shape: the object.
        params: tolerances, and how thoroughly axes are searched for.
    """
    (moments, principal), centroid = shape.principal(), shape.centroid
    judge = SymmetryJudge(shape, params)
    alike = _others_alike(moments, params)
    if ball := _of_a_ball(judge, alike, centroid):
        return ball

    for axis in _third_turns(judge, principal, alike):
        if judge.turns_freely(axis):
            across = np.linalg.svd(axis[None])[2][1]
            flips = [RotationalSymmetry(across, centroid, 2)] if judge.holds(across, _turns_of(2)) else []
            return (RotationalSymmetry(axis, centroid, CONTINUOUS), *flips)

    found: list[tuple[int, FloatArray]] = []
    orders = _ORDERS_OF_THREE_EQUAL if alike.all() else range(params.highest_order, 1, -1)
    for order in (each for each in orders if each <= params.highest_order):
        turn = 2 * np.pi / order
        seeds = _seeds(order, principal, alike, params.directions)
        near = _distinct(judge.refine(judge.most_promising(seeds, turn), turn, 3))
        for axis in _distinct(judge.refine(near, turn, 4)):
            known = any(_parallel(axis, other) for _, other in found)
            if not known and judge.holds(axis, _turns_of(order)):
                multiples = range(order * (params.highest_order // order), order, -order)
                found.append((next((m for m in multiples if judge.holds(axis, _turns_of(m))), order), axis))
    found.sort(key=lambda item: -item[0])
    return _one_group((RotationalSymmetry(axis, centroid, order) for order, axis in found), judge)


def detect_near_symmetries(
    shape: JudgedShape, found: Iterable[RotationalSymmetry], params: SymmetryDetectionParams = _USUAL
) -> tuple[RotationalSymmetry, ...]:
    """The axes about which every rotation nearly leaves the object unchanged, unless there is a continuous symmetry.

    Examples are a scan of a can, or a can with a dent. A rotation counts if the 95th percentile of the samples'
    distances is at most 2.5 % of the size and 10 % of their mean distance from the longest axis, the largest 5 % of the
    size, and the median angle between the normals that of a continuous axis. A three-fold or higher symmetry about the
    axis is taken to be intended, as of a pencil or a nut. A ball is represented by three axes.

    Args:
        shape: the object.
        found: the result of `detect_symmetries`.
        params: those given to it.
    """
    known = tuple(found)
    if any(symmetry.is_continuous for symmetry in known):
        return ()
    loose = replace(
        params,
        tolerance=max(_NEAR_TOLERANCE, params.tolerance),
        radius_share=max(_NEAR_RADIUS_SHARE, params.radius_share),
        outlier_factor=_NEAR_OUTLIER_FACTOR,
    )
    (moments, principal), centroid = shape.principal(), shape.centroid
    judge = SymmetryJudge(shape, loose)
    alike = _others_alike(moments, params)
    if ball := _of_a_ball(judge, alike, centroid):
        return ball
    for refined in _third_turns(judge, principal, alike):
        axis = refined * np.sign(refined[np.abs(refined).argmax()])
        meant = any(symmetry.order > 2 and _parallel(axis, symmetry.axis) for symmetry in known)
        if not meant and judge.turns_freely(axis):
            return (RotationalSymmetry(axis, centroid, CONTINUOUS),)
    return ()


def detect_likenesses(shape: JudgedShape, found: Iterable[RotationalSymmetry]) -> FloatArray:
    """The rotations that leave the object roughly unchanged, as poses X_OO', the identity first, shape (n, 3, 4).

    Examples are those of a cube for a die, or for a noisy scan of a cube. A rotation counts if the 95th percentile of
    the samples' distances is at most 4 % of the size and 15 % of their mean distance from the longest axis, the largest
    12 % of the size, and the median angle between the normals 45 degrees.

    The identity alone is returned if all moments of inertia differ by more than 10 %, as only half turns about the
    principal axes could be such rotations; if every rotation about an axis counts, as their number is not finite; and
    if the symmetries are as many as those of a cube, as larger groups hardly contain them.

    Args:
        shape: the object.
        found: the result of `detect_symmetries`.
    """
    if len(symmetry_group(found)) >= _CUBE_S_GROUP or not _others_alike(shape.principal()[0], _ROUGHLY).any():
        return identity_poses(1)
    alike = detect_symmetries(shape, _ROUGHLY)
    return identity_poses(1) if any(symmetry.is_continuous for symmetry in alike) else symmetry_group(alike)


def _others_alike(moments: FloatArray, params: SymmetryDetectionParams) -> NDArray[np.bool_]:
    """For each principal axis, whether the moments about the two others may be equal; moments are ascending."""
    alike: NDArray[np.bool_] = (moments[[2, 2, 1]] - moments[[1, 0, 0]]) / moments[2] < params.equal_moments
    return alike


def _of_a_ball(judge: SymmetryJudge, alike: NDArray[np.bool_], centroid: FloatArray) -> tuple[RotationalSymmetry, ...]:
    """The three axes that represent a ball, if every rotation leaves the object unchanged; else none."""
    is_ball = alike.all() and all(judge.turns_freely(axis) for axis in _sphere_directions(6))
    return tuple(RotationalSymmetry(axis, centroid, CONTINUOUS) for axis in np.eye(3)) if is_ball else ()


def _third_turns(judge: SymmetryJudge, principal: FloatArray, alike: NDArray[np.bool_]) -> Iterator[FloatArray]:
    """The principal axes whose two other moments may be equal, each refined for rotations by a third of a turn."""
    for k in np.flatnonzero(alike):
        yield judge.refine(principal[k : k + 1], 2 * np.pi / 3, 6)[0]


def _seeds(order: int, principal: FloatArray, alike: NDArray[np.bool_], directions: int) -> FloatArray:
    """Directions (n, 3) near which an axis of this order may lie, given which pairs of moments are equal."""
    if alike.all():
        return np.concatenate([principal, _sphere_directions(directions)])
    if order > 2:
        return principal[alike]
    angles = np.arange(0.0, np.pi, np.radians(3.0))
    planes = [
        np.outer(np.cos(angles), principal[k - 2]) + np.outer(np.sin(angles), principal[k - 1])
        for k in np.flatnonzero(alike)
    ]
    return np.concatenate([principal, *planes])


def _turns_of(order: int) -> FloatArray:
    """The angles 2 pi j / order up to half a turn; the others are their inverses."""
    return np.arange(1.0, order // 2 + 1) * (2 * np.pi / order)


def _parallel(axis: FloatArray, other: FloatArray) -> bool:
    return abs(float(axis @ other)) > 0.9986  # 3 degrees


def _distinct(axes: FloatArray) -> FloatArray:
    """The axes (n, 3) without those parallel to an earlier one."""
    kept: list[FloatArray] = []
    for axis in axes:
        if not any(_parallel(axis, other) for other in kept):
            kept.append(axis)
    return np.array(kept).reshape(-1, 3)


def _one_group(symmetries: Iterable[RotationalSymmetry], judge: SymmetryJudge) -> tuple[RotationalSymmetry, ...]:
    """The symmetries, in order, that generate one finite group of rotations that all leave the object unchanged.

    For an almost symmetric object more may be found, and products of rotations within the tolerance may exceed it.
    """
    kept: tuple[RotationalSymmetry, ...] = ()
    for symmetry in symmetries:
        try:
            group = symmetry_group([*kept, symmetry])
        except InvalidInputError:
            continue
        if not judge.holds_all(group):
            continue
        kept = (*kept, symmetry)
    return kept


def _sphere_directions(count: int) -> FloatArray:
    """Unit vectors spread evenly over a hemisphere (Fibonacci), shape (count, 3)."""
    z = (np.arange(count) + 0.5) / count
    angle = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(count)
    radius = np.sqrt(1.0 - z * z)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
