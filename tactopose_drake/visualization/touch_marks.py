"""Contacts in Meshcat: points, normals, friction cones and forces; false contacts are crossed out.

The parts are made once and then only moved, shown and scaled, because Meshcat records only such changes.
"""

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Cylinder, Meshcat, MeshcatCone, Rgba, Shape, Sphere
from pydrake.math import RigidTransform, RotationMatrix

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.patch_contacts import tell_normals
from tactopose_drake.visualization.appearance import CONE, CONTACT, FALSE_CONTACT, FORCE, NORMAL, Look
from tactopose_drake.visualization.frame_marks import along, shine_through
from tactopose_drake.visualization.remote_meshcat import RemoteMeshcat
from tactopose_drake.visualization.scene import arrow_lengths

CONE_LENGTH = 0.018
"""Length of a friction cone, m."""

_CONTACT_RADIUS = 0.003
_HIDDEN_OPACITY = 0.3  # of a contact behind a surface
_ARROW_RADIUS = 0.0012
_HEAD_RADIUS, _HEAD_LENGTH = 0.0036, 0.009
_NORMAL_RADIUS, _NORMAL_LENGTH = 0.0006, 0.02
_CONE_OPACITY = 0.2
_CROSS_RADIUS, _CROSS_LENGTH = 0.0008, 0.016
_FLIPPED = RotationMatrix.MakeXRotation(np.pi)


def add_touch(meshcat: Meshcat | RemoteMeshcat, path: str, count: int, *, friction: float | None = None) -> None:
    """Adds the parts that show contacts, hidden until `move_touch` places them.

    Args:
        meshcat: the display.
        path: path of the parts.
        count: number of contacts that can be shown at once.
        friction: coefficient of friction of the cones at the contacts; None to add no cones.
    """
    meshcat.Delete(path)
    for row in range(count):
        at = f"{path}/{row}"
        _add_both(meshcat, f"{at}/point/ball", Sphere(_CONTACT_RADIUS), CONTACT)
        _add_cross(meshcat, f"{at}/false")
        meshcat.SetObject(f"{at}/normal/line", Cylinder(_NORMAL_RADIUS, _NORMAL_LENGTH), Rgba(*NORMAL.colour))
        meshcat.SetTransform(f"{at}/normal/line", RigidTransform([0.0, 0.0, _NORMAL_LENGTH / 2]))
        if friction is not None:
            radius, colour = friction * CONE_LENGTH, Rgba(*CONE.colour, _CONE_OPACITY)
            meshcat.SetObject(f"{at}/normal/cone", MeshcatCone(CONE_LENGTH, radius, radius), colour)
        meshcat.SetObject(f"{at}/force/shaft", Cylinder(_ARROW_RADIUS, 1.0), Rgba(*FORCE.colour))
        head = MeshcatCone(_HEAD_LENGTH, _HEAD_RADIUS, _HEAD_RADIUS)
        meshcat.SetObject(f"{at}/force/head", head, Rgba(*FORCE.colour))
        meshcat.SetProperty(at, "visible", False)


def move_touch(
    meshcat: Meshcat | RemoteMeshcat,
    path: str,
    contacts: Contacts,
    count: int,
    time: float | None = None,
    is_false: NDArray[np.bool_] | None = None,
) -> None:
    """Places the parts that `add_touch` has added, and hides those that are not needed.

    The arrows are the forces on the fingers; they and the normals point out of the object.

    Args:
        meshcat: the display.
        path: path of the parts.
        contacts: in the frame of the path's parent; those beyond `count` are not shown.
        count: number of contacts for which `add_touch` has added parts.
        time: time in the recording, s, if there is one.
        is_false: which contacts are probably not on the object, shape (k,); by default, all are.
    """
    lengths, has_normal = arrow_lengths(contacts, is_false), tell_normals(contacts)
    for row in range(count):
        at = f"{path}/{row}"
        meshcat.SetProperty(at, "visible", row < len(contacts), time)
        if row >= len(contacts):
            continue
        crossed = is_false is not None and bool(is_false[row])
        meshcat.SetProperty(f"{at}/point", "visible", not crossed, time)
        meshcat.SetProperty(f"{at}/false", "visible", crossed, time)
        meshcat.SetTransform(at, RigidTransform(contacts.p_PC[row]), time)
        meshcat.SetProperty(f"{at}/normal", "visible", bool(has_normal[row]), time)
        if contacts.n_PC is not None and has_normal[row]:
            meshcat.SetTransform(f"{at}/normal", along(contacts.n_PC[row]), time)
        has_arrow = contacts.f_PC is not None and bool(lengths[row] > _HEAD_LENGTH)
        meshcat.SetProperty(f"{at}/force", "visible", has_arrow, time)
        if contacts.f_PC is not None and has_arrow:
            shaft = float(lengths[row]) - _HEAD_LENGTH
            meshcat.SetTransform(f"{at}/force", along(contacts.f_PC[row]), time)
            # In this order, because without a recording, setting a transform resets the scale.
            meshcat.SetTransform(f"{at}/force/shaft", RigidTransform([0.0, 0.0, shaft / 2]), time)
            meshcat.SetProperty(f"{at}/force/shaft", "scale", [1.0, 1.0, shaft], time)
            meshcat.SetTransform(f"{at}/force/head", RigidTransform(_FLIPPED, [0.0, 0.0, shaft + _HEAD_LENGTH]), time)


def _add_cross(meshcat: Meshcat | RemoteMeshcat, path: str) -> None:
    """Adds a grey ball with three bars, which look like a cross from every side."""
    _add_both(meshcat, f"{path}/ball", Sphere(_CONTACT_RADIUS), FALSE_CONTACT)
    for axis in range(3):
        _add_both(meshcat, f"{path}/bar_{axis}", Cylinder(_CROSS_RADIUS, _CROSS_LENGTH), FALSE_CONTACT)
        meshcat.SetTransform(f"{path}/bar_{axis}", along(np.eye(3)[axis]))
    meshcat.SetProperty(path, "visible", False)


def _add_both(meshcat: Meshcat | RemoteMeshcat, path: str, shape: Shape, look: Look) -> None:
    """Adds a shape, and a translucent copy that stays visible behind other objects."""
    meshcat.SetObject(path, shape, Rgba(*look.colour))
    meshcat.SetObject(f"{path}/through", shape, Rgba(*look.colour, _HIDDEN_OPACITY))
    shine_through(meshcat, f"{path}/through")
