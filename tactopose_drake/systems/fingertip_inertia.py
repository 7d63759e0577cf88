"""The inertial forces of the fingertips that their force-torque sensors read, as a system."""

import dataclasses
import math

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context, EventStatus, State

from tactopose_drake.core.parameter_checks import params_of
from tactopose_drake.core.tracking.frame import FASTEST
from tactopose_drake.core.validation import FloatArray, positive_number
from tactopose_drake.hand.encoder_offsets import encoder_gains
from tactopose_drake.hand.fingertip_weights import fingertip_mass
from tactopose_drake.hand.hand_in_plant import Hand
from tactopose_drake.systems.collectable_system import CollectableSystem, SharedState
from tactopose_drake.systems.hand_kinematics import declare_kinematics

# An acceleration is the change of velocity over at least this, s: in less, noise of the encoders would be all of it.
_LEAST_TIME = 0.01
_PAUSE = 0.15  # s: after so long without an update, the change of velocity tells nothing of the present acceleration
# A moving hand that reads the same for no longer than this, s, has not been read anew; after it, it stands still.
_REPEATED = 0.03
_SURE = 2.0  # standard deviations of what encoders' noise makes of an acceleration; beyond, the finger is accelerated


@dataclasses.dataclass(kw_only=True, slots=True)
class FingertipInertiaParams:
    """Which forces count as inertial forces of a fingertip."""

    # The largest force that counts as inertial, in multiples of the fingertip's mass times its mean acceleration
    # between two updates; no unit. It is above 1 because a motor's step accelerates a finger more than that for an
    # instant, and a sensor reads it some milliseconds late. 0: no force counts as inertial.
    margin: float = 3.0
    # Noise of each encoder's reading, standard deviation, deg; of a joint that slides, 1 degree counts as 1 mm. An
    # acceleration that this noise explains counts as 0, so that it hides no touch.
    encoder_noise_deg: float = 0.05

    def validate(self) -> None:
        """Raises InvalidInputError if a number is out of its range."""
        for name in ("margin", "encoder_noise_deg"):
            positive_number(f"FingertipInertiaParams.{name}", getattr(self, name), allow_zero=True)


@dataclasses.dataclass(frozen=True, eq=False)
class _Motion(SharedState):
    """How the fingertips moved at one time.

    Attributes:
        time: s.
        p_PTip: the fingertips' centres of mass, shape (k, 3), m; NaN where a joint is not known.
        v_PTip: their velocities, m/s.
        a_PTip: their accelerations in the time before, m/s^2; 0 where they are not known.
    """

    time: float
    p_PTip: FloatArray
    v_PTip: FloatArray
    a_PTip: FloatArray

    def is_repeated(self, p_PTip: FloatArray, v_PTip: FloatArray) -> bool:
        """Whether fingertips that moved are read where they were; velocities that are not known differ in nothing."""
        same_p = np.array_equal(p_PTip, self.p_PTip, equal_nan=True)
        same_v = bool(np.all(np.isnan(v_PTip) | (v_PTip == self.v_PTip)))
        return same_p and same_v and bool(np.any(self.v_PTip))


