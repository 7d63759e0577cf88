"""All that the belief is told at one time."""

import dataclasses
from collections.abc import Mapping, Sequence

from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.tracking.pose_measurement import PoseMeasurement
from tactopose_drake.core.validation import LATEST, FloatArray, instance_of, limited, pose_matrix
from tactopose_drake.errors import InvalidInputError

_FASTEST = 1e4  # rad/s and m/s


@dataclasses.dataclass(frozen=True, eq=False)
class Frame:
    """What is sensed at one time.

    Attributes:
        time: s.
        evidence: the touch, and what else is known at this time. A prior in it starts a belief that has no pose yet.
        sources: what made each row of `evidence.touch` (a finger, a pad), as the same contact is known by at other
            times; by default the rows' numbers.
        tip_velocity: spatial velocity of each source in P, by source, shape (6,): [w, v], rad/s, and m/s of its point
            at the origin of P. None where fingers are not known to move: the object then moves with the palm.
        vision: the latest pose from vision, however late; None where there is none.
        X_WP: pose of the palm in the world, shape (3, 4), where an object rests that nothing touches; None where it is
            not known: that object then stays where it is in the palm, about.

    Raises:
        InvalidInputError: sources that are not as many as the contacts, or twice the same; a velocity of another shape.
    """

    time: float
    evidence: Evidence
    sources: tuple[str, ...] | None = None
    tip_velocity: Mapping[str, FloatArray] | None = None
    vision: PoseMeasurement | None = None
    X_WP: FloatArray | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "time", float(limited("time", self.time, (), most=LATEST)))
        instance_of("evidence", self.evidence, Evidence)
        if self.vision is not None:
            instance_of("vision", self.vision, PoseMeasurement)
        if self.sources is not None:
            instance_of("sources", self.sources, Sequence)
        count = len(self.evidence.touch)
        sources = tuple(map(str, range(count) if self.sources is None else self.sources))
        if len(sources) != count or len(set(sources)) < count:
            raise InvalidInputError(
                f"sources: are {sources}; allowed are {count} different names, one for each contact."
            )
        object.__setattr__(self, "sources", sources)
        if self.X_WP is not None:
            object.__setattr__(self, "X_WP", pose_matrix("X_WP", self.X_WP))
        if self.tip_velocity is not None:
            instance_of("tip_velocity", self.tip_velocity, Mapping)
            velocities = {
                name: limited(f"tip_velocity[{name}]", velocity, (6,), most=_FASTEST)
                for name, velocity in self.tip_velocity.items()
            }
            object.__setattr__(self, "tip_velocity", velocities)
