"""The page of an estimate: what it says of a scene, in words and numbers, and the switches of what is drawn."""

import numpy as np
from pydrake.geometry import Meshcat, MeshcatParams
from pydrake.math import RigidTransform

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.estimation.descriptions import (
    determined_sigmas,
    false_contacts_line,
    free_line,
    meaning,
    sigma_line,
)
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.visualization import appearance
from tactopose_drake.visualization.appearance import Look
from tactopose_drake.visualization.meshcat import draw_scene, upright
from tactopose_drake.visualization.page import Label, Page, PageTable, Row, Switch, hand_switch
from tactopose_drake.visualization.scene import Scene
from tactopose_drake.visualization.timeline import Timeline
from tactopose_drake.visualization.uncertainty import free_arrows
from tactopose_drake.visualization.viewpoint import choose_view, points_of_interest

_PARTS: dict[Look, str] = {
    appearance.ESTIMATE: r"^/tactopose/estimate(/|$)",
    appearance.ALTERNATIVE: r"^/tactopose/alternatives/",
    appearance.UNCERTAINTY: r"^/tactopose/estimate/uncertainty/",
    appearance.FREE: r"^/tactopose/free/",
    appearance.PRIOR: r"^/tactopose/prior(/|$)",
    appearance.TRUTH: r"^/tactopose/truth(/|$)",
    appearance.CONTACT: r"^/tactopose/touch/\d+/point",
    appearance.FALSE_CONTACT: r"^/tactopose/touch/\d+/false",
    appearance.NORMAL: r"^/tactopose/touch/\d+/normal",
    appearance.FORCE: r"^/tactopose/touch/\d+/force",
    appearance.PRESSURE: r"^/tactopose(_|/)patches/",
}
# Hypotheses beside the best that are shown at first: so many at the most, and so probable at the least.
_SHOWN, _LEAST_SHOWN = 3, 0.1
_DIRECTIONS = 60  # along each of which the outermost point is framed


def page_of(
    scene: Scene,
    estimate: PoseEstimate,
    *,
    title: str = "",
    X_WP: RigidTransform | None = None,
    tables: tuple[PageTable, ...] = (),
    when: str = "",
    timeline: Timeline | None = None,
) -> Page:
    """The page of an estimate.

    Args:
        scene: what is drawn.
        estimate: the result.
        title: what the page is; by default the object's name, and that touch put it there.
        X_WP: the palm in Meshcat's world; by default where `draw_scene` has it.
        tables: further ones, before that of the hypotheses.
        when: of a recording, the time of what the page says beside the scene.
        timeline: of a recording.
    """
    name, best = scene.model.name.replace("_", " "), estimate.best
    X_WP = upright(scene) if X_WP is None else X_WP
    lines = (
        f"{meaning(estimate)[0].upper()}{meaning(estimate)[1:]}.",
        sigma_line(best, scene.model.size),
        free_line(best),
        false_contacts_line(scene.is_false),
    )
    return Page(
        title=title or f"{name[0].upper()}{name[1:]} in the hand: pose by touch",
        status=estimate.status,
        when=when,
        sentences=tuple(line for line in lines if line),
        switches=scene_switches(scene),
        tables=(*tables, _hypotheses(estimate, scene.model.size, len(scene.alternatives))),
        details=(_contacts(scene),),
        labels=_labels(scene),
        direction_W=X_WP.rotation() @ choose_view(scene),
        p_WQ=_outermost(X_WP.multiply(points_of_interest(scene).T).T),
        timeline=timeline,
    )


def estimate_meshcat(scene: Scene) -> Meshcat:
    """A Meshcat of its own, in which a scene is drawn."""
    meshcat = Meshcat(MeshcatParams(host="localhost"))
    draw_scene(meshcat, scene)
    return meshcat


def scene_switches(scene: Scene) -> tuple[Switch, ...]:
    """The legend of a scene."""
    forces = scene.contacts.f_PC
    details = {}
    if forces is not None and len(forces):
        details[appearance.FORCE] = (
            f"{appearance.FORCE.meaning}; the longest is {float(np.linalg.norm(forces, axis=1).max()):.1f} N"
        )
    return tuple(
        hand_switch(look) if look is appearance.HAND else Switch(look, _PARTS[look], details.get(look, ""))
        for look in scene.looks
    )


def _hypotheses(estimate: PoseEstimate, size: float, count: int) -> PageTable:
    rows = []
    for index, hypothesis in enumerate(estimate.hypotheses[: 1 + count]):
        rotation, translation = determined_sigmas(hypothesis, size)
        cells = (
            f"{hypothesis.probability:.1%}",
            _millimetres(hypothesis.X_PO.translation()),
            f"{1e3 * translation:.1f}",
            f"{np.degrees(rotation):.1f}",
        )
        hides = f"^/tactopose/alternatives/{index - 1}(/|$)" if index else ""
        rows.append(Row(cells, hides, index <= _SHOWN and hypothesis.probability >= _LEAST_SHOWN))
    hidden = len(estimate.hypotheses) - len(rows)
    return PageTable(
        "Hypotheses in the palm frame",
        ("prob.", "x y z, mm", "\u00b1 mm", "\u00b1 deg"),
        tuple(rows),
        f"and {hidden} less probable" if hidden > 0 else "",
    )


def _contacts(scene: Scene) -> PageTable:
    contacts = scene.contacts
    columns = [
        ("contact", [str(row + 1) for row in range(len(contacts))]),
        ("x y z, mm", [_millimetres(point) for point in contacts.p_PC]),
    ]
    if contacts.f_PC is not None:
        columns.append(("force, N", [f"{force:.2f}" for force in np.linalg.norm(contacts.f_PC, axis=1)]))
    inlier = scene.hypotheses[0].inlier_probability if scene.hypotheses else None
    if inlier is not None and len(inlier) >= len(contacts):
        columns.append(("is one", [f"{share:.0%}" for share in inlier[: len(contacts)]]))
    rows = tuple(Row(cells) for cells in zip(*(cells for _, cells in columns), strict=True))
    return PageTable("Contacts in the palm frame", tuple(heading for heading, _ in columns), rows)


def _millimetres(point: FloatArray) -> str:
    return " ".join(f"{x:.1f}" for x in np.round(1e3 * point, 1) + 0.0)  # no -0.0


def _labels(scene: Scene) -> tuple[Label, ...]:
    contacts = [
        Label(
            f"/tactopose/touch/{row}",
            str(row + 1),
            appearance.FALSE_CONTACT.colour if is_false else appearance.CONTACT.colour,
        )
        for row, is_false in enumerate(scene.is_false)
    ]
    arrows = free_arrows(scene.model, scene.hypotheses[0]) if scene.hypotheses else []
    free = [
        Label(
            f"/tactopose/free/{row}/{'turn' if arrow.is_turn else 'slide'}",
            arrow.name,
            appearance.FREE.colour,
            tuple(arrow.p_AT.tolist()),
        )
        for row, arrow in enumerate(arrows)
    ]
    return (*contacts, *free)


def _outermost(points: FloatArray) -> FloatArray:
    """The few of many points (n, 3) that a view must hold, in any direction."""
    if not len(points):
        return points
    generator = np.random.default_rng(0)
    directions = generator.normal(size=(_DIRECTIONS, 3))
    rows = np.unique(np.argmax(points @ directions.T, axis=0))
    chosen: FloatArray = points[rows]
    return chosen
