"""What is doubted of contacts: what each may be beside as told, how often, and whether all noise is as told."""

import dataclasses
import math
from typing import NamedTuple

import numpy as np

# The odds that one of three contacts or fewer is the false one, over those of one of five or more.
_ODDS_AMONG_THREE = 0.1


class KindShares(NamedTuple):
    """The probabilities of what a contact is before the touch; their sum is 1.

    What is told of one that is `other` or `lost` says nothing of the object, neither its point nor its normal.
    """

    as_told: float
    flipped: float
    turned: float
    displaced: float
    other: float
    lost: float

    @property
    def false(self) -> float:
        """That it is not as told, in whatever way."""
        return self.flipped + self.turned + self.displaced + self.other + self.lost

    def without_normals(self) -> "KindShares":
        """Those where no normal is measured: of a contact whose normal is another, all that is told is true."""
        return KindShares(self.as_told + self.flipped + self.turned, 0.0, 0.0, self.displaced, self.other, self.lost)


@dataclasses.dataclass(frozen=True, kw_only=True)
class ContactKinds:
    """How often a contact with the object is not as told, by how often one is of something else.

    The first has odds against being as told that are so many times those of the second against being of the object:
    a hand that often touches something else is in clutter, at edges, or badly calibrated.

    Attributes:
        flipped: the odds that a contact's normal shows the other way, over those of something else.
        turned: the odds that one has any normal, likewise.
        displaced: the odds that one is displaced, likewise.
        lost: the odds that one tells no more than one of something else, likewise: two touches taken for one, say.
    """

    flipped: float = 0.0
    turned: float = 1.0
    displaced: float = 6.0
    lost: float = 0.0

    def shares(self, outlier_probability: float) -> KindShares:
        """The probabilities of all kinds, by that of a contact with something else, from 0 to below 1."""
        p, q = outlier_probability, 1.0 - outlier_probability
        per_kind = q / (q + (self.flipped + self.turned + self.displaced + self.lost) * p)
        each = p * per_kind
        return KindShares(
            q * per_kind, self.flipped * each, self.turned * each, self.displaced * each, p, self.lost * each
        )

    def among(self, count: int) -> "ContactKinds":
        """Of the false one of so many: of five, four are left to judge it; three, of which two are, tell too little."""
        share = float(np.interp(count, (3, 5), (_ODDS_AMONG_THREE, 1.0)))
        return ContactKinds(
            flipped=share * self.flipped,
            turned=share * self.turned,
            displaced=share * self.displaced,
            lost=share * self.lost,
        )


@dataclasses.dataclass(frozen=True, kw_only=True)
class ContactDoubt:
    """What is doubted of contacts.

    Each is false by itself as `kinds` say. Beside that one of them at the most, whichever, is so as `of_one` says: a
    sceptic, who asks of each whether it is the false one, does not take two or three of five for false.

    Attributes:
        surroundings: a contact with something else is anywhere within so much of the object, m.
        displacement: standard deviation of how far a displaced contact is off, along each axis, m.
        most_noise: with more noise than this of points, m, and of normals, rad, no contact is likelier to be lost: one
            that is would, among so much noise, be about as likely as one that is as told.
        kinds: how often a contact is not as told otherwise, by how often it is of something else.
        of_one: how often, by the same, the one is not as told, where others judge it: see `ContactKinds.among`; None
            where there is no such doubt.
        doublings: how often the variance of points and that of normals may be twice what is told, and the probability
            of that before the touch. That it is as told is the most probable: data sheets are. Errors of joints, of the
            fingertips' mounting and of the mesh, which no data sheet tells, move points more than they turn normals.
        reached: the exact density is known up to this energy; see `SurfaceDensity`.
    """

    surroundings: float = 0.025
    displacement: float = 0.015
    most_noise: tuple[float, float] = (0.001, math.radians(5.0))
    kinds: ContactKinds = dataclasses.field(default_factory=ContactKinds)
    of_one: ContactKinds | None = None
    doublings: tuple[tuple[int, int, float], ...] = (
        (0, 0, 0.56),
        (1, 0, 0.10),
        (2, 0, 0.08),
        (3, 0, 0.05),
        (4, 0, 0.03),
        (1, 1, 0.07),
        (2, 2, 0.06),
        (3, 3, 0.03),
        (4, 4, 0.02),
    )
    reached: float = 6.5


USUAL = ContactDoubt()
"""That of a good hand."""

SCEPTICAL = ContactDoubt(
    of_one=ContactKinds(flipped=3.0, turned=4.5, displaced=21.0, lost=375.0),
    doublings=(
        (0, 0, 0.15),
        (1, 0, 0.17),
        (2, 0, 0.14),
        (3, 0, 0.10),
        (4, 0, 0.07),
        (1, 1, 0.14),
        (2, 2, 0.11),
        (3, 3, 0.07),
        (4, 4, 0.05),
    ),
)
"""That of an estimate of one touch, which somebody is to act on.

The odds are those with which five contacts, one of them false, lead to no more wrong certainty than is stated, and are
far above how often contacts are false: a touch without a false one is then believed as much, for all its contacts
agree, and one with a false one is not. Who takes them for rarer is sure and wrong where one is, and hardly
surer where none is. Likewise the noise may well be up to four times what is told: where it is not, contacts that agree
say so themselves. But so all objects explain a touch better, which tells them apart less well; and a belief
over time sees for itself what lasts.
"""
