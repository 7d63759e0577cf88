"""The belief of a held object's pose over time, as a system."""

import dataclasses
import time
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import BasicVector, Context, EventStatus, State

from tactopose_drake.core.parameter_checks import check_parts, params_of
from tactopose_drake.core.posterior.moved_origin import about_middle
from tactopose_drake.core.posterior.plausibility import may_be_touched
from tactopose_drake.core.posterior.posterior_params import DEFAULT_PARAMS
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.frame import Frame
from tactopose_drake.core.tracking.pose_belief import PoseBelief
from tactopose_drake.core.tracking.pose_tracker import PoseTracker
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams
from tactopose_drake.core.validation import FloatArray, instance_of, positive_number
from tactopose_drake.errors import PortTypeError
from tactopose_drake.hand.collision import HandCollision
from tactopose_drake.systems.belief_hypotheses import estimate_of
from tactopose_drake.systems.belief_inputs import BeliefInputs, Reading, Remembered
from tactopose_drake.systems.collectable_system import CollectableSystem
from tactopose_drake.systems.collision_input import CollisionInput
from tactopose_drake.systems.ports import eval_optional_input


@dataclasses.dataclass(kw_only=True, slots=True)
class PoseBeliefParams:
    """How often the belief is updated, how late it is known, and what it assumes."""

    tracker: PoseTrackerParams = dataclasses.field(default_factory=PoseTrackerParams)
    period: float = 0.01  # s between two updates; up to 1, for by then an object that is not felt is lost
    latency: float = 0.0  # s from the reading of the inputs until the outputs show it: the time that computing takes

    def validate(self) -> None:
        """Raises InvalidInputError if a number is out of its range."""
        check_parts(self, tracker=PoseTrackerParams)
        positive_number("PoseBeliefParams.period", self.period, most=1.0, unit="s")
        positive_number("PoseBeliefParams.latency", self.latency, allow_zero=True)


@dataclasses.dataclass(frozen=True, eq=False)
class TimedBelief:
    """A belief and how long its update took, s of real time."""

    belief: PoseBelief
    duration: float = 0.0

    def __deepcopy__(self, memo: Any) -> "TimedBelief":
        return self


