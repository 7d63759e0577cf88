"""Estimates in Meshcat, and as a web page that needs neither server nor network.

The parts are made once and then only moved, shown and stretched, because that is what Meshcat records.
"""

from pathlib import Path
from typing import Literal

import numpy as np
from pydrake.geometry import Cylinder, Meshcat, MeshcatCone, Rgba, Sphere
from pydrake.math import RigidTransform, RotationMatrix

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.estimation.output_files import written_beside
from tactopose_drake.visualization.patch_marks import add_patches, move_patches
from tactopose_drake.visualization.remote_meshcat import RemoteMeshcat
from tactopose_drake.visualization.scene import (
    CONTACT_COLOUR,
    ESTIMATE_COLOUR,
    FORCE_COLOUR,
    NORMAL_COLOUR,
    PRIOR_COLOUR,
    TRUTH_COLOUR,
    Scene,
    arrow_lengths,
)
from tactopose_drake.visualization.viewpoint import choose_view, points_of_interest

Role = Literal["prior", "estimate", "truth"]

_CONTACT_RADIUS = 0.003
_ARROW_RADIUS = 0.0012
_HEAD_RADIUS, _HEAD_LENGTH = 0.0036, 0.009
_NORMAL_RADIUS, _NORMAL_LENGTH = 0.0006, 0.02
_CONE_LENGTH = 0.018
_FLIPPED = RotationMatrix.MakeXRotation(np.pi)
# Of Meshcat's camera, vertical, rad.
_FIELD_OF_VIEW = np.radians(75.0)
# Estimate and prior are drawn this much larger all round, m: surfaces that coincide would flicker.
_INFLATION = {"estimate": 0.0006, "prior": 0.0003, "truth": 0.0}
_OPACITY = {"estimate": 1.0, "prior": 0.28, "truth": 0.3}
_COLOUR = {"estimate": ESTIMATE_COLOUR, "prior": PRIOR_COLOUR, "truth": TRUTH_COLOUR}


def add_object(
    meshcat: Meshcat | RemoteMeshcat, path: str, model: ObjectModel, role: Role, opacity: float | None = None
) -> None:
    """Adds an object's surface in its frame O; `SetTransform` on the path places it.

    Args:
        meshcat: receives it.
        path: where.
        model: the object.
        role: what its pose will be, which decides its colour.
        opacity: 0 to 1; the role's own by default.
    """
    vertices = model.vertices + _INFLATION[role] * _vertex_normals(model)
    rgba = Rgba(*_COLOUR[role], _OPACITY[role] if opacity is None else opacity)
    meshcat.SetTriangleMesh(
        path, np.asfortranarray(vertices.T), np.asfortranarray(model.faces.T.astype(np.int32)), rgba
    )


def add_touch(meshcat: Meshcat | RemoteMeshcat, path: str, count: int, *, friction: float | None = None) -> None:
    """Adds the parts that show contacts, hidden until `move_touch` places them.

    Args:
        meshcat: receives them.
        path: where.
        count: of contacts that can be shown at once.
        friction: coefficient of the cones in which the contact forces must lie; no cones without.
    """
    meshcat.Delete(path)
    for row in range(count):
        at = f"{path}/{row}"
        meshcat.SetObject(f"{at}/point", Sphere(_CONTACT_RADIUS), Rgba(*CONTACT_COLOUR))
        meshcat.SetObject(f"{at}/normal/line", Cylinder(_NORMAL_RADIUS, _NORMAL_LENGTH), Rgba(*NORMAL_COLOUR))
        meshcat.SetTransform(f"{at}/normal/line", RigidTransform([0.0, 0.0, _NORMAL_LENGTH / 2]))
        if friction is not None:
            radius = friction * _CONE_LENGTH
            meshcat.SetObject(f"{at}/normal/cone", MeshcatCone(_CONE_LENGTH, radius, radius), Rgba(*NORMAL_COLOUR, 0.2))
        meshcat.SetObject(f"{at}/force/shaft", Cylinder(_ARROW_RADIUS, 1.0), Rgba(*FORCE_COLOUR))
        meshcat.SetObject(
            f"{at}/force/head", MeshcatCone(_HEAD_LENGTH, _HEAD_RADIUS, _HEAD_RADIUS), Rgba(*FORCE_COLOUR)
        )
        meshcat.SetProperty(at, "visible", False)


