"""All that is known at one instant of where the object is."""

import dataclasses

from tactopose_drake.core.contacts import Contacts
from tactopose_drake.core.force_balance import ForceBalance
from tactopose_drake.core.hand_spheres import HandSpheres
from tactopose_drake.core.prior import PosePrior
from tactopose_drake.core.validation import positive_number
from tactopose_drake.errors import InvalidInputError


@dataclasses.dataclass(frozen=True, eq=False)
class Evidence:
    """What an estimate is made from, in the palm frame; None is what is not known.

    Attributes:
        contacts: the touch.
        prior: what is known of the pose without it; None where the object may be anywhere that the contacts touch it.
        hand: the hand's volume, which the object keeps out of but for what soft skin gives way.
        untouched: parts of the hand that feel no contact, which the object does not press at all.
        balance: that the object is at rest under the contacts' forces and gravity alone.
        friction: coefficient of friction between fingertips and object, by which no contact slips.

    Raises:
        InvalidInputError: a friction below 0, or balance or friction without forces.
    """

    contacts: Contacts
    prior: PosePrior | None = None
    hand: HandSpheres | None = None
    untouched: HandSpheres | None = None
    balance: ForceBalance | None = None
    friction: float | None = None

    def __post_init__(self) -> None:
        if self.friction is not None:
            object.__setattr__(self, "friction", positive_number("friction", self.friction, allow_zero=True))
        for name in ("balance", "friction"):
            if getattr(self, name) is not None and self.contacts.f_PC is None:
                raise InvalidInputError(f"contacts: have no forces; {name} needs them.")
