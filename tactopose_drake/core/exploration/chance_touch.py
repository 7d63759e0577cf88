"""A random next touch: the baseline for choices by information."""

from collections.abc import Mapping

import numpy as np

from tactopose_drake.core.evidence.hand_geometry import HandGeometry
from tactopose_drake.core.exploration.foreseen_touch import entropy
from tactopose_drake.core.exploration.guarded_moves import GuardedMoves
from tactopose_drake.core.exploration.next_touch import Hold, NextTouch, TouchCriterion, allowed_moves, information
from tactopose_drake.core.exploration.tolerance import merged_modes
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture
from tactopose_drake.core.posterior.moved_origin import about_middle
from tactopose_drake.core.shape.object_model import ObjectModel


def choose_by_chance(
    model: ObjectModel,
    hold: Hold,
    belief: GaussianMixture,
    moves: Mapping[str, GuardedMoves],
    generator: np.random.Generator,
    *,
    others: Mapping[str, HandGeometry] | None = None,
    criterion: TouchCriterion = TouchCriterion(),
) -> NextTouch | None:
    """A random motion of those that `choose_touch` allows and that meet the object at the best pose, or None.

    Args:
        model: the object.
        hold: the fingers that hold it.
        belief: of its pose.
        moves: the possible motions of each finger.
        generator: makes the choice.
        others: as for `choose_touch`.
        criterion: which modes are likely.

    Raises:
        InvalidInputError: a belief without a mode.
    """
    model, belief = about_middle(model, belief)
    distinct = merged_modes(model, belief, criterion.tolerance)
    allowed = {
        finger: mask & moves[finger].feel(model, distinct.X_PO[:1]).is_hit[0]
        for finger, mask in allowed_moves(model, hold, distinct, moves, others, criterion).items()
    }
    choices = [(finger, int(move)) for finger, mask in allowed.items() for move in np.flatnonzero(mask)]
    if not choices:
        return None
    finger, move = choices[generator.integers(len(choices))]
    told = float(information(model, distinct, moves[finger].take(np.array([move])), criterion)[0])
    value = {name: np.full(len(options), np.nan) for name, options in moves.items()}
    value[finger][move] = told
    return NextTouch(finger, move, told, entropy(distinct, criterion.tolerance), allowed, value)
