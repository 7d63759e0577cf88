"""What a contact may be, and how often it is that: as told, of something else, displaced, or with another normal."""

import dataclasses
from typing import NamedTuple


class KindShares(NamedTuple):
    """The probabilities of what a contact is before the touch; their sum is 1.

    What is told of one that is `other` says nothing of the object, neither its point nor its normal.
    """

    as_told: float
    turned: float
    displaced: float
    other: float

    @property
    def false(self) -> float:
        """That it is not as told, in whatever way."""
        return self.turned + self.displaced + self.other

    def without_normals(self) -> "KindShares":
        """Those where no normal is measured: of a contact whose normal is any, all that is told is true."""
        return KindShares(self.as_told + self.turned, 0.0, self.displaced, self.other)


@dataclasses.dataclass(frozen=True, kw_only=True)
class ContactKinds:
    """How often a contact with the object is not as told, by how often one is of something else.

    The first has odds against being as told that are so many times those of the second against being of the object:
    a hand that often touches something else is in clutter, at edges, or badly calibrated.

    Attributes:
        turned: the odds that a contact has any normal, over those of something else.
        displaced: the odds that one is displaced, likewise.
        lost: the odds that one tells no more than one of something else, likewise: two touches taken for one, say.
    """

    turned: float = 1.0
    displaced: float = 6.0
    lost: float = 0.0

    def shares(self, outlier_probability: float) -> KindShares:
        """The probabilities of all kinds, by that of a contact with something else, from 0 to below 1."""
        p, q = outlier_probability, 1.0 - outlier_probability
        per_kind = q / (q + (self.turned + self.displaced + self.lost) * p)
        return KindShares(
            q * per_kind, self.turned * p * per_kind, self.displaced * p * per_kind, p + self.lost * p * per_kind
        )
