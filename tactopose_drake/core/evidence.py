"""All that is known at one instant of where the object is."""

import dataclasses

from tactopose_drake.core.contacts import Contacts
from tactopose_drake.core.prior import PosePrior


@dataclasses.dataclass(frozen=True, eq=False)
class Evidence:
    """What an estimate is made from, in the palm frame; None is what is not known.

    Attributes:
        contacts: the touch.
        prior: what is known of the pose without it; None where the object may be anywhere that the contacts touch it.
    """

    contacts: Contacts
    prior: PosePrior | None = None
