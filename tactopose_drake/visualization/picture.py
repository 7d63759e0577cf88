"""A PNG picture of an estimate, drawn without a display, a GPU or a browser."""

from pathlib import Path

import numpy as np
import trimesh
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray
from pydrake.math import RigidTransform, RotationMatrix
from scipy.ndimage import binary_dilation, binary_erosion

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.core.vision.rasterizer import Camera, Layer, Surface, render
from tactopose_drake.estimation.output_files import written_beside
from tactopose_drake.visualization.patch_marks import plate_edges
from tactopose_drake.visualization.scene import (
    CONTACT_COLOUR,
    ESTIMATE_COLOUR,
    PRESSURE_COLOUR,
    PRIOR_COLOUR,
    TRUTH_COLOUR,
    Colour,
    Scene,
    arrow_lengths,
)
from tactopose_drake.visualization.viewpoint import choose_view, points_of_interest

Image = NDArray[np.float32]

_DPI = 100
_PANEL = (7.0, 6.2)  # inches
_OVERSAMPLING = 2
_BACKGROUND = (np.array([0.985, 0.988, 0.992]), np.array([0.900, 0.915, 0.935]))  # top, bottom
_CREASE = np.radians(35.0)  # edges sharper than this stay sharp
_HAND_OPACITY = 0.38
_MARKER_THROUGH = 0.55  # opacity of a marker that lies behind something
_CONTACT_RADIUS = 0.0032
_ARROW_RADIUS = 0.0014
_PLATE_HEIGHT = 0.0008
_HAND_LABEL_COLOUR: Colour = (0.62, 0.64, 0.67)


def save_picture(
    path: Path,
    scene: Scene,
    *,
    captions: tuple[str, str] = ("before: vision", "after: touch"),
    prior_label: str = "prior",
    colours: FloatArray | None = None,
) -> None:
    """Writes a picture of a scene: one panel for the prior, one for the estimate, from the same viewpoint.

    Args:
        path: the PNG file.
        scene: what to draw.
        captions: titles of the panels of prior and estimate.
        prior_label: what the legend calls the prior.
        colours: red, green and blue of the model's vertices at the estimate, 0 to 1, shape (v, 3); None for one colour.
    """
    paints = (PRIOR_COLOUR, ESTIMATE_COLOUR if colours is None else colours)
    panels = [
        (pose, _smooth(scene.model.vertices, scene.model.faces, paint), caption)
        for pose, paint, caption in zip((scene.prior, scene.estimate), paints, captions, strict=True)
        if pose is not None
    ]
    width, height = (int(side * _DPI) * _OVERSAMPLING for side in _PANEL)
    camera = Camera.framing(points_of_interest(scene), choose_view(scene), scene.up_P, width, height)
    overlay = _Overlay(scene, camera)
    figure = Figure(figsize=(_PANEL[0] * max(len(panels), 1), _PANEL[1] + 0.9), dpi=_DPI)
    FigureCanvasAgg(figure)
    for index, (pose, thing, caption) in enumerate(panels):
        lines = [(scene.prior, PRIOR_COLOUR), (scene.truth, TRUTH_COLOUR)]
        image = _background(camera)
        solid = render(_placed(thing, pose), camera)
        image = np.where(solid.covered[..., None], solid.colour, image)
        image = overlay.hand_over(image, solid)
        for other, line_colour in lines:
            if other is not None and other is not pose:
                image = _outline(image, render(_placed(thing, other), camera), line_colour)
        image = overlay.markers_over(image, solid)
        axes = figure.add_axes((index / len(panels), 0.08, 1 / len(panels), 0.86))
        axes.imshow(_shrunk(image))
        axes.set_axis_off()
        axes.set_title(caption, fontsize=15, pad=7)
    handles = _legend(scene, prior_label, is_painted=colours is not None)
    figure.legend(handles=handles, loc="lower center", ncols=4 if len(panels) < 2 else 7, frameon=False, fontsize=11)
    with written_beside(path) as beside:
        figure.savefig(beside, facecolor="white")


class _Overlay:
    """What lies over the object in every panel: the hand, translucent, and the markers."""

    def __init__(self, scene: Scene, camera: Camera) -> None:
        self._hand = self._markers = None
        if scene.hand is not None:
            self._hand = render(_smooth(scene.hand.vertices, scene.hand.faces, scene.hand.colour), camera)
        if len(scene.contacts) or any(patch.is_felt for patch in scene.patches):
            self._markers = render(_markers(scene), camera)

    def hand_over(self, image: Image, solid: Layer) -> Image:
        """Lays the hand over the image; at grazing angles it is denser, like glass."""
        if self._hand is None:
            return image
        opacity = _HAND_OPACITY + (1.0 - _HAND_OPACITY) * (1.0 - self._hand.facing) ** 3
        opacity = np.where(self._hand.inverse_depth > solid.inverse_depth, opacity, 0.0)[..., None]
        return ((1.0 - opacity) * image + opacity * self._hand.colour).astype(np.float32)

    def markers_over(self, image: Image, solid: Layer) -> Image:
        """Lays the markers over the image; those behind something shine through."""
        if self._markers is None:
            return image
        nearest = solid.inverse_depth
        if self._hand is not None:
            nearest = np.maximum(nearest, self._hand.inverse_depth)
        opacity = np.where(nearest > self._markers.inverse_depth, _MARKER_THROUGH, 1.0) * self._markers.covered
        return ((1.0 - opacity[..., None]) * image + opacity[..., None] * self._markers.colour).astype(np.float32)


