"""The belief from frame to frame: predict, update with vision and touch, test for consistency, relocalise."""

from __future__ import annotations

import dataclasses

import numpy as np

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.kernel_library import make_kernels_ready
from tactopose_drake.core.posterior.plausibility import explain_touch
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.belief_summary import summarise
from tactopose_drake.core.tracking.frame import ContactReading, Frame, PoseMeasurement, read_contacts
from tactopose_drake.core.tracking.measurement_update import MeasurementUpdate, update_modes
from tactopose_drake.core.tracking.motion_prediction import (
    Motion,
    MotionHistory,
    move_freely,
    move_with_fingertips,
    move_with_palm,
    predict_modes,
)
from tactopose_drake.core.tracking.pose_belief import PoseBelief
from tactopose_drake.core.tracking.relocalisation import add_proposals, choose_region, propose_modes
from tactopose_drake.core.tracking.tracked_modes import TrackedModes
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams
from tactopose_drake.core.tracking.vision_update import read_vision, update_with_vision
from tactopose_drake.core.validation import instance_of
from tactopose_drake.errors import InvalidInputError


class PoseTracker:
    """Makes beliefs of frames; keeps nothing between them.

    A reading that equals the last one to the last bit is taken for the same reading: it tells nothing new.
    """

    def __init__(self, model: ObjectModel, params: PoseTrackerParams | None = None) -> None:
        """Keeps a reference to the model, and makes ready what its steps run: nothing is compiled in one.

        Args:
            model: the object.
            params: what is assumed.
        """
        instance_of("model", model, ObjectModel)
        self._params = PoseTrackerParams() if params is None else params
        instance_of("params", self._params, PoseTrackerParams)
        self._params.validate()
        self._model = model
        make_kernels_ready()
        model.make_ready()

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
        duration, params = frame.time - belief.time, self._params
        if duration < 0.0:
            raise InvalidInputError(
                f"frame.time: is {frame.time:g} s; allowed is the belief's, {belief.time:g} s, or later."
            )
        reading = read_contacts(frame, belief.sources, belief.p_PC)
        belief = self._predict(belief, frame, reading, duration)
        measurement, record = read_vision(belief.vision, frame.vision, belief.history, frame.time, params.vision)
        modes, is_outlier = belief.modes, False
        if measurement is not None:
            modes, record, is_outlier = update_with_vision(modes, reading, measurement, record, params.vision)
        belief = dataclasses.replace(belief, modes=modes, vision=record)
        if reading.is_new:
            belief = self._update_with_touch(belief, frame, reading, measurement, duration, is_outlier=is_outlier)
        elif reading.has_contact:
            belief = dataclasses.replace(belief, touch_time=frame.time)
        return summarise(self._model, params, belief, frame.evidence, has_contact=reading.has_contact)

    def _predict(self, belief: PoseBelief, frame: Frame, reading: ContactReading, duration: float) -> PoseBelief:
        """The belief at the frame's time, before anything that is sensed then."""
        motion, history = self._motion(belief, frame, reading.contacts, duration), belief.history
        if duration > 0.0:
            history = history.followed_by(motion, frame.time, self._params.vision.max_age)
        modes = belief.modes.with_sources(len(reading.sources))
        return dataclasses.replace(
            belief,
            time=frame.time,
            history=history,
            sources=reading.sources,
            modes=predict_modes(modes, motion, self._params.mixture.max_sigma_translation),
            X_WP=frame.X_WP,
        )

    def _motion(self, belief: PoseBelief, frame: Frame, contacts: Contacts, duration: float) -> Motion:
        """How the object moved since the belief's time."""
        slips, noise = belief.time < belief.slip_time + self._params.slip_time, self._params.noise
        if not len(contacts) or duration > noise.longest_gap:
            most = self._params.mixture.max_sigma_translation
            return move_freely(noise, duration, most, belief.X_WP, frame.X_WP)
        if frame.tip_velocity is None:
            return move_with_palm(noise, duration, slips=slips)
        assert frame.sources is not None
        forces = frame.evidence.contacts if len(frame.evidence.contacts) == len(contacts) else contacts
        return move_with_fingertips(forces, frame.sources, frame.tip_velocity, noise, duration, slips=slips)

    def _update_with_touch(
        self,
        belief: PoseBelief,
        frame: Frame,
        reading: ContactReading,
        measurement: PoseMeasurement | None,
        duration: float,
        *,
        is_outlier: bool,
    ) -> PoseBelief:
        """The belief with new contacts, by what vision measured and whether that is an outlier."""
        time, params, mixture = frame.time, self._params, self._params.mixture
        update: MeasurementUpdate | None = None
        modes = belief.modes
        if len(modes):
            update = update_modes(self._model, params, reading, modes, duration)
            modes = update.modes
        slips = update is not None and update.is_inconsistent
        best = modes.X_PO[:1]
        explained = bool(len(modes) and explain_touch(self._model, frame.evidence, best, params.plausibility)[0])
        is_urgent = slips or is_outlier or not explained or time > belief.touch_time + params.lost_time
        searches, search_time = belief.searches, belief.search_time
        settings = params.relocalisation
        if time >= search_time + (settings.urgent_period if is_urgent else settings.period):
            modes = self._relocalise(belief, frame, reading, measurement, update, is_urgent=is_urgent)
            searches, search_time = searches + 1, time
        modes = modes.merged(self._model.symmetry_poses, mixture.same_sigmas) if len(modes) else modes
        return dataclasses.replace(
            belief,
            modes=modes.pruned(mixture),
            p_PC=reading.contacts.p_PC,
            touch_time=time,
            slip_time=time if slips else belief.slip_time,
            searches=searches,
            search_time=search_time,
        )

    def _relocalise(
        self,
        belief: PoseBelief,
        frame: Frame,
        reading: ContactReading,
        measurement: PoseMeasurement | None,
        update: MeasurementUpdate | None,
        *,
        is_urgent: bool,
    ) -> TrackedModes:
        """The modes after the touch with those that a search finds; the latter alone where there were none."""
        modes = belief.modes if update is None else update.modes
        prior, generator = frame.evidence.prior, np.random.default_rng([self._params.seed, belief.searches])
        region = choose_region(belief, modes, measurement, prior, self._params, is_urgent=is_urgent)
        proposed = propose_modes(self._model, self._params, frame.evidence, reading, region.near, generator)
        return proposed if update is None else add_proposals(update, proposed, region)
