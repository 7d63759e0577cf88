"""The page of an estimate: sentences and tables beside the scene, and switches for the drawn parts."""

import dataclasses

import numpy as np
from pydrake.geometry import Meshcat, MeshcatParams
from pydrake.math import RigidTransform

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.estimation.descriptions import (
    false_contacts_line,
    free_line,
    meaning,
    sigma_cells,
    sigma_line,
)
from tactopose_drake.estimation.far_origins import about_middle
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.visualization import appearance
from tactopose_drake.visualization.appearance import Look
from tactopose_drake.visualization.arrow_shapes import SLIDE_TIP, TURN_TIP
from tactopose_drake.visualization.meshcat import draw_scene, upright
from tactopose_drake.visualization.page import Label, Page, Switch, hand_switch
from tactopose_drake.visualization.page_tables import Instant, PageTable, Row
from tactopose_drake.visualization.scene import Scene, inlier_probabilities
from tactopose_drake.visualization.timeline import Timeline
from tactopose_drake.visualization.uncertainty import free_arrows, has_cut_ellipsoids, most_radius
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
    appearance.NORMAL: r"^/tactopose/touch/\d+/normal/line",
    appearance.FORCE: r"^/tactopose/touch/\d+/force",
    appearance.PRESSURE: r"^/tactopose/patches/\d+/cells/",
    appearance.PATCH_AXES: r"^/tactopose/patches/\d+/axes/",
    appearance.CONE: r"^/tactopose/touch/\d+/normal/cone",
    appearance.FRAMES: r"^/tactopose/(palm|estimate/frame)/",
}
# Maximum number and minimum probability of the hypotheses beside the best that are visible at first.
_SHOWN, _LEAST_SHOWN = 3, 0.1
_AT_FIRST_OFF = (appearance.CONE, appearance.FRAMES)  # parts whose switches are off at first
_DIRECTIONS = 60  # the outermost point along each is kept in view


def page_of(
    scene: Scene,
    estimate: PoseEstimate,
    *,
    title: str = "",
    X_WP: RigidTransform | None = None,
    tables: tuple[PageTable, ...] = (),
    timeline: Timeline | None = None,
) -> Page:
    """The page of an estimate.

    Args:
        scene: the scene that is drawn.
        estimate: the result.
        title: the page's title; by default made from the object's name.
        X_WP: pose of the palm in Meshcat's world; by default that of `draw_scene`.
        tables: further tables, above that of the hypotheses.
        timeline: the timeline of a recording, if any.
    """
    name = scene.model.name.replace("_", " ")
    X_WP = upright(scene) if X_WP is None else X_WP
    said = instant_of(scene, estimate)
    unknown = ("Which hand holds it is not told, so none is drawn.",) if scene.hand is None else ()
    return Page(
        title=title or f"{name[0].upper()}{name[1:]} in the hand: pose by touch",
        said=said._replace(sentences=(*said.sentences, *unknown)),
        tables=tables,
        switches=_switches(scene, timeline),
        labels=_labels(scene, timeline),
        direction_W=X_WP.rotation() @ choose_view(scene),
        p_WQ=_outermost(X_WP.multiply(points_of_interest(scene).T).T),
        timeline=timeline,
    )


def estimate_meshcat(scene: Scene) -> Meshcat:
    """A new Meshcat in which a scene is drawn, with the frames of palm and object."""
    meshcat = Meshcat(MeshcatParams(host="localhost"))
    draw_scene(meshcat, dataclasses.replace(scene, frames=True))
    return meshcat


def instant_of(scene: Scene, estimate: PoseEstimate | None, status: str = "") -> Instant:
    """The sentences and tables of a page for a scene at one instant.

    Args:
        scene: the scene that is drawn.
        estimate: the result; None if there is none yet.
        status: the status of a station, a word that may be followed by ": " and the reason; by default that of the
            estimate.
    """
    word, _, why = status.partition(": ")
    sentences = [why[0].upper() + why[1:] + "."] if why else []
    if estimate is not None:
        word = word or estimate.status
        believed, best = meaning(estimate), about_middle(estimate.best, scene.model)
        sentences += [
            f"{believed[0].upper()}{believed[1:]}.",
            sigma_line(best, scene.model.size),
            free_line(best),
            false_contacts_line(scene.is_false, scene.touched_by),
        ]
    return Instant(
        status=word,
        sentences=tuple(sentence for sentence in sentences if sentence),
        hypotheses=_hypotheses(estimate, scene.model, len(scene.alternatives)),
        contacts=_contacts(scene),
        free=_free_names(scene),
    )


