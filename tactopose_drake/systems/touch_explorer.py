"""The execution of exploratory touches with free fingers, as a system."""

import dataclasses

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, EventStatus, State

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.hand_geometry import HandGeometry
from tactopose_drake.core.grasping.finger_reach import ReachParams
from tactopose_drake.core.parameter_checks import check_numbers, params_of
from tactopose_drake.core.validation import FloatArray, instance_of
from tactopose_drake.hand.hand_config import HandConfig
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.hand.hand_joints import HandJoints
from tactopose_drake.hand.hand_reach import check_rest_positions, make_hand_reach, rest_posture
from tactopose_drake.systems.collectable_system import CollectableSystem
from tactopose_drake.systems.next_touch_chooser import GuardedMove
from tactopose_drake.systems.ports import eval_fingers, eval_input, eval_optional_input

_SWEPT = 0.002  # m between the recorded positions of a fingertip that has met nothing


@dataclasses.dataclass(kw_only=True, slots=True)
class TouchExplorerParams:
    """Times and limits of the motions."""

    period: float = 0.01  # s between two decisions
    speed: float = 0.8  # of the joint that moves farthest, rad/s; a faster finger would push the object away
    # Wait after the grasp and after each touch before a motion is asked for, s, so that the estimate is up to date.
    settle_time: float = 0.6
    touch_force: float = 0.25  # least force of a touch, N; less may be due to the fingertip's own acceleration
    press_time: float = 0.1  # how long this force must last before the contact is recorded, s
    most_lag: float = 0.05  # lag of a joint behind its command beyond which the finger is taken to be blocked, rad
    most_touches: int = 60  # number of touches after which the exploration ends

    def validate(self) -> None:
        """Raises InvalidInputError if a value is not positive."""
        check_numbers("TouchExplorerParams", self)


@dataclasses.dataclass(frozen=True, eq=False)
class Exploration:
    """The state of an exploration.

    Attributes:
        phase: see `TouchExplorer`.
        since: when the phase began, s.
        move: the current motion; None if there is none.
        share: commanded share of the motion's path, 0 to 1.
        way: the finger's measured joint positions along the path, each of shape (n,), rad.
        felt: contacts that were felt by exploring, in P.
        swept: spheres in which a fingertip has met nothing, centres and radii in P, shape (n, 4), m.
        touches: number of motions that have ended.
    """

    phase: str = "wait"
    since: float = 0.0
    move: GuardedMove | None = None
    share: float = 0.0
    way: tuple[FloatArray, ...] = ()
    felt: Contacts = dataclasses.field(default_factory=Contacts.empty)
    swept: FloatArray = dataclasses.field(default_factory=lambda: np.zeros((0, 4)))
    touches: int = 0


