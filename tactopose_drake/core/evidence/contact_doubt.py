"""Prior probabilities of how contacts are false, and of how much their noise exceeds what is told."""

import dataclasses
import math
from typing import NamedTuple

import numpy as np

# Factor of the odds that a contact is false, when it is one of three or fewer instead of five or more.
_ODDS_AMONG_THREE = 0.1


class KindShares(NamedTuple):
    """Prior probabilities of what a contact is; they sum to 1.

    The point and normal of one that is `other` or `lost` carry no information on the object.
    """

    as_told: float
    flipped: float
    turned: float
    displaced: float
    other: float
    lost: float

    @property
    def false(self) -> float:
        """The probability that it is not as told, in whatever way."""
        return self.flipped + self.turned + self.displaced + self.other + self.lost

    def without_normals(self) -> "KindShares":
        """The probabilities if no normals are measured: contacts that differ only in the normal are then as told."""
        return KindShares(self.as_told + self.flipped + self.turned, 0.0, 0.0, self.displaced, self.other, self.lost)


@dataclasses.dataclass(frozen=True, kw_only=True)
class ContactKinds:
    """How often a contact with the object is false, relative to how often one is with something else.

    Each rate multiplies the odds that a contact is with something else; the product is the odds of this kind of error
    against being as told. A hand that often touches something else is in clutter, at edges, or badly calibrated.

    Attributes:
        flipped: rate of contacts whose normal is reversed.
        turned: rate of contacts with an arbitrary normal.
        displaced: rate of contacts that are displaced.
        lost: rate of contacts that carry no information, such as two touches taken for one.
    """

    flipped: float = 0.0
    turned: float = 1.0
    displaced: float = 6.0
    lost: float = 0.0

    def shares(self, outlier_probability: float) -> KindShares:
        """The probabilities of all kinds, given that of a contact with something else, from 0 to below 1."""
        p, q = outlier_probability, 1.0 - outlier_probability
        per_kind = q / (q + (self.flipped + self.turned + self.displaced + self.lost) * p)
        each = p * per_kind
        return KindShares(
            q * per_kind, self.flipped * each, self.turned * each, self.displaced * each, p, self.lost * each
        )

    def among(self, count: int) -> "ContactKinds":
        """The rates for the one false contact of `count`: of five, four are left to contradict it, of three too few."""
        share = float(np.interp(count, (3, 5), (_ODDS_AMONG_THREE, 1.0)))
        return ContactKinds(
            flipped=share * self.flipped,
            turned=share * self.turned,
            displaced=share * self.displaced,
            lost=share * self.lost,
        )


@dataclasses.dataclass(frozen=True, kw_only=True)
class ContactDoubt:
    """The model of false contacts and of uncertain noise.

    Contacts are independently false with the rates `kinds`. In addition at most one of them, whichever, is false with
    the rates `of_one`: this sceptical model considers each contact as the false one, but not two or three of five.

    Attributes:
        surroundings: distance from the object within which a contact with something else may be, m.
        displacement: standard deviation of a displaced contact's offset, along each axis, m.
        most_noise: noise of points, m, and of normals, rad, beyond which the density of lost contacts does not grow
            any more: with so much noise, a contact as told would be about as likely.
        kinds: rates of false contacts, relative to contacts with something else.
        of_one: rates of the single false contact, where others contradict it, see `ContactKinds.among`; None without
            this doubt.
        doublings: numbers of doublings of the variance of points and of that of normals, with the prior probability of
            each pair. No doubling is the most probable, as data sheets are right. Errors of joints, of the fingertips'
            mounting and of the mesh, which no data sheet tells, affect points more than normals.
        reached: energy up to which the exact density is used; see `SurfaceDensity`.
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
"""The model of a good hand."""

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
"""The model for an estimate from one touch that is to be acted on.

The odds are those for which five contacts, one of them false, lead to no more false certainty than is stated. They far
exceed the actual rate of false contacts: a touch without one is believed as much, as all its contacts agree, and one
with a false contact is not. Lower odds are confidently wrong in the latter case, and hardly surer in the former.
Likewise the noise may well be up to four times what is told; if it is not, contacts that agree show it. But with this
model all objects explain a touch better, which makes them harder to tell apart; and a belief over time estimates by
itself what lasts.
"""
