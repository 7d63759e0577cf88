"""The marks of a picture as surfaces: contacts, forces, pressed cells, 95 % regions and free directions."""

from collections.abc import Iterable

import numpy as np
import trimesh
from numpy.typing import NDArray
from pydrake.math import RigidTransform

from tactopose_drake.core.evidence.patch_contacts import tell_normals
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.core.vision.rasterizer import DrawnSurface
from tactopose_drake.visualization.appearance import (
    AXIS_COLOURS,
    CONE,
    CONTACT,
    FALSE_CONTACT,
    FORCE,
    FREE,
    PRESSURE,
    UNCERTAINTY,
    Colour,
)
from tactopose_drake.visualization.arrow_shapes import slide_arrow, turn_arrow
from tactopose_drake.visualization.frame_marks import OBJECT_AXES, PALM_AXES, THICKNESS, along
from tactopose_drake.visualization.object_shapes import CREASE
from tactopose_drake.visualization.patch_marks import plate_pose, plate_sizes
from tactopose_drake.visualization.scene import Scene
from tactopose_drake.visualization.scene import arrow_lengths as force_lengths
from tactopose_drake.visualization.touch_marks import CONE_LENGTH
from tactopose_drake.visualization.uncertainty import ellipsoids, free_arrows, shown_points

_CONTACT_RADIUS = 0.0032
_ARROW_RADIUS = 0.0014
_CROSS_LENGTH, _CROSS_RADIUS = 0.018, 0.0009
_PLATE_HEIGHT = 0.0008

Painted = tuple[trimesh.Trimesh, Colour]


def touch_surface(scene: Scene) -> DrawnSurface | None:
    """Contacts as small spheres, or crosses, the object's force on each as an arrow, and pressed cells as plates."""
    return _joined([*_contacts(scene), *_plates(scene)])


def certainty_surface(scene: Scene) -> DrawnSurface | None:
    """95 % regions of points of the estimate as ellipsoids, free directions as arrows, and friction cones if asked."""
    if not scene.hypotheses:
        return None
    best = scene.hypotheses[0]
    parts: list[Painted] = []
    for found in ellipsoids(scene.model, best, shown_points(scene.model)):
        ball = trimesh.creation.icosphere(subdivisions=2)
        vertices = (best.X_PO @ found.X_OE).multiply((found.radii * np.asarray(ball.vertices)).T).T
        parts.append((trimesh.Trimesh(vertices, ball.faces, process=False), UNCERTAINTY.colour))
    for arrow in free_arrows(scene.model, best):
        vertices, faces = turn_arrow() if arrow.is_turn else slide_arrow()
        vertices = arrow.X_PA.multiply(arrow.scale * vertices.T).T
        parts.append((trimesh.Trimesh(vertices, faces, process=False), FREE.colour))
    return _joined([*parts, *_cones(scene)])


def frames_surface(scene: Scene) -> DrawnSurface | None:
    """The frames of palm and estimate, if the scene asks for them."""
    return _joined(list(_frames(scene, scene.hypotheses[0].X_PO))) if scene.hypotheses else None


def smooth(vertices: FloatArray, faces: NDArray[np.int32], colour: Colour | FloatArray) -> DrawnSurface:
    """A surface with normals for smooth shading and sharp edges; `colour` is one colour, or one per vertex, (v, 3)."""
    colour = np.array(np.broadcast_to(colour, vertices.shape))
    mesh = trimesh.Trimesh(vertices, faces, vertex_colors=colour, process=False)
    shaded = trimesh.graph.smooth_shade(mesh, angle=CREASE)
    return DrawnSurface(
        np.array(shaded.vertices),
        np.array(shaded.vertex_normals),
        np.array(shaded.faces, dtype=np.int32),
        shaded.visual.vertex_colors[:, :3] / 255.0,
    )


