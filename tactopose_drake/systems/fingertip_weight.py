"""Compensates the wrenches of tared sensors for the fingertips' weight as it turns."""

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, DiscreteValues, EventStatus

from tactopose_drake.core.validation import FloatArray, instance_of
from tactopose_drake.hand.fingertip_weights import FingertipWeights
from tactopose_drake.systems.collectable_system import CollectableSystem, declare_cache
from tactopose_drake.systems.ports import eval_input


class FingertipWeight(CollectableSystem):
    """Subtracts the change of the fingertips' weight, in the sensors' frames, since the sensors were tared.

    A tare subtracts the fingertip's weight in the orientation of that moment. When the finger bends or an arm turns
    the hand, the weight turns in the sensor's frame, and up to twice the weight would be taken for a touch.

    .. pydrake_system::

        name: FingertipWeight
        input_ports:
        - joint_positions
        - palm_pose
        - wrench_<finger>
        output_ports:
        - wrench_<finger>

    - joint_positions: of the hand, shape (nq,), rad. Those at a context's first initialisation count as those of the
      tare. For a finger with an unknown joint at that time, the first known ones at a later step or initialisation do.
    - palm_pose: `RigidTransform` X_WP at each instant of a hand that an arm moves, z of W pointing up; only its
      orientation is used, NaN where unknown. Optional: without it, the hand's base stays as in `weights`.
    - wrench_<finger> (input): F_S of a sensor that was tared with nothing but the fingertip on it, N m and N.
    - wrench_<finger> (output): F_S of what touches the fingertip; changes with all inputs. NaN where a joint that
      turns the sensor, or the palm's orientation, is unknown, now or at the tare.
    """

    def __init__(self, weights: FingertipWeights, fingers: tuple[str, ...], num_positions: int) -> None:
        """Keeps a reference to the plant of `weights`.

        Args:
            weights: the weights of the hand's fingertips.
            fingers: names of the fingers with a tared sensor.
            num_positions: number of the hand's joint positions.
        """
        super().__init__()
        instance_of("weights", weights, FingertipWeights)
        self._fingers = fingers
        self._positions = self.DeclareVectorInputPort("joint_positions", num_positions)
        self._palm = self.DeclareAbstractInputPort("palm_pose", AbstractValue.Make(RigidTransform()))
        self._at_tare = self.DeclareDiscreteState(np.full(6 * len(fingers), np.nan))
        self.DeclareInitializationDiscreteUpdateEvent(self._remember)
        self.DeclarePerStepDiscreteUpdateEvent(self._remember)
        self._weights = declare_cache(
            self, "a context's own weights", AbstractValue.Make(weights).Clone, lambda *_: None, {self.nothing_ticket()}
        )
        needs = {self._positions.ticket(), self._palm.ticket(), self.discrete_state_ticket(self._at_tare)}
        self._turned = self.declare_value("changes of the weights since the tare, by finger", self._calc_turned, needs)
        for finger in fingers:
            self._declare(finger)

    def _declare(self, finger: str) -> None:
        name = f"wrench_{finger}"
        measured = self.DeclareVectorInputPort(name, 6)

        def left(context: Context) -> FloatArray:
            wrench: FloatArray = measured.Eval(context) - self._turned.Eval(context)[finger]
            return wrench

        self.declare_output(name, 6, left, {measured.ticket(), self._turned.ticket()})

    def _calc_turned(self, context: Context) -> dict[str, FloatArray]:
        at_tare = context.get_discrete_state(self._at_tare).value().reshape(-1, 6)
        now = self._now(context)
        return {finger: now[finger] - at_tare[k] for k, finger in enumerate(self._fingers)}

    def _now(self, context: Context) -> dict[str, FloatArray]:
        X_WP = eval_input(self._palm, context, RigidTransform) if self._palm.HasValue(context) else None
        if X_WP is not None and not np.isfinite(X_WP.GetAsMatrix34()).all():
            # As for all poses, a NaN means that the whole pose is unknown, including its orientation.
            return {finger: np.full(6, np.nan) for finger in self._fingers}
        weights: FingertipWeights = self._weights.Eval(context)
        return weights.wrenches(self._positions.Eval(context), None if X_WP is None else X_WP.rotation())

    def _remember(self, context: Context, discrete_state: DiscreteValues) -> EventStatus:
        before = context.get_discrete_state(self._at_tare).value()
        if not np.isnan(before).any():  # In a context that is initialized again, the sensors stay tared.
            return EventStatus.DidNothing()
        now = self._now(context)
        at_tare = np.concatenate([now[finger] for finger in self._fingers])
        discrete_state.set_value(self._at_tare, np.where(np.isnan(before), at_tare, before))
        return EventStatus.Succeeded()
