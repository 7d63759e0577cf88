"""Matrices from the joints that a real hand measures to the positions of its plant."""

import math
from collections.abc import Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant

from tactopose_drake.core.validation import FloatArray, known_name
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.hand_in_plant import Hand, joints_of, sliding_joints


def joint_matrix(plant: MultibodyPlant, hand: Hand, measured: Sequence[str]) -> FloatArray:
    """The matrix from measured joints, in the hand's own order, to the plant's positions: q = matrix @ measured.

    A joint that is not measured follows another by its coupling. If couplings have offsets, add `joint_offsets`. The
    matrix can be used in a `MatrixGain`.

    Args:
        plant: finalized plant of the hand alone.
        hand: the hand in it.
        measured: names in the model of the measured joints, in the order of the measurement.

    Returns:
        The matrix, shape (nq, k).

    Raises:
        UnknownNameError: if a measured joint does not exist in the hand.
        InvalidInputError: if a name is duplicate, or a joint is neither measured nor coupled to a measured one.
    """
    start = _places(plant, hand)
    for name in measured:
        known_name("each name in measured", name, sorted(start))
    if len(set(measured)) < len(measured):
        raise InvalidInputError(f"measured must be different joints, not {list(measured)}.")
    matrix = np.zeros((plant.num_positions(), len(measured)))
    for name, row in start.items():
        leader, ratio, _ = _leader(hand, name, measured)
        if leader not in measured:
            raise InvalidInputError(
                f"measured must have {leader!r}, which follows no joint, not only {list(measured)}."
            )
        matrix[row, list(measured).index(leader)] = ratio
    return matrix


def joint_offsets(plant: MultibodyPlant, hand: Hand, measured: Sequence[str]) -> FloatArray:
    """The couplings' offsets, which are added to `joint_matrix(...) @ measured`, shape (nq,), rad or m."""
    offsets = np.zeros(plant.num_positions())
    for name, place in _places(plant, hand).items():
        offsets[place] = _leader(hand, name, measured)[2]
    return offsets


def reading_offsets(plant: MultibodyPlant, hand: Hand) -> FloatArray:
    """Offsets of the readings of the plant's positions by the hand's calibration, shape (nq,), rad or m."""
    found = {} if hand.calibration is None else hand.calibration.joint_offsets
    offsets, sliding = np.zeros(plant.num_positions()), sliding_joints(plant, hand)
    for name, place in _places(plant, hand).items():
        leader, ratio, _ = _leader(hand, name, list(found))
        if leader in found:
            value = found[leader].value
            offsets[place] = ratio * (value if leader in sliding else math.radians(value))
    return offsets


def _places(plant: MultibodyPlant, hand: Hand) -> dict[str, int]:
    """The index of each moving joint's position, by name."""
    return {joint.name(): joint.position_start() for joint in joints_of(plant, hand) if joint.num_positions() == 1}


def _leader(hand: Hand, joint: str, measured: Sequence[str]) -> tuple[str, float, float]:
    """The measured joint that a joint is or follows, the ratio of their positions, and the offset."""
    coupling = hand.config.couplings.get(joint)
    if joint in measured or coupling is None:
        return joint, 1.0, 0.0
    return coupling.follows, coupling.ratio, coupling.offset
