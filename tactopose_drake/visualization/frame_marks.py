"""Coordinate frames in Meshcat: three bars, x red, y green, z blue, that are seen through whatever covers them."""

import numpy as np
from pydrake.geometry import Cylinder, Meshcat, Rgba
from pydrake.math import RigidTransform, RotationMatrix

from tactopose_drake.visualization.appearance import AXIS_COLOURS
from tactopose_drake.visualization.remote_meshcat import RemoteMeshcat

PALM_AXES, OBJECT_AXES = 0.05, 0.04
"""Lengths of the axes of P and O, m."""
THICKNESS = 0.02
"""Radius of an axis, of its length."""

_FORWARD = -2.5e3  # steps of the depth buffer: some 3 mm at half a metre
_NEARLY_OPAQUE = 0.95  # what is translucent is drawn last


def add_frame(meshcat: Meshcat | RemoteMeshcat, path: str, length: float) -> None:
    """Adds the axes of the frame that is at a path.

    Args:
        meshcat: receives them.
        path: of the frame; `path/x`, `path/y` and `path/z` are made.
        length: of each, m.
    """
    for axis, colour in enumerate(AXIS_COLOURS):
        at = f"{path}/{'xyz'[axis]}"
        meshcat.SetObject(at, Cylinder(THICKNESS * length, length), Rgba(*colour, _NEARLY_OPAQUE))
        direction = np.eye(3)[axis]
        meshcat.SetTransform(
            at, RigidTransform(RotationMatrix.MakeFromOneVector(direction, 2), 0.5 * length * direction)
        )
        shine_through(meshcat, at)


def add_frames(meshcat: Meshcat | RemoteMeshcat, path: str) -> None:
    """Adds the frames of the palm and of the object at the estimate to a scene that is drawn at the path."""
    add_frame(meshcat, f"{path}/palm", PALM_AXES)
    add_frame(meshcat, f"{path}/estimate/frame", OBJECT_AXES)


def shine_through(meshcat: Meshcat | RemoteMeshcat, path: str) -> None:
    """Lets a translucent object be seen through what covers it."""
    meshcat.SetProperty(f"{path}/<object>", "material.depthTest", False)


def bring_forward(meshcat: Meshcat | RemoteMeshcat, path: str) -> None:
    """Draws an object as if it were a little nearer, so that a surface in which it just lies does not hide it."""
    for name, value in {"polygonOffset": True, "polygonOffsetUnits": _FORWARD, "needsUpdate": True}.items():
        meshcat.SetProperty(f"{path}/<object>", f"material.{name}", value)
