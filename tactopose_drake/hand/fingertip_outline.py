"""Fitting of a fingertip surface to the collision shape at a finger's end."""

import itertools
from dataclasses import dataclass

import numpy as np
import trimesh
from pydrake.geometry import Box, Capsule, Convex, Cylinder, Ellipsoid, Mesh, Role, SceneGraphInspector, Shape, Sphere
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant

from tactopose_drake.core.surfaces import Capsule as CapsuleTip
from tactopose_drake.core.surfaces import Sphere as SphereTip
from tactopose_drake.core.surfaces import Superquadric, Surface
from tactopose_drake.core.surfaces.surface import random_directions
from tactopose_drake.core.surfaces.surface_fitting import fit_surface, residual
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.estimation.hull_vertices import hull_vertices
from tactopose_drake.hand.hand_in_plant import Hand
from tactopose_drake.hand.shape_depth import convex_shape

_POINTS = 600
_DIRECTIONS = random_directions(np.random.default_rng(0), 1000)
_CIRCLE = np.stack([np.cos(np.arange(48) * np.pi / 24), np.sin(np.arange(48) * np.pi / 24)], axis=1)
_CORNERS = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
_WITHIN = 3e-4  # depth in another shape of the same link from which on a point is not on the outside, m
_BACK = 0.7  # cosine between normal and direction to the joint from which on a place cannot be touched
_FEWEST = 50  # least number of points for a fit
_FARTHEST = 0.3  # of the points from the sensor, m; a larger shape is no fingertip, or not in metres
# Only the finger's end is fitted if the residual there exceeds the first number, m, and that reduces it to this share.
_OFF, _BETTER = 1e-3, 0.5
_ALONG = 0.87  # least cosine between the axis of a capsule along the finger and the direction of the finger's end


@dataclass(frozen=True, eq=False)
class FittedSurface:
    """The surface that fits a fingertip's shape best, with its residual and that of the hand's own surface.

    Attributes:
        surface: the surface, in the sensor's frame.
        residual: root mean square distance of the shape from it, m.
        own_residual: likewise from the surface of the hand's file, m.
        length: length of the shape's end if only that was fitted, m; None if the whole shape was.
    """

    surface: Surface
    residual: float
    own_residual: float
    length: float | None = None

    @property
    def yaml(self) -> str:
        """The surface as YAML for a hand's file, rounded to 0.01 mm and 0.1 degrees."""
        R_SF, p_SF = RotationMatrix(self.surface.X_SF[:, :3]), self.surface.X_SF[:, 3]
        angles = np.degrees(RollPitchYaw(R_SF).vector())
        place = f"X_SF: {{translation: {_numbers(p_SF, 5)}, rotation: !Rpy {{deg: {_numbers(angles, 1)}}}}}"
        if isinstance(self.surface, CapsuleTip):
            size = f"radius: {self.surface.radius:.5g}, length: {self.surface.length:.5g}"
            return f"!CapsuleSurface {{{size}, {place}}}"
        if isinstance(self.surface, Superquadric):
            axes, exponents = _numbers(self.surface.semi_axes, 5), _numbers(self.surface.exponents, 2)
            return f"!SuperquadricSurface {{semi_axes: {axes}, exponents: {exponents}, {place}}}"
        return f"!SphereSurface {{radius: {self.surface.half_width:.5g}, {place}}}"


