"""A controller that closes each finger of a hand until its motors stall, and then holds."""

import dataclasses

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import PdControllerGains
from pydrake.systems.framework import Context, DiscreteValues, EventStatus

from tactopose_drake.core.grasping.stall_law import close_until_stalled
from tactopose_drake.core.parameter_checks import params_of
from tactopose_drake.core.validation import FloatArray, finite_array, instance_of, known_name, positive_number
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.hand_in_plant import Hand
from tactopose_drake.hand.hand_joints import HandJoints, joint_arms
from tactopose_drake.systems.collectable_system import CollectableSystem


@dataclasses.dataclass(kw_only=True, slots=True)
class GripControllerParams:
    """Speed, stall torque and position control of the motors. For prismatic joints, 5 cm count as a radian."""

    fixed: dict[str, float] = dataclasses.field(default_factory=dict)  # positions of joints that do not close, rad or m
    falling: list[str] = dataclasses.field(default_factory=list)  # joints that close towards smaller positions
    closing_speed: float = 1.5  # of the other joints, rad/s
    stall_torque: float = 1.0  # of the other joints, N m
    stiffness: float = 50.0  # of each motor's position control, N m/rad
    damping: float = 1.0  # N m s/rad
    period: float = 0.004  # s

    def validate(self) -> None:
        """Raises InvalidInputError if a value is out of its range."""
        for name in ("closing_speed", "stall_torque", "stiffness", "period"):
            positive_number(f"GripControllerParams.{name}", getattr(self, name))
        positive_number("GripControllerParams.damping", self.damping, allow_zero=True)
        for joint, position in self.fixed.items():
            finite_array(f"GripControllerParams.fixed[{joint}]", position, ())
        for joint in self.falling:
            if joint in self.fixed:
                raise InvalidInputError(f"GripControllerParams.falling must not have {joint!r}, which is fixed.")


def set_motor_gains(plant: MultibodyPlant, hand: Hand, params: GripControllerParams) -> None:
    """Sets the PD gains of the hand's motors; the plant solves the control implicitly together with the contact.

    Args:
        plant: plant that is not finalized yet.
        hand: the hand in it.
        params: stiffness and damping.
    """
    params.validate()
    motors = [plant.get_mutable_joint_actuator(index) for index in plant.GetJointActuatorIndices()]
    motors = [motor for motor in motors if motor.model_instance() == hand.model_instance]
    arms = joint_arms(plant, hand, [motor.joint().name() for motor in motors])
    for motor, arm in zip(motors, arms, strict=True):
        motor.set_controller_gains(PdControllerGains(p=params.stiffness / arm**2, d=params.damping / arm**2))


class GripController(CollectableSystem):
    """Closes each joint at a constant speed until its motor stalls; from then on the motor holds its position.

    Hands with worm drives, like Barrett's, behave so. A joint closes towards larger positions, unless the parameters
    list it as `falling`; a joint of no finger, such as a wrist's, keeps its position. Call `set_motor_gains` for the
    plant before.

    .. pydrake_system::

        name: GripController
        input_ports:
        - hand_state
        output_ports:
        - desired_state
        - holding
        - status

    - hand_state: measured positions and velocities of the hand's joints, shape (nq + nv,), rad and rad/s, or m and m/s
      for prismatic joints; NaN where unknown, which a closing motor waits for.
    - desired_state: positions, then velocities, of the hand's actuators, shape (2 na,), in the same units; for the
      plant's port of that name. Changes once a period. The first initialisation sets all but the fixed joints to their
      measured positions, 0 before and while they are unknown; a later one changes nothing.
    - holding: shape (1,), 1 once every closing motor has stalled, 0 before.
    - status: str, "closing: " and the joints whose motors have not stalled, or "holding".
    """

    def __init__(self, plant: MultibodyPlant, hand: Hand, params: GripControllerParams | None = None) -> None:
        """Takes numbers from a finalized plant; keeps no reference to it.

        Args:
            plant: finalized plant that holds the hand.
            hand: the hand in it.
            params: speed, torque and gains of the motors.

        Raises:
            UnknownNameError: if `fixed` or `falling` name a joint without an actuator.
        """
        super().__init__()
        instance_of("plant", plant, MultibodyPlant)
        instance_of("hand", hand, Hand)
        self._params = params_of(GripControllerParams, params)
        joints = HandJoints.of(plant, hand)
        names = joints.actuated
        for key in ("fixed", "falling"):
            for name in getattr(self._params, key):
                known_name(f"each name in GripControllerParams.{key}", name, names)
        self._joints = joints.positions(names)
        self._arms = joint_arms(plant, hand, names)
        self._signs = np.array([-1.0 if name in self._params.falling else 1.0 for name in names])
        self._names = names
        start = np.array([self._params.fixed.get(name, np.nan) for name in names])
        of_fingers = hand.config.driven or names
        stays = [name in self._params.fixed or name not in of_fingers for name in names]

        nx = plant.num_multibody_states(hand.model_instance)
        self._state_port = self.DeclareVectorInputPort("hand_state", nx)
        # Commanded positions (of closing joints NaN until they are measured), then which motors have stalled; a motor
        # that does not close counts as stalled.
        state = self.DeclareDiscreteState(np.concatenate([start, stays]))
        self.DeclareInitializationDiscreteUpdateEvent(self._start)
        self.DeclarePeriodicDiscreteUpdateEvent(self._params.period, self._params.period, self._update)
        ticket = self.discrete_state_ticket(state)
        self.declare_output("desired_state", 2 * len(names), self._desired_state, {ticket})
        self.declare_output("holding", 1, self._is_holding, {ticket})
        self.declare_output("status", "", self._status, {ticket})

    def _measured(self, context: Context) -> FloatArray:
        q: FloatArray = self._state_port.Eval(context)[self._joints]
        return q

    def _start(self, context: Context, state: DiscreteValues) -> EventStatus:
        commanded, stalled = np.split(context.get_discrete_state_vector().value(), 2)
        # Commands from before a repeated initialisation stay: they lie beyond the joint in proportion to the torque.
        begun = np.where(np.isnan(commanded), self._measured(context), commanded)
        state.get_mutable_vector().SetFromVector(np.concatenate([begun, stalled]))
        return EventStatus.Succeeded()

    def _update(self, context: Context, state: DiscreteValues) -> EventStatus:
        commanded, stalled = np.split(context.get_discrete_state_vector().value(), 2)
        params = self._params
        commanded, now_stalled = close_until_stalled(
            commanded,
            self._measured(context),
            stalled > 0,
            step=self._signs * self._arms * (params.closing_speed * params.period),
            reach=self._arms * (params.stall_torque / params.stiffness),
        )
        state.get_mutable_vector().SetFromVector(np.concatenate([commanded, now_stalled]))
        return EventStatus.Succeeded()

    def _desired_state(self, context: Context) -> FloatArray:
        commanded, stalled = np.split(context.get_discrete_state_vector().value(), 2)
        # With a desired velocity of 0, damping would hold a moving finger back as if it had stalled.
        velocity = np.where(stalled > 0, 0.0, self._signs * self._arms * self._params.closing_speed)
        return np.concatenate([np.nan_to_num(commanded), velocity])

    def _is_holding(self, context: Context) -> list[float]:
        _, stalled = np.split(context.get_discrete_state_vector().value(), 2)
        return [float(stalled.all())]

    def _status(self, context: Context) -> str:
        _, stalled = np.split(context.get_discrete_state_vector().value(), 2)
        waiting = [name for name, done in zip(self._names, stalled > 0, strict=True) if not done]
        return f"closing: {', '.join(waiting)}" if waiting else "holding"
