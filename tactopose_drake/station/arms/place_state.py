"""The state and the parameters of the task of taking and placing a rod."""

import dataclasses
from collections.abc import Mapping

from pydrake.trajectories import PiecewisePolynomial

from tactopose_drake.core.grasping.held_axis import HeldAxis
from tactopose_drake.core.parameter_checks import check_numbers
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.station.arms.table_touch import TableTouch
from tactopose_drake.systems.collectable_system import SharedState


@dataclasses.dataclass(kw_only=True, slots=True)
class PlaceTaskParams:
    """Times and limits of the task."""

    period: float = 0.02  # s between two decisions
    # Attempts at a grip in which every finger carries its share and the rod is at the best grip.
    tries: int = 5
    most_misplaced: float = 0.005  # largest distance of the lower end from the best grip, across the rod, m
    # Wait after the grasp, after the rod is released by the giver, and after each touch of the table, s.
    settle_time: float = 0.5
    patience: float = 2.0  # longest wait for an estimate that is good enough, s
    most_sigma: float = 0.005  # largest standard deviation of the rod's lower end across its axis, m
    # The table is touched until the rod's lower end is known along its axis, and which of its ends it is.
    most_sigma_end: float = 0.002  # largest standard deviation along the axis, m
    sure: float = 0.98  # least probability of the end
    touches: int = 8  # largest number of touches of the table
    pause: float = 0.2  # wait above the table until vibrations have decayed, s
    touch_force: float = 0.1  # force on the rod from which the table counts as touched, N
    # Standard deviation of the rod's lowest point over the table at a touch, m: a rod's edge sinks in by 0.2 mm less
    # than `PlaceParams.table_give`, its point by 0.2 mm more, and the arm descends by 0.4 mm within a period.
    sigma_touch: float = 0.00025
    # Standard deviation of the rod's motion in the hand by each further touch, beyond the fingertips' motion, m: it
    # creeps and rolls on them, mostly in the same direction each time.
    sigma_moved: float = 0.0003
    # Largest motion of the lower end in the palm while carried, beyond three standard deviations of the estimates, m.
    most_drift: float = 0.005
    most_offset: float = 0.003  # largest offset of the lower end above the hole, before the arm aligns it again, m
    alignments: int = 2  # largest number of such alignments
    open_time: float = 1.5  # for the fingers to open, s

    def validate(self) -> None:
        """Raises InvalidInputError if a value is not positive, or the probability above 1."""
        check_numbers("PlaceTaskParams", self, most={"sure": 1.0})

    def is_known(self, held: HeldAxis) -> bool:
        """Whether a rod's lower end is known well enough, so that no further touch of the table is needed."""
        return held.sigma_end <= self.most_sigma_end and max(held.same_way, 1.0 - held.same_way) >= self.sure


@dataclasses.dataclass(frozen=True, eq=False)
class TaskState(SharedState):
    """The state of the task.

    Attributes:
        phase: see `PlaceTask`.
        since: when the phase began, s.
        q: the arm's positions at the end of the phase, or throughout it if there is no motion, shape (nq,), rad.
        motion: the arm's motion, starting at `since`; None: it stays.
        held: the rod's axis with which the motions were planned.
        ahead: the next motions: insertion and retreat; or the one down to the table, or to meet the rod.
        tried: number of grips that were given up.
        aligned: how often the rod was aligned again above the hole.
        touches: touches of the table by the rod so far.
        above: positions of the arm over the table, shape (nq,), rad, to which the rod is lifted after a touch.
        carried: upward force of the rod on each finger while nothing else touches it, N, by finger.
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
    carried: Mapping[str, float] = dataclasses.field(default_factory=dict)

    def to(self, phase: str, time: float, motion: PiecewisePolynomial | None = None) -> "TaskState":
        """The state at the start of the next phase, with the arm following a motion or staying where it is."""
        q = self.q if motion is None else motion.value(motion.end_time())[:, 0]
        return dataclasses.replace(self, phase=phase, since=time, q=q, motion=motion)

    def reference(self, time: float) -> tuple[FloatArray, FloatArray]:
        """Positions and velocities of the arm at a time, shape (nq,) each, rad and rad/s."""
        if self.motion is None:
            return self.q, 0.0 * self.q
        time = min(time - self.since, self.motion.end_time())
        return self.motion.value(time)[:, 0], self.motion.EvalDerivative(time, 1)[:, 0]
