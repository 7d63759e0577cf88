"""Decides what arm and hand do to put a handed-over rod into a hole: the decision in figure 6.5 of the thesis.

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016, section 4.3.2.3.
"""

import dataclasses

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, EventStatus, State
from pydrake.trajectories import PiecewisePolynomial

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.grasping.held_axis import HeldAxis
from tactopose_drake.core.validation import FloatArray, positive_number
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.station.arms.place_planning import PlacePlanner
from tactopose_drake.systems.collectable_system import CollectableSystem
from tactopose_drake.systems.ports import eval_input, eval_optional_input

# Phases in which the hand is to be open.
_OPEN = ("open", "meet", "again", "release", "retreat", "done")


@dataclasses.dataclass(kw_only=True, slots=True)
class PlaceTaskParams:
    """Times and limits of the task."""

    period: float = 0.02  # s between two decisions
    # To get a grip in which every finger carries its share and the rod lies where the hand holds it best.
    tries: int = 5
    most_misplaced: float = 0.006  # of the lower end from there, across the rod, m
    # From the hand's hold, and again from the rod being let go, to the look at the estimate, s.
    settle_time: float = 0.5
    patience: float = 2.0  # how long an estimate that is good enough is waited for, s
    most_sigma: float = 0.005  # standard deviation of the rod's lower end across its axis, m
    # Of the lower end in the palm while it is carried, beyond three standard deviations of the estimates, m.
    most_drift: float = 0.005
    most_offset: float = 0.003  # of the lower end above the hole, by the estimate then; else the arm aligns it anew, m
    alignments: int = 2  # of that at the most
    open_time: float = 1.5  # for the fingers to open, s

    def validate(self) -> None:
        """Raises InvalidInputError if a value is not positive."""
        for field in dataclasses.fields(self):
            positive_number(f"PlaceTaskParams.{field.name}", getattr(self, field.name))


@dataclasses.dataclass(frozen=True, eq=False)
class TaskState:
    """Where the task stands.

    Attributes:
        phase: see `PlaceTask`.
        since: when it began, s.
        q: the arm's positions at its end, or all along it if there is no motion, shape (nq,), rad.
        motion: of the arm, from `since` on.
        held: the rod's axis by which the motions were planned.
        ahead: the motions that follow: the insertion, the retreat; or the one to meet the rod.
        tried: how many grips were given up.
        aligned: how often the rod was aligned anew above the hole.
    """

    phase: str
    since: float
    q: FloatArray
    motion: PiecewisePolynomial | None = None
    held: HeldAxis | None = None
    ahead: tuple[PiecewisePolynomial, ...] = ()
    tried: int = 0
    aligned: int = 0


