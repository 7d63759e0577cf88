"""A grasp controller: closes the fingers until each carries its set force, then holds."""

import dataclasses
import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context, DiscreteValues, EventStatus

from tactopose_drake.core.grasping.grasp_law import (
    ClosingMotion,
    GraspLaw,
    commanded_positions,
    joint_torques,
    update_push,
)
from tactopose_drake.core.parameter_checks import check_numbers, params_of
from tactopose_drake.core.validation import FloatArray, known_name
from tactopose_drake.hand.hand_in_plant import Hand
from tactopose_drake.hand.hand_joints import HandJoints, joint_arms
from tactopose_drake.systems.collectable_system import CollectableSystem


@dataclasses.dataclass(kw_only=True, slots=True)
class GraspControllerParams:
    """Gains and times of the grasp controller."""

    finger_stiffness: float = 5.0  # of each finger joint, N m/rad; for a prismatic joint, 5 cm count as a radian
    finger_damping: float = 0.02  # N m s/rad
    other_stiffness: float = 300.0  # of the wrist and all other joints that are not part of a finger, N m/rad
    other_damping: float = 0.5  # N m s/rad
    push_rate: float = 8.0  # how fast a finger's push grows, N/s
    settle_time: float = 0.06  # how long all fingers must carry their set force before they hold, s
    closing_time: float = 2.5  # time after which the fingers hold in any case, s
    period: float = 0.008  # period of the force loop, s

    def validate(self) -> None:
        """Raises InvalidInputError if a value is not positive."""
        check_numbers("GraspControllerParams", self)


class _State(NamedTuple):
    """The controller's discrete state.

    Attributes:
        pushes: one for each finger that closes, N.
        since: the time since which all fingers carry their set force, s; NaN: they do not.
        is_holding: whether the hand holds.
        began: the time at which the fingers began to close, s; NaN: they have not.
    """

    pushes: FloatArray
    since: float = math.nan
    is_holding: bool = False
    began: float = math.nan

    def packed(self) -> FloatArray:
        """The state as a vector."""
        return np.array([*self.pushes, self.since, self.is_holding, self.began])

    @classmethod
    def of(cls, context: Context) -> "_State":
        """The state in a context of the controller."""
        *pushes, since, is_holding, began = context.get_discrete_state_vector().value()
        return cls(np.array(pushes), since, bool(is_holding), began)


