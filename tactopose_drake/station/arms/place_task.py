"""Task logic of arm and hand to put a handed-over rod into a hole: the decision in figure 6.5 of the thesis.

The fingertips' forces on the rod sum to its weight; once the rod touches the table, they carry less.

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016, section 4.3.2.3.
"""

import dataclasses

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, EventStatus, State

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.plane_contact import PlaneContact
from tactopose_drake.core.grasping.held_axis import HeldAxis
from tactopose_drake.core.parameter_checks import params_of
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.station.arms.place_planning import PlacePlanner
from tactopose_drake.station.arms.place_state import PlaceTaskParams, TaskState
from tactopose_drake.station.arms.table_touch import TableTouch, forces_on_hand, rise_of_force, touched_planes
from tactopose_drake.systems.collectable_system import CollectableSystem
from tactopose_drake.systems.ports import eval_fingers, eval_input, eval_optional_input

# Phases in which the hand is to be open.
_OPEN = ("open", "meet", "again", "release", "retreat", "done")


class PlaceTask(CollectableSystem):
    """Waits until a rod is held, estimates its pose by touch, and has the arm put it into a hole.

    .. pydrake_system::

        name: PlaceTask
        input_ports:
        - holding
        - grasp_status
        - contacts
        - fingers_in_contact
        - hypotheses
        - joint_positions
        - palm_pose
        output_ports:
        - arm_reference
        - open
        - planes
        - phase

    All inputs are read once a period.

    - holding: shape (1,), above 0 once the hand holds something.
    - grasp_status: str, "holding" if every finger carries its share; the `status` of `GraspController`.
    - contacts: `Contacts` in P, with forces.
    - fingers_in_contact: tuple of the fingers' names, in the order of the contacts.
    - hypotheses: `PoseEstimate` of X_PO, or None while there is none.
    - joint_positions: positions of the hand's joints, shape (nq,), rad.
    - palm_pose: `RigidTransform` X_WP.
    - arm_reference: positions, then velocities of the arm's joints, shape (2 na,), rad and rad/s.
    - open: shape (1,), 1 if the hand is to open.
    - planes: tuple of `PlaneContact` in P: the table at each touch by the held rod, moved with the rod as the
      fingertips have moved since; empty after the release.
    - phase: str, "receive", "touch", "open", "meet", "again", "feel", "approach", "lower", "lift", "move", "insert",
      "release", "retreat" and "done"; or "failed: " and why, after which the arm stays and the hand keeps its grip.

    The giver holds the rod until "feel". Before that, the rod's pose is estimated ("touch"). If the rod is not at the
    best grip, the hand opens ("open"), the arm moves it to where the rod is ("meet"), and it closes again. If the grip
    does not tell enough for that, or is not firm although the rod is well placed, the hand opens ("again"), and the
    rod must be offered again.

    The hand alone cannot tell how far the rod has slid along its axis, nor which of its ends is up. So the arm moves it
    over the table ("approach"), lowers it ("lower") until the force on it shows a touch, lifts it ("lift"), and
    estimates again with the new plane; with another lean each time, until both are known.
    """

    def __init__(self, planner: PlacePlanner, q_receive: FloatArray, params: PlaceTaskParams | None = None) -> None:
        """Keeps a reference to the planner.

        Args:
            planner: plans the motions of arm and hand.
            q_receive: positions in which the arm waits for the rod, shape (na,), rad.
            params: times and limits.
        """
        super().__init__()
        self._params = params_of(PlaceTaskParams, params)
        self._planner = planner
        q = np.array(q_receive, dtype=np.float64)
        self._holding = self.DeclareVectorInputPort("holding", 1)
        self._grasp_status = self.DeclareAbstractInputPort("grasp_status", AbstractValue.Make(""))
        self._contacts = self.DeclareAbstractInputPort("contacts", AbstractValue.Make(Contacts.empty()))
        self._fingers = self.DeclareAbstractInputPort("fingers_in_contact", AbstractValue.Make(()))
        self._hypotheses = self.DeclareAbstractInputPort("hypotheses", AbstractValue.Make(None))
        self._positions = self.DeclareVectorInputPort("joint_positions", planner.num_hand_positions)
        self._palm_pose = self.DeclareAbstractInputPort("palm_pose", AbstractValue.Make(RigidTransform()))
        self._state = self.DeclareAbstractState(AbstractValue.Make(TaskState("receive", 0.0, q)))
        self.DeclarePeriodicUnrestrictedUpdateEvent(self._params.period, 0.0, self._update)
        ticket = self.abstract_state_ticket(self._state)
        self.declare_output("arm_reference", 2 * len(q), self._arm_reference, {ticket, self.time_ticket()})
        self.declare_output("open", 1, lambda context: [float(self.state(context).phase in _OPEN)], {ticket})
        self.declare_output("planes", (), self._planes, {ticket, self._positions.ticket()})
        self.declare_output("phase", "", lambda context: self.state(context).phase, {ticket})

    @property
    def planner(self) -> PlacePlanner:
        """The planner of the motions."""
        return self._planner

    def state(self, context: Context) -> TaskState:
        """The state of the task in a context of this system."""
        state: TaskState = context.get_abstract_state(self._state).get_value()
        return state

    def _update(self, context: Context, state: State) -> EventStatus:
        before = self.state(context)
        decide = {
            "receive": self._receive,
            "touch": self._touch,
            "again": self._again,
            "feel": self._feel,
            "lower": self._lower,
        }.get(before.phase, self._go_on)
        after = before if before.phase == "done" or before.phase.startswith("failed") else decide(context, before)
        if after is not before:
            state.get_mutable_abstract_state(self._state).set_value(after)
        return EventStatus.Succeeded()

    def _receive(self, context: Context, before: TaskState) -> TaskState:
        return before.to("touch", context.get_time()) if self._holding.Eval(context)[0] > 0.0 else before

    def _touch(self, context: Context, before: TaskState) -> TaskState:
        """Decides whether the grip is good, while the giver still holds the rod."""
        time = context.get_time()
        if time - before.since < self._params.settle_time:
            return before
        held, status = self._held(context), eval_input(self._grasp_status, context, str)
        misplacement = np.inf if held is None else self._planner.misplacement(held)
        if misplacement <= self._params.most_misplaced and status == "holding":
            return before.to("feel", time)
        if before.tried + 1 >= self._params.tries:
            felt = "nothing is felt in the hand"
            if held is not None:
                felt = f"the rod's end is {1e3 * misplacement:.0f} mm off its place"
            reason = felt if status == "holding" else status
            return self._fail(context, before, f"no good grip in {self._params.tries} tries: {reason}")
        after = dataclasses.replace(before.to("again", time), tried=before.tried + 1)
        # Meeting the rod helps only if the estimate is more exact than the misplacement.
        explained = self._explained(context)
        if explained is not None and max(explained.sigma, self._params.most_misplaced) < misplacement:
            meet = self._planner.meet(before.q, self._positions.Eval(context), explained)
            if meet is not None:
                return dataclasses.replace(after, phase="open", ahead=(meet,))
        return after

    def _again(self, context: Context, before: TaskState) -> TaskState:
        time = context.get_time()
        return before if time - before.since < self._params.open_time else before.to("receive", time)

    def _feel(self, context: Context, before: TaskState) -> TaskState:
        """Waits for an estimate that determines the rod's axis well enough, then plans."""
        waited = context.get_time() - before.since
        if waited < self._params.settle_time:
            return before
        held = self._explained(context)
        if held is not None and held.sigma <= self._params.most_sigma:
            if not self._params.is_known(held) and len(before.touches) < self._params.touches:
                return self._set_upon_table(context, before, held)
            if held.sigma_end <= self._params.most_sigma_end:
                planned = self._to_hole(context, before, held)
                return planned or self._fail(context, before, "the arm cannot reach the hole")
        if waited < self._params.patience:
            return before
        if held is None:
            is_felt = self._held(context) is not None
            reason = "no pose of the rod explains the touch" if is_felt else "nothing is felt in the hand"
            return self._fail(context, before, reason)
        deviations = f"{1e3 * held.sigma:.1f} mm across and {1e3 * held.sigma_end:.1f} mm along it only"
        return self._fail(context, before, f"ambiguous: the rod's end is known to {deviations}")

    def _set_upon_table(self, context: Context, before: TaskState, held: HeldAxis) -> TaskState:
        estimate = eval_input(self._hypotheses, context, PoseEstimate)
        planned = self._planner.touch_table(before.q, self._positions.Eval(context), held, estimate)
        if planned is None:
            return self._fail(context, before, "the arm cannot reach the table")
        move, down, above = planned
        after = before.to("approach", context.get_time(), move)
        return dataclasses.replace(after, held=held, ahead=(down,), above=above)

    def _to_hole(self, context: Context, before: TaskState, held: HeldAxis) -> TaskState | None:
        planned = self._planner.plan(before.q, self._positions.Eval(context), held)
        if planned is None:
            return None
        move, insert, retreat = planned
        return dataclasses.replace(before.to("move", context.get_time(), move), held=held, ahead=(insert, retreat))

    def _lower(self, context: Context, before: TaskState) -> TaskState:
        """Lowers the rod until the table is felt, then lifts it."""
        time = context.get_time()
        lost = self._lost(context, before)
        if lost:
            return self._fail(context, before, f"the rod moved in the hand on the table: {lost}")
        if rise_of_force(before.carried, self._pressed(context)) >= self._params.touch_force:
            assert before.above is not None
            up = self._planner.lift(before.reference(time)[0], before.above)
            return dataclasses.replace(before.to("lift", time, up), touches=(*before.touches, self._table(context)))
        assert before.motion is not None
        if time - before.since < before.motion.end_time():
            return before
        return self._fail(context, before, "the rod does not reach the table")

    def _pressed(self, context: Context) -> dict[str, float]:
        """The upward force of the rod on each finger, N."""
        X_WP = eval_input(self._palm_pose, context, RigidTransform)
        contacts, fingers = eval_fingers(self._contacts, self._fingers, context)
        return forces_on_hand(contacts, fingers, X_WP.rotation().matrix()[2])

    def _table(self, context: Context) -> TableTouch:
        """The touch of the table at this instant."""
        X_PW = eval_input(self._palm_pose, context, RigidTransform).inverse()
        p_PQ, n_P = X_PW.multiply(self._planner.p_WTouch), X_PW.rotation().col(2)
        contacts, fingers = eval_fingers(self._contacts, self._fingers, context)
        X_PS = self._planner.fingertips(self._positions.Eval(context))
        return TableTouch(PlaneContact(p_PQ, n_P, self._params.sigma_touch), contacts, fingers, X_PS)

    def _go_on(self, context: Context, before: TaskState) -> TaskState:
        """Follows the motions; fails if the rod moves in the hand."""
        time, passed = context.get_time(), context.get_time() - before.since
        if before.phase in ("open", "release"):
            if passed < self._params.open_time:
                return before
            after = before.to("meet" if before.phase == "open" else "retreat", time, before.ahead[0])
            return dataclasses.replace(after, ahead=())
        assert before.motion is not None
        if before.phase in ("approach", "lift", "move", "insert"):
            lost = self._lost(context, before)
            if lost:
                return self._fail(context, before, f"the rod moved in the hand during {before.phase!r}: {lost}")
        pause = self._params.pause if before.phase == "approach" else 0.0
        if passed < before.motion.end_time() + pause:
            return before
        if before.phase == "move":
            return self._align(context, before) or self._next(before, "insert", time)
        if before.phase == "approach":
            return dataclasses.replace(self._next(before, "lower", time), carried=self._pressed(context))
        if before.phase == "insert":
            return dataclasses.replace(before.to("release", time), touches=())
        return before.to({"meet": "receive", "lift": "feel", "retreat": "done"}[before.phase], time)

    def _next(self, before: TaskState, phase: str, time: float) -> TaskState:
        """Starts the next of the planned motions."""
        motion, *ahead = before.ahead
        return dataclasses.replace(before.to(phase, time, motion), ahead=tuple(ahead))

    def _align(self, context: Context, before: TaskState) -> TaskState | None:
        """Plans again above the hole if the rod is known to have slipped on the way; None if it is well aligned."""
        held = self._explained(context)
        if held is None or held.sigma > self._params.most_sigma or before.aligned >= self._params.alignments:
            return None
        assert before.held is not None
        if self._planner.end_distance(held, before.held) <= self._params.most_offset:
            return None
        planned = self._to_hole(context, before, held)
        return None if planned is None else dataclasses.replace(planned, aligned=before.aligned + 1)

    def _held(self, context: Context) -> HeldAxis | None:
        estimate = eval_optional_input(self._hypotheses, context, PoseEstimate)
        contacts = eval_input(self._contacts, context, Contacts)
        return None if estimate is None or len(contacts) < 2 else self._planner.held_axis(estimate, contacts)

    def _explained(self, context: Context) -> HeldAxis | None:
        """The same from which motions may be planned: None if no hypothesis explains the touch."""
        estimate = eval_optional_input(self._hypotheses, context, PoseEstimate)
        return None if estimate is None or estimate.status == "no_solution" else self._held(context)

    def _lost(self, context: Context, before: TaskState) -> str:
        """Why the hold is lost; empty while the rod's lower end is where it was."""
        assert before.held is not None
        held = self._held(context)
        if held is None:
            return "it is no longer felt"
        drift = self._planner.end_distance(held, before.held)
        allowed = self._params.most_drift + 3.0 * float(np.hypot(held.sigma, before.held.sigma))
        return f"its end by {1e3 * drift:.0f} mm" if drift > allowed else ""

    def _fail(self, context: Context, before: TaskState, reason: str) -> TaskState:
        time = context.get_time()
        q, _ = before.reference(time)
        return TaskState(f"failed: {reason}", time, q, held=before.held)

    def _arm_reference(self, context: Context) -> FloatArray:
        return np.concatenate(self.state(context).reference(context.get_time()))

    def _planes(self, context: Context) -> tuple[PlaneContact, ...]:
        touches = self.state(context).touches
        X_PS = self._planner.fingertips(self._positions.Eval(context)) if touches else {}
        return touched_planes(touches, X_PS, self._params.sigma_moved)
