"""The belief from frame to frame: predict, update with vision and touch, test for consistency, relocalise."""

from __future__ import annotations

import dataclasses

import numpy as np

from tactopose_drake.core.evidence.contact_reading import ContactReading, ErrorScales
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.kernel_library import make_kernels_ready
from tactopose_drake.core.motion.rigid_motion import Motion
from tactopose_drake.core.parameter_checks import params_of
from tactopose_drake.core.plain_values import copied, seal
from tactopose_drake.core.posterior.moved_origin import has_far_origin, mixture_of_origin
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.slip.slip_by_forces import BY_FORCES, detect_by_forces
from tactopose_drake.core.slip.slip_by_motion import BY_MOTION, detect_by_motion
from tactopose_drake.core.slip.slip_by_surface import BY_SURFACE, PoseChange, SlipTest, detect_by_surface
from tactopose_drake.core.times import has_exceeded, has_passed
from tactopose_drake.core.tracking.belief_prediction import follow_motion, motion_since, move_standing, unknown_past
from tactopose_drake.core.tracking.contact_errors import (
    as_doubted,
    follow_doubt,
    read_contacts,
    surest_position,
    with_errors,
)
from tactopose_drake.core.tracking.contact_update import follow_lasting_errors, update_modes
from tactopose_drake.core.tracking.frame import Frame
from tactopose_drake.core.tracking.keyframes import Keyframe, Touch, follow_touch, move_keyframes
from tactopose_drake.core.tracking.pose_belief import Explanation, PoseBelief, summarise
from tactopose_drake.core.tracking.relocalisation import relocalise
from tactopose_drake.core.tracking.sliced_search import search_on
from tactopose_drake.core.tracking.tracked_modes import has_moved, predict_modes
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams
from tactopose_drake.core.tracking.vision_update import see
from tactopose_drake.core.validation import instance_of
from tactopose_drake.errors import InvalidInputError


