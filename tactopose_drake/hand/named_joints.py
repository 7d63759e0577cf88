"""Conversion of joint positions by name, as from drivers and messages, to the order of a hand's plant."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike
from pydrake.multibody.plant import MultibodyPlant

from tactopose_drake.core.validation import FloatArray, known_name, number_array
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.hand_in_plant import Hand, joints_of, sliding_joints
from tactopose_drake.hand.reading_ranges import ReadingRange

_GIVE_RAD, _GIVE_M = 0.05, 0.003  # tolerance of a coupled joint's reading, as couplings are compliant


class NamedJoints:
    """Puts joint positions into the plant's order, and computes coupled joints.

    Attributes:
        names: names of the joints that move, in the order of the plant's positions.
    """

    def __init__(self, plant: MultibodyPlant, hand: Hand) -> None:
        """Takes the names from a plant; keeps no reference to it.

        Args:
            plant: finalized plant of the hand alone.
            hand: the hand in it.
        """
        moving = [joint for joint in joints_of(plant, hand) if joint.num_positions() == 1]
        moving.sort(key=lambda joint: joint.position_start())
        self.names = tuple(joint.name() for joint in moving)
        self._size = plant.num_positions()
        self._place = {joint.name(): joint.position_start() for joint in moving}
        self._sliding = sliding_joints(plant, hand)
        self._couplings = hand.config.couplings
        self._carried = frozenset(
            joint
            for joint, coupling in self._couplings.items()
            if plant.GetJointByName(joint, hand.model_instance).parent_body().index()
            in plant.GetBodiesKinematicallyAffectedBy(
                [plant.GetJointByName(coupling.follows, hand.model_instance).index()]
            )
        )

    def positions(self, name: str, values: Mapping[str, float] | ArrayLike) -> FloatArray:
        """Positions in the plant's order, shape (nq,), rad; of prismatic joints, m.

        Args:
            name: name of the argument, for messages.
            values: by the joints' names, or for all joints in the plant's order; NaN where unknown. A joint that is
                left out is computed from its coupling, or else unknown.

        Raises:
            InvalidInputError: if the shape is wrong, a name is unknown, or a value is no number.
        """
        ordered = self._in_order(name, values)
        if isinstance(values, Mapping):
            for joint, coupling in self._couplings.items():
                if joint not in values:
                    ordered[self._place[joint]] += coupling.offset
        return ordered

    def velocities(self, name: str, values: Mapping[str, float] | ArrayLike) -> FloatArray:
        """Velocities in the plant's order, rad/s; of prismatic joints, m/s; arguments as in `positions`."""
        return self._in_order(name, values)

    def check_couplings(self, name: str, values: Mapping[str, float], *, clutches: bool = False) -> None:
        """Checks that readings of coupled joints agree with those of the joints that they follow.

        Args:
            name: name of the argument, for messages.
            values: positions by the joints' names, all of which must exist; NaN passes.
            clutches: whether to skip coupled joints that are farther out on the finger than their leader: a clutch,
                like the Barrett hand's, decouples them when the finger is blocked.

        Raises:
            InvalidInputError: if a reading differs from its coupling by more than compliant couplings allow.
        """
        for joint, coupling in self._couplings.items():
            if joint not in values or coupling.follows not in values or (clutches and joint in self._carried):
                continue
            unit, give = ("m", _GIVE_M) if joint in self._sliding else ("rad", _GIVE_RAD)
            told, coupled = values[joint], coupling.ratio * values[coupling.follows] + coupling.offset
            if abs(told - coupled) > give:
                raise InvalidInputError(
                    f"{name}[{joint}] must be left out, as it follows another joint, or within {give:g} {unit} of "
                    f"{coupled:.4g} {unit}, by the coupling with {coupling.follows}, not {told:.4g} {unit}."
                )

    def _in_order(self, name: str, values: Mapping[str, float] | ArrayLike) -> FloatArray:
        if not isinstance(values, Mapping):
            return number_array(name, values, (self._size,))
        ordered = np.full(self._size, np.nan)
        for joint, value in values.items():
            known_name(f"each name in {name}", joint, self.names)
            ordered[self._place[joint]] = number_array(f"{name}[{joint}]", value, ())
        for joint, coupling in self._couplings.items():
            if joint not in values:
                ordered[self._place[joint]] = coupling.ratio * ordered[self._place[coupling.follows]]
        return ordered


def check_near_limits(name: str, values: Mapping[str, float], plant: MultibodyPlant, hand: Hand) -> None:
    """Checks that positions from a file are possible, and not in degrees, for instance.

    Positions slightly beyond a limit pass, because encoders may have offsets.

    Args:
        name: name of the argument, for messages.
        values: positions by the joints' names, all of which must exist; NaN passes.
        plant: finalized plant that holds the hand.
        hand: the hand in it.

    Raises:
        InvalidInputError: if a position is far beyond its joint's limits.
    """
    for joint_name, value in values.items():
        joint = plant.GetJointByName(joint_name, hand.model_instance)
        least, most, unit = ReadingRange.of(joint)
        if not np.isnan(value) and not least <= value <= most:
            low, high = joint.position_lower_limits()[0], joint.position_upper_limits()[0]
            raise InvalidInputError(
                f"{name}[{joint_name}] must be from {least:.4g} to {most:.4g} {unit}, near the joint's limits, "
                f"{low:.4g} and {high:.4g}, not {value:g}."
            )
