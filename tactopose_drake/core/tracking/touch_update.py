"""A new touch: what it makes of the modes, and how modes that a search finds by it compare with them."""

import dataclasses
import math
from typing import NamedTuple

import numpy as np

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.contact_update import Stable, number_of_numbers, update_with_contacts
from tactopose_drake.core.tracking.frame_touch import FrameTouch
from tactopose_drake.core.tracking.looking_elsewhere import Look
from tactopose_drake.core.tracking.mode_set import ModeSet
from tactopose_drake.core.tracking.surprise import calmed, is_surprised, watch
from tactopose_drake.core.tracking.touch_memory import fade, remember, worth_of_a_frame


class Felt(NamedTuple):
    """Modes, at least one, after a touch.

    Attributes:
        modes: by falling weight.
        slipped: whether the touch contradicts the best.
        log_evidence: logarithm of the touch's probability by all of them together.
        log_before: of the best mode's `log_touch` the part that is of earlier frames.
        worth: by how much this frame's evidence is in the modes' weights.
    """

    modes: ModeSet
    slipped: bool
    log_evidence: float
    log_before: float
    worth: float


def feel(model: ObjectModel, touch: FrameTouch, stable: Stable, modes: ModeSet, forgotten: float) -> Felt:
    """Updates modes, at least one, with a touch.

    Args:
        model: the object.
        touch: what is touched.
        stable: of what the contacts' biases are.
        modes: as they are predicted.
        forgotten: the share by which fades what the touch told of the pose before.
    """
    modes = fade(model, touch.contacts, modes, forgotten)
    update = update_with_contacts(
        model, touch.contacts, touch.source, stable, modes.X_PO, modes.covariance, modes.cross, modes.roughness
    )
    evidence = float(np.logaddexp.reduce(modes.log_weight + update.log_evidence))
    modes = remember(watch(modes, update, number_of_numbers(touch.contacts)), update.log_evidence, update.stays)
    modes = modes.touched(touch.source, update.roughness, stable.variances[[0, 3]])
    order = np.argsort(-modes.log_weight, kind="stable")
    modes = modes.chosen(order)
    worth = float(worth_of_a_frame(modes, update.stays)[0])
    before = float(modes.log_touch[0] - worth * update.log_evidence[order[0]])
    slipped = bool(is_surprised(modes.chosen([0]))[0])
    return Felt(calmed(modes) if slipped else modes, slipped, evidence, before, worth)


def join(felt: Felt, found: ModeSet, look: Look) -> ModeSet:
    """The modes and those that were found by the same touch, weighed with what the best has felt before.

    Args:
        felt: the modes after the touch.
        found: those of a search.
        look: where it looked, and how probable it is that the object is there and no mode has it.
    """
    if not len(found):
        return felt.modes
    log_evidence = felt.log_evidence if look.jumped else np.logaddexp.reduce(found.log_weight)
    total = np.logaddexp.reduce(felt.modes.log_weight) + math.log(look.probability)
    weight = total + found.log_weight - log_evidence
    log_touch = felt.log_before + felt.worth * found.log_touch
    frames = np.full(len(found), felt.modes.frames[0])
    found = dataclasses.replace(found, log_prior=weight - log_touch, log_touch=log_touch, frames=frames)
    return felt.modes.joined(found)
