"""Joint positions by name, as drivers and messages have them, in the order of a hand's plant."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike
from pydrake.multibody.plant import MultibodyPlant

from tactopose_drake.core.validation import FloatArray, known_name, number_array
from tactopose_drake.hand.hand_in_plant import Hand


class NamedJoints:
    """Puts joint positions into the plant's order, and lets coupled joints follow theirs.

    Attributes:
        names: of the joints that move, in the order of the plant's positions.
    """

    def __init__(self, plant: MultibodyPlant, hand: Hand) -> None:
        """Takes the names from a plant; keeps no reference to it.

        Args:
            plant: finalized plant of the hand alone.
            hand: the hand in it.
        """
        joints = [plant.get_joint(index) for index in plant.GetJointIndices(hand.model_instance)]
        moving = sorted((joint for joint in joints if joint.num_positions() == 1), key=lambda j: j.position_start())
        self.names = tuple(joint.name() for joint in moving)
        self._size = plant.num_positions()
        self._place = {joint.name(): joint.position_start() for joint in moving}
        self._couplings = [coupling for finger in hand.config.fingers for coupling in finger.couplings]

    def positions(self, name: str, values: Mapping[str, float] | ArrayLike) -> FloatArray:
        """Positions in the plant's order, shape (nq,), rad, of prismatic joints m.

        Args:
            name: of the argument, for messages.
            values: by the joints' names, or for all joints in the plant's order; NaN where one is not known. A joint
                that is left out is where its coupling says, or not known.

        Raises:
            InvalidInputError: if it is of another shape, a name is no joint's, or a value no number.
        """
        ordered = self._in_order(name, values)
        if isinstance(values, Mapping):
            for coupling in self._couplings:
                if coupling.joint not in values:
                    ordered[self._place[coupling.joint]] += coupling.offset
        return ordered

    def velocities(self, name: str, values: Mapping[str, float] | ArrayLike) -> FloatArray:
        """Velocities likewise, rad/s, m/s."""
        return self._in_order(name, values)

    def _in_order(self, name: str, values: Mapping[str, float] | ArrayLike) -> FloatArray:
        if not isinstance(values, Mapping):
            return number_array(name, values, (self._size,))
        ordered = np.full(self._size, np.nan)
        for joint, value in values.items():
            known_name(name, joint, self.names)
            ordered[self._place[joint]] = number_array(f"{name}[{joint}]", value, ())
        for coupling in self._couplings:
            if coupling.joint not in values:
                ordered[self._place[coupling.joint]] = coupling.ratio * ordered[self._place[coupling.follows]]
        return ordered
