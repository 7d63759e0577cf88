"""What `belief_study.py` records at each instant, and its counts of them."""

import dataclasses
import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

Array = NDArray[np.float64]
DURATION, SETTLED = 1.5, 0.5  # s
RIGHT, WRONG = (0.010, 10.0), (0.020, 20.0)  # m, deg


@dataclasses.dataclass(frozen=True)
class Instant:
    """The outputs at one time; errors are [m, deg], without the part along the free directions.

    The open error is also without the directions that the touch determines no better than the tolerance of a right
    pose. Probabilities are those that the belief and the estimate give to right poses.
    """

    time: float
    fingers: tuple[str, ...]
    status: str
    belief_error: Array
    estimate_error: Array
    belief_open_error: Array
    estimate_is_sure: bool
    belief_probability: float
    estimate_probability: float

    @property
    def belief_is_right(self) -> bool:
        """Whether the belief's best pose is right."""
        return bool(np.all(self.belief_error < RIGHT))

    @property
    def estimate_is_right(self) -> bool:
        """Whether the estimate's best pose is right."""
        return bool(np.all(self.estimate_error < RIGHT))


class Counts(NamedTuple):
    """Counts of instants.

    Attributes:
        instants: all.
        wrong: those at which the belief's status is "ok" while it is wrong.
        settled: those from half a second after the last finger's first contact.
        settled_right: settled ones at which the belief is right.
        belief_probability, estimate_probability: sums over settled ones of the probability of right poses.
        counted: settled ones at which the estimate is right; the following are of these.
        right: those at which the belief is right.
        open_right: those at which it is right apart from the open directions.
        followed: those with a next instant.
        next_right: those at which the next estimate is right.
        sure: those at which the estimate's status is "ok".
        sure_right: those at which it is, and the belief is right.
    """

    instants: float = 0.0
    wrong: float = 0.0
    settled: float = 0.0
    settled_right: float = 0.0
    belief_probability: float = 0.0
    estimate_probability: float = 0.0
    counted: float = 0.0
    right: float = 0.0
    open_right: float = 0.0
    followed: float = 0.0
    next_right: float = 0.0
    sure: float = 0.0
    sure_right: float = 0.0

    def plus(self, more: "Counts") -> "Counts":
        """The sum of both."""
        return Counts(*(mine + its for mine, its in zip(self, more, strict=True)))


def counts(instants: list[Instant]) -> Counts:
    """Counts the instants of one grasp."""
    first: dict[str, float] = {}
    for instant in instants:
        for finger in instant.fingers:
            first.setdefault(finger, instant.time)
    begin = max(first.values(), default=DURATION) + SETTLED
    settled = [i for i in instants if i.time > begin]
    counted = [i for i in settled if i.estimate_is_right]
    right = [i for i in counted if i.belief_is_right]
    followed = [(now, then) for now, then in itertools.pairwise(settled) if now.estimate_is_right]
    return Counts(
        instants=len(instants),
        wrong=sum(i.status == "ok" and bool(np.any(i.belief_error > WRONG)) for i in instants),
        settled=len(settled),
        settled_right=sum(i.belief_is_right for i in settled),
        belief_probability=sum(i.belief_probability for i in settled),
        estimate_probability=sum(i.estimate_probability for i in settled),
        counted=len(counted),
        right=len(right),
        open_right=sum(bool(np.all(i.belief_open_error < RIGHT)) for i in counted),
        followed=len(followed),
        next_right=sum(then.estimate_is_right for _, then in followed),
        sure=sum(i.estimate_is_sure for i in counted),
        sure_right=sum(i.estimate_is_sure for i in right),
    )


def print_line(name: str, of: Counts) -> None:
    """Prints the counts as a sentence."""
    counted, settled = max(of.counted, 1.0), max(of.settled, 1.0)
    Console().print(
        f"{name}: the belief is right at {of.right / counted:.1%} of {of.counted:.0f} instants at which the estimate "
        f"is (the next estimate is at {of.next_right / max(of.followed, 1.0):.1%} of them), up to what the "
        f"touch knows no better than 10 mm at {of.open_right / counted:.1%}, and at "
        f"{of.sure_right / max(of.sure, 1.0):.1%} of {of.sure:.0f} at which the estimate is sure as well; of "
        f"{of.settled:.0f} settled instants the belief is right at {of.settled_right / settled:.1%}, the estimate at "
        f"{of.counted / settled:.1%}; they give {of.belief_probability / settled:.1%} and "
        f"{of.estimate_probability / settled:.1%} to poses that are; "
        f'"ok" while wrong at {of.wrong / of.instants:.2%} of {of.instants:.0f}'
    )
