"""Check that the fingertip surfaces in a hand's file agree with the shapes in its model."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from pydrake.geometry import Role, SceneGraph, SceneGraphInspector
from pydrake.multibody.plant import MultibodyPlant

from tactopose_drake.hand.findings import Entry, Finding, Verdict
from tactopose_drake.hand.finger_chain import welded_bodies
from tactopose_drake.hand.fingertip_outline import fit_fingertip
from tactopose_drake.hand.hand_in_plant import Hand, joints_by_child
from tactopose_drake.hand.shape_depth import body_depths

_LIES_ON_IT = 0.95  # share of a surface within 1 mm of the shapes from which on no better one is searched for
_FAR_BETTER, _GOOD_ENOUGH = 1.5, 5e-4  # a better surface is suggested beyond this ratio of residuals and residual, m
_POINTS = 400  # of a surface that are compared
_NEAR = 1e-3  # m; within this distance a point lies on the shapes
_TOO_FAR, _TIMES = 3e-3, 4.0  # a surface is wrong beyond this residual, m, and this ratio to the fitted surface's


class _Fit(NamedTuple):
    """The fit of a fingertip's surface to the collision shapes of its link.

    Attributes:
        share: share of the surface within 1 mm of the shapes' surface, 0 to 1.
        above: largest distance of the surface outside all shapes, m.
        below: largest depth of the surface inside them, m.
    """

    share: float
    above: float
    below: float


def check_fingertips(plant: MultibodyPlant, scene_graph: SceneGraph, hand: Hand) -> Iterator[Finding]:
    """Compares the fingertips' surfaces with their links' collision shapes, and looks for better ones."""
    for finger, frame in hand.sensor_frames.items():
        part, weld = f"fingertip {finger}", hand.welds[finger]
        tip = weld.child_body().name()
        if frame.body().index() not in welded_bodies(plant, weld.frame_on_child()):
            yield _elsewhere(plant, hand, finger)
            continue
        yield Finding(part, f"sensor frame {frame.name()!r} at joint {weld.name()!r}, before link {tip!r}")
        fit = _fit(plant, scene_graph.model_inspector(), hand, finger)
        if fit is None:
            yield _bare(plant, scene_graph, hand, finger)
            continue
        text = (
            f"of its surface {fit.share:.0%} lie within 1 mm of the collision shapes of link {tip!r}; "
            f"the rest is up to {1e3 * fit.above:.1f} mm outside of them and {1e3 * fit.below:.1f} mm inside"
        )
        verdict: Verdict = "ok" if fit.share > 0.5 else "note" if fit.share > 0.1 else "fault"
        yield Finding(part, text, verdict)
        if fit.share < _LIES_ON_IT:
            yield from _better_surface(plant, scene_graph, hand, finger, can_be_wrong=verdict == "note")


def _fit(plant: MultibodyPlant, inspector: SceneGraphInspector, hand: Hand, finger: str) -> _Fit | None:
    """Compares a fingertip's surface with the collision shapes of its link; None if the link has none."""
    tip, surface = hand.welds[finger].child_body(), hand.surfaces[finger]
    context = plant.CreateDefaultContext()
    X_TipS = plant.CalcRelativeTransform(context, tip.body_frame(), hand.sensor_frames[finger])
    p_TipQ = X_TipS.multiply(surface.sample(np.random.default_rng(0), _POINTS).T).T
    deepest = body_depths(plant, inspector, tip, p_TipQ)
    if deepest is None:
        return None
    share = float(np.mean(np.abs(deepest) < _NEAR))
    return _Fit(share, float(max(0.0, -deepest.min())), float(max(0.0, deepest.max())))


def _elsewhere(plant: MultibodyPlant, hand: Hand, finger: str) -> Finding:
    """The finding for a sensor frame that its weld does not carry."""
    frame, weld = hand.sensor_frames[finger], hand.welds[finger]
    frames = map(plant.get_frame, plant.GetFrameIndices(hand.model_instance))
    carried = sorted(other.name() for other in frames if other.body().index() == weld.child_body().index())
    text = (
        f"sensor frame {frame.name()!r} is on link {frame.body().name()!r}, which the weld {weld.name()!r} does not "
        f"carry; frames that it carries are {', '.join(carried)}"
    )
    return Finding(f"fingertip {finger}", text, "fault")


def _bare(plant: MultibodyPlant, scene_graph: SceneGraph, hand: Hand, finger: str) -> Finding:
    """The finding for a fingertip link without a shape; suggests the nearest link towards the palm that has one."""
    part, tip = f"fingertip {finger}", hand.welds[finger].child_body()
    text = f"the link {tip.name()!r} has no collision shape, which its surface could be compared with"
    inspector, on_palm = scene_graph.model_inspector(), welded_bodies(plant, hand.palm_frame)
    body, before = tip, joints_by_child(plant, hand)
    while body.index() in before and body.index() not in on_palm:
        joint = before[body.index()]
        if inspector.GetGeometries(plant.GetBodyFrameIdOrThrow(body.index()), Role.kProximity):
            text += f"; the nearest one that has is {body.name()!r} behind the joint {joint.name()!r}"
            entries = Entry(finger, "sensor_frame", body.name()), Entry(finger, "weld", joint.name())
            return Finding(part, text, "fault", entries)
        body = joint.parent_body()
    return Finding(part, text, "fault")


def _better_surface(
    plant: MultibodyPlant, scene_graph: SceneGraph, hand: Hand, finger: str, *, can_be_wrong: bool
) -> Iterator[Finding]:
    """Suggests a surface that fits the fingertip's shape much better than the file's."""
    fitted = fit_fingertip(plant, scene_graph.model_inspector(), hand, finger)
    if fitted is None or fitted.own_residual < max(_FAR_BETTER * fitted.residual, _GOOD_ENOUGH):
        return
    where = f"the last {1e3 * fitted.length:.0f} mm of " if fitted.length is not None else ""
    text = (
        f"a surface fitted to {where}the shape in which the finger ends is off by {1e3 * fitted.residual:.2f} mm (root "
        f"mean square), the file's by {1e3 * fitted.own_residual:.2f} mm"
    )
    is_wrong = can_be_wrong and fitted.own_residual > max(_TIMES * fitted.residual, _TOO_FAR)
    yield Finding(
        f"fingertip {finger}", text, "fault" if is_wrong else "note", (Entry(finger, "surface", fitted.yaml),)
    )