def _background(camera: Camera) -> Image:
    ramp = np.linspace(0.0, 1.0, camera.height)[:, None, None]
    shades = (1.0 - ramp) * _BACKGROUND[0] + ramp * _BACKGROUND[1]
    return np.broadcast_to(shades, (camera.height, camera.width, 3)).astype(np.float32)


def _outline(image: Image, layer: Layer, colour: Colour) -> Image:
    """Draws the silhouette of a layer as a line, over everything."""
    inside = layer.covered
    line = binary_dilation(inside & ~binary_erosion(inside, iterations=2), iterations=2)
    return np.where(line[..., None], np.array(colour, dtype=np.float32), image)


def _shrunk(image: Image) -> Image:
    """The average of each block of pixels: smooth edges."""
    height, width, s = image.shape[0], image.shape[1], _OVERSAMPLING
    small: Image = image.reshape(height // s, s, width // s, s, 3).mean(axis=(1, 3))
    return small


def _placed(surface: Surface, X_PO: RigidTransform) -> Surface:
    return Surface(
        X_PO.multiply(surface.vertices.T).T,
        X_PO.rotation().multiply(surface.normals.T).T,
        surface.faces,
        surface.colour,
    )


def _markers(scene: Scene) -> Surface:
    """Contacts as small spheres, the force that the object exerts on each as an arrow, and pressed cells as plates."""
    contacts = scene.contacts
    balls: list[trimesh.Trimesh] = []
    for row, length in enumerate(arrow_lengths(contacts)):
        ball = trimesh.creation.icosphere(subdivisions=2, radius=_CONTACT_RADIUS)
        balls.append(ball.apply_translation(contacts.p_PC[row]))
        if contacts.f_PC is not None and length > 4 * _ARROW_RADIUS:
            X_PArrow = RigidTransform(RotationMatrix.MakeFromOneVector(contacts.f_PC[row], 2), contacts.p_PC[row])
            balls.extend(part.apply_transform(X_PArrow.GetAsMatrix4()) for part in _arrow(length))
    plates = _plates(scene)
    parts = [*balls, *plates]
    vertices, faces = trimesh.util.append_faces([part.vertices for part in parts], [part.faces for part in parts])
    counts = [sum(len(part.vertices) for part in some) for some in (balls, plates)]
    colour = np.repeat([CONTACT_COLOUR, PRESSURE_COLOUR], counts, axis=0)
    return _smooth(vertices.astype(np.float64), faces.astype(np.int32), colour)


def _plates(scene: Scene) -> list[trimesh.Trimesh]:
    """A plate on each pressed cell, as large as its pressure."""
    plates = []
    for patch in scene.patches:
        edges = plate_edges(patch)
        for cell in np.flatnonzero(edges):
            X_PCell = RigidTransform(RotationMatrix.MakeFromOneVector(patch.n_PT[cell], 2), patch.p_PT[cell])
            box = trimesh.creation.box([edges[cell], edges[cell], _PLATE_HEIGHT])
            plates.append(box.apply_transform(X_PCell.GetAsMatrix4()))
    return plates


def _arrow(length: float) -> tuple[trimesh.Trimesh, trimesh.Trimesh]:
    """Shaft and head of an arrow from the origin along z."""
    head = min(0.35 * length, 8 * _ARROW_RADIUS)
    shaft = trimesh.creation.cylinder(
        radius=_ARROW_RADIUS, segment=np.array([[0.0, 0.0, 0.0], [0.0, 0.0, length - head]])
    )
    cone = trimesh.creation.cone(radius=3 * _ARROW_RADIUS, height=head)
    return shaft, cone.apply_translation([0, 0, length - head])


def _smooth(vertices: FloatArray, faces: NDArray[np.int32], colour: Colour | FloatArray) -> Surface:
    """Normals for smooth shading, with the sharp edges kept; of one colour, or of one for each vertex."""
    colour = np.array(np.broadcast_to(colour, vertices.shape))
    mesh = trimesh.Trimesh(vertices, faces, vertex_colors=colour, process=False)
    shaded = trimesh.graph.smooth_shade(mesh, angle=_CREASE)
    return Surface(
        np.array(shaded.vertices),
        np.array(shaded.vertex_normals),
        np.array(shaded.faces, dtype=np.int32),
        shaded.visual.vertex_colors[:, :3] / 255.0,
    )


def _legend(scene: Scene, prior_label: str, *, is_painted: bool) -> list[Patch | Line2D]:
    handles: list[Patch | Line2D] = []
    if scene.prior is not None:
        handles.append(Patch(color=PRIOR_COLOUR, label=prior_label))
    if scene.estimate is not None and not is_painted:
        handles.append(Patch(color=ESTIMATE_COLOUR, label="estimate"))
    if scene.truth is not None:
        handles.append(Line2D([], [], color=TRUTH_COLOUR, linewidth=2.5, label="true pose"))
    if scene.hand is not None:
        handles.append(Patch(color=_HAND_LABEL_COLOUR, label="hand"))
    if len(scene.contacts):
        handles.append(Line2D([], [], color=CONTACT_COLOUR, marker="o", linestyle="", markersize=8, label="contact"))
    if scene.contacts.f_PC is not None and len(scene.contacts):
        largest = float(np.linalg.norm(scene.contacts.f_PC, axis=1).max())
        label = f"force on the {'pad' if scene.patches else 'finger'} (longest {largest:.1f} N)"
        handles.append(
            Line2D([], [], color=CONTACT_COLOUR, marker=r"$\rightarrow$", linestyle="", markersize=18, label=label)
        )
    if any(patch.is_felt for patch in scene.patches):
        handles.append(Patch(color=PRESSURE_COLOUR, label="pressed cells"))
    return handles
