"""What a touch says of which object it is of."""

import dataclasses
from collections.abc import Sequence
from typing import overload

from tactopose_drake.core.statuses import Status
from tactopose_drake.estimation.results import PoseEstimate


@dataclasses.dataclass(frozen=True, eq=False)
class Identity:
    """One object that the touch may be of.

    Attributes:
        name: the object's.
        index: its place among the objects that were given.
        rank: 1 for the most likely object; objects of equal shape share theirs.
        likelihood: its share among all objects, which sum to 1; objects of equal shape have the same.
        log_evidence: logarithm of the touch's likelihood over all poses of the object, up to a constant that all
            objects share (see `core.identification.model_evidence`); minus infinity where the index ruled it out.
        estimate: its pose; None where the index ruled the object out.
    """

    name: str
    index: int
    rank: int
    likelihood: float
    log_evidence: float
    estimate: PoseEstimate | None


@dataclasses.dataclass(frozen=True, eq=False)
class Identification(Sequence[Identity]):
    """The objects that one touch may be of, the most likely first: a sequence of `Identity`.

    Attributes:
        identities: by falling likelihood; never empty.
        status: "ok"; "ambiguous" when the first object has less than half of the likelihood, with its equals, or when
            there are fewer than three contacts, which leave whole families of poses; "no_solution" when no pose of the
            first object explains the touch.
        duration: s.
    """

    identities: tuple[Identity, ...]
    status: Status
    duration: float

    @overload
    def __getitem__(self, index: int) -> Identity: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Identity]: ...
    def __getitem__(self, index: int | slice) -> Identity | Sequence[Identity]:
        return self.identities[index]

    def __len__(self) -> int:
        return len(self.identities)

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
