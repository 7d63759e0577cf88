"""Why no grasp was found: what was wrong with the poses that were looked at, counted."""

from collections import Counter, defaultdict
from dataclasses import dataclass, field

_MOST_REASONS = 3  # that a sentence tells of a finger


@dataclass(frozen=True, eq=False)
class Refusals:
    """What a search for grasps has refused.

    Attributes:
        poses: how many of the object's poses were refused, by the reason.
        touches: likewise of each finger's touches, by the finger.
    """

    poses: Counter[str] = field(default_factory=Counter)
    touches: defaultdict[str, Counter[str]] = field(default_factory=lambda: defaultdict(Counter))

    def explanation(self) -> str:
        """The counts as sentences; of touches the most frequent reasons, which are what was wrong with them first."""
        parts = [f"of {self.poses.total()} poses: " + _listed(self.poses.most_common())]
        for finger, reasons in self.touches.items():
            most = [(reason, count) for reason, count in reasons.most_common(_MOST_REASONS) if count]
            if most:
                parts.append(f"of {reasons.total()} touches of {finger!r}: {_listed(most)}")
        return "; ".join(parts)


def _listed(counts: list[tuple[str, int]]) -> str:
    return ", ".join(f"{count} because {reason}" for reason, count in counts)