def move_touch(
    meshcat: Meshcat | RemoteMeshcat, path: str, contacts: Contacts, count: int, time: float | None = None
) -> None:
    """Places the parts that `add_touch` has added, and hides those that are not needed.

    The arrows are the forces on the fingers; they and the normals point out of the object.

    Args:
        meshcat: holds the parts.
        path: where.
        contacts: in the frame of the path's parent; what is beyond `count` is not shown.
        count: of contacts that `add_touch` has made.
        time: of the recording, s, if there is one.
    """
    lengths = arrow_lengths(contacts)
    for row in range(count):
        at = f"{path}/{row}"
        meshcat.SetProperty(at, "visible", row < len(contacts), time)
        if row >= len(contacts):
            continue
        meshcat.SetTransform(at, RigidTransform(contacts.p_PC[row]), time)
        meshcat.SetProperty(f"{at}/normal", "visible", contacts.n_PC is not None, time)
        if contacts.n_PC is not None:
            meshcat.SetTransform(f"{at}/normal", _along(contacts.n_PC[row]), time)
        has_arrow = contacts.f_PC is not None and bool(lengths[row] > _HEAD_LENGTH)
        meshcat.SetProperty(f"{at}/force", "visible", has_arrow, time)
        if contacts.f_PC is not None and has_arrow:
            shaft = float(lengths[row]) - _HEAD_LENGTH
            meshcat.SetTransform(f"{at}/force", _along(contacts.f_PC[row]), time)
            meshcat.SetProperty(f"{at}/force/shaft", "scale", [1.0, 1.0, shaft], time)
            meshcat.SetTransform(f"{at}/force/shaft", RigidTransform([0.0, 0.0, shaft / 2]), time)
            meshcat.SetTransform(f"{at}/force/head", RigidTransform(_FLIPPED, [0.0, 0.0, shaft + _HEAD_LENGTH]), time)


def draw_scene(
    meshcat: Meshcat | RemoteMeshcat, scene: Scene, *, path: str = "/tactopose", friction: float | None = None
) -> None:
    """Draws a scene, in the palm frame, upright.

    Args:
        meshcat: receives it; what was at the path is deleted.
        scene: what to draw.
        path: where.
        friction: coefficient of the friction cones; none are drawn without.
    """
    meshcat.Delete(path)
    meshcat.SetTransform(path, upright(scene))
    poses: dict[Role, RigidTransform | None] = {
        "estimate": scene.estimate,
        "prior": scene.prior,
        "truth": scene.truth,
    }
    for role, pose in poses.items():
        if pose is not None:
            add_object(meshcat, f"{path}/{role}", scene.model, role)
            meshcat.SetTransform(f"{path}/{role}", pose)
    if scene.hand is not None:
        meshcat.SetTriangleMesh(
            f"{path}/hand",
            np.asfortranarray(scene.hand.vertices.T),
            np.asfortranarray(scene.hand.faces.T),
            Rgba(0.62, 0.64, 0.67, 0.5),
        )
    add_touch(meshcat, f"{path}/touch", len(scene.contacts), friction=friction)
    move_touch(meshcat, f"{path}/touch", scene.contacts, len(scene.contacts))
    cells = max((len(patch.p_PT) for patch in scene.patches), default=0)
    add_patches(meshcat, f"{path}/patches", len(scene.patches), cells)
    move_patches(meshcat, f"{path}/patches", scene.patches, len(scene.patches), cells)


def upright(scene: Scene) -> RigidTransform:
    """X_WP, the palm in Meshcat's world, by which the scene's up is up."""
    return RigidTransform(RotationMatrix.MakeFromOneVector(scene.up_P, 2).inverse(), np.zeros(3))


def aim_camera(meshcat: Meshcat, scene: Scene, X_WP: RigidTransform) -> None:
    """Points Meshcat's camera at a scene from where its picture is taken, the palm being at X_WP in Meshcat's world."""
    points = points_of_interest(scene)
    if len(points):
        low, high = points.min(axis=0), points.max(axis=0)
        direction = X_WP.rotation() @ choose_view(scene)
        set_stage(meshcat, X_WP @ (0.5 * (low + high)), float(np.linalg.norm(high - low)), direction)


def set_stage(meshcat: Meshcat, target: FloatArray, size: float, direction: FloatArray) -> None:
    """Points Meshcat's camera at what is held, before a light background without grid and axes.

    Args:
        meshcat: the display.
        target: point to look at, in Meshcat's world, shape (3,), m.
        size: of what should be seen whole, m.
        direction: from the target to the camera, shape (3,); not vertical.
    """
    distance = 0.5 * size / np.tan(0.5 * _FIELD_OF_VIEW)
    meshcat.SetCameraPose(target + distance * direction / np.linalg.norm(direction), target)
    meshcat.SetProperty("/Background", "top_color", [0.97, 0.975, 0.985])
    meshcat.SetProperty("/Background", "bottom_color", [0.82, 0.84, 0.87])
    for path in ("/Grid", "/Axes"):
        meshcat.SetProperty(path, "visible", False)


def save_html(path: Path, meshcat: Meshcat) -> None:
    """Writes all that Meshcat shows, with its published recording, as one web page that works without a network.

    Raises:
        InvalidFileError: the file cannot be written.
    """
    with written_beside(path) as beside:
        beside.write_text(meshcat.StaticHtml(), encoding="utf-8")


def _along(direction: FloatArray) -> RigidTransform:
    """A frame whose z axis is along a direction of any length but zero."""
    return RigidTransform(RotationMatrix.MakeFromOneVector(direction, 2), np.zeros(3))


def _vertex_normals(model: ObjectModel) -> FloatArray:
    """Unit normals at the vertices, averaged over the adjacent faces by area, shape (v, 3)."""
    corners = model.vertices[model.faces]
    doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(model.vertices)
    for corner in range(3):
        np.add.at(normals, model.faces[:, corner], doubled)
    unit: FloatArray = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return unit
