"""The belief from frame to frame: predict, compare, update, look elsewhere."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.contacts import Contacts
from tactopose_drake.core.objects import ObjectModel
from tactopose_drake.core.plausibility import explain_touch
from tactopose_drake.core.tracking.contact_update import Stable, number_of_numbers, update_with_contacts
from tactopose_drake.core.tracking.frame import Frame
from tactopose_drake.core.tracking.mode_set import ModeSet
from tactopose_drake.core.tracking.motion_history import MotionHistory
from tactopose_drake.core.tracking.new_modes import SLIPPED, around, find_new_modes
from tactopose_drake.core.tracking.object_motion import (
    Motion,
    MotionNoise,
    move_freely,
    move_with_fingertips,
    move_with_palm,
)
from tactopose_drake.core.tracking.pose_belief import BeliefStatus, PoseBelief, VisionRecord
from tactopose_drake.core.tracking.pose_measurement import PoseMeasurement
from tactopose_drake.core.tracking.present_bounds import bound_modes
from tactopose_drake.core.tracking.surprise import calmed, is_surprised, watch
from tactopose_drake.core.tracking.touch_memory import fade, remember, worth_of_a_frame
from tactopose_drake.core.validation import positive_number
from tactopose_drake.errors import InvalidInputError

# The mode that carries more than this share of the mass is the answer.
_MOST_OF_THE_MASS = 0.5
# Prior probabilities that the object is where no mode has it: anywhere when nothing says so; near the best mode, which
# may be too sure of itself; and when the touch or vision say so.
_UNSEEN_JUMP, _TOO_SURE, _JUMP = 1e-4, 0.01, 0.1
# While all is well every so many-th look is anywhere, the others near the best mode.
_ANYWHERE = 8
# The density of poses of vision that are errors: one in twenty, turned at random, within a cubic metre.
_LOG_OUTLIER = math.log(0.05 / (8.0 * math.pi**2))
# So many times of poses of vision are remembered.
_REMEMBERED = 16


@dataclasses.dataclass(kw_only=True, slots=True)
class PoseTrackerParams:
    """What the belief assumes of the hand and of the motion, and how much it works."""

    calibration_position: float = 0.0005  # the part of a contact's error that never changes, of each coordinate, m
    calibration_normal_deg: float = 2.5  # likewise of its normal about each axis, deg
    surface_position: float = 0.0001  # how far the model's surface is from the object's, m
    surface_normal_deg: float = 1.0  # how far its normals are about each axis, deg
    noise: MotionNoise = dataclasses.field(default_factory=MotionNoise)
    max_modes: int = 8  # kept at the most
    least_share: float = 1e-7  # of the mass of the best mode; less is dropped
    slip_time: float = 0.1  # s for which a slip that was found is taken to go on
    lost_time: float = 0.2  # s without an explanation of the touch, after which the pose is lost
    forget_time: float = 1.0  # s without touch or vision, after which the pose is lost
    memory_time: float = 0.3  # s after which what the touch told of the pose has faded
    search_period: float = 0.4  # s between two looks elsewhere, while all is well
    search_period_lost: float = 0.05  # s between two looks elsewhere, while it is not
    vision_time: float = 0.5  # s after which the error of vision is a new one; more frequent poses count less
    vision_memory: float = 1.0  # s; what vision saw earlier is of no use
    seed: int = 0  # of the searches' random numbers

    def validate(self) -> None:
        """Raises InvalidInputError if a number is out of its range."""
        self.noise.validate()
        for field in dataclasses.fields(self):
            if isinstance(getattr(self, field.name), float):
                positive_number(f"PoseTrackerParams.{field.name}", getattr(self, field.name))
        for name, least in (("max_modes", 1), ("seed", 0)):
            if getattr(self, name) < least:
                raise InvalidInputError(
                    f"PoseTrackerParams.{name}: is {getattr(self, name)}; allowed are integers >= {least}."
                )


class _Touch(NamedTuple):
    """The contacts of a frame by the sources that the belief knows.

    Attributes:
        contacts: all points that are touched.
        source: the source of each, shape (k,).
        sources: names of all sources.
        is_new: whether this reading is not the last one again.
    """

    contacts: Contacts
    source: NDArray[np.intp]
    sources: tuple[str, ...]
    is_new: bool

    @property
    def is_felt(self) -> bool:
        return len(self.contacts) > 0


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
        self._params = PoseTrackerParams() if params is None else params
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
        duration = frame.time - belief.time
        if duration < 0.0:
            raise InvalidInputError(
                f"frame.time: is {frame.time:g} s; allowed is the belief's, {belief.time:g} s, or later."
            )
        touch = _gather(belief, frame)
        motion = self._motion(belief, frame, touch.contacts, duration)
        history = belief.history
        if duration > 0.0:
            history = history.followed_by(motion, frame.time, self._params.vision_memory)
        modes = belief.modes.with_sources(len(touch.sources)).moved(motion)
        seen, vision = self._look(belief, frame, history)
        doubted = False
        if seen is not None and len(modes):
            modes, believed = modes.seen(seen, _LOG_OUTLIER)
            doubted = not believed[0]
            if doubted:
                vision = dataclasses.replace(vision, remark="vision is not believed")
            else:
                vision = dataclasses.replace(vision, believed_time=frame.time)
        elif seen is not None and not touch.is_felt:
            cross = np.zeros((1, 6, 6 * len(touch.sources)))
            flat, even = np.zeros((1, len(touch.sources), 2)), np.zeros(1)
            modes = ModeSet.make(seen.X_PO[None], seen.covariance[None], cross, flat, even, even)
            vision = dataclasses.replace(vision, believed_time=frame.time)
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

    def _look(
        self, belief: PoseBelief, frame: Frame, history: MotionHistory
    ) -> tuple[PoseMeasurement | None, VisionRecord]:
        """What vision says that is new, as of now, and the record of it."""
        seen, record = frame.vision, belief.vision
        if seen is None:
            return None, record
        age = frame.time - seen.time
        if age > self._params.vision_memory:
            return None, dataclasses.replace(record, remark=f"vision is of {age:.1f} s ago")
        if age < 0.0:
            return None, dataclasses.replace(record, remark="vision is of the future")
        if seen.time in record.times:
            return None, record
        times = (*record.times[-_REMEMBERED:], seen.time)
        if record.X_PO is not None and np.array_equal(record.X_PO, seen.X_PO):
            return None, dataclasses.replace(record, times=times, remark="vision is frozen")
        here = history.bring_here(seen)
        record = dataclasses.replace(record, times=times, X_PO=seen.X_PO, remark="")
        if here is None:
            return None, record
        if len(times) > 1:
            # The errors of pictures that follow each other are much the same.
            since = max(min(abs(seen.time - time) for time in times[:-1]), 1e-3 * self._params.vision_time)
            here = dataclasses.replace(here, covariance=here.covariance * max(1.0, self._params.vision_time / since))
        return here, record

    def _feel(
        self,
        belief: PoseBelief,
        frame: Frame,
        touch: _Touch,
        seen: PoseMeasurement | None,
        doubted: bool,
        duration: float,
    ) -> PoseBelief:
        """The belief with a new touch."""
        time, params = frame.time, self._params
        modes, slip_time = belief.modes, belief.slip_time
        if len(modes):
            modes = fade(self._model, touch.contacts, modes, min(1.0, duration / params.memory_time))
            update = update_with_contacts(
                self._model,
                touch.contacts,
                touch.source,
                self._stable,
                modes.X_PO,
                modes.covariance,
                modes.cross,
                modes.roughness,
            )
            evidence = np.logaddexp.reduce(modes.log_weight + update.log_evidence)
            modes = remember(watch(modes, update, number_of_numbers(touch.contacts)), update.log_evidence, update.stays)
            modes = modes.touched(touch.source, update.roughness, self._stable.variances[[0, 3]])
            order = np.argsort(-modes.log_weight, kind="stable")
            modes = modes.chosen(order)
            of_this_frame = worth_of_a_frame(modes, update.stays)[0]
            before = modes.log_touch[0] - of_this_frame * update.log_evidence[order[0]]
        slipped = bool(len(modes) and is_surprised(modes.chosen([0]))[0])
        if slipped:
            modes, slip_time = calmed(modes), time
        explained = bool(len(modes)) and bool(explain_touch(self._model, frame.evidence, modes.X_PO[:1])[0])
        troubled = slipped or doubted or not explained or time > belief.touch_time + params.lost_time
        searches, search_time = belief.searches, belief.search_time
        if time >= search_time + (params.search_period_lost if troubled else params.search_period):
            near = self._where(belief, frame, seen, modes, troubled)
            found = self._search(belief, frame, touch, near)
            if len(modes):
                jump = _UNSEEN_JUMP if near is None else _JUMP if troubled or seen is not None else _TOO_SURE
                total = np.logaddexp.reduce(modes.log_weight) + math.log(jump) + found.log_weight - evidence
                log_touch = before + of_this_frame * found.log_touch
                found = dataclasses.replace(
                    found,
                    log_prior=total - log_touch,
                    log_touch=log_touch,
                    frames=np.full(len(found), modes.frames[0]),
                )
            else:
                found = dataclasses.replace(found, frames=np.ones(len(found)))
            modes = modes.joined(found)
            searches, search_time = searches + 1, time
        modes = modes.merged(self._model.symmetry_poses) if len(modes) else modes
        modes = modes.best(params.max_modes, params.least_share)
        return dataclasses.replace(
            belief,
            modes=modes,
            touched=touch.contacts.p_PC,
            touch_time=time,
            slip_time=slip_time,
            searches=searches,
            search_time=search_time,
        )

    def _where(
        self, belief: PoseBelief, frame: Frame, seen: PoseMeasurement | None, modes: ModeSet, troubled: bool
    ) -> PoseMeasurement | None:
        """Where modes that the belief lacks may be: where vision or a prior says, near the best, or anywhere: None."""
        time = frame.time
        if seen is not None:
            return seen
        if not len(modes):
            prior = frame.evidence.prior
            return None if prior is None else PoseMeasurement.from_prior(prior, time)
        if time > belief.touch_time + self._params.lost_time:
            return PoseMeasurement(time, belief.modes.X_PO[0], belief.modes.covariance[0])
        # It slips before it is anywhere: that is asked when near the best there is no explanation.
        explained = time < belief.explained_time + 0.5 * self._params.lost_time
        is_near = explained if troubled else belief.searches % _ANYWHERE > 0
        return around(modes.X_PO[0], *SLIPPED, time) if is_near else None

    def _search(self, belief: PoseBelief, frame: Frame, touch: _Touch, near: PoseMeasurement | None) -> ModeSet:
        """Modes that the belief may lack."""
        return find_new_modes(
            self._model,
            frame.evidence,
            near,
            touch.source,
            len(touch.sources),
            self._stable,
            self._params.max_modes,
            np.random.default_rng([self._params.seed, belief.searches]),
        )

    def _conclude(self, belief: PoseBelief, frame: Frame, touch: _Touch) -> PoseBelief:
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
        status, remarks = self._judge(belief, touch)
        if belief.vision.remark:
            remarks = (*remarks, belief.vision.remark)
        return dataclasses.replace(belief, status=status, remarks=remarks)

    def _judge(self, belief: PoseBelief, touch: _Touch) -> tuple[BeliefStatus, tuple[str, ...]]:
        """The status, and why."""
        params, time = self._params, belief.time
        if not touch.is_felt:
            if not belief.has_pose:
                return "lost", ("nothing is touched",)
            since = time - max(belief.touch_time, belief.vision.believed_time)
            if since > params.forget_time:
                return "lost", (f"nothing was touched or seen for {since:.1f} s",)
            return "no_contact", ()
        if not belief.has_pose:
            return "lost", ("no pose explains the touch",)
        if time > belief.explained_time + params.lost_time:
            return "lost", ("no pose explains the touch",)
        if time < belief.slip_time + params.slip_time or not belief.explains_touch[0]:
            return "slipping", ()
        if belief.probability[0] < _MOST_OF_THE_MASS:
            return "ambiguous", ()
        return "ok", ()


def _gather(belief: PoseBelief, frame: Frame) -> _Touch:
    """The frame's touch by the sources known so far and the new ones."""
    contacts = frame.evidence.touch
    assert frame.sources is not None
    sources = belief.sources + tuple(name for name in frame.sources if name not in belief.sources)
    source = np.array([sources.index(name) for name in frame.sources], dtype=np.intp)
    is_new = len(contacts) > 0 and not np.array_equal(contacts.p_PC, belief.touched)
    return _Touch(contacts, source, sources, is_new)
