"""A PNG picture of an estimate, drawn without a display, a GPU or a browser."""

import io
from pathlib import Path

import matplotlib.patheffects
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray
from pydrake.math import RigidTransform
from scipy.ndimage import binary_dilation, binary_erosion

from tactopose_drake.core.validation import FloatArray, instance_of, path_of
from tactopose_drake.core.vision.rasterizer import Camera, DrawnSurface, Layer, render
from tactopose_drake.estimation.output_files import written_beside
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.visualization.appearance import (
    ALTERNATIVE,
    CONTACT,
    ESTIMATE,
    FALSE_CONTACT,
    FORCE,
    FRAMES,
    FREE,
    NORMAL,
    PATCH_AXES,
    PRIOR,
    TRUTH,
    UNCERTAINTY,
    Colour,
    Look,
)
from tactopose_drake.visualization.label_places import label_places
from tactopose_drake.visualization.picture_marks import certainty_surface, frames_surface, smooth, touch_surface
from tactopose_drake.visualization.pose_marks import opacity_of
from tactopose_drake.visualization.scene import Scene, scene_of
from tactopose_drake.visualization.uncertainty import free_arrows, has_cut_ellipsoids, most_radius
from tactopose_drake.visualization.viewpoint import choose_view, points_of_interest

Image = NDArray[np.float32]

_DPI, _SMALL_DPI = 100, 60
_PANEL = (7.0, 6.2)  # inches
_HEAD = 0.4  # height of the captions above a panel, inches
_COLUMNS = 3  # of the legend below each panel
_OVERSAMPLING = 2
_BACKGROUND = (np.array([0.985, 0.988, 0.992]), np.array([0.900, 0.915, 0.935]))  # top, bottom
_HAND_OPACITY = 0.38
_MARKER_THROUGH = 0.55  # opacity of a marker behind a surface
_FRAME_OPACITY = 0.9  # of frames, which are drawn over all surfaces
_CERTAINTY_OPACITY = 0.75  # of ellipsoids and of arrows of free directions
_GHOSTS = 3  # maximum number of hypotheses that are drawn beside the best


def save_picture(
    path: str | Path,
    scene: Scene | PoseEstimate,
    *,
    captions: tuple[str, str] = ("before: prior", "after: touch"),
    prior_label: str = PRIOR.name,
    colours: FloatArray | None = None,
) -> None:
    """Writes a picture of an estimate: one panel for the prior, one for the estimate, from the same viewpoint.

    Args:
        path: the PNG file; its suffix does not matter.
        scene: the scene, or an estimate by `estimate_pose`, which is drawn with the inputs it was made from.
        captions: titles of the panels of prior and estimate.
        prior_label: name of the prior in the legend.
        colours: red, green and blue of the model's vertices at the estimate, 0 to 1, shape (v, 3); None for one colour.

    Raises:
        InvalidInputError: if an estimate does not hold its inputs, or a value has another type.
        InvalidFileError: if the file cannot be written.
    """
    path = path_of("path", path)
    scene = scene_of(scene) if isinstance(scene, PoseEstimate) else scene
    instance_of("scene", scene, Scene)
    figure = _draw(scene, captions, prior_label, colours, _DPI)
    with written_beside(path) as beside:
        figure.savefig(beside, facecolor="white", format="png")


def small_picture(scene: Scene) -> bytes:
    """A PNG picture of the estimate alone, for a notebook; the prior, if any, is drawn as an outline."""
    figure = _draw(scene, None, PRIOR.name, None, _SMALL_DPI)
    buffer = io.BytesIO()
    figure.savefig(buffer, facecolor="white")
    return buffer.getvalue()