class PlaceTask(CollectableSystem):
    """Waits until a rod is held, feels where it is, and has the arm put it into a hole.

    .. pydrake_system::

        name: PlaceTask
        input_ports:
        - holding
        - grasp_status
        - contacts
        - hypotheses
        - joint_positions
        output_ports:
        - arm_reference
        - open
        - phase

    All inputs are read once a period.

    - holding: shape (1,), above 0 once the hand holds something.
    - grasp_status: str, "holding" where every finger carries its share; the `status` of `GraspController`.
    - contacts: `Contacts` in P.
    - hypotheses: `PoseEstimate` of X_PO, or None while there is none.
    - joint_positions: of the hand, shape (nq,), rad.
    - arm_reference: positions, then velocities of the arm's joints, shape (2 na,), rad and rad/s.
    - open: shape (1,), 1 where the hand is to open.
    - phase: str, "receive", "touch", "open", "meet", "again", "feel", "move", "insert", "release", "retreat" and
      "done"; or "failed: " and why, from when on the arm stays where it is and the hand holds on.

    Whoever hands over holds on until "feel". Before, the rod's place is felt ("touch"); where it does not lie in the
    hand as it should, the hand opens ("open"), the arm brings it to where it does ("meet"), and it closes once more.
    Where a grip tells too little for that, or is not firm although the rod lies well, the hand opens too ("again"), and
    the rod is to be offered anew.
    """

    def __init__(self, planner: PlacePlanner, q_receive: FloatArray, params: PlaceTaskParams | None = None) -> None:
        """Keeps a reference to the planner.

        Args:
            planner: knows arm, hand, rod and hole.
            q_receive: where the arm waits for the rod, shape (na,), rad.
            params: times and limits.
        """
        super().__init__()
        self._params = PlaceTaskParams() if params is None else params
        self._params.validate()
        self._planner = planner
        q = np.array(q_receive, dtype=np.float64)
        self._holding = self.DeclareVectorInputPort("holding", 1)
        self._grasp_status = self.DeclareAbstractInputPort("grasp_status", AbstractValue.Make(""))
        self._contacts = self.DeclareAbstractInputPort("contacts", AbstractValue.Make(Contacts.empty()))
        self._hypotheses = self.DeclareAbstractInputPort("hypotheses", AbstractValue.Make(None))
        self._positions = self.DeclareVectorInputPort("joint_positions", planner.num_hand_positions)
        self._state = self.DeclareAbstractState(AbstractValue.Make(TaskState("receive", 0.0, q)))
        self.DeclarePeriodicUnrestrictedUpdateEvent(self._params.period, 0.0, self._update)
        ticket = self.abstract_state_ticket(self._state)
        self.DeclareVectorOutputPort(
            "arm_reference", 2 * len(q), self._calc_reference, prerequisites_of_calc={ticket, self.time_ticket()}
        )
        self.DeclareVectorOutputPort("open", 1, self._calc_open, prerequisites_of_calc={ticket})
        self.DeclareAbstractOutputPort(
            "phase", lambda: AbstractValue.Make(""), self._calc_phase, prerequisites_of_calc={ticket}
        )

    @property
    def planner(self) -> PlacePlanner:
        """What knows arm, hand, rod and hole."""
        return self._planner

    def state(self, context: Context) -> TaskState:
        """Where the task stands in a context of this system."""
        state: TaskState = context.get_abstract_state(self._state).get_value()
        return state

    def _update(self, context: Context, state: State) -> EventStatus:
        before = self.state(context)
        decide = {
            "receive": self._receive,
            "touch": self._touch,
            "again": self._again,
            "feel": self._feel,
        }.get(before.phase, self._go_on)
        after = before if before.phase == "done" or before.phase.startswith("failed") else decide(context, before)
        if after is not before:
            state.get_mutable_abstract_state(self._state).set_value(after)
        return EventStatus.Succeeded()

    def _receive(self, context: Context, before: TaskState) -> TaskState:
        if self._holding.Eval(context)[0] <= 0.0:
            return before
        return dataclasses.replace(before, phase="touch", since=context.get_time())

    def _touch(self, context: Context, before: TaskState) -> TaskState:
        """Decides, while the rod is still held by whoever hands it over, whether the grip is good."""
        time = context.get_time()
        if time - before.since < self._params.settle_time:
            return before
        held, status = self._held(context), eval_input(self._grasp_status, context, str)
        misplacement = np.inf if held is None else self._planner.misplacement(held)
        if misplacement <= self._params.most_misplaced and status == "holding":
            return dataclasses.replace(before, phase="feel", since=time)
        if before.tried + 1 >= self._params.tries:
            reason = status
            if status == "holding":
                where = f"the rod's end is {1e3 * misplacement:.0f} mm off its place"
                reason = "nothing is felt in the hand" if held is None else where
            return self._fail(context, before, f"no good grip in {self._params.tries} tries: {reason}")
        after = dataclasses.replace(before, phase="again", since=time, tried=before.tried + 1)
        # By an estimate that is less exact than the rod is misplaced, the hand gets nearer to it.
        if held is not None and max(held.sigma, self._params.most_misplaced) < misplacement:
            meet = self._planner.meet(before.q, self._positions.Eval(context), held)
            if meet is not None:
                return dataclasses.replace(after, phase="open", ahead=(meet,))
        return after

    def _again(self, context: Context, before: TaskState) -> TaskState:
        if context.get_time() - before.since < self._params.open_time:
            return before
        return dataclasses.replace(before, phase="receive", since=context.get_time())

    def _feel(self, context: Context, before: TaskState) -> TaskState:
        """Waits for an estimate that tells the rod's lower end well enough, then plans."""
        waited = context.get_time() - before.since
        if waited < self._params.settle_time:
            return before
        held = self._held(context)
        if held is not None and held.sigma <= self._params.most_sigma:
            positions = self._positions.Eval(context)
            plan = self._planner.plan(before.q, positions, held)
            if plan is None:
                return self._fail(context, before, "the arm cannot reach the hole")
            move, insert, retreat = plan
            return TaskState("move", context.get_time(), _end(move), move, held, (insert, retreat))
        if waited < self._params.patience:
            return before
        if held is None:
            return self._fail(context, before, "nothing is felt in the hand")
        return self._fail(context, before, f"ambiguous: the rod's end is known to {1e3 * held.sigma:.1f} mm only")

    def _go_on(self, context: Context, before: TaskState) -> TaskState:
        """Follows the motions; stops where the rod has moved in the hand."""
        time, passed = context.get_time(), context.get_time() - before.since
        if before.phase in ("open", "release"):
            if passed < self._params.open_time:
                return before
            following, motion = "meet" if before.phase == "open" else "retreat", before.ahead[0]
            return TaskState(following, time, _end(motion), motion, tried=before.tried)
        assert before.motion is not None
        if before.phase in ("move", "insert"):
            lost = self._lost(context, before)
            if lost:
                return self._fail(context, before, f"the rod moved in the hand during {before.phase!r}: {lost}")
        if passed < before.motion.end_time():
            return before
        if before.phase == "move":
            aligned = self._align(context, before)
            if aligned is not None:
                return aligned
            insert, retreat = before.ahead
            return TaskState("insert", time, _end(insert), insert, before.held, (retreat,))
        if before.phase in ("meet", "insert"):
            following = "receive" if before.phase == "meet" else "release"
            return dataclasses.replace(before, phase=following, since=time, motion=None)
        return dataclasses.replace(before, phase="done", since=time, motion=None)

    def _align(self, context: Context, before: TaskState) -> TaskState | None:
        """Above the hole: a motion to where the rod has slipped to on the way; None where it is well aligned."""
        held = self._held(context)
        if held is None or held.sigma > self._params.most_sigma or before.aligned >= self._params.alignments:
            return None
        assert before.held is not None
        if self._planner.end_distance(held, before.held) <= self._params.most_offset:
            return None
        plan = self._planner.plan(before.q, self._positions.Eval(context), held)
        if plan is None:
            return None
        move, insert, retreat = plan
        time, aligned = context.get_time(), before.aligned + 1
        return TaskState("move", time, _end(move), move, held, (insert, retreat), aligned=aligned)

    def _held(self, context: Context) -> HeldAxis | None:
        estimate = eval_optional_input(self._hypotheses, context, PoseEstimate)
        contacts = eval_input(self._contacts, context, Contacts)
        return None if estimate is None or len(contacts) < 2 else self._planner.held_axis(estimate, contacts)

    def _lost(self, context: Context, before: TaskState) -> str:
        """What is wrong with the hold; empty while the rod's lower end is where it was."""
        assert before.held is not None
        held = self._held(context)
        if held is None:
            return "it is no longer felt"
        drift = self._planner.end_distance(held, before.held)
        allowed = self._params.most_drift + 3.0 * float(np.hypot(held.sigma, before.held.sigma))
        return f"its end by {1e3 * drift:.0f} mm" if drift > allowed else ""

    def _fail(self, context: Context, before: TaskState, reason: str) -> TaskState:
        q = self._reference(context)[0]
        return TaskState(f"failed: {reason}", context.get_time(), q, held=before.held)

    def _reference(self, context: Context) -> tuple[FloatArray, FloatArray]:
        state = self.state(context)
        if state.motion is None:
            return state.q, np.zeros_like(state.q)
        time = min(context.get_time() - state.since, state.motion.end_time())
        return state.motion.value(time)[:, 0], state.motion.EvalDerivative(time, 1)[:, 0]

    def _calc_reference(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(np.concatenate(self._reference(context)))

    def _calc_open(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector([float(self.state(context).phase in _OPEN)])

    def _calc_phase(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self.state(context).phase)


def _end(motion: PiecewisePolynomial) -> FloatArray:
    q: FloatArray = motion.value(motion.end_time())[:, 0]
    return q