def _contacts(scene: Scene) -> Iterable[Painted]:
    contacts = scene.contacts
    for row, (length, is_false) in enumerate(zip(force_lengths(contacts, scene.is_false), scene.is_false, strict=True)):
        ball = trimesh.creation.icosphere(subdivisions=2, radius=_CONTACT_RADIUS).apply_translation(contacts.p_PC[row])
        yield ball, FALSE_CONTACT.colour if is_false else CONTACT.colour
        if is_false:
            for axis in np.eye(3):
                bar = trimesh.creation.cylinder(
                    radius=_CROSS_RADIUS, segment=np.array([-axis, axis]) * _CROSS_LENGTH / 2 + contacts.p_PC[row]
                )
                yield bar, FALSE_CONTACT.colour
        elif contacts.f_PC is not None and length > 4 * _ARROW_RADIUS:
            X_PArrow = along(contacts.f_PC[row], contacts.p_PC[row])
            yield from ((_moved(part, X_PArrow), FORCE.colour) for part in _arrow(length))


def _cones(scene: Scene) -> Iterable[Painted]:
    """Friction cones at the contacts, if the scene has a coefficient of friction."""
    contacts = scene.contacts
    if scene.friction is None or contacts.n_PC is None:
        return
    told = tell_normals(contacts)
    for point, normal in zip(contacts.p_PC[told], contacts.n_PC[told], strict=True):
        cone = trimesh.creation.cone(radius=scene.friction * CONE_LENGTH, height=CONE_LENGTH)
        cone.vertices = [0.0, 0.0, CONE_LENGTH] - cone.vertices  # standing on its tip; `invert` keeps faces outward
        cone.invert()
        yield _moved(cone, along(normal, point)), CONE.colour


def _frames(scene: Scene, X_PO: RigidTransform) -> Iterable[Painted]:
    """The frames of palm and object, if the scene asks for them."""
    if scene.frames:
        for X_PFrame, length in ((RigidTransform(), PALM_AXES), (X_PO, OBJECT_AXES)):
            for axis, colour in enumerate(AXIS_COLOURS):
                segment = np.array([np.zeros(3), length * np.eye(3)[axis]])
                bar = trimesh.creation.cylinder(radius=THICKNESS * length, segment=segment)
                yield _moved(bar, X_PFrame), colour


def _plates(scene: Scene) -> Iterable[Painted]:
    """A plate on each pressed cell, with an area proportional to the pressure."""
    for patch in scene.patches:
        sizes = plate_sizes(patch)
        for cell in np.flatnonzero(sizes[:, 1]):
            yield (
                _moved(trimesh.creation.box([*sizes[cell], _PLATE_HEIGHT]), plate_pose(patch, int(cell))),
                PRESSURE.colour,
            )


def _arrow(length: float) -> tuple[trimesh.Trimesh, trimesh.Trimesh]:
    """Shaft and head of an arrow from the origin along z."""
    head = min(0.35 * length, 8 * _ARROW_RADIUS)
    shaft = trimesh.creation.cylinder(
        radius=_ARROW_RADIUS, segment=np.array([[0.0, 0.0, 0.0], [0.0, 0.0, length - head]])
    )
    cone = trimesh.creation.cone(radius=3 * _ARROW_RADIUS, height=head)
    return shaft, cone.apply_translation([0, 0, length - head])


def _moved(mesh: trimesh.Trimesh, X: RigidTransform) -> trimesh.Trimesh:
    return mesh.apply_transform(X.GetAsMatrix4())


def _joined(parts: list[Painted]) -> DrawnSurface | None:
    if not parts:
        return None
    vertices, faces = trimesh.util.append_faces([mesh.vertices for mesh, _ in parts], [mesh.faces for mesh, _ in parts])
    colour = np.repeat([colour for _, colour in parts], [len(mesh.vertices) for mesh, _ in parts], axis=0)
    return smooth(vertices.astype(np.float64), faces.astype(np.int32), colour)
