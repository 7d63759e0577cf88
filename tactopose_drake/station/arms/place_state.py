"""Where the task of handing over and placing stands, and its times and limits."""

import dataclasses
from typing import Any

from pydrake.trajectories import PiecewisePolynomial

from tactopose_drake.core.grasping.held_axis import HeldAxis
from tactopose_drake.core.parameter_checks import check_numbers
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.station.arms.table_touch import TableTouch


@dataclasses.dataclass(kw_only=True, slots=True)
class PlaceTaskParams:
    """Times and limits of the task."""

    period: float = 0.02  # s between two decisions
    # To get a grip in which every finger carries its share and the rod lies where the hand holds it best.
    tries: int = 5
    most_misplaced: float = 0.005  # of the lower end from there, across the rod, m
    # From the hand's hold, from the rod being let go, and from each touch of the table, to the look at the estimate, s.
    settle_time: float = 0.5
    patience: float = 2.0  # how long an estimate that is good enough is waited for, s
    most_sigma: float = 0.005  # standard deviation of the rod's lower end across its axis, m
    # The table is touched until the rod's lower end is known along its axis, and which one it is.
    most_sigma_end: float = 0.002  # m
    sure: float = 0.98  # probability of the end
    touches: int = 8  # of the table at the most
    pause: float = 0.2  # over the table, until what the arm's halt has shaken is at rest, s
    touch_force: float = 0.1  # on the rod by which the table is felt, N
    # Standard deviation of the rod's lowest point over the table then, m: a rod's edge sinks in by 0.2 mm less than
    # `PlaceParams.table_give`, and its point by as much more, and within a period the arm goes down by 0.4 mm.
    sigma_touch: float = 0.00025
    # By what else than the fingertips' motion each further touch moves the rod in the hand, standard deviation, m: it
    # creeps and rolls on them as it is held and pressed, and mostly on in the direction in which it has begun.
    sigma_moved: float = 0.0003
    # Of the lower end in the palm while it is carried, beyond three standard deviations of the estimates, m.
    most_drift: float = 0.005
    most_offset: float = 0.003  # of the lower end above the hole, by the estimate then; else the arm aligns it anew, m
    alignments: int = 2  # of that at the most
    open_time: float = 1.5  # for the fingers to open, s

    def validate(self) -> None:
        """Raises InvalidInputError if a value is not positive, or the probability above 1."""
        check_numbers("PlaceTaskParams", self, most={"sure": 1.0})

    def is_known(self, held: HeldAxis) -> bool:
        """Whether the table need not be asked any more about a rod's lower end."""
        return held.sigma_end <= self.most_sigma_end and max(held.same_way, 1.0 - held.same_way) >= self.sure


@dataclasses.dataclass(frozen=True, eq=False)
class TaskState:
    """Where the task stands.

    Attributes:
        phase: see `PlaceTask`.
        since: when it began, s.
        q: the arm's positions at its end, or all along it if there is no motion, shape (nq,), rad.
        motion: of the arm, from `since` on.
        held: the rod's axis by which the motions were planned.
        ahead: the motions that follow: the insertion, the retreat; or the one down to the table, or to meet the rod.
        tried: how many grips were given up.
        aligned: how often the rod was aligned anew above the hole.
        touches: of the table by the rod.
        above: positions of the arm over the table, shape (nq,), rad, to which the rod is lifted once it has touched it.
        carried: force of the rod on the hand, upwards, while nothing else touches it, N.
    """

    phase: str
    since: float
    q: FloatArray
    motion: PiecewisePolynomial | None = None
    held: HeldAxis | None = None
    ahead: tuple[PiecewisePolynomial, ...] = ()
    tried: int = 0
    aligned: int = 0
    touches: tuple[TableTouch, ...] = ()
    above: FloatArray | None = None
    carried: float = 0.0

    def __deepcopy__(self, memo: Any) -> "TaskState":
        """Itself: nothing in it changes, and a simulator copies all state with each event."""
        return self

    def to(self, phase: str, time: float, motion: PiecewisePolynomial | None = None) -> "TaskState":
        """The next phase, from a time on, with the arm following a motion or resting where it is."""
        q = self.q if motion is None else motion.value(motion.end_time())[:, 0]
        return dataclasses.replace(self, phase=phase, since=time, q=q, motion=motion)

    def reference(self, time: float) -> tuple[FloatArray, FloatArray]:
        """Positions and velocities of the arm at a time, shape (nq,) each, rad and rad/s."""
        if self.motion is None:
            return self.q, 0.0 * self.q
        time = min(time - self.since, self.motion.end_time())
        return self.motion.value(time)[:, 0], self.motion.EvalDerivative(time, 1)[:, 0]
