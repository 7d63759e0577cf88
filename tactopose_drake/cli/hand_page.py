"""A page that shows a hand with its palm, sensor and fingertip frames, and the findings of the check."""

import dataclasses
from pathlib import Path

import numpy as np
from pydrake.geometry import Capsule, Convex, Ellipsoid, Meshcat, MeshcatParams, Rgba, Shape, Sphere
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import Context

from tactopose_drake.core.surfaces import Capsule as CapsuleTip
from tactopose_drake.core.surfaces import Ellipsoid as EllipsoidTip
from tactopose_drake.core.surfaces import Superquadric as SuperquadricTip
from tactopose_drake.core.surfaces import Surface
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.hand.findings import Finding
from tactopose_drake.hand.hand_check import CheckedHand, HandCheck
from tactopose_drake.visualization.appearance import FRAMES, HAND, Look
from tactopose_drake.visualization.body_meshes import BodyMeshes
from tactopose_drake.visualization.frame_marks import add_frame, bring_forward
from tactopose_drake.visualization.page import Label, Page, Switch, hand_switch, save_html
from tactopose_drake.visualization.page_tables import Instant, PageTable, Row

_TIP = Look("fingertip surface", (0.90, 0.45, 0.10), "solid", "of the hand's file, on which contacts are solved for")
_KINDS = {
    "P": Look("palm frame P", FRAMES.colour, "frame", "in which poses are given: x red, y green, z blue"),
    "S": Look("sensor frames S", FRAMES.colour, "frame", "of the force-torque sensors"),
    "F": Look("fingertip frames F", FRAMES.colour, "frame", "of the fingertips' surfaces; S = F where they are one"),
    "T": Look("pad frames T", FRAMES.colour, "frame", "of the tactile arrays"),
}
_LENGTHS = {"P": 0.05, "S": 0.02, "F": 0.012, "T": 0.02}  # of the axes, m
_TIP_OPACITY = 0.6
_POINTS = 1500  # points of a superquadric, whose hull is drawn


def save_hand_page(path: Path, name: str, check: HandCheck) -> None:
    """Writes the page: collision shapes at zero joint positions, fingertip surfaces, and frames.

    Args:
        path: path of the page.
        name: name of the hand, or path of its file.
        check: the hand's check, with its parts.

    Raises:
        InvalidFileError: if the file cannot be written.
    """
    assert check.parts is not None
    meshcat = Meshcat(MeshcatParams(host="localhost"))
    save_html(path, meshcat, draw_hand(meshcat, name, check.parts, check.findings))


def draw_hand(meshcat: Meshcat, name: str, checked: CheckedHand, findings: tuple[Finding, ...]) -> Page:
    """Draws a hand in its palm frame P with its sensors' frames S, fingertips' F and pads' T; returns the page."""
    plant, hand = checked.plant, checked.hand
    context = plant.GetMyContextFromRoot(checked.diagram.CreateDefaultContext())
    surface = BodyMeshes.in_palm(plant, context, hand.palm_frame, colliding=True)
    meshcat.SetTriangleMesh("/tactopose/hand", surface.vertices.T, surface.faces.T, Rgba(*HAND.colour))
    frames = _frames(meshcat, checked, context)
    kinds = list(dict.fromkeys(kind for kind, _, _ in frames))
    for kind, text, X in frames:
        add_frame(meshcat, f"/tactopose/{kind}/{text}", _LENGTHS[kind])
        meshcat.SetTransform(f"/tactopose/{kind}/{text}", X)
    switches = [Switch(_KINDS[kind], f"^/tactopose/{kind}/") for kind in kinds]
    if hand.surfaces:
        switches.insert(0, Switch(_TIP, "^/tactopose/fingertips/"))
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    return Page(
        title=f"The hand {Path(name).name.split('.')[0]}: frames and {'fingertips' if hand.surfaces else 'pads'}",
        said=_said(findings),
        switches=(*switches, hand_switch(HAND._replace(meaning="collision shapes at zero joint positions"))),
        details=(_table(findings),),
        labels=tuple(Label(f"/tactopose/{kind}/{text}", text, FRAMES.colour) for kind, text, _ in frames),
        direction_W=_view([X.translation() for _, _, X in frames], 0.5 * (low + high)),
        p_WQ=_held(surface.vertices, [X.translation() for _, _, X in frames]),
    )


