"""Scenes in Meshcat, its camera and its background."""

from typing import Literal

import numpy as np
from pydrake.geometry import Meshcat, Rgba
from pydrake.math import RigidTransform, RotationMatrix

from tactopose_drake.core.validation import FloatArray, kind_name
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.visualization.appearance import HAND
from tactopose_drake.visualization.frame_marks import add_frames
from tactopose_drake.visualization.patch_marks import add_patches, move_patches
from tactopose_drake.visualization.pose_marks import add_hypotheses, add_object, move_hypotheses
from tactopose_drake.visualization.remote_meshcat import RemoteMeshcat
from tactopose_drake.visualization.scene import Scene
from tactopose_drake.visualization.touch_marks import add_touch, move_touch
from tactopose_drake.visualization.viewpoint import choose_view, points_of_interest

# Vertical field of view of Meshcat's camera, rad.
_FIELD_OF_VIEW = np.radians(75.0)
_HAND_OPACITY = 0.5


def check_meshcat(meshcat: object) -> None:
    """Checks early that an argument is a display, which is used only later.

    Raises:
        InvalidInputError: if it lacks Meshcat's methods.
    """
    if not hasattr(meshcat, "SetTransform"):
        raise InvalidInputError(
            "meshcat must be a Meshcat, such as from `StartMeshcat`, or an object with its methods, not "
            f"{kind_name(type(meshcat))}."
        )


def draw_scene(meshcat: Meshcat | RemoteMeshcat, scene: Scene) -> None:
    """Draws a scene, given in the palm frame, with its up direction along Meshcat's z axis.

    Args:
        meshcat: the display; the scene is drawn under `/tactopose`, and replaces whatever is there.
        scene: the scene.
    """
    path = "/tactopose"
    meshcat.Delete(path)
    meshcat.SetTransform(path, upright(scene))
    if scene.hypotheses:
        shown = (scene.hypotheses[0], *scene.alternatives)
        add_hypotheses(meshcat, path, scene.model, len(shown) - 1)
        move_hypotheses(meshcat, path, scene.model, shown, len(shown) - 1)
    poses: dict[Literal["prior", "truth"], RigidTransform | None] = {"prior": scene.prior, "truth": scene.truth}
    for role, pose in poses.items():
        if pose is not None:
            add_object(meshcat, f"{path}/{role}", scene.model, role)
            meshcat.SetTransform(f"{path}/{role}", pose)
    if scene.hand is not None:
        meshcat.SetTriangleMesh(
            f"{path}/hand", scene.hand.vertices.T, scene.hand.faces.T, Rgba(*HAND.colour, _HAND_OPACITY)
        )
    add_touch(meshcat, f"{path}/touch", len(scene.contacts), friction=scene.friction)
    move_touch(meshcat, f"{path}/touch", scene.contacts, len(scene.contacts), is_false=scene.is_false)
    cells = max((len(patch.p_PT) for patch in scene.patches), default=0)
    add_patches(meshcat, f"{path}/patches", len(scene.patches), cells)
    move_patches(meshcat, f"{path}/patches", scene.patches, len(scene.patches), cells)
    if scene.frames:
        add_frames(meshcat, path)


def upright(scene: Scene) -> RigidTransform:
    """X_WP, the pose of the palm in Meshcat's world that turns the scene's up direction to the z axis."""
    return RigidTransform(RotationMatrix.MakeFromOneVector(scene.up_P, 2).inverse(), np.zeros(3))


def aim_camera(
    meshcat: Meshcat, scene: Scene, X_WP: RigidTransform, *, stage: bool = True, margin: float = 1.0
) -> None:
    """Points Meshcat's camera at a scene, from the viewpoint of its picture.

    Args:
        meshcat: the display.
        scene: the scene; if it is empty, the camera does not move.
        X_WP: pose of the palm in Meshcat's world.
        stage: whether the background becomes light, and grid and axes are hidden.
        margin: size of the visible region relative to the scene, 1 or more.
    """
    points = points_of_interest(scene)
    if not len(points):
        return
    low, high = points.min(axis=0), points.max(axis=0)
    direction = X_WP.rotation() @ choose_view(scene)
    look = set_stage if stage else look_at
    look(meshcat, X_WP @ (0.5 * (low + high)), margin * float(np.linalg.norm(high - low)), direction)


def set_stage(meshcat: Meshcat, target: FloatArray, size: float, direction: FloatArray) -> None:
    """Points Meshcat's camera at a target, with a light background and without grid and axes.

    Args:
        meshcat: the display.
        target: point to look at, in Meshcat's world, shape (3,), m.
        size: size of the region to show, m.
        direction: from the target to the camera, shape (3,); not vertical.
    """
    look_at(meshcat, target, size, direction)
    meshcat.SetProperty("/Background/<object>", "top_color", [0.97, 0.975, 0.985])
    meshcat.SetProperty("/Background/<object>", "bottom_color", [0.82, 0.84, 0.87])
    for path in ("/Grid", "/Axes"):
        meshcat.SetProperty(path, "visible", False)


def look_at(meshcat: Meshcat, target: FloatArray, size: float, direction: FloatArray) -> None:
    """Points Meshcat's camera at a target; the arguments are those of `set_stage`."""
    distance = 0.5 * size / np.tan(0.5 * _FIELD_OF_VIEW)
    meshcat.SetCameraPose(target + distance * direction / np.linalg.norm(direction), target)
