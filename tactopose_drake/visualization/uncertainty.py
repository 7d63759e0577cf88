"""The drawn uncertainty of a pose: 95 % regions of points of the object, and directions that the touch leaves free."""

import dataclasses
from typing import NamedTuple

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from tactopose_drake.core.posterior import determined_rows
from tactopose_drake.core.posterior.moved_origin import has_far_origin
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.estimation.descriptions import direction_name
from tactopose_drake.estimation.far_origins import about_middle
from tactopose_drake.estimation.pose_hypothesis import PoseHypothesis
from tactopose_drake.visualization.appearance import MOST_FREE
from tactopose_drake.visualization.arrow_shapes import SLIDE_TIP, TURN_TIP
from tactopose_drake.visualization.frame_marks import along
from tactopose_drake.visualization.scene import ShownHypothesis

POINTS = 10
"""Number of points of the object at which its uncertainty is drawn."""

_SIGMAS = 2.796  # radius, in standard deviations, of the ellipsoid with 95 % of a Gaussian in three dimensions
_LEAST_RADIUS, _MOST_RADIUS = 1e-5, 0.25  # limits of an ellipsoid's radii, as shares of the object's size
_TURN_RADII = 0.012, 0.08  # limits of the radius of a curved arrow, m
_BEYOND = 0.06  # distance of a straight arrow's head from the object, as a share of its size


class ConfidenceEllipsoid(NamedTuple):
    """The 95 % region of one point of the object, in the directions that the touch determines.

    Attributes:
        X_OE: the ellipsoid's frame E, at the point; its axes are E's.
        radii: drawn radii, shape (3,), m, at most `most_radius`.
        is_cut: whether a radius is larger than that, and drawn smaller.
    """

    X_OE: RigidTransform
    radii: FloatArray
    is_cut: bool


class FreeArrow(NamedTuple):
    """A free direction as it is drawn.

    Attributes:
        is_turn: true for an arrow around the z axis, false for a double-headed one along it.
        X_PA: pose of the arrow's frame A.
        scale: the radius of a rotation's arrow, or the length of a translation's, m.
        name: the label.
    """

    is_turn: bool
    X_PA: RigidTransform
    scale: float
    name: str

    @property
    def p_AT(self) -> FloatArray:
        """Position of its label in A, shape (3,), m."""
        return self.scale * np.array(TURN_TIP if self.is_turn else SLIDE_TIP)

    @property
    def p_PQ(self) -> FloatArray:
        """Its outermost points in P, shape (n, 3), m."""
        angles = np.linspace(0.0, 2.0 * np.pi, 12)
        ring = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)
        outermost = ring if self.is_turn else np.array([[0.0, 0.0, 0.5], [0.0, 0.0, -0.5]])
        points: FloatArray = self.X_PA.multiply(self.scale * outermost.T).T
        return points


def shown_points(model: ObjectModel) -> FloatArray:
    """Points of the object that are far from each other, in O, shape (POINTS, 3), m."""
    vertices = model.vertices
    chosen = [int(np.argmax(np.linalg.norm(vertices - vertices.mean(axis=0), axis=1)))]
    distance = np.full(len(vertices), np.inf)
    while len(chosen) < POINTS:
        distance = np.minimum(distance, np.linalg.norm(vertices - vertices[chosen[-1]], axis=1))
        chosen.append(int(np.argmax(distance)))
    points: FloatArray = vertices[chosen]
    return points


def ellipsoids(model: ObjectModel, hypothesis: ShownHypothesis, p_OQ: FloatArray) -> list[ConfidenceEllipsoid]:
    """The 95 % regions of points (n, 3) of the object, in O; empty without a covariance."""
    if hypothesis.covariance is None:
        return []
    p_ON = model.middle if has_far_origin(model) else np.zeros(3)
    near = _seen_near(model, hypothesis)
    assert near.covariance is not None
    rows = determined_rows(near.covariance, near.free_directions, model.size)
    R_PO = hypothesis.X_PO.rotation().matrix()
    found = []
    for point in p_OQ:
        # R exp(w) p + v: the point moves by w x p + R' v in O.
        moved = np.cross(rows[:, :3], point - p_ON) + rows[:, 3:] @ R_PO
        variance, axes = np.linalg.eigh(moved.T @ moved)
        axes = axes * np.sign(np.linalg.det(axes))
        radii = _SIGMAS * np.sqrt(np.maximum(variance, 0.0))
        most = most_radius(model)
        is_cut = bool(radii.max() > most)
        radii = np.clip(radii, _LEAST_RADIUS * model.size, most)
        found.append(ConfidenceEllipsoid(RigidTransform(RotationMatrix(axes), point), radii, is_cut))
    return found