class PoseBeliefEstimator(CollectableSystem):
    """Keeps the belief of a held object's pose up to date, from touch, vision, and the fingers' motion.

    .. pydrake_system::

        name: PoseBeliefEstimator
        input_ports:
        - contacts
        - fingers_in_contact
        - patches
        - pads
        - contact_status
        - patch_status
        - prior
        - vision
        - hand
        - untouched
        - planes
        - tip_velocities
        - palm_pose
        - joint_positions
        output_ports:
        - object_pose
        - object_pose_vector
        - object_pose_in_world
        - covariance
        - hypotheses
        - status
        - belief

    All inputs but palm_pose are read at each period; any may stay unconnected, but one of contacts and patches.

    - contacts: `Contacts` in P.
    - fingers_in_contact: tuple of the names of the fingers of its rows, by which a contact is known again; without it,
      by the row.
    - patches: tuple of `Patch` in P, one for each pad that has a reading, those that feel nothing too.
    - pads: tuple of the names of those pads, by which a patch is known again; without it, by its place among them.
    - contact_status, patch_status: str, "ok", or which fingers and pads do not feel the object and why; remarks of the
      status.
    - prior: `PosePrior`, or None while there is none. It counts once, and as well as it says until the object is felt;
      one that changes before that takes its place. Where an object that was gone is felt again, one that has not
      changed says nothing of it.
    - vision: `PoseMeasurement`, with the time of its picture, or `PosePrior`, which counts as of when its pose changes
      or is surer than before, and the first as a prior; None while there is none.
    - hand: `HandGeometry` in P, where the object is not, or None.
    - untouched: `HandGeometry` in P, the parts of the hand that feel no contact, or None.
    - planes: tuple of `PlaneContact` in P, what of the world the object rests against; they count while it is felt.
    - tip_velocities: dict of the fingertips' spatial velocities [w, v] in P by finger, or None: the object then moves
      with the palm.
    - palm_pose: `RigidTransform` X_WP; a NaN where it is not known. Where it jumps as no hand is carried, the object
      goes with it.
    - joint_positions: of the hand, shape (nq,), rad; there is such a port only where collisions are checked.
    - object_pose: `RigidTransform` X_PO of the best mode; the identity before the first.
    - object_pose_vector: the same, size 7: the quaternion w, x, y, z, and the position, m.
    - object_pose_in_world: `RigidTransform` X_WO, by palm_pose at the time that it is asked for; NaN where that is.
    - covariance: size 36, that of the increment (w, v) of the best mode row by row, rad and m; before there is one,
      infinite variances.
    - hypotheses: `PoseEstimate`, all modes; None before the first.
    - status: str, that of `PoseBelief` ("ok", "ambiguous", "slipping", "no_contact", "lost"), maybe with ": " and
      remarks: what is wrong with vision, with the senses, and with the clock. The pose is an estimate for the first
      three only.
    - belief: `PoseBelief`.

    The outputs change once a period, `latency` after the inputs are read.
    """

    def __init__(
        self, model: ObjectModel, params: PoseBeliefParams | None = None, collision: HandCollision | None = None
    ) -> None:
        """Keeps references to the model and to what checks collisions.

        Args:
            model: the object.
            params: period, latency, and what is assumed.
            collision: says, where there are several likely modes, how deep the object reaches into the hand at each, as
                a search ends; that is not asked without.
        """
        instance_of("model", model, ObjectModel)
        super().__init__()
        self._params = params_of(PoseBeliefParams, params)
        self._model = model
        self._tracker = PoseTracker(model, self._params.tracker)
        make = AbstractValue.Make
        self._inputs = BeliefInputs(self, model, None if collision is None else CollisionInput(self, collision))
        start = TimedBelief(self._tracker.start())
        self._pending = self.DeclareAbstractState(make((start,)))  # beliefs, oldest first
        self._shown = self.DeclareAbstractState(make(start))
        self._remembered = self.DeclareAbstractState(make(Remembered()))
        self.DeclarePeriodicUnrestrictedUpdateEvent(self._params.period, 0.0, self._update)
        if self._params.latency > 0.0:
            self.DeclarePeriodicUnrestrictedUpdateEvent(self._params.period, self._params.latency, self._show)
        shown = {self.abstract_state_ticket(self._shown)}
        for name, model_value, calc in (
            ("object_pose", RigidTransform(), self._calc_pose),
            ("hypotheses", None, self._calc_hypotheses),
            ("status", "", self._calc_status),
            ("belief", start.belief, self._calc_belief),
        ):
            self.DeclareAbstractOutputPort(name, make(model_value).Clone, calc, shown)
        self.DeclareVectorOutputPort("covariance", 36, self._calc_covariance, shown)
        self.DeclareVectorOutputPort("object_pose_vector", 7, self._calc_pose_vector, shown)
        self.DeclareAbstractOutputPort(
            "object_pose_in_world",
            make(RigidTransform()).Clone,
            self._calc_pose_in_world,
            shown | {self._inputs.palm.ticket()},
        )

    def advance(self, context: Context) -> None:
        """Makes the next belief at once, of what the inputs are at the context's time: for a loop without a simulator.

        Args:
            context: this system's; its state becomes the next.
        """
        self._update(context, context.get_mutable_state())

    def _update(self, context: Context, state: State) -> EventStatus:
        reading = self._read(context, state)
        pending = context.get_abstract_state(self._pending).get_value()
        latest = self._step(pending[-1], reading)
        set_back = latest.belief.time < pending[-1].belief.time
        # Kept are those that are still to be shown.
        oldest = latest.belief.time - self._params.latency - 2.0 * self._params.period
        pending = (*(timed for timed in pending if timed.belief.time > oldest), latest)
        state.get_mutable_abstract_state(self._pending).set_value(pending)
        if self._params.latency == 0.0 or set_back:
            state.get_mutable_abstract_state(self._shown).set_value(latest)
        return EventStatus.Succeeded()

    def _show(self, context: Context, state: State) -> EventStatus:
        """Shows the belief whose computation is done by now."""
        ready = context.get_time() - self._params.latency + 1e-3 * self._params.period
        done = [timed for timed in context.get_abstract_state(self._pending).get_value() if timed.belief.time <= ready]
        if done:
            state.get_mutable_abstract_state(self._shown).set_value(done[-1])
        return EventStatus.Succeeded()

    def _step(self, timed: TimedBelief, reading: Reading) -> TimedBelief:
        """The next belief. One that cannot be made of the last, as after a jump of the clock, is begun anew."""
        started = time.perf_counter()
        before, frame, remarks = timed.belief, reading.frame, reading.remarks
        if frame.time < before.time:
            remarks = (f"begun anew: the clock went back from {before.time:g} s", *remarks)
            before = self._tracker.start(frame.time)
        elif before.has_pose and self._says_nothing(before, frame):
            vision = before.vision.of_next_belief()
            before = dataclasses.replace(
                self._tracker.start(before.time), history=before.history, vision=vision, X_WP=before.X_WP
            )
        seen = frame.vision
        # The spread of vision is that of the object's middle, wherever its origin is.
        if seen is not None and not _may_be_touched(self._model, seen.X_PO, seen.covariance, frame):
            frame = dataclasses.replace(frame, vision=None)
            remarks = ("vision is not believed: it is out of reach of the touch", *remarks)
        try:
            belief = self._tracker.step(before, frame)
        except np.linalg.LinAlgError as error:  # of numbers beyond arithmetic
            belief = self._tracker.start(frame.time)
            belief = dataclasses.replace(
                belief, remarks=(f"begun anew: {error}",), vision=before.vision.of_next_belief()
            )
        if belief.status == "slipping" and belief.probability[0] < DEFAULT_PARAMS.modes.answer_share:
            remarks = ("none of several poses carries most of the mass", *remarks)
        belief = dataclasses.replace(belief, remarks=(*belief.remarks, *remarks))
        return TimedBelief(belief, time.perf_counter() - started)

    def _says_nothing(self, belief: PoseBelief, frame: Frame) -> bool:
        """Whether something is felt or seen of an object that may be anywhere by now, or that never was in reach."""
        since = frame.time - max(belief.touch_time, belief.vision.accepted_time)
        is_news = frame.vision is not None and frame.vision.time not in belief.vision.times
        is_forgotten = since > self._params.tracker.unobserved_time and (is_news or len(frame.evidence.touch) > 0)
        if is_forgotten:
            return True
        best = dataclasses.replace(
            belief.mixture, X_PO=belief.X_PO[:1], weights=np.ones(1), covariance=belief.covariance[:1]
        )
        near, best = about_middle(self._model, best)
        return not _may_be_touched(near, best.X_PO[0], best.covariance[0], frame)

    def _read(self, context: Context, state: State) -> Reading:
        """All that the inputs say now; writes what is to be remembered of it into the state."""
        before = context.get_abstract_state(self._remembered).get_value()
        reading, remembered = self._inputs.read(context, before)
        state.get_mutable_abstract_state(self._remembered).set_value(remembered)
        return reading

    def _belief(self, context: Context) -> PoseBelief:
        return context.get_abstract_state(self._shown).get_value().belief

    def _calc_pose(self, context: Context, output: AbstractValue) -> None:
        output.set_value(_pose(self._belief(context)))

    def _calc_pose_vector(self, context: Context, output: BasicVector) -> None:
        X_PO = _pose(self._belief(context))
        output.SetFromVector(np.concatenate([X_PO.rotation().ToQuaternion().wxyz(), X_PO.translation()]))

    def _calc_pose_in_world(self, context: Context, output: AbstractValue) -> None:
        palm = eval_optional_input(self._inputs.palm, context, RigidTransform)
        if palm is None:
            raise PortTypeError(
                f"input port 'palm_pose' of system {self.get_name()!r}: is not connected; "
                "object_pose_in_world needs it."
            )
        output.set_value(palm @ _pose(self._belief(context)))

    def _calc_covariance(self, context: Context, output: BasicVector) -> None:
        belief = self._belief(context)
        covariance = belief.covariance[0] if belief.has_pose else np.where(np.eye(6) > 0.0, np.inf, 0.0)
        output.SetFromVector(covariance.reshape(-1))

    def _calc_hypotheses(self, context: Context, output: AbstractValue) -> None:
        timed = context.get_abstract_state(self._shown).get_value()
        output.set_value(estimate_of(timed.belief, self._model, timed.duration))

    def _calc_status(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._belief(context).message)

    def _calc_belief(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._belief(context))


def _may_be_touched(model: ObjectModel, X_PO: FloatArray, covariance: FloatArray, frame: Frame) -> bool:
    contacts = frame.evidence.touch
    return not len(contacts) or may_be_touched(model, X_PO, covariance, contacts)


def _pose(belief: PoseBelief) -> RigidTransform:
    return RigidTransform(belief.X_PO[0]) if belief.has_pose else RigidTransform()