class TouchExplorer(CollectableSystem):
    """Executes guarded motions one after the other while the hand holds an object, and records what each has felt.

    .. pydrake_system::

        name: TouchExplorer
        input_ports:
        - holding
        - next_touch
        - contacts
        - fingers_in_contact
        - joint_positions
        output_ports:
        - rest_positions
        - touches
        - untouched
        - deciding
        - phase
        - count

    All inputs are read once a period. Touches are recorded in the palm frame, where they stay valid as long as the
    object does not move in the hand. When the hand lets go, or the clock goes back, they are deleted, a moving finger
    returns, and the system waits for the next grasp.

    - holding: shape (1,), above 0 while the hand holds the object.
    - next_touch: `GuardedMove` of a `NextTouchChooser`, or None. A motion that was chosen before it was asked for, or
      in the future, is ignored.
    - contacts: `Contacts` in P, with forces.
    - fingers_in_contact: tuple of the names of the fingers that make them.
    - joint_positions: measured positions of the hand's joints, shape (nq,), rad; a finger with a NaN returns.
    - rest_positions: desired positions of the hand's joints, shape (nq,), rad; for the port of that name of
      `GraspController`.
    - touches: `Contacts` in P: the current ones of the fingers that hold the object, and the recorded ones of the
      exploration. Their forces are not simultaneous, so they do not balance.
    - untouched: `HandGeometry` in P, the volume in which fingertips have met nothing; None if there is none.
    - deciding: shape (1,), 1 while it waits for `next_touch`.
    - phase: str, "wait" until the hand holds the object, then "settle", "decide", "reach", "press" and "return"; "done"
      after `most_touches`.
    - count: number of motions that have ended since the object was grasped, shape (1,).
    """

    def __init__(self, hand: HandConfig, params: TouchExplorerParams | None = None) -> None:
        """Builds the fingers' kinematics.

        Raises:
            InvalidInputError: if a parameter is out of its range, fewer than two of the hand's fingertips have a
                force-torque sensor, or the hand's joints are to rest beyond their limits.
        """
        super().__init__()
        instance_of("hand", hand, HandConfig)
        self._params = params_of(TouchExplorerParams, params)
        self._fingers = {name: part.geometry for name, part in make_hand_reach(hand, ReachParams()).fingers.items()}
        plant, parts = make_hand_plant(hand)
        check_rest_positions(plant, parts)
        joints = HandJoints.of(plant, parts)
        self._places = {name: joints.positions(hand.finger(name).joints) for name in self._fingers}
        self._q_rest = rest_posture(plant, parts)
        self._holding = self.DeclareVectorInputPort("holding", 1)
        self._next_touch = self.DeclareAbstractInputPort("next_touch", AbstractValue.Make(None))
        self._contacts = self.DeclareAbstractInputPort("contacts", AbstractValue.Make(Contacts.empty()))
        self._touching = self.DeclareAbstractInputPort("fingers_in_contact", AbstractValue.Make(()))
        self._positions = self.DeclareVectorInputPort("joint_positions", plant.num_positions())
        self._state = self.DeclareAbstractState(AbstractValue.Make(Exploration()))
        self.DeclarePeriodicUnrestrictedUpdateEvent(self._params.period, 0.0, self._update)
        ticket = self.abstract_state_ticket(self._state)
        self.declare_output("rest_positions", len(self._q_rest), self._rest_positions, {ticket})
        felt = {ticket, self._contacts.ticket(), self._touching.ticket()}
        self.declare_output("touches", None, self._touches, felt)
        self.declare_output("untouched", None, self._untouched, {ticket})
        self.declare_output("deciding", 1, lambda context: [float(self.state(context).phase == "decide")], {ticket})
        self.declare_output("phase", "", lambda context: self.state(context).phase, {ticket})
        self.declare_output("count", 1, lambda context: [float(self.state(context).touches)], {ticket})

    def state(self, context: Context) -> Exploration:
        """The state of the exploration in a context of this system."""
        state: Exploration = context.get_abstract_state(self._state).get_value()
        return state

    def _update(self, context: Context, state: State) -> EventStatus:
        before = self.state(context)
        step = {
            "wait": self._wait,
            "settle": self._settle,
            "decide": self._decide,
            "reach": self._reach,
            "press": self._press,
            "return": self._come_back,
        }
        is_held = self._holding.Eval(context)[0] > 0.0
        if before.phase != "wait" and (not is_held or context.get_time() < before.since):
            after = self._let_go(context, before)
        else:
            after = before if before.phase == "done" else step[before.phase](context, before)
        if after is not before:
            state.get_mutable_abstract_state(self._state).set_value(after)
        return EventStatus.Succeeded()

    def _let_go(self, context: Context, before: Exploration) -> Exploration:
        """Deletes the recorded touches; a finger that is moving returns first."""
        nothing = Exploration()
        if before.move is None:
            return nothing
        coming_back = dataclasses.replace(before, phase="return", felt=nothing.felt, swept=nothing.swept)
        return self._come_back(context, coming_back)

    def _wait(self, context: Context, before: Exploration) -> Exploration:
        if not self._holding.Eval(context)[0] > 0.0:
            return before
        return dataclasses.replace(before, phase="settle", since=context.get_time())

    def _settle(self, context: Context, before: Exploration) -> Exploration:
        if context.get_time() - before.since < self._params.settle_time:
            return before
        return dataclasses.replace(before, phase="decide", since=context.get_time())

    def _decide(self, context: Context, before: Exploration) -> Exploration:
        move = eval_optional_input(self._next_touch, context, GuardedMove)
        if move is None or not before.since <= move.time <= context.get_time():
            return before
        return dataclasses.replace(before, phase="reach", since=context.get_time(), move=move, share=0.0, way=())

    def _reach(self, context: Context, before: Exploration) -> Exploration:
        """Moves on until the fingertip feels the object, the finger is blocked or unknown, or the path ends."""
        assert before.move is not None
        time, move = context.get_time(), before.move
        if self._felt_row(context, move.finger) is not None:
            return dataclasses.replace(before, phase="press", since=time)
        q = np.asarray(self._positions.Eval(context))[self._places[move.finger]]
        is_near = np.abs(self._commanded(before) - q).max() <= self._params.most_lag  # False if q has a NaN
        if not is_near:
            return dataclasses.replace(before, phase="return", since=time)
        way = (*before.way, q)
        if before.share >= 1.0:
            return dataclasses.replace(before, phase="return", since=time, swept=self._with_swept(before, way))
        return dataclasses.replace(before, share=min(1.0, before.share + self._step(move)), way=way)

    def _press(self, context: Context, before: Exploration) -> Exploration:
        """Records what the fingertip feels once it has pressed long enough."""
        assert before.move is not None
        row = self._felt_row(context, before.move.finger)
        if row is None:
            return dataclasses.replace(before, phase="reach")
        if context.get_time() - before.since < self._params.press_time:
            return before
        felt = _joined(before.felt, eval_input(self._contacts, context, Contacts)[row])
        return dataclasses.replace(before, phase="return", since=context.get_time(), felt=felt)

    def _come_back(self, context: Context, before: Exploration) -> Exploration:
        assert before.move is not None
        if before.share > 0.0:
            return dataclasses.replace(before, share=max(0.0, before.share - self._step(before.move)))
        touches = before.touches + 1
        phase = "done" if touches >= self._params.most_touches else "settle"
        return dataclasses.replace(before, phase=phase, since=context.get_time(), move=None, touches=touches)

    def _felt_row(self, context: Context, finger: str) -> int | None:
        """The row of a finger's contact; None if it feels nothing, or too small a force."""
        contacts, fingers = eval_fingers(self._contacts, self._touching, context)
        if finger not in fingers:
            return None
        row: int = fingers.index(finger)
        is_firm = contacts.f_PC is not None and np.linalg.norm(contacts.f_PC[row]) >= self._params.touch_force
        return row if is_firm else None

    def _step(self, move: GuardedMove) -> float:
        """Share of a motion's path that is covered in a period."""
        farthest = float(np.abs(move.q_goal - move.q_start).max())
        return self._params.period * self._params.speed / max(farthest, 1e-6)

    def _commanded(self, state: Exploration) -> FloatArray:
        """Commanded positions of the moving finger's joints, shape (n,), rad."""
        assert state.move is not None
        return state.move.q_start + state.share * (state.move.q_goal - state.move.q_start)

    def _with_swept(self, before: Exploration, way: tuple[FloatArray, ...]) -> FloatArray:
        """The spheres in which fingertips have met nothing, including those along a path that has ended."""
        assert before.move is not None
        finger = self._fingers[before.move.finger]
        tips = finger.tip(np.array(way))
        gone = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(tips, axis=0), axis=1)))
        _, kept = np.unique(np.floor(gone / _SWEPT), return_index=True)
        spheres = np.column_stack([tips[kept], np.full(len(kept), finger.tip_radius)])
        return np.concatenate([before.swept, spheres])

    def _rest_positions(self, context: Context) -> FloatArray:
        state, q = self.state(context), self._q_rest.copy()
        if state.move is not None:
            q[self._places[state.move.finger]] = self._commanded(state)
        return q

    def _touches(self, context: Context) -> Contacts:
        state = self.state(context)
        contacts, fingers = eval_fingers(self._contacts, self._touching, context)
        moving = None if state.move is None else state.move.finger
        holding = np.array([i for i, name in enumerate(fingers) if name != moving], dtype=np.intp)
        return _joined(contacts[holding], state.felt)

    def _untouched(self, context: Context) -> HandGeometry | None:
        swept = self.state(context).swept
        return HandGeometry(swept[:, :3], swept[:, 3]) if len(swept) else None


def _joined(first: Contacts, second: Contacts) -> Contacts:
    """The contacts of both; either may be empty."""
    if not len(first) or not len(second):
        return second if not len(first) else first
    return first.joined(second)
