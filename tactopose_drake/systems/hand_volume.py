"""The hand's volume at the measured joint positions, as a system."""

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context

from tactopose_drake.errors import PortTypeError
from tactopose_drake.hand.contact_uncertainty import ContactUncertainty
from tactopose_drake.hand.geometry import BodySpheres, HandGeometry
from tactopose_drake.hand.hand_in_plant import Hand
from tactopose_drake.systems.collectable_system import CollectableSystem
from tactopose_drake.systems.hand_kinematics import declare_kinematics
from tactopose_drake.systems.ports import eval_items, port_name


@dataclasses.dataclass(frozen=True, eq=False)
class _Placed:
    """The spheres in the palm.

    Attributes:
        hand: the spheres of links whose pose in the palm is known; None where there are none.
        known: which of all spheres they are, shape (h,).
    """

    hand: HandGeometry | None
    known: NDArray[np.bool_]


class HandVolume(CollectableSystem):
    """Moves the spheres that fill the hand's links to where the measured joint positions put them.

    .. pydrake_system::

        name: HandVolume
        input_ports:
        - joint_positions
        - fingers_untouched
        output_ports:
        - hand
        - untouched

    - joint_positions: measured positions of the hand's joints, shape (nq,) of the hand's own plant, rad.
    - fingers_untouched: tuple of the names of the fingers that nothing touches; may stay unconnected.
    - hand: `HandGeometry` in P of all links except those moved by a joint whose position is unknown; None if there are
      none.
    - untouched: `HandGeometry` in P of the fingertips of `fingers_untouched`; None where there are none.
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        hand: Hand,
        spheres: BodySpheres,
        uncertainty: ContactUncertainty | None = None,
    ) -> None:
        """Keeps references to plant, spheres and uncertainty.

        Args:
            plant: finalized plant of the hand alone, for kinematics.
            hand: the hand in it.
            spheres: the spheres that fill its links.
            uncertainty: the hand's errors, which increase the uncertainty of its surface.
        """
        super().__init__()
        self._spheres, self._uncertainty = spheres, uncertainty
        self._filled = HandGeometry(spheres.p_BH, spheres.radius) if len(spheres.radius) else None
        tips = {finger: int(weld.child_body().index()) for finger, weld in hand.welds.items()}
        self._on_tip = {finger: spheres.body == tip for finger, tip in tips.items()}
        self._positions = self.DeclareVectorInputPort("joint_positions", plant.num_positions())
        self._fingers_untouched = self.DeclareAbstractInputPort("fingers_untouched", AbstractValue.Make(()))
        self._kinematics = declare_kinematics(self, plant, hand.palm_frame, self._positions)
        self._placed = self.declare_value("the spheres in the palm", self._place, {self._kinematics.ticket()})
        placed = {self._placed.ticket()}
        self.declare_output("hand", None, lambda context: self._placed.Eval(context).hand, placed)
        self.declare_output("untouched", None, self._untouched, placed | {self._fingers_untouched.ticket()})

    def _place(self, context: Context) -> _Placed:
        kinematics = self._kinematics.Eval(context)
        sigma = HandGeometry.sigma
        if self._uncertainty is not None:
            sigma = math.hypot(sigma, self._uncertainty.surface_sigma(kinematics))
        known, hand = kinematics.is_known(self._spheres.body), None
        if self._filled is not None and known.any():
            filled = self._filled if known.all() else self._filled.chosen(known)
            hand = filled.placed(kinematics.positions(self._spheres)[known], sigma)
        return _Placed(hand, known)

    def _untouched(self, context: Context) -> HandGeometry | None:
        fingers = eval_items(self._fingers_untouched, context, str)
        chosen = np.zeros(len(self._spheres.radius), dtype=np.bool_)
        for finger in fingers:
            if finger not in self._on_tip:
                raise PortTypeError(
                    f"{port_name(self._fingers_untouched)} must hold names among {', '.join(self._on_tip)}, not "
                    f"{finger!r}."
                )
            chosen |= self._on_tip[finger]
        placed = self._placed.Eval(context)
        of_known = chosen[placed.known]
        return placed.hand.chosen(of_known) if of_known.any() else None
