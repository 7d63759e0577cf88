"""The evidence on an object's pose at one instant."""

import dataclasses
import functools
from collections.abc import Sequence

from tactopose_drake.core.evidence.contact_doubt import USUAL, ContactDoubt
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.force_balance import ForceBalance
from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.evidence.hand_geometry import HandGeometry
from tactopose_drake.core.evidence.patch_contacts import with_patches
from tactopose_drake.core.evidence.plane_contact import PlaneContact
from tactopose_drake.core.plain_values import copied
from tactopose_drake.core.sensing.patches import Patch
from tactopose_drake.core.validation import MOST_FRICTION, MOST_OUTLIERS, instance_of, kind_name, positive_number
from tactopose_drake.errors import InvalidInputError, TooFewContactsError

# The type of each field, and its public name.
_KINDS = {
    "contacts": (Contacts, "Contacts"),
    "prior": (GaussianPrior, "PosePrior"),
    "hand": (HandGeometry, "HandGeometry"),
    "untouched": (HandGeometry, "HandGeometry"),
    "balance": (ForceBalance, "ForceBalance"),
}
_SEQUENCES: dict[str, type] = {"patches": Patch, "planes": PlaneContact}


@dataclasses.dataclass(frozen=True, eq=False)
class Evidence:
    """What an estimate is made from, in the palm frame; None for what is not known.

    Attributes:
        contacts: the touch at single points.
        patches: the touch of tactile arrays; pads that feel nothing tell where the object is not.
        prior: what is known of the pose without the touch; None if the object may be anywhere where it is touched.
        hand: the hand's volume, which the object does not penetrate except for yielding skin.
        untouched: parts of the hand without contact, which the object does not press at all.
        balance: that the object is at rest under the contacts' forces and gravity alone.
        friction: coefficient of friction between fingertips and object, if no contact slips.
        planes: known planes of the world that the object touches, with its lowest point over each.
        outlier_probability: that a contact is with something else than the object; 0 takes every contact as told.
        doubt: other errors of contacts, with rates relative to contacts with something else.

    Raises:
        InvalidInputError: a value of another type, a friction below 0, or balance or friction without forces.
        TooFewContactsError: balance without a contact.
    """

    contacts: Contacts
    prior: GaussianPrior | None = None
    hand: HandGeometry | None = None
    untouched: HandGeometry | None = None
    balance: ForceBalance | None = None
    friction: float | None = None
    patches: Sequence[Patch] = ()
    outlier_probability: float = 0.02
    planes: Sequence[PlaneContact] = ()
    doubt: ContactDoubt = USUAL

    def __post_init__(self) -> None:
        for name, (kind, called) in _KINDS.items():
            value = getattr(self, name)
            if not isinstance(value, kind) and (value is not None or name == "contacts"):
                raise InvalidInputError(f"{name} must be a {called}, not {kind_name(type(value))}.")
        if self.friction is not None:
            object.__setattr__(
                self, "friction", positive_number("friction", self.friction, allow_zero=True, most=MOST_FRICTION)
            )
        outlier_probability = positive_number(
            "outlier_probability", self.outlier_probability, allow_zero=True, most=MOST_OUTLIERS
        )
        object.__setattr__(self, "outlier_probability", outlier_probability)
        for name in ("balance", "friction"):
            if getattr(self, name) is not None and self.contacts.f_PC is None:
                raise InvalidInputError(f"contacts must have forces f_PC for the {name}, not None.")
        if self.balance is not None and not len(self.contacts):
            raise TooFewContactsError("contacts must be at least 1 for the balance, not 0.")
        for name, kind in _SEQUENCES.items():
            values = getattr(self, name)
            if not isinstance(values, Sequence):
                raise InvalidInputError(f"{name} must be a sequence of {kind.__name__}, not {kind_name(type(values))}.")
            object.__setattr__(self, name, tuple(values))
            for i, value in enumerate(values):
                instance_of(f"{name}[{i}]", value, kind)

    def rounded(self) -> "Evidence":
        """The evidence with positions rounded to a nanometre and directions to a nanoradian.

        Descents among many minima can diverge over a difference in the last digit. Rounding makes the answer
        independent of smaller differences.
        """
        return self.with_parts(self.contacts.rounded(), None if self.prior is None else self.prior.rounded())

    def with_parts(self, contacts: Contacts, prior: GaussianPrior | None) -> "Evidence":
        """The evidence with another prior, and other contacts of the same number and with the same arrays."""
        return copied(self, contacts=contacts, prior=prior)

    @property
    def tells_position(self) -> bool:
        """Whether a prior tells the position; otherwise the object is where it is touched."""
        return self.prior is not None and self.prior.tells_position

    @property
    def felt(self) -> tuple[Patch, ...]:
        """The patches of the pads that feel the object."""
        return tuple(patch for patch in self.patches if patch.is_felt)

    @functools.cached_property
    def touch(self) -> Contacts:
        """Contacts and patches as contacts: what poses are proposed from."""
        return with_patches(self.contacts, self.patches)
