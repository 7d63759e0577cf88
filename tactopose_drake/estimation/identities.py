"""What a touch says of which object it is of."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any, Self, overload

from tactopose_drake.core.plain_values import PlainValue
from tactopose_drake.core.statuses import Status
from tactopose_drake.core.validation import shown, whole_number
from tactopose_drake.estimation.plain_data import (
    Readers,
    number_or,
    read_amount,
    read_fields,
    read_parts,
    read_share,
    read_status,
)
from tactopose_drake.estimation.results import PoseEstimate

_OF_IDENTITY: Readers = {
    "index": lambda name, value: whole_number(name, value, least=0),
    "rank": lambda name, value: whole_number(name, value, least=1),
    "likelihood": read_share,
    "probability": read_share,
    "log_evidence": number_or(-math.inf),
    "estimate": lambda name, value: None if value is None else PoseEstimate.from_dict(value),
}
_OF_IDENTIFICATION: Readers = {"status": read_status, "duration": read_amount, "unknown": read_share}


@dataclasses.dataclass(frozen=True, eq=False)
class Identity(PlainValue):
    """One object that the touch may be of.

    Attributes:
        name: the object's.
        index: its place among the objects that were given.
        rank: 1 for the most likely object; objects of equal shape share theirs.
        likelihood: its share among all known objects, which sum to 1; objects of equal shape have the same.
        probability: that the touched object is this one: the likelihood, times the probability that it is a known one.
        log_evidence: logarithm of the touch's likelihood over all poses of the object, up to a constant that all
            objects share (see `core.identification.model_evidence`); minus infinity where the index ruled it out.
        estimate: its pose; None where the index ruled the object out.
    """

    name: str
    index: int
    rank: int
    likelihood: float
    probability: float
    log_evidence: float
    estimate: PoseEstimate | None

    def __repr__(self) -> str:
        return f"<Identity {self.rank}: {shown(self.name)} {self.probability:.1%}>"

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """What `to_dict` has made it of, to the last bit.

        Raises:
            InvalidInputError: for an unknown or missing name, or a value that cannot be one.
        """
        return super().from_dict(read_fields(cls, data, _OF_IDENTITY))


@dataclasses.dataclass(frozen=True, eq=False)
class Identification(PlainValue, Sequence[Identity]):
    """The objects that one touch may be of, the most likely first: a sequence of `Identity`.

    Attributes:
        identities: by falling likelihood; never empty.
        status: "ok"; "ambiguous" when the first object has a probability below 90 %, with its equals, or when there are
            fewer than three contacts, which leave whole families of poses; "no_solution" when no pose of the first
            object explains the touch, or when the touch is of none of the objects with 90 % or more.
        duration: s.
        unknown: the probability that the touched object is none of the known ones; with those of the objects it sums
            to 1.
    """

    identities: tuple[Identity, ...]
    status: Status
    duration: float = dataclasses.field(compare=False)
    unknown: float

    @overload
    def __getitem__(self, index: int) -> Identity: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Identity]: ...
    def __getitem__(self, index: int | slice) -> Identity | Sequence[Identity]:
        return self.identities[index]

    def __len__(self) -> int:
        return len(self.identities)

    def __repr__(self) -> str:
        many = "1 object" if len(self) == 1 else f"{len(self)} objects"
        return (
            f"<Identification {self.status!r}: {many} in {1e3 * self.duration:.1f} ms, best {self.best!r}, "
            f"unknown {self.unknown:.1%}>"
        )

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """What `to_dict` has made it of, to the last bit.

        Raises:
            InvalidInputError: for an unknown or missing name, or a value that cannot be one.
        """
        given = read_fields(cls, data, _OF_IDENTIFICATION)
        given["identities"] = read_parts(cls, "identities", given.get("identities", ()), Identity)
        return super().from_dict(given)

    @property
    def best(self) -> Identity:
        """The most likely object; of several that are equal, one."""
        return self.identities[0]

    @property
    def ties(self) -> tuple[tuple[Identity, ...], ...]:
        """The objects of equal shape, which no touch tells apart; those without an equal are in none."""
        by_rank: dict[int, list[Identity]] = {}
        for identity in self.identities:
            by_rank.setdefault(identity.rank, []).append(identity)
        return tuple(tuple(group) for group in by_rank.values() if len(group) > 1)
