"""The belief from frame to frame: predict, compare, update, look elsewhere."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.posterior.plausibility import explain_touch
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.belief_status import judge
from tactopose_drake.core.tracking.contact_update import Stable
from tactopose_drake.core.tracking.frame import Frame
from tactopose_drake.core.tracking.frame_touch import FrameTouch, gather_touch
from tactopose_drake.core.tracking.looking_elsewhere import where_to_look
from tactopose_drake.core.tracking.motion_history import MotionHistory
from tactopose_drake.core.tracking.new_modes import find_new_modes
from tactopose_drake.core.tracking.object_motion import Motion, move_freely, move_with_fingertips, move_with_palm
from tactopose_drake.core.tracking.pose_belief import PoseBelief
from tactopose_drake.core.tracking.pose_measurement import PoseMeasurement
from tactopose_drake.core.tracking.present_bounds import bound_modes
from tactopose_drake.core.tracking.touch_update import Felt, feel, join
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams
from tactopose_drake.core.tracking.vision_intake import believe_vision, take_in_vision
from tactopose_drake.core.validation import instance_of
from tactopose_drake.errors import InvalidInputError


class PoseTracker:
    """Makes beliefs of frames; keeps nothing between them.

    A reading that equals the last one to the last bit is taken for the same reading: it tells nothing new.
    """

    def __init__(self, model: ObjectModel, params: PoseTrackerParams | None = None) -> None:
        """Keeps a reference to the model.

        Args:
            model: the object.
            params: what is assumed.
        """
        instance_of("model", model, ObjectModel)
        self._params = PoseTrackerParams() if params is None else params
        instance_of("params", self._params, PoseTrackerParams)
        self._params.validate()
        self._model = model
        self._stable = Stable(
            (self._params.calibration_position, math.radians(self._params.calibration_normal_deg)),
            (self._params.surface_position, math.radians(self._params.surface_normal_deg)),
        )

    def start(self, time: float = 0.0) -> PoseBelief:
        """The belief that knows nothing, s."""
        return PoseBelief(time=time, status="lost", history=MotionHistory((time,)), remarks=("no estimate yet",))

    def step(self, belief: PoseBelief, frame: Frame) -> PoseBelief:
        """The belief at the frame's time.

        Args:
            belief: of an earlier time.
            frame: all that is sensed now.

        Raises:
            InvalidInputError: a frame of an earlier time than the belief's, or evidence that does not suit the object.
        """
        instance_of("belief", belief, PoseBelief)
        instance_of("frame", frame, Frame)
        duration = frame.time - belief.time
        if duration < 0.0:
            raise InvalidInputError(
                f"frame.time: is {frame.time:g} s; allowed is the belief's, {belief.time:g} s, or later."
            )
        touch = gather_touch(belief, frame)
        motion = self._motion(belief, frame, touch.contacts, duration)
        history = belief.history
        if duration > 0.0:
            history = history.followed_by(motion, frame.time, self._params.vision_memory)
        modes = belief.modes.with_sources(len(touch.sources)).moved(motion)
        seen, vision = take_in_vision(belief.vision, frame.vision, history, frame.time, self._params)
        doubted = False
        if seen is not None:
            modes, vision, doubted = believe_vision(modes, touch, seen, vision, frame.time)
        belief = dataclasses.replace(
            belief,
            time=frame.time,
            history=history,
            sources=touch.sources,
            modes=modes,
            vision=vision,
            X_WP=frame.X_WP,
        )
        if touch.is_new:
            belief = self._feel(belief, frame, touch, seen, doubted, duration)
        elif touch.is_felt:
            belief = dataclasses.replace(belief, touch_time=frame.time)
        return self._conclude(belief, frame, touch)

    def _motion(self, belief: PoseBelief, frame: Frame, contacts: Contacts, duration: float) -> Motion:
        """How the object moved since the belief's time."""
        slips, noise = belief.time < belief.slip_time + self._params.slip_time, self._params.noise
        if not len(contacts):
            return move_freely(noise, duration, belief.X_WP, frame.X_WP)
        if frame.tip_velocity is None:
            return move_with_palm(noise, duration, slips=slips)
        assert frame.sources is not None
        forces = frame.evidence.contacts if len(frame.evidence.contacts) == len(contacts) else contacts
        return move_with_fingertips(forces, frame.sources, frame.tip_velocity, noise, duration, slips=slips)

    def _feel(
        self,
        belief: PoseBelief,
        frame: Frame,
        touch: FrameTouch,
        seen: PoseMeasurement | None,
        doubted: bool,
        duration: float,
    ) -> PoseBelief:
        """The belief with a new touch."""
        time, params, modes = frame.time, self._params, belief.modes
        felt: Felt | None = None
        if len(modes):
            felt = feel(self._model, touch, self._stable, modes, min(1.0, duration / params.memory_time))
            modes = felt.modes
        slipped = felt is not None and felt.slipped
        explained = bool(len(modes)) and bool(explain_touch(self._model, frame.evidence, modes.X_PO[:1])[0])
        troubled = slipped or doubted or not explained or time > belief.touch_time + params.lost_time
        searches, search_time = belief.searches, belief.search_time
        if time >= search_time + (params.search_period_lost if troubled else params.search_period):
            look = where_to_look(belief, modes, seen, frame.evidence.prior, params.lost_time, troubled=troubled)
            found = find_new_modes(
                self._model,
                frame.evidence,
                look.near,
                touch.source,
                len(touch.sources),
                self._stable,
                params.max_modes,
                np.random.default_rng([params.seed, searches]),
            )
            modes = found if felt is None else join(felt, found, look)
            searches, search_time = searches + 1, time
        modes = modes.merged(self._model.symmetry_poses) if len(modes) else modes
        return dataclasses.replace(
            belief,
            modes=modes.best(params.max_modes, params.least_share),
            touched=touch.contacts.p_PC,
            touch_time=time,
            slip_time=time if slipped else belief.slip_time,
            searches=searches,
            search_time=search_time,
        )

    def _conclude(self, belief: PoseBelief, frame: Frame, touch: FrameTouch) -> PoseBelief:
        """The belief with what is told of it."""
        X_PO, covariance, probability = bound_modes(self._model, frame.evidence, belief.modes)
        order = np.argsort(-probability, kind="stable")
        X_PO, covariance, probability = X_PO[order], covariance[order], probability[order]
        explains = np.ones(len(X_PO), dtype=np.bool_)
        if touch.is_felt and len(X_PO):
            explains = explain_touch(self._model, frame.evidence, np.ascontiguousarray(X_PO))
        explained_time = belief.time if touch.is_felt and explains[:1].any() else belief.explained_time
        belief = dataclasses.replace(
            belief,
            X_PO=X_PO,
            covariance=covariance,
            probability=probability,
            explains_touch=explains,
            explained_time=explained_time,
        )
        status, remarks = judge(belief, touch.is_felt, self._params)
        if belief.vision.remark:
            remarks = (*remarks, belief.vision.remark)
        return dataclasses.replace(belief, status=status, remarks=remarks)
