"""The belief of a held object's pose over time, as a system."""

import dataclasses
import time

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, EventStatus, State

from tactopose_drake.core.parameter_checks import check_parts, params_of
from tactopose_drake.core.posterior.moved_origin import about_middle
from tactopose_drake.core.posterior.plausibility import may_be_touched
from tactopose_drake.core.posterior.posterior_params import DEFAULT_PARAMS
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.times import offset_of_delayed
from tactopose_drake.core.tracking.frame import Frame
from tactopose_drake.core.tracking.pose_belief import PoseBelief
from tactopose_drake.core.tracking.pose_tracker import PoseTracker
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams
from tactopose_drake.core.validation import FloatArray, instance_of, positive_number
from tactopose_drake.errors import PortTypeError
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.hand.collision import HandCollision
from tactopose_drake.systems.belief_hypotheses import estimate_of
from tactopose_drake.systems.belief_inputs import BeliefInputs, Reading, Remembered
from tactopose_drake.systems.collectable_system import CollectableSystem, SharedState
from tactopose_drake.systems.collision_input import CollisionInput
from tactopose_drake.systems.ports import eval_optional_input, port_name


@dataclasses.dataclass(kw_only=True, slots=True)
class PoseBeliefParams:
    """Period and latency of the belief, and the tracker's parameters."""

    tracker: PoseTrackerParams = dataclasses.field(default_factory=PoseTrackerParams)
    period: float = 0.01  # s between two updates; at most 1, since an object that is not felt is lost by then
    latency: float = 0.0  # s from reading the inputs until the outputs change: the simulated computing time

    def validate(self) -> None:
        """Raises InvalidInputError if a number is out of its range."""
        check_parts(self, tracker=PoseTrackerParams)
        positive_number("PoseBeliefParams.period", self.period, most=1.0, unit="s")
        positive_number("PoseBeliefParams.latency", self.latency, allow_zero=True)


@dataclasses.dataclass(frozen=True, eq=False)
class TimedBelief(SharedState):
    """A belief and how long its update took, s of real time."""

    belief: PoseBelief
    duration: float = 0.0


