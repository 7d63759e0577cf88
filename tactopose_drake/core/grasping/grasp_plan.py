"""A planned grasp, the object's pose in the palm and the motion of each finger; or the reasons why none was found."""

from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field

from tactopose_drake.core.grasping.grasp_law import ClosingMotion
from tactopose_drake.core.validation import FloatArray

_MOST_REASONS = 3  # that a sentence lists for a finger


@dataclass(frozen=True, eq=False)
class FingerPlan:
    """What one finger is to do, and where it is meant to touch: point (3,), m, and object's normal (3,), in P."""

    motion: ClosingMotion
    p_PC: FloatArray
    n_PC: FloatArray


@dataclass(frozen=True, eq=False)
class GraspPlan:
    """An object's pose in the palm, and the fingers that touch it.

    Attributes:
        X_PO: shape (3, 4).
        fingers: by name; idle fingers are absent.
        score: larger is better.
        waiting: by name, actuated joint positions, shape (m,), rad or m, of idle fingers that must make way for the
            object.
    """

    X_PO: FloatArray
    fingers: Mapping[str, FingerPlan]
    score: float
    waiting: Mapping[str, FloatArray] = field(default_factory=dict)


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
