"""From the joints that a real hand measures to the positions of its plant."""

from collections.abc import Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.errors import InvalidInputError, UnknownNameError
from tactopose_drake.hand.hand_config import Hand


def joint_matrix(plant: MultibodyPlant, hand: Hand, measured: Sequence[str]) -> FloatArray:
    """What turns the joints that a hand measures, in its own order, into the plant's positions: q = matrix @ measured.

    A joint that is not measured follows its leader as the hand's description says. The matrix fits a `MatrixGain`.

    Args:
        plant: finalized plant of the hand alone.
        hand: the hand in it.
        measured: the model's names of the joints that are measured, in the order of the measurement.

    Returns:
        Shape (nq, k).

    Raises:
        UnknownNameError: if a measured joint is none of the hand's.
        InvalidInputError: if a name is double, or a joint is neither measured nor follows one that is.
    """
    joints = [plant.get_joint(index) for index in plant.GetJointIndices(hand.model_instance)]
    start = {joint.name(): joint.position_start() for joint in joints if joint.num_positions() == 1}
    for name in measured:
        if name not in start:
            raise UnknownNameError("measured joint", name, sorted(start))
    if len(set(measured)) < len(measured):
        raise InvalidInputError(f"measured: holds {list(measured)}; allowed are different joints.")
    followed = {coupling.joint: coupling for finger in hand.config.fingers for coupling in finger.couplings}
    matrix = np.zeros((plant.num_positions(), len(measured)))
    for name, row in start.items():
        leader, ratio = name, 1.0
        while leader not in measured and leader in followed:
            leader, ratio = followed[leader].follows, ratio * followed[leader].ratio
        if leader not in measured:
            raise InvalidInputError(f"measured: lacks {leader!r}, which follows none of {list(measured)}.")
        matrix[row, list(measured).index(leader)] = ratio
    return matrix
