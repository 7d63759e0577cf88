"""The choice of the next exploratory touch, as a system."""

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, EventStatus, State

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.hand_geometry import HandGeometry
from tactopose_drake.core.exploration.chance_touch import choose_by_chance
from tactopose_drake.core.exploration.guarded_moves import GuardedMoves
from tactopose_drake.core.exploration.next_touch import Hold, TouchCriterion, choose_touch
from tactopose_drake.core.exploration.tolerance import Tolerance, resolved_share
from tactopose_drake.core.grasping.finger_geometry import FingerGeometry
from tactopose_drake.core.grasping.finger_reach import ReachParams
from tactopose_drake.core.grasping.finger_sides import sides
from tactopose_drake.core.parameter_checks import params_of
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import (
    MOST_FRICTION,
    FloatArray,
    instance_of,
    known_name,
    positive_number,
    whole_number,
)
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.hand.hand_config import HandConfig
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.hand.hand_joints import HandJoints
from tactopose_drake.hand.hand_reach import make_hand_reach
from tactopose_drake.hand.reading_ranges import ReadingRanges
from tactopose_drake.systems.collectable_system import CollectableSystem
from tactopose_drake.systems.ports import eval_fingers, eval_optional_input

_RULES = ("information", "chance")


@dataclasses.dataclass(kw_only=True, slots=True)
class NextTouchParams:
    """How and how often the next touch is chosen."""

    period: float = 0.1  # s between two choices
    rule: str = "information"  # or "chance": any motion that meets the object at the most probable pose
    moves: int = 300  # candidate motions of each finger, to random postures within its joints' limits
    places: int = 40  # postures that are checked along each motion
    same_translation: float = 0.010  # poses closer than this, in both respects, count as the same, m
    same_rotation_deg: float = 15.0  # likewise, deg
    enough: float = 0.95  # probability of one pose from which on no touch is needed
    friction: float = 0.6  # coefficient between fingertips and object
    seed: int = 0  # of the candidate motions

    def validate(self) -> None:
        """Raises InvalidInputError if a number is out of its range, or there is no such rule."""
        for name in ("period", "same_translation", "same_rotation_deg"):
            positive_number(f"NextTouchParams.{name}", getattr(self, name))
        positive_number("NextTouchParams.enough", self.enough, most=1.0)
        positive_number("NextTouchParams.friction", self.friction, allow_zero=True, most=MOST_FRICTION)
        whole_number("NextTouchParams.moves", self.moves, least=1)
        whole_number("NextTouchParams.places", self.places, least=2)
        whole_number("NextTouchParams.seed", self.seed, least=0)
        known_name("NextTouchParams.rule", self.rule, _RULES)

    @property
    def tolerance(self) -> Tolerance:
        """The tolerance within which poses count as the same."""
        return Tolerance(translation=self.same_translation, rotation=math.radians(self.same_rotation_deg))


@dataclasses.dataclass(frozen=True, eq=False)
class GuardedMove:
    """A motion of one finger, straight in joint space, that ends where the fingertip meets the object.

    Attributes:
        finger: name of the finger.
        joints: names of the finger's actuated joints.
        q_start: their positions at the start, shape (n,), rad.
        q_goal: their positions at the end if nothing stops them, shape (n,), rad.
        information: expected reduction of the belief's entropy by the touch, nats.
        entropy: the belief's entropy before the touch, nats.
        time: when the motion was chosen, s.
    """

    finger: str
    joints: tuple[str, ...]
    q_start: FloatArray
    q_goal: FloatArray
    information: float
    entropy: float
    time: float


