"""Ground truth of the contacts of fingertips and pads in the simulator, to evaluate estimates."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Body, BodyIndex
from pydrake.systems.framework import Context

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.estimation.drake_contacts import reported_contacts
from tactopose_drake.hand.hand_in_plant import Hand


@dataclass(frozen=True, eq=False)
class PartContact:
    """The contact between one fingertip or pad and the object.

    If either has several collision shapes, it combines several contact patches.

    Attributes:
        p_PC: centre of pressure in the palm, shape (3,), m.
        n_PC: pressure-weighted mean normal, out of the object, shape (3,).
        f_PC: force of the object on the fingertip or pad, shape (3,), N.
        area: total area of the patches, m^2.
    """

    p_PC: FloatArray
    n_PC: FloatArray
    f_PC: FloatArray
    area: float


@dataclass(frozen=True, eq=False)
class ContactTruth:
    """All contacts between hand and object at one instant.

    Attributes:
        tips: contacts of the fingertips with a force-torque sensor, by finger.
        pads: contacts of the tactile pads, by pad.
        other_contacts: names of other links that touch the object.
    """

    tips: dict[str, PartContact]
    pads: dict[str, PartContact]
    other_contacts: tuple[str, ...]


def contact_truth(plant: MultibodyPlant, plant_context: Context, hand: Hand, object_body: Body) -> ContactTruth:
    """Reads the contact results of a hydroelastic simulation.

    Args:
        plant: finalized plant in a diagram, with `use_sampled_output_ports` False or at least one step taken.
        plant_context: the plant's context in that diagram.
        hand: the hand in the plant.
        object_body: the object.
    """
    finger_of_tip = {int(weld.child_body().index()): finger for finger, weld in hand.welds.items()}
    pad_of_body = {int(frame.body().index()): pad for pad, frame in hand.pad_frames.items()}
    results = plant.get_contact_results_output_port().Eval(plant_context)
    X_PW = hand.palm_frame.CalcPoseInWorld(plant_context).inverse()
    rotate = X_PW.rotation()

    tips: dict[str, list[PartContact]] = {}
    pads: dict[str, list[PartContact]] = {}
    others: list[str] = []
    for found in reported_contacts(results, plant, plant_context, object_body):
        finger, pad = finger_of_tip.get(found.partner), pad_of_body.get(found.partner)
        if found.surface is None or (finger is None and pad is None):
            others.append(plant.get_body(BodyIndex(found.partner)).name())
            continue
        area = float(found.surface.total_area())
        contact = PartContact(X_PW @ found.p_WC, rotate @ found.n_W, rotate @ found.f_W, area)
        if finger is not None:
            tips.setdefault(finger, []).append(contact)
        if pad is not None:
            pads.setdefault(pad, []).append(contact)
    joined_tips, joined_pads = ({name: _joined(parts) for name, parts in each.items()} for each in (tips, pads))
    return ContactTruth(joined_tips, joined_pads, tuple(others))


def _joined(parts: Sequence[PartContact]) -> PartContact:
    """Combines several patches, weighted by their normal forces."""
    if len(parts) == 1:
        return parts[0]
    p, n, f = (np.array([getattr(part, name) for part in parts]) for name in ("p_PC", "n_PC", "f_PC"))
    weight = np.maximum(np.einsum("ki,ki->k", f, n), 1e-12)
    normal = weight @ n
    return PartContact(
        weight @ p / weight.sum(),
        normal / max(float(np.linalg.norm(normal)), 1e-12),
        f.sum(axis=0),
        sum(part.area for part in parts),
    )
