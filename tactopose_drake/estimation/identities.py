"""The results of identification."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any, Self, overload

from tactopose_drake.core.plain_values import PlainValue, counted
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
    """One candidate for the touched object.

    Attributes:
        name: name of the object.
        index: its index among the objects that were given.
        rank: 1 for the most likely object; objects of equal shape share a rank.
        likelihood: its likelihood relative to all known objects; these sum to 1, and objects of equal shape have the
            same.
        probability: probability that the touched object is this one: the likelihood times the probability that it is a
            known object.
        log_evidence: logarithm of the marginal likelihood over all poses of the object, up to a constant that all
            objects share (see `core.identification.model_evidence`); minus infinity if the index ruled it out.
        estimate: its pose; None if the index ruled the object out.
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
        """Restores the value that `to_dict` converted, to the last bit.

        Raises:
            InvalidInputError: for an unknown or missing name, or an invalid value.
        """
        return super().from_dict(read_fields(cls, data, _OF_IDENTITY))


@dataclasses.dataclass(frozen=True, eq=False)
class Identification(PlainValue, Sequence[Identity]):
    """The candidates for one touched object, the most likely first: a sequence of `Identity`.

    Attributes:
        identities: the candidates by falling likelihood; never empty.
        status: "ok"; "ambiguous" if the first object and those of equal shape together have a probability below 90 %,
            or if there are fewer than three contacts, which leave whole families of poses; "no_solution" if no pose of
            the first object explains the touch, or if `unknown` is 90 % or more.
        duration: computing time, s.
        unknown: probability that the touched object is none of the known ones; it sums to 1 with the objects'
            probabilities.
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
        many = counted(len(self), "object", "objects")
        return (
            f"<Identification {self.status!r}: {many} in {1e3 * self.duration:.1f} ms, best {self.best!r}, "
            f"unknown {self.unknown:.1%}>"
        )

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Restores the value that `to_dict` converted, to the last bit.

        Raises:
            InvalidInputError: for an unknown or missing name, or an invalid value.
        """
        given = read_fields(cls, data, _OF_IDENTIFICATION)
        given["identities"] = read_parts(cls, "identities", given.get("identities", ()), Identity)
        return super().from_dict(given)

    @property
    def best(self) -> Identity:
        """The most likely object; one of them if several have the same shape."""
        return self.identities[0]

    @property
    def ties(self) -> tuple[tuple[Identity, ...], ...]:
        """Groups of objects of equal shape, which no touch distinguishes; objects of a unique shape are in no group."""
        by_rank: dict[int, list[Identity]] = {}
        for identity in self.identities:
            by_rank.setdefault(identity.rank, []).append(identity)
        return tuple(tuple(group) for group in by_rank.values() if len(group) > 1)
