"""Estimates encoder offsets while a hand feels an object, and subtracts them from the joint positions."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context, EventStatus, State

from tactopose_drake.core.calibration.offset_refinement import JointOffsets, OffsetRefinementParams, refine_offsets
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.parameter_checks import params_of
from tactopose_drake.core.sensing.intrinsic_contact import ContactSolution
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.keyframes import Keyframe
from tactopose_drake.core.tracking.pose_belief import PoseBelief
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.hand.encoder_offsets import encoder_gains, offset_sigmas, radian_units
from tactopose_drake.hand.hand_config import HandUncertainty
from tactopose_drake.hand.hand_in_plant import Hand
from tactopose_drake.hand.kinematics import HandKinematics
from tactopose_drake.systems.collectable_system import CollectableSystem, SharedState
from tactopose_drake.systems.hand_kinematics import declare_kinematics
from tactopose_drake.systems.ports import eval_input, eval_named


@dataclasses.dataclass(frozen=True, eq=False)
class _Refined(SharedState):
    """The offsets' estimate, the offsets that are subtracted, and the joint positions at the last update."""

    offsets: JointOffsets
    applied: FloatArray
    q_told: FloatArray | None = None


class JointOffsetRefiner(CollectableSystem):
    """Refines the encoders' offsets by the touches of a run; see `core.calibration.offset_refinement`.

    New offsets are applied only once nothing has been touched for `let_go_time`, so that contacts do not jump while the
    hand holds something.

    .. pydrake_system::

        name: JointOffsetRefiner
        input_ports:
        - joint_positions
        - contact_solutions
        - belief
        output_ports:
        - joint_positions
        - joint_offsets
        - joint_offset_sigmas

    - joint_positions (input): measured positions, shape (nq,), rad.
    - contact_solutions: dict of `ContactSolution` by finger.
    - belief: `PoseBelief`; all inputs are read once a period.
    - joint_positions (output): the measured positions minus the applied offsets, shape (nq,), rad.
    - joint_offsets: estimated offset (reading minus true position) of each encoder, in the order of `joints`, shape
      (k,), rad; for a prismatic joint, 1 degree stands for 1 mm.
    - joint_offset_sigmas: their standard deviations, likewise.
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        hand: Hand,
        uncertainty: HandUncertainty,
        model: ObjectModel,
        params: OffsetRefinementParams | None = None,
    ) -> None:
        """Keeps references to plant and model.

        Args:
            plant: finalized plant of the hand alone.
            hand: the hand in it.
            uncertainty: the prior uncertainty of its encoders.
            model: the object.
            params: how slowly the offsets are refined.
        """
        super().__init__()
        self._params, self._model = params_of(OffsetRefinementParams, params), model
        self.joints, self._gains = encoder_gains(plant, hand)
        self._frames, self._units = hand.sensor_frames, radian_units(plant)
        self._positions = self.DeclareVectorInputPort("joint_positions", plant.num_positions())
        self._solutions = self.DeclareAbstractInputPort("contact_solutions", AbstractValue.Make({}))
        self._belief = self.DeclareAbstractInputPort("belief", AbstractValue.Make(None))
        self._kinematics = declare_kinematics(self, plant, hand.palm_frame, self._positions)
        count = len(self.joints)
        start = JointOffsets.of_sigma(offset_sigmas(plant, hand, uncertainty))
        self._refined = self.DeclareAbstractState(AbstractValue.Make(_Refined(start, np.zeros(count))))
        self.DeclarePeriodicUnrestrictedUpdateEvent(self._params.period, 0.0, self._update)
        ticket = self.abstract_state_ticket(self._refined)
        needs = {self._positions.ticket(), ticket}
        self.declare_output("joint_positions", plant.num_positions(), self._refined_positions, needs)
        self.declare_output("joint_offsets", count, lambda context: self._state(context).offsets.mean, {ticket})
        self.declare_output("joint_offset_sigmas", count, lambda context: self._state(context).offsets.sigma, {ticket})

    def _state(self, context: Context) -> _Refined:
        refined: _Refined = context.get_abstract_state(self._refined).get_value()
        return refined

    def _refined_positions(self, context: Context) -> FloatArray:
        q: FloatArray = self._positions.Eval(context) - self._gains @ self._state(context).applied
        return q

    def advance(self, context: Context) -> None:
        """Updates the offsets at once: for a loop without a simulator.

        Args:
            context: context of this system, whose state is updated.
        """
        self._update(context, context.get_mutable_state())

    def _update(self, context: Context, state: State) -> EventStatus:
        belief = eval_input(self._belief, context, PoseBelief)
        before = self._state(context)
        after = self._follow(context, belief, before)
        if after is not before:
            state.get_mutable_abstract_state(self._refined).set_value(after)
        return EventStatus.Succeeded()

    def _follow(self, context: Context, belief: PoseBelief, before: _Refined) -> _Refined:
        """The next state, given the belief."""
        q = self._positions.Eval(context)
        if not len(belief.contacts) or belief.touch_time < belief.time:
            if before.q_told is None or belief.time < belief.touch_time + self._params.let_go_time:
                return before
            return _Refined(before.offsets, before.offsets.mean)
        told = before.q_told
        turned = np.inf if told is None else np.nanmax(np.abs(q - told) / self._units, initial=0.0)
        if not self._is_settled(belief) or turned < math.radians(self._params.least_turn_deg):
            return before
        touch = belief.keyframes[-1]
        by_source = self._contact_gains(context, eval_named(self._solutions, context, ContactSolution))
        rows = [i for i, source in enumerate(touch.sources) if source in by_source]
        gains = np.array([by_source[touch.sources[i]] for i in rows]).reshape(len(rows), 6, len(self.joints))
        known = before.offsets
        left = dataclasses.replace(known, mean=known.mean - before.applied)
        found = refine_offsets(self._model, self._params, _contacts(touch, rows), gains, belief.X_PO[0], left)
        return _Refined(dataclasses.replace(found, mean=found.mean + before.applied), before.applied, q.copy())

    def _is_settled(self, belief: PoseBelief) -> bool:
        """Whether the belief's best mode is probable and explains a touch that has lasted long enough."""
        is_known = belief.status in ("ok", "ambiguous") and belief.probability[0] >= self._params.least_probability
        has_lasted = bool(belief.keyframes) and belief.keyframes[-1].frames >= self._params.least_frames
        return is_known and has_lasted and bool(belief.explains_touch[0])

    def _contact_gains(self, context: Context, solutions: Mapping[str, ContactSolution]) -> dict[str, FloatArray]:
        """Jacobian of each contact by the encoders' errors, by finger."""
        kinematics: HandKinematics = self._kinematics.Eval(context)
        gains = {}
        for finger in kinematics.poses(self._frames):
            if finger in solutions and solutions[finger].valid:
                J = kinematics.jacobian(self._frames[finger], solutions[finger].p_SC) @ self._gains
                gains[finger] = np.concatenate([J[3:], J[:3]])
        return gains


def _contacts(touch: Keyframe, rows: list[int]) -> Contacts:
    """The given rows of a keyframe's contacts."""
    normals = None if touch.normals is None else touch.normals[rows]
    return Contacts(touch.points[rows], normals).with_variances(touch.variances[rows])