def _draw(
    scene: Scene, captions: tuple[str, str] | None, prior_label: str, colours: FloatArray | None, dpi: int
) -> Figure:
    """A panel for the prior and one for the estimate, or, without captions, one for the estimate alone."""
    paints = (PRIOR.colour, ESTIMATE.colour if colours is None else colours)
    panels = [
        (pose, smooth(scene.model.vertices, scene.model.faces, paint), caption)
        for pose, paint, caption in zip((scene.prior, scene.estimate), paints, captions or (None, ""), strict=True)
        if pose is not None and caption is not None
    ]
    width, height = (int(side * dpi) * _OVERSAMPLING for side in _PANEL)
    camera = Camera.framing(points_of_interest(scene), choose_view(scene), scene.up_P, width, height)
    overlay = _Overlay(scene, camera)
    looks = [
        look for look in scene.looks if look not in (NORMAL, PATCH_AXES) and (colours is None or look is not ESTIMATE)
    ]
    columns = _COLUMNS * max(len(panels), 1)
    foot = 0.3 + 0.24 * -(-len(looks) // columns)
    size = _PANEL[0] * max(len(panels), 1), _HEAD + _PANEL[1] + foot
    figure = Figure(figsize=size, dpi=dpi)
    FigureCanvasAgg(figure)
    for index, (pose, thing, caption) in enumerate(panels):
        is_estimate = pose is scene.estimate
        image = overlay.over_all(_background(camera), render(_placed(thing, pose), camera), is_estimate)
        for other, colour in ((scene.prior, PRIOR.colour), (scene.truth, TRUTH.colour)):
            if other is not None and other is not pose:
                image = _outline(image, render(_placed(thing, other), camera), colour)
        image = overlay.markers_over(image)
        axes = figure.add_axes((index / len(panels), foot / size[1], 1 / len(panels), _PANEL[1] / size[1]))
        axes.imshow(_shrunk(image))
        axes.set_axis_off()
        axes.set_title(caption, fontsize=15, pad=7)
        _write(axes, scene, camera, is_estimate, dpi)
    handles = [_handle(look, scene, prior_label) for look in looks]
    figure.legend(handles=handles, loc="lower center", ncols=columns, frameon=False, fontsize=10)
    return figure


class _Overlay:
    """All parts of a panel but the object: other hypotheses, uncertainty, frames, the translucent hand, and markers."""

    def __init__(self, scene: Scene, camera: Camera) -> None:
        hand, touch, certainty = scene.hand, touch_surface(scene), certainty_surface(scene)
        self._hand = None if hand is None else render(smooth(hand.vertices, hand.faces, hand.colour), camera)
        self._markers = None if touch is None else render(touch, camera)
        frames = frames_surface(scene)
        self._frames = None if frames is None else render(frames, camera)
        self._certainty = None if certainty is None else render(certainty, camera)
        ghosts = scene.alternatives[:_GHOSTS]
        ghost = smooth(scene.model.vertices, scene.model.faces, ALTERNATIVE.colour) if ghosts else None
        self._ghosts = [
            (render(_placed(ghost, other.X_PO), camera), opacity_of(other.probability))
            for other in ghosts
            if ghost is not None
        ]
        self._nearest = np.zeros((camera.height, camera.width), dtype=np.float32)

    def over_all(self, image: Image, solid: Layer, is_estimate: bool) -> Image:
        """Draws other hypotheses, the object, its uncertainty, the hand and the frames over the image."""
        for ghost, share in self._ghosts if is_estimate else []:
            # Drawn first, so that the estimate covers them.
            image = _blended(image, ghost.colour, share * ghost.covered)
        image = np.where(solid.covered[..., None], solid.colour, image)
        nearest = solid.inverse_depth
        if is_estimate and self._certainty is not None:
            image = _blended(
                image, self._certainty.colour, _CERTAINTY_OPACITY * (self._certainty.inverse_depth > nearest)
            )
        if self._hand is not None:
            # More opaque at grazing angles, like glass.
            opacity = _HAND_OPACITY + (1.0 - _HAND_OPACITY) * (1.0 - self._hand.facing) ** 3
            image = _blended(image, self._hand.colour, np.where(self._hand.inverse_depth > nearest, opacity, 0.0))
            nearest = np.maximum(nearest, self._hand.inverse_depth)
        if is_estimate and self._frames is not None:
            image = _blended(image, self._frames.colour, _FRAME_OPACITY * self._frames.covered)
        self._nearest = nearest
        return image

    def markers_over(self, image: Image) -> Image:
        """Draws the markers over the image; those behind a surface are translucent."""
        if self._markers is None:
            return image
        hidden = self._nearest > self._markers.inverse_depth
        return _blended(image, self._markers.colour, np.where(hidden, _MARKER_THROUGH, 1.0) * self._markers.covered)


def _blended(image: Image, colour: NDArray[np.float32], opacity: NDArray[np.floating]) -> Image:
    return ((1.0 - opacity[..., None]) * image + opacity[..., None] * colour).astype(np.float32)


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
    """The average of each block of pixels, for smooth edges."""
    height, width, s = image.shape[0], image.shape[1], _OVERSAMPLING
    small: Image = image.reshape(height // s, s, width // s, s, 3).mean(axis=(1, 3))
    return small


def _placed(surface: DrawnSurface, X_PO: RigidTransform) -> DrawnSurface:
    return DrawnSurface(
        X_PO.multiply(surface.vertices.T).T,
        X_PO.rotation().multiply(surface.normals.T).T,
        surface.faces,
        surface.colour,
    )


def _write(axes: Axes, scene: Scene, camera: Camera, is_estimate: bool, dpi: int) -> None:
    """Draws the numbers of the contacts, and the names of the free directions and the frames."""
    texts: list[tuple[FloatArray, str, Colour]] = [
        (point, str(row + 1), FALSE_CONTACT.colour if is_false else CONTACT.colour)
        for row, (point, is_false) in enumerate(zip(scene.contacts.p_PC, scene.is_false, strict=True))
    ]
    if is_estimate and scene.hypotheses:
        arrows = free_arrows(scene.model, scene.hypotheses[0])
        texts += [(arrow.X_PA.multiply(arrow.p_AT), arrow.name, FREE.colour) for arrow in arrows]
        if scene.frames:
            origins = np.zeros(3), scene.hypotheses[0].X_PO.translation()
            texts += [(origin, name, FRAMES.colour) for origin, name in zip(origins, "PO", strict=True)]
    p_C = [camera.X_CP[:, :3] @ point + camera.X_CP[:, 3] for point, _, _ in texts]
    anchors = [(camera.focal_length * p[:2] / p[2] + camera.center) / _OVERSAMPLING for p in p_C]
    places = label_places(anchors, [text for _, text, _ in texts], camera.width / _OVERSAMPLING, dpi)
    for (_, text, colour), place in zip(texts, places, strict=True):
        axes.text(
            place[0],
            place[1],
            text,
            va="bottom",
            clip_on=True,
            fontsize=10,
            fontweight="bold",
            color=tuple(0.75 * channel for channel in colour),
            path_effects=[matplotlib.patheffects.withStroke(linewidth=2.5, foreground="white")],
        )


def _handle(look: Look, scene: Scene, prior_label: str) -> Patch | Line2D:
    """The entry of a part in the legend."""
    label = prior_label if look is PRIOR else look.name
    if look is FORCE:
        label = f"force on the finger (longest {scene.largest_force:.1f} N)"
    if look is UNCERTAINTY and has_cut_ellipsoids(scene.model, scene.hypotheses[0]):
        label = f"{label} (cut off at {1e3 * most_radius(scene.model):.0f} mm)"
    if look.mark == "line":
        return Line2D([], [], color=look.colour, linewidth=2.5, label=label)
    markers = {
        "ball": "o",
        "cross": "x",
        "arrow": r"$\rightarrow$",
        "turn": r"$\circlearrowleft$",
        "ellipsoid": "o",
        "frame": "+",
    }
    if look.mark in markers:
        size = 16 if look.mark in ("arrow", "turn") else 8
        return Line2D([], [], color=look.colour, marker=markers[look.mark], linestyle="", markersize=size, label=label)
    return Patch(color=look.colour, alpha=0.45 if look.mark == "ghost" else 1.0, label=label)
