"""Coordinate frames in Meshcat: three bars, x red, y green, z blue, which stay visible behind other objects."""

import numpy as np
from numpy.typing import ArrayLike
from pydrake.geometry import Cylinder, Meshcat, Rgba
from pydrake.math import RigidTransform, RotationMatrix

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.visualization.appearance import AXIS_COLOURS
from tactopose_drake.visualization.remote_meshcat import RemoteMeshcat

PALM_AXES, OBJECT_AXES = 0.05, 0.04
"""Lengths of the axes of P and O, m."""
THICKNESS = 0.02
"""Radius of an axis, as a share of its length."""

_FORWARD = -2.5e3  # steps of the depth buffer: about 3 mm at half a metre
_NEARLY_OPAQUE = 0.95  # below 1, because Meshcat draws translucent objects last


def add_frame(meshcat: Meshcat | RemoteMeshcat, path: str, length: float) -> None:
    """Adds the axes of a frame.

    Args:
        meshcat: the display.
        path: path of the frame; the axes are `path/x`, `path/y` and `path/z`.
        length: length of each axis, m.
    """
    for axis, colour in enumerate(AXIS_COLOURS):
        at = f"{path}/{'xyz'[axis]}"
        meshcat.SetObject(at, Cylinder(THICKNESS * length, length), Rgba(*colour, _NEARLY_OPAQUE))
        direction = np.eye(3)[axis]
        meshcat.SetTransform(at, along(direction, 0.5 * length * direction))
        shine_through(meshcat, at)


def add_frames(meshcat: Meshcat | RemoteMeshcat, path: str) -> None:
    """Adds the frame of the palm, and that of the object at the estimate, to a scene that is drawn at the path."""
    add_frame(meshcat, f"{path}/palm", PALM_AXES)
    add_frame(meshcat, f"{path}/estimate/frame", OBJECT_AXES)


def along(direction: FloatArray, origin: ArrayLike = (0.0, 0.0, 0.0)) -> RigidTransform:
    """A pose whose z axis is along a nonzero direction (3,), with its origin at a point, shape (3,), m."""
    return RigidTransform(RotationMatrix.MakeFromOneVector(direction, 2), origin)


def shine_through(meshcat: Meshcat | RemoteMeshcat, path: str) -> None:
    """Makes a translucent object visible through the objects in front of it."""
    meshcat.SetProperty(f"{path}/<object>", "material.depthTest", False)


def bring_forward(meshcat: Meshcat | RemoteMeshcat, path: str) -> None:
    """Draws an object as if it were slightly nearer to the camera, so that no coincident surface hides it."""
    for name, value in {"polygonOffset": True, "polygonOffsetUnits": _FORWARD, "needsUpdate": True}.items():
        meshcat.SetProperty(f"{path}/<object>", f"material.{name}", value)