class NextTouchChooser(CollectableSystem):
    """Chooses the guarded motion of a free finger with the largest expected information on the held object's pose.

    .. pydrake_system::

        name: NextTouchChooser
        input_ports:
        - hypotheses
        - hypotheses_status
        - contacts
        - fingers_in_contact
        - joint_positions
        - deciding
        output_ports:
        - next_touch
        - resolved
        - status

    Inputs are read, and outputs change, at each period in which a motion is asked for. Only fingers that do not touch
    the object move. Each candidate motion starts at the finger's current posture and avoids the other fingers; of the
    moving finger only the fingertip may touch the object.

    - hypotheses: `PoseEstimate` of an estimate or a belief, X_PO, or None while there is none.
    - hypotheses_status: str, the status of the `PoseEstimator` that gives them. While it starts with "held", they are
      those of an earlier touch, possibly of another grasp, and count as no estimate. May stay unconnected.
    - contacts: `Contacts` in P of the fingers that hold the object.
    - fingers_in_contact: tuple of their names.
    - joint_positions: of the hand, in the order of a plant of the hand alone, shape (nq,), rad.
    - deciding: shape (1,), above 0 while a motion is asked for; if unconnected, a motion is always asked for.
    - next_touch: `GuardedMove`; None if no touch is needed, no motion is allowed, or a joint position is unknown.
    - resolved: the probability that the object is within the tolerance of one pose, shape (1,); 0 while there is no
      estimate of the current touch, or none that explains it.
    - status: str, "chosen", "resolved" if that probability is at least `enough`, or "held: " and why there is no
      choice.
    """

    def __init__(self, hand: HandConfig, model: ObjectModel, params: NextTouchParams | None = None) -> None:
        """Builds the fingers' kinematics; keeps a reference to the model.

        Raises:
            InvalidInputError: if a parameter is out of its range, or fewer than two of the hand's fingertips have a
                force-torque sensor.
        """
        super().__init__()
        instance_of("hand", hand, HandConfig)
        instance_of("model", model, ObjectModel)
        self._params = params_of(NextTouchParams, params)
        self._criterion = TouchCriterion(tolerance=self._params.tolerance)
        self._model = model
        reach = make_hand_reach(hand, ReachParams())
        self._fingers: Mapping[str, FingerGeometry] = {name: part.geometry for name, part in reach.fingers.items()}
        plant, parts = make_hand_plant(hand)
        joints, self._ranges = HandJoints.of(plant, parts), ReadingRanges.of(plant)
        self._joints = {name: tuple(hand.finger(name).joints) for name in self._fingers}
        self._places = {name: joints.positions(names) for name, names in self._joints.items()}
        self._hypotheses = self.DeclareAbstractInputPort("hypotheses", AbstractValue.Make(None))
        self._of_hypotheses = self.DeclareAbstractInputPort("hypotheses_status", AbstractValue.Make(""))
        self._contacts = self.DeclareAbstractInputPort("contacts", AbstractValue.Make(Contacts.empty()))
        self._holding = self.DeclareAbstractInputPort("fingers_in_contact", AbstractValue.Make(()))
        self._positions = self.DeclareVectorInputPort("joint_positions", plant.num_positions())
        self._deciding = self.DeclareVectorInputPort("deciding", 1)
        self._touch = self.DeclareAbstractState(AbstractValue.Make(None))
        self._status = self.DeclareAbstractState(AbstractValue.Make("held: no estimate yet"))
        self._share = self.DeclareDiscreteState([0.0])
        self.DeclarePeriodicUnrestrictedUpdateEvent(self._params.period, 0.0, self._update)
        self.DeclareStateOutputPort("next_touch", self._touch)
        self.DeclareStateOutputPort("resolved", self._share)
        self.DeclareStateOutputPort("status", self._status)

    def _update(self, context: Context, state: State) -> EventStatus:
        if self._deciding.HasValue(context) and self._deciding.Eval(context)[0] <= 0.0:
            return EventStatus.Succeeded()
        touch, share, status = None, 0.0, "held: no estimate yet"
        estimate = eval_optional_input(self._hypotheses, context, PoseEstimate)
        told = eval_optional_input(self._of_hypotheses, context, str) or ""
        if told.startswith("held"):
            status = told
        elif estimate is not None and estimate.status == "no_solution":
            status = "held: no pose explains the touch"
        elif estimate is not None:
            share = resolved_share(self._model, estimate.modes, self._criterion.tolerance)
            if share >= self._params.enough:
                status = "resolved"
            else:
                touch, status = self._choose(context, estimate.modes)
        state.get_mutable_discrete_state(self._share).set_value([share])
        state.get_mutable_abstract_state(self._touch).set_value(touch)
        state.get_mutable_abstract_state(self._status).set_value(status)
        return EventStatus.Succeeded()

    def _choose(self, context: Context, belief: GaussianMixture) -> tuple[GuardedMove | None, str]:
        """The motion, and the status that says why there may be none."""
        q = self._positions.Eval(context)
        if not self._ranges.told(q).all():
            return None, "held: a joint position is not known"
        contacts, fingers = eval_fingers(self._contacts, self._holding, context)
        hold = Hold(contacts, fingers, self._params.friction)
        generator = np.random.default_rng([self._params.seed, round(context.get_time() / self._params.period)])
        goals = {
            name: generator.uniform(
                finger.chain.lower, finger.chain.upper, (self._params.moves, len(self._places[name]))
            )
            for name, finger in self._fingers.items()
            if name not in fingers
        }
        start = {name: q[self._places[name]] for name in self._fingers}
        moves = {
            name: GuardedMoves.of_finger(self._fingers[name], start[name], q_goal, self._params.places)
            for name, q_goal in goals.items()
        }
        others = {name: self._rest_of_hand(name, start) for name in moves}
        given = self._model, hold, belief, moves
        if self._params.rule == "chance":
            found = choose_by_chance(*given, generator, others=others, criterion=self._criterion)
        else:
            found = choose_touch(*given, others=others, criterion=self._criterion)
        if found is None:
            return None, "held: no motion is allowed"
        finger = found.finger
        motion = self._joints[finger], start[finger], goals[finger][found.move]
        return GuardedMove(finger, *motion, found.information, found.entropy, context.get_time()), "chosen"

    def _rest_of_hand(self, finger: str, q: Mapping[str, FloatArray]) -> HandGeometry:
        """The last two links and the tips of the other fingers, at joint positions q."""
        others = [sides(other, q[name][None]) for name, other in self._fingers.items() if name != finger]
        return HandGeometry(np.concatenate([p[0] for p, _ in others]), np.concatenate([r for _, r in others]))
