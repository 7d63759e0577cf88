"""Reasons for which no grasp was found: counts of what was wrong with the poses that were tried."""

from collections import Counter, defaultdict
from dataclasses import dataclass, field

_MOST_REASONS = 3  # that a sentence lists for a finger


@dataclass(frozen=True, eq=False)
class Refusals:
    """Counts of what a search for grasps has rejected.

    Attributes:
        poses: number of the object's poses that were rejected, by the reason.
        touches: the same for each finger's touches, by the finger.
    """

    poses: Counter[str] = field(default_factory=Counter)
    touches: defaultdict[str, Counter[str]] = field(default_factory=lambda: defaultdict(Counter))

    def explanation(self) -> str:
        """The counts as sentences; for touches, only the most frequent reasons, each the first that applied."""
        parts = [f"of {self.poses.total()} poses: " + _listed(self.poses.most_common())]
        for finger, reasons in self.touches.items():
            most = [(reason, count) for reason, count in reasons.most_common(_MOST_REASONS) if count]
            if most:
                parts.append(f"of {reasons.total()} touches of {finger!r}: {_listed(most)}")
        return "; ".join(parts)


def _listed(counts: list[tuple[str, int]]) -> str:
    return ", ".join(f"{count} because {reason}" for reason, count in counts)
