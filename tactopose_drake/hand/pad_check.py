"""Check that a hand's tactile pads have a plausible stiffness, and agree with their links' collision shapes."""

from collections.abc import Iterator

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant

from tactopose_drake.core.sensing.pad_values import DEEPEST
from tactopose_drake.core.sensing.tactile_array import TactileModel
from tactopose_drake.core.sensing.tactile_layout import TactileLayout
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.findings import Finding, Verdict, fault
from tactopose_drake.hand.hand_in_plant import Hand
from tactopose_drake.hand.shape_depth import body_depths
from tactopose_drake.hand.tactile_pads import load_tactile_pad

_SHALLOW, _THICK = 0.0001, 0.02  # plausible indentations of a soft layer, m
_NEAR = 0.005  # tolerance of a cell's distance to the shapes, which are coarser than pads, m
_BESIDE = 0.015  # largest distance of a cell outside the shapes, m
_STEP = 0.001  # step along a normal, m


def check_pads(plant: MultibodyPlant, scene_graph: SceneGraph, hand: Hand) -> Iterator[Finding]:
    """Reports the pads' indentation, and compares their cells and normals with their links' collision shapes."""
    for pad in hand.config.pads:
        part = f"pad {pad.name}"
        try:
            array = load_tactile_pad(pad.array)
        except InvalidInputError as error:
            yield fault(part, error)
            continue
        yield Finding(part, f"{len(array.layout)} cells of {pad.array} in frame {pad.frame!r}")
        yield from _depth(part, pad.alpha, array.model.range)
        yield from _place(plant, scene_graph, hand, pad.name, array.layout)


def _depth(part: str, alpha: float, most: float) -> Iterator[Finding]:
    """A pad's indentation at its array's range, Pa, if the range is given."""
    if most >= TactileModel().range:
        return
    depth = alpha * most
    text = f"at the array's range, {most:g} Pa, it is pressed in by {1e3 * depth:.3g} mm by alpha = {alpha:g} m/Pa"
    if depth > DEEPEST:
        yield Finding(part, f"{text}, which must be at most {1e3 * DEEPEST:g} mm", "fault")
    else:
        yield Finding(part, text, "ok" if _SHALLOW < depth < _THICK else "note")


def _place(
    plant: MultibodyPlant, scene_graph: SceneGraph, hand: Hand, pad: str, layout: TactileLayout
) -> Iterator[Finding]:
    """Compares the cells of a pad with its link's shapes, and checks that their normals point out of the link."""
    part, frame, inspector = f"pad {pad}", hand.pad_frames[pad], scene_graph.model_inspector()
    body, X_BT = frame.body(), frame.GetFixedPoseInBodyFrame()
    link, p_BC, step = body.name(), X_BT.multiply(layout.p_TC.T).T, _STEP * layout.n_T @ X_BT.rotation().matrix().T
    depth, behind, before = (body_depths(plant, inspector, body, p) for p in (p_BC, p_BC - step, p_BC + step))
    if depth is None or behind is None or before is None:
        text = (
            f"the link {link!r} has no collision shape, which its cells could be compared with, and that could be "
            "touched in simulation: there, its frame must be one of the link that has the shape"
        )
        yield Finding(part, text, "note")
        return
    share, off = float(np.mean(np.abs(depth) < _NEAR)), float(np.mean(depth < -_NEAR))
    above, below = max(0.0, -float(depth.min())), max(0.0, float(depth.max()))
    text = (
        f"{share:.0%} of its cells lie within {1e3 * _NEAR:.0f} mm of the collision shapes of link {link!r}; the rest "
        f"is up to {1e3 * above:.1f} mm outside of them and {1e3 * below:.1f} mm inside"
    )
    # Convex hulls fill hollow palms, so that a pad may be deep inside them.
    verdict: Verdict = "fault" if off > 0.5 or above > _BESIDE else "ok" if share > 0.5 else "note"
    yield Finding(part, text, verdict)
    inwards = float(np.mean(before > behind))
    if off <= 0.5 and inwards:
        text = f"the normals of {inwards:.0%} of its cells point into the link {link!r}; they point out of the pad"
        yield Finding(part, text, "fault" if inwards > 0.5 else "note")