class PoseBeliefEstimator(CollectableSystem):
    """Keeps the belief of a held object's pose up to date from touch, vision, and the fingers' motion.

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

    All inputs are read at each period. Either contacts or patches must be connected; all others are optional.

    - contacts: `Contacts` in P.
    - fingers_in_contact: tuple of the fingers' names, one for each row of contacts, which identify a contact over time;
      without it, the row's index does.
    - patches: tuple of `Patch` in P, one for each pad that has a reading, including those that feel nothing.
    - pads: tuple of the names of those pads, which identify a patch over time; without it, its index does.
    - contact_status, patch_status: str, "ok", or which fingers and pads do not feel the object and why; repeated in the
      remarks of the status.
    - prior: `PosePrior`, or None while there is none. It counts once, with the uncertainty it states, until the object
      is felt; a prior that changes before that replaces it. When a lost object is felt again, a prior that has not
      changed is ignored.
    - vision: `PoseMeasurement`, with the time of its picture, or `PosePrior`, or None while there is none. The first
      `PosePrior` counts as a prior, and later ones as measurements at the time when their pose changes or becomes more
      certain.
    - hand: `HandGeometry` in P, space that the object does not occupy, or None.
    - untouched: `HandGeometry` in P, the parts of the hand that feel no contact, or None.
    - planes: tuple of `PlaneContact` in P, planes of the world that the object rests against; used while it is felt.
    - tip_velocities: dict of the fingertips' spatial velocities [w, v] in P by finger, or None: the object is then
      taken to move with the palm.
    - palm_pose: `RigidTransform` X_WP, NaN if unknown. If it jumps farther than any carried hand could move, the object
      is taken to move with it.
    - joint_positions: of the hand, shape (nq,), rad; the port exists only if collisions are checked.
    - object_pose: `RigidTransform` X_PO of the best mode; the identity before the first.
    - object_pose_vector: the same, size 7: the quaternion w, x, y, z, and the position, m.
    - object_pose_in_world: `RigidTransform` X_WO, computed from the current palm_pose; NaN if that is.
    - covariance: size 36, the covariance of the best mode's increment (w, v), row by row, rad and m; infinite variances
      before the first mode.
    - hypotheses: `PoseEstimate`, all modes; None before the first.
    - status: str, that of `PoseBelief` ("ok", "ambiguous", "slipping", "no_contact", "lost"), possibly with ": " and
      remarks on vision, the sensors, and the clock. The pose is an estimate only for the first three, and not while it
      is "slipping" with the remark that the best pose does not explain the touch.
    - belief: `PoseBelief`.

    The outputs change once a period, `latency` after the inputs are read; object_pose_in_world also with palm_pose.
    """

    def __init__(
        self, model: ObjectModel, params: PoseBeliefParams | None = None, collision: HandCollision | None = None
    ) -> None:
        """Keeps references to the model and to the collision checker.

        Args:
            model: the object.
            params: period, latency, and tracker.
            collision: computes, at the end of a search with several likely modes, how deep the object penetrates the
                hand at each of them; None: not checked.
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
            offset = offset_of_delayed(self._params.latency, self._params.period)
            self.DeclarePeriodicUnrestrictedUpdateEvent(self._params.period, offset, self._show)
        shown = {self.abstract_state_ticket(self._shown)}
        self.declare_output("object_pose", RigidTransform(), lambda context: _pose(self._belief(context)), shown)
        self.declare_output("hypotheses", None, self._estimate, shown)
        self.declare_output("status", "", lambda context: self._belief(context).message, shown)
        self.declare_output("belief", start.belief, self._belief, shown)
        self.declare_output("covariance", 36, self._covariance, shown)
        self.declare_output("object_pose_vector", 7, self._pose_vector, shown)
        needs = shown | {self._inputs.palm.ticket()}
        self.declare_output("object_pose_in_world", RigidTransform(), self._pose_in_world, needs)

    def advance(self, context: Context) -> None:
        """Updates the belief at once from the inputs at the context's time: for a loop without a simulator.

        Args:
            context: context of this system, whose state is updated.
        """
        self._update(context, context.get_mutable_state())

    def _update(self, context: Context, state: State) -> EventStatus:
        reading = self._read(context, state)
        pending = context.get_abstract_state(self._pending).get_value()
        latest = self._step(pending[-1], reading)
        set_back = latest.belief.time < pending[-1].belief.time
        # Keep the beliefs that are still to be shown.
        oldest = latest.belief.time - self._params.latency - 2.0 * self._params.period
        pending = (*(timed for timed in pending if timed.belief.time > oldest), latest)
        state.get_mutable_abstract_state(self._pending).set_value(pending)
        if self._params.latency == 0.0 or set_back:
            state.get_mutable_abstract_state(self._shown).set_value(latest)
        return EventStatus.Succeeded()

    def _show(self, context: Context, state: State) -> EventStatus:
        """Publishes the newest belief whose latency is over."""
        ready = context.get_time() - self._params.latency + 1e-3 * self._params.period
        done = [timed for timed in context.get_abstract_state(self._pending).get_value() if timed.belief.time <= ready]
        if done:
            state.get_mutable_abstract_state(self._shown).set_value(done[-1])
        return EventStatus.Succeeded()

    def _step(self, timed: TimedBelief, reading: Reading) -> TimedBelief:
        """The next belief; if it cannot follow from the last, as after the clock went back, a new one is started."""
        started = time.perf_counter()
        before, frame, remarks = timed.belief, reading.frame, reading.remarks
        if frame.time < before.time:
            remarks = (f"begun anew: the clock went back from {before.time:.15g} s", *remarks)
            before = self._tracker.start(frame.time)
        elif before.has_pose and self._says_nothing(before, frame):
            vision = before.vision.of_next_belief()
            before = dataclasses.replace(
                self._tracker.start(before.time), history=before.history, vision=vision, X_WP=before.X_WP
            )
        seen = frame.vision
        # Vision's covariance is about the object's middle, wherever its origin is.
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
        # What a remark says with its reason is not said without it as well.
        own = tuple(one for one in belief.remarks if not any(remark.startswith(one) for remark in remarks))
        belief = dataclasses.replace(belief, remarks=(*own, *remarks))
        return TimedBelief(belief, time.perf_counter() - started)

    def _says_nothing(self, belief: PoseBelief, frame: Frame) -> bool:
        """Whether the belief is useless for this frame.

        So it is if the object was unobserved for so long that it may be anywhere and is felt or seen again, or if the
        belief's pose is out of reach of the touch.
        """
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
        """Reads all inputs, and stores in the state what the next reading needs."""
        before = context.get_abstract_state(self._remembered).get_value()
        reading, remembered = self._inputs.read(context, before)
        state.get_mutable_abstract_state(self._remembered).set_value(remembered)
        return reading

    def _belief(self, context: Context) -> PoseBelief:
        return context.get_abstract_state(self._shown).get_value().belief

    def _pose_vector(self, context: Context) -> FloatArray:
        X_PO = _pose(self._belief(context))
        return np.concatenate([X_PO.rotation().ToQuaternion().wxyz(), X_PO.translation()])

    def _pose_in_world(self, context: Context) -> RigidTransform:
        palm = eval_optional_input(self._inputs.palm, context, RigidTransform)
        if palm is None:
            raise PortTypeError(
                f"{port_name(self._inputs.palm)} must hold a RigidTransform for object_pose_in_world, but is not "
                "connected."
            )
        return palm @ _pose(self._belief(context))

    def _covariance(self, context: Context) -> FloatArray:
        belief = self._belief(context)
        covariance = belief.covariance[0] if belief.has_pose else np.where(np.eye(6) > 0.0, np.inf, 0.0)
        return covariance.reshape(-1)

    def _estimate(self, context: Context) -> PoseEstimate | None:
        timed = context.get_abstract_state(self._shown).get_value()
        return estimate_of(timed.belief, self._model, timed.duration)


def _may_be_touched(model: ObjectModel, X_PO: FloatArray, covariance: FloatArray, frame: Frame) -> bool:
    contacts = frame.evidence.touch
    return not len(contacts) or may_be_touched(model, X_PO, covariance, contacts)


def _pose(belief: PoseBelief) -> RigidTransform:
    return RigidTransform(belief.X_PO[0]) if belief.has_pose else RigidTransform()