def _frames(meshcat: Meshcat, checked: CheckedHand, context: Context) -> list[tuple[str, str, RigidTransform]]:
    """Kind, name and pose in P of each frame; draws the fingertips' surfaces."""
    plant, hand = checked.plant, checked.hand
    P = hand.palm_frame
    frames = [("P", "P", RigidTransform())]
    frames += [("T", f"T {pad}", _pose(plant, context, P, frame)) for pad, frame in hand.pad_frames.items()]
    for finger, tip in hand.surfaces.items():
        X_PS = _pose(plant, context, P, hand.sensor_frames[finger])
        X_PF = X_PS @ RigidTransform(RotationMatrix(tip.X_SF[:, :3]), tip.X_SF[:, 3])
        meshcat.SetObject(f"/tactopose/fingertips/{finger}", _shape(tip), Rgba(*_TIP.colour, _TIP_OPACITY))
        bring_forward(meshcat, f"/tactopose/fingertips/{finger}")  # It coincides with the hand's own shape.
        meshcat.SetTransform(f"/tactopose/fingertips/{finger}", X_PF)
        is_same = X_PF.IsNearlyEqualTo(X_PS, 1e-6)
        frames.append(("S", f"S = F {finger}" if is_same else f"S {finger}", X_PS))
        if not is_same:
            frames.append(("F", f"F {finger}", X_PF))
    return frames


def _said(findings: tuple[Finding, ...]) -> Instant:
    """Sentences on whether the hand can be used, and on faults and notes."""
    faults = [finding for finding in findings if finding.verdict == "fault"]
    notes = [finding for finding in findings if finding.verdict == "note"]
    right = len(findings) - len(faults) - len(notes)
    usable = "cannot be used as it is" if faults else "can be used"
    sentences = [f"It {usable}. Faults: {len(faults)}, notes: {len(notes)}, passed: {right}."]
    sentences += [f"{finding.part}: {finding.text}." for finding in (*faults, *notes)]
    nothing = PageTable("", (), ())
    return Instant("fault" if faults else "ok", tuple(sentences), nothing, nothing)


def _table(findings: tuple[Finding, ...]) -> PageTable:
    rows = tuple(Row((finding.part, finding.text)) for finding in findings if finding.verdict == "ok")
    return PageTable("Passed checks", ("part", "what"), rows, of_words=True)


def _pose(plant: MultibodyPlant, context: Context, P: Frame, frame: Frame) -> RigidTransform:
    return plant.CalcRelativeTransform(context, P, frame)


def _shape(surface: Surface) -> Shape:
    """Drake's shape of a fingertip's surface, in F."""
    if isinstance(surface, CapsuleTip):
        return Capsule(surface.radius, surface.length)
    if isinstance(surface, EllipsoidTip):
        return Ellipsoid(*surface.semi_axes)
    if isinstance(surface, SuperquadricTip):
        in_F = dataclasses.replace(surface, X_SF=np.eye(3, 4))
        return Convex(in_F.sample(np.random.default_rng(0), _POINTS).T, "fingertip")
    return Sphere(surface.half_width)


def _held(vertices: FloatArray, origins: list[FloatArray]) -> FloatArray:
    """Points that the view must contain: fingers and palm, but only the start of a long forearm, (n, 3), m."""
    frames = np.array(origins)
    reach = float(np.linalg.norm(np.ptp(frames, axis=0)))
    near = np.min(np.linalg.norm(vertices[:, None] - frames, axis=2), axis=1) < max(0.5 * reach, 0.08)
    held: FloatArray = np.concatenate([vertices[near], frames])
    return held


def _view(points: list[FloatArray], middle: FloatArray) -> FloatArray:
    """View direction that shows the frames side by side: nearly normal to their best-fit plane."""
    _, _, axes = np.linalg.svd(np.array(points) - np.mean(points, axis=0), full_matrices=True)
    normal = axes[-1] if axes[-1] @ (np.mean(points, axis=0) - middle) >= 0 else -axes[-1]
    tilted: FloatArray = normal + 0.25 * np.array([0.3, -0.5, 0.6])
    return tilted / np.linalg.norm(tilted)