def _switches(scene: Scene, timeline: Timeline | None) -> tuple[Switch, ...]:
    """The legend of a scene, and of what a recording shows before its end, whose forces change.

    The largest force is therefore given only without a recording.
    """
    is_over_time = timeline is not None
    looks = {*dataclasses.replace(scene, frames=True).looks, *(() if timeline is None else timeline.looks)}
    longest = "the largest of the object's contacts below" if is_over_time else f"{scene.largest_force:.1f} N"
    details = {appearance.FORCE: f"{appearance.FORCE.meaning}; the longest is {longest}"}
    if is_over_time or (scene.hypotheses and has_cut_ellipsoids(scene.model, scene.hypotheses[0])):
        cut = f"cut off at {1e3 * most_radius(scene.model):.0f} mm{' where larger' if is_over_time else ''}"
        details[appearance.UNCERTAINTY] = f"{appearance.UNCERTAINTY.meaning}; {cut}"
    return tuple(
        hand_switch(look)
        if look is appearance.HAND
        else Switch(look, _PARTS[look], details.get(look, ""), look not in _AT_FIRST_OFF)
        for look in (*_PARTS, appearance.HAND)
        if look in looks
    )


def _hypotheses(estimate: PoseEstimate | None, model: ObjectModel, count: int) -> PageTable:
    found = () if estimate is None else estimate.hypotheses
    rows = []
    for index, hypothesis in enumerate(found[: 1 + count]):
        cells = (
            f"{hypothesis.probability:.1%}",
            _millimetres(hypothesis.X_PO.translation()),
            *sigma_cells(about_middle(hypothesis, model), model.size),
        )
        hides = f"^/tactopose/alternatives/{index - 1}(/|$)" if index else ""
        rows.append(Row(cells, hides, index <= _SHOWN and hypothesis.probability >= _LEAST_SHOWN))
    hidden = len(found) - len(rows)
    return PageTable(
        "Hypotheses in the palm frame",
        ("prob.", "x y z, mm", "\u00b1 mm", "\u00b1 deg"),
        tuple(rows),
        f"and {hidden} less probable" if hidden > 0 else "",
    )


def _contacts(scene: Scene) -> PageTable:
    contacts = scene.contacts
    names = scene.touched_by or ("",) * len(contacts)
    columns = [
        ("contact", [f"{row + 1} {name}".rstrip() for row, name in enumerate(names)]),
        ("x y z, mm", [_millimetres(point) for point in contacts.p_PC]),
    ]
    if contacts.f_PC is not None:
        texts = [f"{force:.2f}" for force in np.linalg.norm(contacts.f_PC, axis=1)]
        of_fingers = len(texts) - sum(patch.is_felt for patch in scene.patches)  # Pads come last, without forces.
        columns.append(("force, N", [*texts[:of_fingers], *[""] * (len(texts) - of_fingers)]))
    inlier = inlier_probabilities(scene.hypotheses, len(contacts), scene.patches)
    if inlier is not None:
        columns.append(("of object", [f"{share:.0%}" for share in inlier]))
    rows = tuple(Row(cells) for cells in zip(*(cells for _, cells in columns), strict=True))
    return PageTable("Contacts in the palm frame", tuple(heading for heading, _ in columns), rows)


def _millimetres(point: FloatArray) -> str:
    return " ".join(f"{x:.1f}" for x in np.round(1e3 * point, 1) + 0.0)  # no -0.0


def _labels(scene: Scene, timeline: Timeline | None) -> tuple[Label, ...]:
    """The texts in a scene; of a recording those of all times, each of which is shown where its part is."""
    said = () if timeline is None else timeline.said
    count = max([len(scene.contacts), *(len(instant.contacts.rows) for instant in said)])
    contacts = [Label(f"/tactopose/touch/{row}", str(row + 1), appearance.CONTACT.colour) for row in range(count)]
    names, colour = _free_names(scene), appearance.FREE.colour
    free = [
        Label(f"/tactopose/free/{row}/{kind}/arrow", names[row] if row < len(names) else "", colour, tip, row)
        for row in range(max([len(names), *(len(instant.free) for instant in said)]))
        for kind, tip in (("turn", TURN_TIP), ("slide", SLIDE_TIP))
    ]
    frames = [
        Label(f"/tactopose/{path}", name, appearance.FRAMES.colour)
        for path, name in (("palm", "P"), ("estimate/frame", "O"))
    ]
    return (*contacts, *free, *frames)


def _free_names(scene: Scene) -> tuple[str, ...]:
    arrows = free_arrows(scene.model, scene.hypotheses[0]) if scene.hypotheses else []
    return tuple(arrow.name for arrow in arrows)


def _outermost(points: FloatArray) -> FloatArray:
    """The outermost of points (n, 3) along many directions: a view that holds these holds nearly all points."""
    if not len(points):
        return points
    generator = np.random.default_rng(0)
    directions = generator.normal(size=(_DIRECTIONS, 3))
    rows = np.unique(np.argmax(points @ directions.T, axis=0))
    chosen: FloatArray = points[rows]
    return chosen
