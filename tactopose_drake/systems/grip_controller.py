"""A controller that closes a hand's fingers until each stalls, and then holds."""

import dataclasses

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint, PdControllerGains, PrismaticJoint
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, EventStatus

from tactopose_drake.core.grasping.serial_chain import SLIDING_ARM
from tactopose_drake.core.grasping.stall_law import close_until_stalled
from tactopose_drake.core.parameter_checks import params_of
from tactopose_drake.core.validation import FloatArray, finite_array, positive_number
from tactopose_drake.errors import InvalidInputError, UnknownNameError
from tactopose_drake.hand.hand_in_plant import Hand
from tactopose_drake.hand.hand_joints import HandJoints
from tactopose_drake.systems.collectable_system import CollectableSystem


@dataclasses.dataclass(kw_only=True, slots=True)
class GripControllerParams:
    """How the motors move. Of a joint that slides, 5 cm count as a radian."""

    # Joints that do not close: their position, rad, of one that slides m.
    fixed: dict[str, float] = dataclasses.field(default_factory=dict)
    falling: list[str] = dataclasses.field(default_factory=list)  # joints that close towards smaller positions
    closing_speed: float = 1.5  # of the others, rad/s
    stall_torque: float = 1.0  # of the others, N m
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
                raise InvalidInputError(
                    f"GripControllerParams.falling: has {joint!r}, which is fixed; allowed is either."
                )


def set_motor_gains(plant: MultibodyPlant, hand: Hand, params: GripControllerParams) -> None:
    """Gives the hand's motors their position control, which the plant solves together with the contact.

    Args:
        plant: not finalized yet.
        hand: the hand in it.
        params: stiffness and damping.
    """
    params.validate()
    for index in plant.GetJointActuatorIndices():
        actuator = plant.get_mutable_joint_actuator(index)
        if actuator.model_instance() == hand.model_instance:
            per_radian = _arm(actuator.joint()) ** 2
            gains = PdControllerGains(p=params.stiffness / per_radian, d=params.damping / per_radian)
            actuator.set_controller_gains(gains)


def _arm(joint: Joint) -> float:
    """What motion of a joint counts as a radian."""
    return SLIDING_ARM if isinstance(joint, PrismaticJoint) else 1.0


class GripController(CollectableSystem):
    """Closes each finger at a constant speed until its motor stalls; from then on the motor holds its position.

    So do hands with worm drives, like Barrett's. A joint closes towards larger positions, unless the parameters say
    that it is `falling`; one of no finger, such as a wrist's, stays where it is. The plant needs `set_motor_gains`.

    .. pydrake_system::

        name: GripController
        input_ports:
        - hand_state
        output_ports:
        - desired_state
        - holding
        - status

    - hand_state: measured positions and velocities of the hand's joints, shape (nq + nv,), rad and rad/s, of those that
      slide m and m/s.
    - desired_state: of the hand's actuators, positions, then velocities, shape (2 na,), likewise; for the plant's port
      of that name. Changes once a period. The initialisation sets all but the fixed joints to where they are measured,
      0 before; a context that is initialised again goes on as it was.
    - holding: shape (1,), 1 once every closing motor has stalled, 0 before.
    - status: str, "closing: " and the joints whose motors have not stalled, or "holding".
    """

    def __init__(self, plant: MultibodyPlant, hand: Hand, params: GripControllerParams | None = None) -> None:
        """Takes numbers from a finalized plant; keeps no reference to it.

        Args:
            plant: finalized plant that holds the hand.
            hand: the hand in it.
            params: how the motors move.

        Raises:
            UnknownNameError: if `fixed` or `falling` name a joint that no motor moves.
        """
        super().__init__()
        self._params = params_of(GripControllerParams, params)
        joints = HandJoints.of(plant, hand)
        names = joints.actuated
        for key in ("fixed", "falling"):
            for name in getattr(self._params, key):
                if name not in names:
                    raise UnknownNameError(f"GripControllerParams.{key}: joint", name, names)
        self._joints = joints.positions(names)
        self._arms = np.array([_arm(plant.GetJointByName(name, hand.model_instance)) for name in names])
        self._signs = np.array([-1.0 if name in self._params.falling else 1.0 for name in names])
        self._names = names
        start = np.array([self._params.fixed.get(name, np.nan) for name in names])
        of_fingers = {name for finger in hand.config.fingers for name in finger.joints} or set(names)
        stays = [name in self._params.fixed or name not in of_fingers for name in names]

        nx = plant.num_multibody_states(hand.model_instance)
        self._state_port = self.DeclareVectorInputPort("hand_state", nx)
        # Commands, NaN until the initialisation where nothing is commanded yet, then which motors have stalled; a motor
        # that does not close counts as stalled.
        state = self.DeclareDiscreteState(np.concatenate([start, stays]))
        self.DeclareInitializationDiscreteUpdateEvent(self._start)
        self.DeclarePeriodicDiscreteUpdateEvent(self._params.period, self._params.period, self._update)
        ticket = self.discrete_state_ticket(state)
        for name, size, calc in (
            ("desired_state", 2 * len(names), self._calc_desired_state),
            ("holding", 1, self._calc_holding),
        ):
            self.DeclareVectorOutputPort(name, size, calc, prerequisites_of_calc={ticket})
        self.DeclareAbstractOutputPort(
            "status", lambda: AbstractValue.Make(""), self._calc_status, prerequisites_of_calc={ticket}
        )

    def _measured(self, context: Context) -> FloatArray:
        q: FloatArray = self._state_port.Eval(context)[self._joints]
        return q

    def _start(self, context: Context, state: DiscreteValues) -> EventStatus:
        commanded, stalled = np.split(context.get_discrete_state_vector().value(), 2)
        # Commands of a context that goes on stay: they lie beyond the joint by what the motor presses with.
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

    def _calc_desired_state(self, context: Context, output: BasicVector) -> None:
        commanded, stalled = np.split(context.get_discrete_state_vector().value(), 2)
        # Without the velocity, the damping would hold a moving finger back as if it had stalled.
        velocity = np.where(stalled > 0, 0.0, self._signs * self._arms * self._params.closing_speed)
        output.SetFromVector(np.concatenate([np.nan_to_num(commanded), velocity]))

    def _calc_holding(self, context: Context, output: BasicVector) -> None:
        _, stalled = np.split(context.get_discrete_state_vector().value(), 2)
        output.SetFromVector([float(stalled.all())])

    def _calc_status(self, context: Context, output: AbstractValue) -> None:
        _, stalled = np.split(context.get_discrete_state_vector().value(), 2)
        waiting = [name for name, done in zip(self._names, stalled > 0, strict=True) if not done]
        output.set_value(f"closing: {', '.join(waiting)}" if waiting else "holding")