class FingertipInertia(CollectableSystem):
    """Computes the inertial forces of the fingertips, so that they are not taken for a touch.

    The sensor at a fingertip's root also reads the inertial force of the fingertip beyond it: mass times acceleration,
    opposite to the acceleration. A free finger therefore seems to be touched while a motor starts or stops it. If an
    object stops the finger, the contact force has the direction of the acceleration and cannot be confused with it.

    .. pydrake_system::

        name: FingertipInertia
        input_ports:
        - joint_positions
        - joint_velocities
        output_ports:
        - inertial_forces

    - joint_positions: measured positions of the hand's joints, shape (nq,) of the hand's own plant, rad; NaN where
      unknown.
    - joint_velocities: of the same joints, shape (nv,), rad/s; NaN where unknown. May stay unconnected. Without them,
      velocities are differences of positions, and the hand is assumed to be at rest at the first update.
    - inertial_forces: dict of arrays by finger, shape (2, 3), N: the sensor's force in P times the margin, first by the
      mean acceleration up to the update before, then by that since. 0 where the acceleration is unknown or may be
      noise. Changes with time, with the inputs, and once a period.

    The acceleration of the palm is neglected, because arms accelerate less than fingers.
    """

    def __init__(
        self, plant: MultibodyPlant, hand: Hand, params: FingertipInertiaParams | None = None, period: float = 0.01
    ) -> None:
        """Keeps a reference to the plant.

        Args:
            plant: finalized plant of the hand alone, for kinematics; not the simulator's.
            hand: the hand in it, with its fingertips' masses; one without a mass has no inertial force.
            params: which forces count.
            period: between updates, s; best that of the system that reads the contacts.
        """
        super().__init__()
        self._params = params_of(FingertipInertiaParams, params)
        self._frames = dict(hand.sensor_frames)
        tips = [fingertip_mass(plant, hand.welds[finger], frame) for finger, frame in self._frames.items()]
        self._masses = np.array([mass for mass, _ in tips])
        self._p_STip = np.array([p_STipcm for _, p_STipcm in tips]).reshape(-1, 3)
        self._noise = math.radians(self._params.encoder_noise_deg) * encoder_gains(plant, hand).gains
        self._positions = self.DeclareVectorInputPort("joint_positions", plant.num_positions())
        self._velocities = self.DeclareVectorInputPort("joint_velocities", plant.num_velocities())
        self._kinematics = declare_kinematics(self, plant, hand.palm_frame, self._positions)
        self._history = self.DeclareAbstractState(AbstractValue.Make(()))  # of `_Motion`, oldest first
        moving = (self._kinematics.ticket(), self._velocities.ticket(), self.time_ticket())
        needs = {*moving, self.abstract_state_ticket(self._history)}
        self._motion = self.declare_value("motion of the fingertips", self._calc_motion, needs)
        self.DeclarePeriodicUnrestrictedUpdateEvent(positive_number("period", period), 0.0, self._update)
        self.declare_output("inertial_forces", {}, self._inertial_forces, {self._motion.ticket()})

    def advance(self, context: Context) -> None:
        """Remembers the motion of now, as at a period's end: for a loop without a simulator.

        Args:
            context: this system's; its state becomes the next.
        """
        remembered = self._next(context)
        context.get_mutable_abstract_state(self._history).set_value(remembered)

    def _update(self, context: Context, state: State) -> EventStatus:
        state.get_mutable_abstract_state(self._history).set_value(self._next(context))
        return EventStatus.Succeeded()

    def _next(self, context: Context) -> tuple[_Motion, ...]:
        """What is to be remembered: the motion of now, and of those before what the next can be compared with."""
        now, history = context.get_time(), self._earlier(context)
        while len(history) > 1 and _is_old(history[1], now):
            history = history[1:]
        motion = self._motion.Eval(context)
        return (*(earlier for earlier in history if earlier.time < now and earlier is not motion), motion)

    def _inertial_forces(self, context: Context) -> dict[str, FloatArray]:
        before = self._before(context)
        a = np.zeros((2, len(self._masses), 3))
        if before is not None:
            a[:] = before.a_PTip, self._motion.Eval(context).a_PTip
        forces = -self._params.margin * self._masses[:, None] * a
        return {finger: forces[:, k] for k, finger in enumerate(self._frames)}

    def _earlier(self, context: Context) -> tuple[_Motion, ...]:
        """What is remembered and can be compared with now; nothing after a pause, or where the clock went back."""
        history: tuple[_Motion, ...] = context.get_abstract_state(self._history).get_value()
        return history if history and 0.0 <= context.get_time() - history[-1].time <= _PAUSE else ()

    def _before(self, context: Context) -> _Motion | None:
        """The last motion that is old enough to be compared with."""
        old = [motion for motion in self._earlier(context) if _is_old(motion, context.get_time())]
        return old[-1] if old else None

    def _calc_motion(self, context: Context) -> _Motion:
        """How the fingertips move now."""
        now, before = context.get_time(), self._before(context)
        q_dot = self._velocities.Eval(context) if self._velocities.HasValue(context) else np.array([np.nan])
        kinematics = self._kinematics.Eval(context)
        count, X_PS = len(self._masses), kinematics.poses(self._frames)
        p, J = np.full((count, 3), np.nan), np.full((count, 3, len(self._noise)), np.nan)
        for k, (finger, frame) in enumerate(self._frames.items()):
            if finger in X_PS:
                p[k] = X_PS[finger] @ self._p_STip[k]
                J[k] = kinematics.jacobian(frame, self._p_STip[k])[3:]
        # If one joint velocity is unknown, the comparison with NaN is false, and no velocity is known.
        v = J @ q_dot if np.abs(q_dot).max(initial=0.0) < FASTEST else np.full((count, 3), np.nan)
        last = next(reversed(self._earlier(context)), None)
        if last is not None and now < last.time + _REPEATED and last.is_repeated(p, v):
            return last
        if before is None:
            at_rest = np.where(np.isnan(v), 0.0, v)
            return _Motion(now, p, at_rest, np.zeros_like(p))
        duration = now - before.time
        v = np.where(np.isnan(v), (p - before.p_PTip) / duration, v)
        a = (v - before.v_PTip) / duration
        # The second difference of readings whose noise is independent.
        noise = _SURE * math.sqrt(6.0) / duration**2 * np.linalg.norm(J @ self._noise, axis=(1, 2))
        is_sure = np.linalg.norm(a, axis=1) > noise
        return _Motion(now, p, v, np.where(is_sure[:, None], a, 0.0))


def _is_old(motion: _Motion, now: float) -> bool:
    return now - motion.time >= (1.0 - 1e-6) * _LEAST_TIME