class PoseTracker:
    """Computes each belief from the previous one and a frame; keeps no state in between.

    For an object far from its frame's origin, all of a belief except its `mixture` refers to a frame at its middle.

    A reading that equals the last one to the last bit is taken for the same reading, which contains nothing new.
    """

    def __init__(self, model: ObjectModel, params: PoseTrackerParams | None = None) -> None:
        """Keeps a reference to the model, and loads and compiles what its steps run, so that none waits for it.

        Args:
            model: the object.
            params: what is assumed.
        """
        instance_of("model", model, ObjectModel)
        self._params = params_of(PoseTrackerParams, params)
        self._p_OC = model.middle if has_far_origin(model) else None
        self._model = model if self._p_OC is None else model.about_middle
        make_kernels_ready()
        self._model.make_ready(surest_position(self._params))

    def start(self, time: float = 0.0) -> PoseBelief:
        """The belief of no knowledge at a time, s."""
        past = unknown_past(self._params, time)
        nothing = PoseBelief(time=time, status="lost", history=past, remarks=("no estimate yet",))
        return _finished(nothing)

    def step(self, belief: PoseBelief, frame: Frame) -> PoseBelief:
        """Computes the belief at the frame's time.

        Args:
            belief: of an earlier time.
            frame: all that is sensed now.

        Raises:
            InvalidInputError: a frame earlier than the belief, or evidence that does not suit the object.
        """
        instance_of("belief", belief, PoseBelief)
        instance_of("frame", frame, Frame)
        if frame.time < belief.time:
            raise InvalidInputError(
                f"frame.time must be at least the belief's time, {belief.time:.15g} s, not {frame.time:.15g} s."
            )
        if self._p_OC is None:
            return self._step(belief, frame)
        after = self._step(belief, frame.of_middle(self._p_OC))
        return _finished(copied(after, mixture=mixture_of_origin(after.mixture, self._p_OC)))

    def _step(self, belief: PoseBelief, frame: Frame) -> PoseBelief:
        """One step for an object whose frame's origin is near it; it does not read the belief's mixture."""
        duration, params = frame.time - belief.time, self._params
        if belief.untouched is not None and self._is_over(belief, frame):
            # A touch that has ended without being explained, or was the first and short, is taken for none: fingers
            # that start to move feel inertia.
            belief = belief.untouched
        untouched = self._untouched(belief, frame)
        reading = as_doubted(read_contacts(frame, belief.sources, belief.contacts, belief.errors, params))
        belief = self._predict(belief, frame, reading, duration)
        belief, is_outlier = see(self._model, belief, frame, reading, params.vision)
        explanation = Explanation(self._model, reading.evidence, params.plausibility)
        if reading.is_new:
            belief = self._update_with_touch(belief, frame, reading, duration)
        if reading.has_contact:
            felt_time = {**belief.felt_time, **dict.fromkeys(frame.names, frame.time)}
            belief = copied(belief, touch_time=frame.time, felt_time=felt_time)
        # Nothing is searched between the readings of a slow sensor, but by contacts that stay exactly as they are.
        stays = reading.has_contact and has_exceeded(frame.time, belief.changed_time, params.flicker_time)
        if reading.is_new or stays:
            belief = self._relocalise(belief, frame, reading, duration, explanation, is_outlier=is_outlier)
        belief = summarise(self._model, params, belief, explanation, has_contact=reading.has_contact)
        if belief.explained_time == frame.time and not self._may_be_none(belief, untouched):
            untouched = None
        return _finished(belief if untouched is belief.untouched else copied(belief, untouched=untouched))

    def _may_be_none(self, belief: PoseBelief, untouched: PoseBelief | None) -> bool:
        """Whether a touch that is explained may still be spurious: it is the first, and new; some pose fits any."""
        is_first = untouched is not None and untouched.touch_time == -np.inf
        return is_first and not has_passed(belief.time, belief.unsettled_time, self._params.settling_time)

    def _is_over(self, belief: PoseBelief, frame: Frame) -> bool:
        """Whether the last touch has ended; allows for lost readings and flickering light touches."""
        goes_on = belief.touch_time == belief.time and len(frame.evidence.touch) > 0
        return not goes_on and has_exceeded(frame.time, belief.touch_time, self._params.flicker_time)

    def _untouched(self, belief: PoseBelief, frame: Frame) -> PoseBelief | None:
        """The belief without the current touch, if that has just begun or nothing has explained it yet."""
        is_over = self._is_over(belief, frame)
        before = belief if is_over and belief.has_pose else belief.untouched
        if before is None or (is_over and not len(frame.evidence.touch)):
            return None
        nothing = dataclasses.replace(frame.evidence, contacts=Contacts.empty(), patches=())
        return self._step(before, dataclasses.replace(frame, evidence=nothing, sources=()))

    def _predict(self, belief: PoseBelief, frame: Frame, reading: ContactReading, duration: float) -> PoseBelief:
        """The belief moved to the frame's time by the motion since, before any measurement."""
        params = self._params
        rigidity_test, slides = detect_by_motion(
            params.rigidity_test, belief.rigidity_test, reading, frame.tip_velocity, frame.time, duration
        )
        slip_time, slip_sign = (frame.time, BY_MOTION) if slides else (belief.slip_time, belief.slip_sign)
        slips = not has_passed(belief.time, slip_time, params.slip_time)
        is_over = self._is_over(belief, frame)
        motion = motion_since(params, belief, frame, reading.contacts, slips=slips, is_over=is_over)
        modes = belief.modes.with_sources(len(reading.sources))
        has_been_free = has_exceeded(frame.time, belief.touch_time, params.lost_time)
        was_taken = has_been_free and belief.touch_time > -np.inf and not reading.has_contact
        return copied(
            belief,
            time=frame.time,
            history=follow_motion(params, belief, motion, frame.time),
            search=belief.search.moved(motion),
            slip_test=belief.slip_test.moved(motion),
            rigidity_test=rigidity_test,
            slip_time=slip_time,
            slip_sign=slip_sign,
            sources=reading.sources,
            contacts=belief.contacts if reading.has_contact else Contacts.empty(),
            modes=predict_modes(modes, motion, params.mixture.max_sigma_translation),
            keyframes=move_keyframes(belief.keyframes, motion),
            standing=move_standing(belief, motion, frame.time, was_taken=was_taken),
            X_WP=frame.X_WP,
        )

    def _update_with_touch(
        self, belief: PoseBelief, frame: Frame, reading: ContactReading, duration: float
    ) -> PoseBelief:
        """Updates with new contacts."""
        time, params, modes, slips, test = frame.time, self._params, belief.modes, False, SlipTest()
        if len(modes):
            modes = update_modes(self._model, params, reading, modes)
            motion = belief.history.motions[-1] if duration > 0.0 else Motion(np.zeros(6), np.zeros((6, 6)))
            change = PoseChange(modes.X_PO[0], modes.roughness[0], motion)
            test, slips = detect_by_surface(self._model, params.slip, belief.slip_test, reading, change)
        # A source of the last frame has touched since, however long that was, as long as the object stays held.
        held = duration if duration <= params.noise.longest_gap else 0.0
        least_gap = max(params.lost_time, held)
        has_joined = any(has_exceeded(time, belief.felt_time.get(name, -np.inf), least_gap) for name in frame.names)
        force_test, gives_way = detect_by_forces(
            params.force_test, belief.force_test, reading, time, has_joined=has_joined
        )
        slip_sign = BY_FORCES if gives_way else BY_SURFACE if slips else belief.slip_sign
        slips = slips or gives_way or belief.slip_time == time
        now = Keyframe.of_now(reading, frame.names)
        return copied(
            belief,
            modes=modes,
            slip_test=test.restarted() if slips else test,
            force_test=force_test,
            keyframes=follow_touch(() if slips else belief.keyframes, now, params.window),
            contacts=reading.contacts,
            changed_time=time,
            joined_time=time if has_joined else belief.joined_time,
            slip_time=time if slips else belief.slip_time,
            slip_sign=slip_sign,
        )

    def _relocalise(
        self,
        belief: PoseBelief,
        frame: Frame,
        reading: ContactReading,
        duration: float,
        explanation: Explanation,
        *,
        is_outlier: bool,
    ) -> PoseBelief:
        """Advances the search for other modes; `is_outlier`: the best mode has just taken vision for an outlier."""
        time, params, modes, slips = frame.time, self._params, belief.modes, belief.slip_time == frame.time
        has_joined = belief.joined_time == time
        X_best, explained = modes.X_PO[:1], bool(explanation.of(modes.X_PO)[:1].any())
        unsettled_time = time if has_joined else belief.unsettled_time
        is_urgent = slips or is_outlier or not explained or not has_passed(time, unsettled_time, params.settling_time)
        if slips or is_outlier or has_joined:
            forgotten = belief.errors._replace(estimates=0)
            belief = copied(belief, search=belief.search._replace(agreeing=0), errors=forgotten)
            reading = reading._replace(errors=forgotten)
        # However rare frames are, a search should look at a touch before it has settled. If the best mode does not
        # explain the touch, finding any other soon is worth more of a frame's time than knowing it accurately.
        slices = None if duration >= params.settling_time else 1 if explained else 2
        belief = self._search(belief, frame, reading, is_urgent=is_urgent, slices=slices, thorough=explained)
        modes, test = belief.modes, belief.slip_test
        if len(modes):
            modes = modes.pruned(params.mixture)
            if not len(X_best) or has_moved(self._model, params, X_best, modes.X_PO[:1]):
                unsettled_time, test = time, test.restarted()
        return copied(belief, modes=modes, slip_test=test, unsettled_time=unsettled_time)

    def _search(
        self,
        belief: PoseBelief,
        frame: Frame,
        reading: ContactReading,
        *,
        is_urgent: bool,
        slices: int | None,
        thorough: bool,
    ) -> PoseBelief:
        """Advances the search, if one is due, by this many slices, or to its end."""
        params, search = self._params, belief.search
        if search.X_PO is None:
            if not search.is_due(frame.time, params.relocalisation, is_urgent=is_urgent):
                return belief
            search = search._replace(time=frame.time)
        touch = Touch(frame.evidence, reading, belief.keyframes, belief.standing, frame.depth_in_hand)
        step = search_on(self._model, params, touch, belief.modes, search, slices=slices, thorough=thorough)
        belief, found = copied(belief, search=step.state), step.found
        if step.errors is not None:
            belief, reading = self._follow_errors(belief, reading, step.errors)
        if found is None:
            return belief
        share = max(1.0 / (1.0 + step.state.agreeing), params.relocalisation.least_share)
        doubt = follow_doubt(belief.errors.doubt, found.inlier_probability, found.noise_scale, found.sources, share)
        belief, reading = self._follow_errors(belief, reading, belief.errors._replace(doubt=doubt))
        touch = touch._replace(reading=reading)
        modes = relocalise(self._model, params, touch, belief.modes, found.modes, share)
        return copied(belief, modes=modes, search=step.state._replace(agreeing=step.state.agreeing + 1))

    def _follow_errors(
        self, belief: PoseBelief, reading: ContactReading, errors: ErrorScales
    ) -> tuple[PoseBelief, ContactReading]:
        """Adapts the belief and the reading to another estimate of the contacts' errors."""
        after = with_errors(reading, errors, self._params)
        modes = follow_lasting_errors(belief.modes, reading, after, self._params)
        return copied(belief, errors=errors, modes=modes), after


def _finished(belief: PoseBelief) -> PoseBelief:
    """Makes the belief's arrays read-only: copies share them, and the next belief is made from them."""
    new = {name: value for name, value in vars(belief).items() if name not in ("history", "untouched")}
    seal((*new.values(), *belief.history.motions[-1:]))
    return belief
