"""A page that shows a hand with its palm, sensor and fingertip frames, drawn and named."""

from pathlib import Path

import numpy as np
from matplotlib.textpath import TextPath
from pydrake.geometry import Capsule, Ellipsoid, Meshcat, MeshcatParams, Rgba, Shape, Sphere
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import Context

from tactopose_drake.core.surfaces import Capsule as CapsuleTip
from tactopose_drake.core.surfaces import Ellipsoid as EllipsoidTip
from tactopose_drake.core.surfaces import Surface
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.hand.hand_check import CheckedHand
from tactopose_drake.visualization.body_meshes import BodyMeshes
from tactopose_drake.visualization.meshcat import set_stage
from tactopose_drake.visualization.page import save_html

_TIP_COLOUR = Rgba(0.95, 0.55, 0.15, 1.0)
_HAND_COLOUR = Rgba(0.62, 0.64, 0.67, 0.45)
_TEXT_COLOUR = Rgba(0.1, 0.1, 0.15, 1.0)
_TEXT_HEIGHT = 0.007  # m
_LABEL_DISTANCE = 0.012  # of a name from its frame's origin, m
_AXIS_COLOURS = (Rgba(0.85, 0.2, 0.2, 1.0), Rgba(0.2, 0.65, 0.2, 1.0), Rgba(0.2, 0.35, 0.9, 1.0))


def save_hand_page(path: Path, checked: CheckedHand) -> None:
    """Writes the page: the collision shapes at zero joint positions, the fingertips' surfaces on them, and the frames.

    Raises:
        InvalidFileError: if the file cannot be written.
    """
    meshcat = Meshcat(MeshcatParams(host="localhost"))
    draw_hand(meshcat, checked)
    save_html(path, meshcat)


def draw_hand(meshcat: Meshcat, checked: CheckedHand) -> None:
    """Draws a hand in its palm frame P with its sensors' frames S, fingertips' F and pads' T, all named."""
    plant, hand = checked.plant, checked.hand
    context = plant.GetMyContextFromRoot(checked.diagram.CreateDefaultContext())
    P = hand.palm_frame
    surface = BodyMeshes.in_palm(plant, context, P, colliding=True)
    meshcat.SetTriangleMesh(
        "/hand/shapes", np.asfortranarray(surface.vertices.T), np.asfortranarray(surface.faces.T), _HAND_COLOUR
    )
    poses = {"P": (RigidTransform(), 0.04)}
    poses |= {f"T {pad}": (_pose(plant, context, P, frame), 0.02) for pad, frame in hand.pad_frames.items()}
    for finger, tip in hand.surfaces.items():
        X_PS = _pose(plant, context, P, hand.sensor_frames[finger])
        X_PF = X_PS @ RigidTransform(RotationMatrix(tip.X_SF[:, :3]), tip.X_SF[:, 3])
        meshcat.SetObject(f"/hand/fingertips/{finger}", _shape(tip), _TIP_COLOUR)
        meshcat.SetTransform(f"/hand/fingertips/{finger}", X_PF)
        is_same = X_PF.IsNearlyEqualTo(X_PS, 1e-6)
        poses[f"S = F {finger}" if is_same else f"S {finger}"] = (X_PS, 0.02)
        if not is_same:
            poses[f"F {finger}"] = (X_PF, 0.012)
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    direction = _view([X.translation() for X, _ in poses.values()], 0.5 * (low + high))
    facing = _facing(direction)
    for name, (X, length) in poses.items():
        _draw_frame(meshcat, f"/hand/frames/{name}", X, length)
        _draw_name(meshcat, f"/hand/names/{name}", name, X.translation() + _LABEL_DISTANCE * direction, facing)
    set_stage(meshcat, 0.5 * (low + high), float(np.linalg.norm(high - low)), direction)


def _pose(plant: MultibodyPlant, context: Context, P: Frame, frame: Frame) -> RigidTransform:
    return plant.CalcRelativeTransform(context, P, frame)


def _shape(surface: Surface) -> Shape:
    """Drake's shape of a fingertip's surface, in F."""
    if isinstance(surface, CapsuleTip):
        return Capsule(surface.radius, surface.length)
    if isinstance(surface, EllipsoidTip):
        return Ellipsoid(*surface.semi_axes)
    return Sphere(surface.half_width)


def _view(points: list[FloatArray], middle: FloatArray) -> FloatArray:
    """From where frames are seen side by side: across the plane that they lie nearest to, and not from above."""
    _, _, axes = np.linalg.svd(np.array(points) - np.mean(points, axis=0), full_matrices=True)
    normal = axes[-1] if axes[-1] @ (np.mean(points, axis=0) - middle) >= 0 else -axes[-1]
    tilted: FloatArray = normal + 0.25 * np.array([0.3, -0.5, 0.6])
    return tilted / np.linalg.norm(tilted)


def _facing(direction: FloatArray) -> RotationMatrix:
    """The orientation of letters, x to the right and y up, that face a camera in that direction; up is z."""
    right = np.cross([0.0, 0.0, 1.0], direction)
    right /= np.linalg.norm(right)
    return RotationMatrix(np.column_stack([right, np.cross(direction, right), direction]))


def _draw_frame(meshcat: Meshcat, path: str, X: RigidTransform, length: float) -> None:
    for axis, colour in enumerate(_AXIS_COLOURS):
        end = length * np.eye(3)[axis]
        meshcat.SetLine(f"{path}/{'xyz'[axis]}", np.column_stack([np.zeros(3), end]), 3.0, colour)
    meshcat.SetObject(f"{path}/origin", Sphere(0.05 * length), _TEXT_COLOUR)
    meshcat.SetTransform(path, X)


def _draw_name(meshcat: Meshcat, path: str, name: str, position: FloatArray, facing: RotationMatrix) -> None:
    """The outlines of letters."""
    starts, ends = [], []
    for outline in TextPath((0.0, 0.0), name, size=_TEXT_HEIGHT).to_polygons(closed_only=False):
        corners = np.asarray(outline, dtype=np.float64)
        points = np.column_stack([corners, np.zeros(len(corners))])
        starts.append(points[:-1])
        ends.append(points[1:])
    meshcat.SetLineSegments(path, np.concatenate(starts).T, np.concatenate(ends).T, 1.5, _TEXT_COLOUR)
    meshcat.SetTransform(path, RigidTransform(facing, position))