def most_radius(model: ObjectModel) -> float:
    """Maximum drawn radius of ellipsoids, m; larger ones would hide the object and each other."""
    return _MOST_RADIUS * model.size


def has_cut_ellipsoids(model: ObjectModel, hypothesis: ShownHypothesis) -> bool:
    """Whether any of the drawn ellipsoids is cut off, so that the pose looks more certain than it is."""
    return any(ellipsoid.is_cut for ellipsoid in ellipsoids(model, hypothesis, shown_points(model)))


def free_arrows(model: ObjectModel, hypothesis: ShownHypothesis) -> list[FreeArrow]:
    """The free directions of a hypothesis as arrows in P; none where there are more than can be told apart."""
    if len(hypothesis.free_directions) > MOST_FREE:
        return []
    if has_far_origin(model):
        model, hypothesis = model.about_middle, _seen_near(model, hypothesis)
    X_PO = hypothesis.X_PO
    R_PO = X_PO.rotation().matrix()
    arrows = []
    for direction in hypothesis.free_directions:
        w_O, v_O = direction[:3], R_PO.T @ direction[3:]
        # As in the names: less than 1 rad per metre is a translation.
        is_turn = bool(np.linalg.norm(w_O) >= np.linalg.norm(v_O))
        X_OA, scale = _turn(model, w_O, v_O) if is_turn else _slide(model, v_O)
        arrows.append(FreeArrow(is_turn, X_PO @ X_OA, scale, direction_name(direction, R_PO)))
    return arrows


def _seen_near(model: ObjectModel, hypothesis: ShownHypothesis) -> ShownHypothesis:
    """The hypothesis about the object's middle if its origin is far away, so that rotations would move it far."""
    if not has_far_origin(model):
        return hypothesis
    covariance = np.eye(6) if hypothesis.covariance is None else hypothesis.covariance
    told = PoseHypothesis(hypothesis.X_PO, 0.0, hypothesis.probability, covariance, hypothesis.free_directions)
    near = about_middle(told, model)
    return dataclasses.replace(
        hypothesis,
        X_PO=near.X_PO,
        covariance=None if hypothesis.covariance is None else near.covariance,
        free_directions=near.free_directions,
    )


def _turn(model: ObjectModel, w_O: FloatArray, v_O: FloatArray) -> tuple[RigidTransform, float]:
    """Frame and radius of arrows around the axis of a rotation, outside of the object at half its height.

    If the axis is farther from the object's middle than half its size, the arrows are around the middle.
    """
    axis = w_O / np.linalg.norm(w_O)
    on_axis = np.cross(w_O, v_O) / (w_O @ w_O)
    if np.linalg.norm(np.cross(on_axis - model.middle, axis)) > 0.5 * model.size:
        on_axis = model.middle
    heights = (model.vertices - on_axis) @ axis
    reach = np.linalg.norm(np.cross(model.vertices - on_axis, axis), axis=1).max()
    center = on_axis + 0.5 * (heights.min() + heights.max()) * axis
    X_OA = along(axis, center)
    return X_OA, float(np.clip(1.12 * reach, *_TURN_RADII))


def _slide(model: ObjectModel, v_O: FloatArray) -> tuple[RigidTransform, float]:
    """Frame and length of an arrow along a translation, through the object's middle."""
    axis = v_O / np.linalg.norm(v_O)
    heights = (model.vertices - model.middle) @ axis
    center = model.middle + 0.5 * (heights.min() + heights.max()) * axis
    length = float(np.ptp(heights)) + 6 * _BEYOND * model.size
    return along(axis, center), length
