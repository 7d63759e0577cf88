"""Poses of an object in Meshcat, and their uncertainty.

The estimate is a smooth solid; prior and truth are wireframes; other hypotheses are translucent, behind the estimate.
Ellipsoids on the estimate contain its points with 95 % probability; arrows show the directions that the touch leaves
free. The parts are made once and then only moved, shown and scaled, because Meshcat records only such changes.
"""

from collections.abc import Sequence
from typing import Literal

from pydrake.geometry import Meshcat, Rgba, Sphere
from pydrake.math import RigidTransform

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.visualization.appearance import ALTERNATIVE, FREE, MOST_FREE, ROLES, UNCERTAINTY, Colour
from tactopose_drake.visualization.arrow_shapes import slide_arrow, turn_arrow
from tactopose_drake.visualization.frame_marks import bring_forward
from tactopose_drake.visualization.object_shapes import Mesh, smooth_mesh, wire_cage
from tactopose_drake.visualization.remote_meshcat import RemoteMeshcat
from tactopose_drake.visualization.scene import ShownHypothesis
from tactopose_drake.visualization.uncertainty import POINTS, ellipsoids, free_arrows, shown_points

Role = Literal["prior", "estimate", "truth"]

REGION_OPACITY = 0.5
"""Opacity of the ellipsoids."""

_LEAST_OPACITY, _MOST_OPACITY = 0.2, 0.7  # of hypotheses with probabilities 0 and 1
_BEHIND = 4e5  # steps of the depth buffer: about 60 cm at half a metre


def add_object(
    meshcat: Meshcat | RemoteMeshcat, path: str, model: ObjectModel, role: Role, opacity: float = 1.0
) -> None:
    """Adds an object's surface in its frame O; `SetTransform` on the path places it.

    Args:
        meshcat: the display.
        path: path of the object.
        model: the object.
        role: role of its pose, which determines the colour, and whether it is a solid or a wireframe.
        opacity: 0 to 1.
    """
    mesh = smooth_mesh(model) if role == "estimate" else wire_cage(model)
    _set_smooth(meshcat, path, mesh, ROLES[role].colour, opacity)
    if role != "estimate":
        bring_forward(meshcat, path)  # else the estimate hides parts of the wires if its pose is nearly the same


def add_hypotheses(meshcat: Meshcat | RemoteMeshcat, path: str, model: ObjectModel, count: int) -> None:
    """Adds the parts that show hypotheses, hidden until `move_hypotheses` places them.

    Args:
        meshcat: the display.
        path: parent path; `path/estimate`, `path/alternatives` and `path/free` are added.
        model: the object.
        count: number of hypotheses beside the best that can be shown at once.
    """
    add_object(meshcat, f"{path}/estimate", model, "estimate")
    for point in range(POINTS):
        at = f"{path}/estimate/uncertainty/{point}"
        meshcat.SetObject(f"{at}/ball", Sphere(1.0), Rgba(*UNCERTAINTY.colour, REGION_OPACITY))
    ghost = smooth_mesh(model)
    for row in range(count):
        _set_smooth(meshcat, f"{path}/alternatives/{row}", ghost, ALTERNATIVE.colour, _LEAST_OPACITY)
    for row in range(MOST_FREE):
        for name, arrow in (("turn", turn_arrow()), ("slide", slide_arrow())):
            _set_smooth(meshcat, f"{path}/free/{row}/{name}/arrow", arrow, FREE.colour, 1.0)


def move_hypotheses(
    meshcat: Meshcat | RemoteMeshcat,
    path: str,
    model: ObjectModel,
    hypotheses: Sequence[ShownHypothesis],
    count: int,
    time: float | None = None,
) -> None:
    """Places the parts that `add_hypotheses` has added, and hides those that are not needed.

    Args:
        meshcat: the display.
        path: parent path.
        model: the object.
        hypotheses: in the frame of the path, the best first; at most `count` beside the best are shown.
        count: the count that `add_hypotheses` was given.
        time: time in the recording, s, if there is one.
    """
    best = hypotheses[0] if hypotheses else None
    place(meshcat, f"{path}/estimate", None if best is None else best.X_PO, time)
    if best is not None:
        _move_ellipsoids(meshcat, f"{path}/estimate/uncertainty", model, best, time)
    for row in range(count):
        shown = hypotheses[row + 1] if row + 1 < len(hypotheses) else None
        place(meshcat, f"{path}/alternatives/{row}", None if shown is None else shown.X_PO, time)
        if shown is not None:
            # Without the time, since Meshcat does not record opacities.
            at = f"{path}/alternatives/{row}"
            meshcat.SetProperty(at, "opacity", opacity_of(shown.probability))
            # Setting the opacity turns this on, which makes hypotheses that nearly coincide look mottled.
            meshcat.SetProperty(f"{at}/<object>", "material.depthWrite", False)
    arrows = [] if best is None else free_arrows(model, best)
    for row in range(MOST_FREE):
        for name in ("turn", "slide"):
            at = f"{path}/free/{row}/{name}"
            is_shown = row < len(arrows) and arrows[row].is_turn == (name == "turn")
            place(meshcat, at, arrows[row].X_PA if is_shown else None, time)
            if is_shown:
                meshcat.SetProperty(f"{at}/arrow", "scale", [arrows[row].scale] * 3, time)


def place(
    meshcat: Meshcat | RemoteMeshcat, path: str, X_Parent: RigidTransform | None, time: float | None = None
) -> None:
    """Shows the object at a path with a pose in its parent's frame; None hides it."""
    meshcat.SetProperty(path, "visible", X_Parent is not None, time)
    if X_Parent is not None:
        meshcat.SetTransform(path, X_Parent, time)


def opacity_of(probability: float) -> float:
    """Opacity of a hypothesis beside the best."""
    return _LEAST_OPACITY + (_MOST_OPACITY - _LEAST_OPACITY) * probability


def _move_ellipsoids(
    meshcat: Meshcat | RemoteMeshcat, path: str, model: ObjectModel, best: ShownHypothesis, time: float | None
) -> None:
    found = ellipsoids(model, best, shown_points(model))
    for point in range(POINTS):
        place(meshcat, f"{path}/{point}", found[point].X_OE if found else None, time)
        if found:
            meshcat.SetProperty(f"{path}/{point}/ball", "scale", found[point].radii.tolist(), time)


def _set_smooth(meshcat: Meshcat | RemoteMeshcat, path: str, mesh: Mesh, colour: Colour, opacity: float) -> None:
    """Adds a smoothly shaded triangle mesh; a translucent one never covers opaque objects."""
    vertices, faces = mesh
    meshcat.SetTriangleMesh(path, vertices.T, faces.T, Rgba(*colour, opacity))
    material: dict[str, bool | float] = {"flatShading": False, "needsUpdate": True}
    if opacity < 1.0:
        material |= {"polygonOffset": True, "polygonOffsetUnits": _BEHIND, "side": 0.0}
    for name, value in material.items():
        meshcat.SetProperty(f"{path}/<object>", f"material.{name}", value)