def fit_fingertip(
    plant: MultibodyPlant, inspector: SceneGraphInspector, hand: Hand, finger: str
) -> FittedSurface | None:
    """Fits a surface to the shape at a finger's end; None if its link has no shape of a fingertip's size.

    If no surface fits the whole shape, such as a tapered one, it is fitted to the end, with which fingers touch.

    Args:
        plant: finalized plant that holds the hand.
        inspector: inspector of its geometry.
        hand: the hand.
        finger: the finger's name.
    """
    tip = hand.welds[finger].child_body()
    X_STip = plant.CalcRelativeTransform(plant.CreateDefaultContext(), hand.sensor_frames[finger], tip.body_frame())
    frame = plant.GetBodyFrameIdOrThrow(tip.index())
    shapes = [
        (X_STip @ inspector.GetPoseInFrame(geometry), inspector.GetShape(geometry))
        for geometry in inspector.GetGeometries(frame, Role.kProximity)
    ]
    outlines = [(X_SG, shape, X_SG.multiply(_outline(shape).T).T) for X_SG, shape in shapes if len(_outline(shape))]
    if not outlines:
        return None
    if len(shapes) == 1 and isinstance(shapes[0][1], Sphere):
        ((X_SG, shape, outline),) = outlines
        if np.linalg.norm(outline, axis=1).max() > _FARTHEST:
            return None
        ball = SphereTip(shape.radius(), X_SF=RigidTransform(X_SG.translation()))
        return FittedSurface(ball, residual(ball, outline), residual(hand.surfaces[finger], outline))
    p_SJ = X_STip.translation()
    _, shape, outline = max(outlines, key=lambda one: np.linalg.norm(one[2] - p_SJ, axis=1).max())
    outwards = outline.mean(axis=0) - p_SJ
    outwards /= max(float(np.linalg.norm(outwards)), 1e-9)
    points = _outside(outline, outwards, [one for one in shapes if one[1] is not shape])
    if len(points) < _FEWEST or np.linalg.norm(points, axis=1).max() > _FARTHEST:
        return None
    rod = _rod(*shapes[0], outwards) if len(shapes) == 1 else None
    if rod is not None:
        touched = points[(points - rod.X_SF[:, 3]) @ rod.X_SF[:, 2] > -0.5 * rod.length]
        return FittedSurface(rod, residual(rod, touched), residual(hand.surfaces[finger], touched))
    surface = fit_surface(points, outwards)
    end, length = _end(points, outwards)
    off = residual(surface, end)
    if off > _OFF and len(end) >= _FEWEST:
        of_end = fit_surface(end, outwards)
        if residual(of_end, end) < _BETTER * off:
            return FittedSurface(of_end, residual(of_end, end), residual(hand.surfaces[finger], end), length)
    return FittedSurface(surface, residual(surface, points), residual(hand.surfaces[finger], points))


def _rod(X_SG: RigidTransform, shape: Shape, outwards: FloatArray) -> CapsuleTip | None:
    """The surface of a capsule along the finger; None for other shapes, and if its rear end can be touched, too."""
    along = float(X_SG.rotation().col(2) @ outwards)
    if not isinstance(shape, Capsule) or shape.length() < shape.radius() or abs(along) < _ALONG:
        return None
    turn = RotationMatrix.MakeXRotation(0.0 if along > 0.0 else np.pi)
    return CapsuleTip(shape.radius(), shape.length(), X_SF=X_SG @ RigidTransform(turn, np.zeros(3)))


def _end(points: FloatArray, outwards: FloatArray) -> tuple[FloatArray, float]:
    """The points (n, 3) on the shape's end, whose length equals the shape's thickness, and that length, m."""
    height = points @ outwards
    across = points - height[:, None] * outwards
    _, _, axes = np.linalg.svd(across - across.mean(axis=0), full_matrices=False)
    length = float(np.ptp(across @ axes[:2].T, axis=0).min())
    end: FloatArray = points[height > height.max() - length]
    return end, length


def _outside(outline: FloatArray, outwards: FloatArray, others: list[tuple[RigidTransform, Shape]]) -> FloatArray:
    """Points on the hull of an outline (n, 3) in S that neither face the joint nor lie in other shapes, (p, 3), m."""
    hull = trimesh.convex.convex_hull(outline)
    points, faces = trimesh.sample.sample_surface(hull, _POINTS, seed=0)
    seen = hull.face_normals[faces] @ outwards > -_BACK
    for X_SG, shape in others:
        other = convex_shape(shape)
        if other is not None:
            seen &= other.depths(X_SG.inverse().multiply(points.T).T) < _WITHIN
    outside: FloatArray = np.asarray(points)[seen]
    return outside


def _outline(shape: Shape) -> FloatArray:
    """Points whose convex hull is the shape's, in its own frame, shape (n, 3), m; none for an unbounded shape."""
    points = np.zeros((0, 3))
    if isinstance(shape, Sphere):
        points = shape.radius() * _DIRECTIONS
    elif isinstance(shape, Ellipsoid):
        points = _DIRECTIONS * [shape.a(), shape.b(), shape.c()]
    elif isinstance(shape, Capsule):
        points = shape.radius() * _DIRECTIONS
        points[:, 2] += np.copysign(0.5 * shape.length(), points[:, 2])
    elif isinstance(shape, Cylinder):
        rings = [np.column_stack([shape.radius() * _CIRCLE, np.full(len(_CIRCLE), z)]) for z in (-0.5, 0.5)]
        points = np.concatenate(rings) * [1.0, 1.0, shape.length()]
    elif isinstance(shape, Box):
        points = _CORNERS * shape.size()
    elif isinstance(shape, Mesh | Convex):
        points = hull_vertices(shape.GetConvexHull())
    return points


def _numbers(values: object, digits: int) -> str:
    return "[" + ", ".join(f"{value:g}" for value in np.round(np.asarray(values), digits) + 0.0) + "]"