class GraspController(CollectableSystem):
    """Closes the hand from an open posture to a grasp by joint torques, using only its own sensors.

    When the clock goes back, the times of `GraspControllerParams` start again; a hand that holds keeps holding.

    .. pydrake_system::

        name: GraspController
        input_ports:
        - hand_state
        - wrench_<finger> (one for each finger that closes)
        - open
        - rest_positions
        output_ports:
        - actuation
        - holding
        - status

    - hand_state: measured positions and velocities of the hand's joints, shape (nq + nv,), rad and rad/s.
    - wrench_<finger>: F_S, shape (6,), N m and N; NaN counts as no force while the fingers close, and changes nothing
      while they hold.
    - open: shape (1,); while above 0 the fingers go back to where they began, and close again afterwards; may stay
      unconnected.
    - rest_positions: desired positions, shape (nq,), rad, of which those of joints outside the closing fingers are
      used; `q_rest` if not connected.
    - actuation: torques, shape (na,), N m, in the order of the hand's actuators; changes with `hand_state` and
      `rest_positions`.
    - holding: shape (1,), 1 once all fingers carry their set force or `closing_time` is over, 0 before and while they
      open.
    - status: str, "closing", "holding", or "holding; not carrying: " and the fingers with too little force now.
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        hand: Hand,
        motions: Mapping[str, ClosingMotion],
        q_rest: FloatArray,
        params: GraspControllerParams | None = None,
    ) -> None:
        """Takes numbers from a finalized plant; keeps no reference to it.

        Args:
            plant: finalized plant that holds the hand.
            hand: the hand in it.
            motions: closing motion of each finger that takes part, by finger.
            q_rest: positions of all other joints, shape (nq,) of the hand, rad.
            params: gains and times.

        Raises:
            UnknownNameError: if a motion is for a finger that the hand lacks.
        """
        super().__init__()
        self._params = params_of(GraspControllerParams, params)
        for finger in motions:
            known_name("each name in motions", finger, hand.fingers)
        self._motions = dict(motions)
        self._law = GraspLaw(push_rate=self._params.push_rate)
        self._q_rest = np.array(q_rest, dtype=np.float64)
        joints = HandJoints.of(plant, hand)
        self._joint_of_actuator = joints.positions(joints.actuated)
        self._velocity_of_actuator = joints.velocities(joints.actuated)
        self._joints_of_finger = {finger.name: joints.positions(finger.joints) for finger in hand.config.fingers}
        on_finger = np.array([name in hand.config.driven for name in joints.actuated])
        arms = joint_arms(plant, hand, joints.actuated)
        stiffness = np.where(on_finger, self._params.finger_stiffness, self._params.other_stiffness)
        damping = np.where(on_finger, self._params.finger_damping, self._params.other_damping)
        self._stiffness, self._damping = stiffness / arms**2, damping / arms**2

        self._nq = plant.num_positions(hand.model_instance)
        self._state_port = self.DeclareVectorInputPort("hand_state", plant.num_multibody_states(hand.model_instance))
        self._wrenches = {finger: self.DeclareVectorInputPort(f"wrench_{finger}", 6) for finger in motions}
        self._open = self.DeclareVectorInputPort("open", 1)
        self._rest_positions = self.DeclareVectorInputPort("rest_positions", self._nq)
        start = _State(np.full(len(motions), -self._law.approach_push))
        state = self.discrete_state_ticket(self.DeclareDiscreteState(start.packed()))
        self.DeclarePeriodicDiscreteUpdateEvent(self._params.period, 0.0, self._update)
        needs = {state, self._state_port.ticket(), self._rest_positions.ticket()}
        self.declare_output("actuation", len(joints.actuated), self._actuation, needs)
        self.declare_output("holding", 1, lambda context: [float(_State.of(context).is_holding)], {state})
        needs = {state, *(port.ticket() for port in self._wrenches.values())}
        self.declare_output("status", "", self._status, needs)

    def commanded(self, pushes: FloatArray, q_rest: FloatArray | None = None) -> FloatArray:
        """Commanded positions of all joints of the hand, shape (nq,), rad.

        Args:
            pushes: one for each finger that closes, N.
            q_rest: positions of the other joints, shape (nq,), rad; None: the constructor's `q_rest`.
        """
        q = np.array(self._q_rest if q_rest is None else q_rest)
        for (finger, motion), push in zip(self._motions.items(), pushes, strict=True):
            q[self._joints_of_finger[finger]] = commanded_positions(motion, float(push), self._law)
        return q

    def _force(self, context: Context, finger: str) -> float:
        return float(np.linalg.norm(self._wrenches[finger].Eval(context)[3:]))

    def _update(self, context: Context, discrete_state: DiscreteValues) -> EventStatus:
        time, (pushes, since, holding, began) = context.get_time(), _State.of(context)
        # A time in the future was set before the clock went back, and counts as NaN.
        began = began if began <= time else time
        if self._open.HasValue(context) and self._open.Eval(context)[0] > 0.0:
            pushes = np.maximum(pushes - self._params.period * self._law.push_rate, -self._law.approach_push)
            discrete_state.set_value(_State(pushes, began=time).packed())
            return EventStatus.Succeeded()
        forces = [self._force(context, finger) for finger in self._motions]
        for i, (motion, force) in enumerate(zip(self._motions.values(), forces, strict=True)):
            pushes[i] = update_push(pushes[i], force, motion.set_force, holding, self._params.period, self._law)
        share = 1.0 - self._law.carry_share
        carried = all(f > share * motion.set_force for f, motion in zip(forces, self._motions.values(), strict=True))
        since = (since if since <= time else time) if carried else math.nan
        holding = holding or time - since >= self._params.settle_time or time - began >= self._params.closing_time
        discrete_state.set_value(_State(pushes, since, holding, began).packed())
        return EventStatus.Succeeded()

    def _actuation(self, context: Context) -> FloatArray:
        state = self._state_port.Eval(context)
        q, v = state[self._joint_of_actuator], state[self._nq + self._velocity_of_actuator]
        q_rest = self._rest_positions.Eval(context) if self._rest_positions.HasValue(context) else None
        q_commanded = self.commanded(_State.of(context).pushes, q_rest)[self._joint_of_actuator]
        return joint_torques(q, v, q_commanded, self._stiffness, self._damping)

    def _status(self, context: Context) -> str:
        if not _State.of(context).is_holding:
            return "closing"
        slack = [
            finger
            for finger, motion in self._motions.items()
            if not self._force(context, finger) >= self._law.slack_share * motion.set_force
        ]
        return "holding" + (f"; not carrying: {', '.join(slack)}" if slack else "")
