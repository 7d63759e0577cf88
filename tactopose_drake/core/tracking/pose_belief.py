"""The belief about the object's pose at one time, as data from which the next one is made with a frame."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.evidence.contact_reading import ErrorScales
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.kernels.matrix_kernels import inverses
from tactopose_drake.core.motion.rigid_motion import MotionHistory
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.plain_values import ReadOnlyCopies, copied, counted, numbers
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture
from tactopose_drake.core.posterior.modes import determined_rows, determined_variance, free_directions
from tactopose_drake.core.posterior.plausibility import explain_touch
from tactopose_drake.core.posterior.posterior_params import DEFAULT_PARAMS, ModeParams, PlausibilityParams
from tactopose_drake.core.shape.free_spin import continuous_turns
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.slip.slip_by_forces import ForceTest
from tactopose_drake.core.slip.slip_by_motion import RigidityTest
from tactopose_drake.core.slip.slip_by_surface import SlipTest
from tactopose_drake.core.statuses import BeliefStatus
from tactopose_drake.core.times import has_exceeded, has_passed
from tactopose_drake.core.tracking.frame import PoseMeasurement
from tactopose_drake.core.tracking.keyframes import Keyframe
from tactopose_drake.core.tracking.sliced_search import SearchState
from tactopose_drake.core.tracking.tracked_modes import TrackedModes
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams
from tactopose_drake.core.validation import FloatArray


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class VisionRecord:
    """What vision has said so far.

    Attributes:
        times: of the latest poses that were used or rejected, s.
        last: the last of them; None before the first.
        accepted_time: when the best mode last took one for an inlier, s.
        remark: what is wrong with vision; empty if nothing is.
        prior: the last prior that was used, before the object was felt; None if there was none.
        spent: the last prior used by an earlier belief, which does not apply to another grasp; None if there was none.
    """

    times: tuple[float, ...] = ()
    last: PoseMeasurement | None = None
    accepted_time: float = -np.inf
    remark: str = ""
    prior: GaussianPrior | None = None
    spent: GaussianPrior | None = None

    def of_next_belief(self) -> VisionRecord:
        """The record for a belief that starts anew: its prior is spent."""
        return dataclasses.replace(self, prior=None, spent=self.spent if self.prior is None else self.prior)


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class PoseBelief(ReadOnlyCopies):
    """The belief at one time; frozen, with read-only arrays, so that copies are shared.

    Attributes:
        time: s.
        status: "ok"; "ambiguous" if no mode carries nearly all of the mass, the best one is a whole family of poses,
            or the touch is too new; "slipping" if the touch is not what the motion predicts, and the belief follows
            it; "no_contact" if nothing is touched, so that the pose is only predicted; "lost" if no known pose explains
            the touch, or nothing has been touched for long: the poses are then no estimate.
        remarks: further explanations of the status.
        mixture: the pose's modes in descending order of probability; none if nothing is known yet.
        explains_touch: whether noise alone may explain the residuals at each of them, shape (n,).
        modes: the filter's state of the modes, without what bounds the pose at this time only.
        keyframes: past touches that told something new, oldest first.
        standing: the fused pose from a prior and vision, moved to this time; None if they said nothing, or of another
            grasp.
        sources: the names of the contacts' sources, in the order of the modes' biases.
        history: the latest motions.
        contacts: those of the last frame; empty if nothing was touched.
        touch_time, explained_time, slip_time: when something was last touched, when a touch was last explained, and
            when the object last slipped, s.
        changed_time: when the contacts last differed from those of the frame before, s.
        slip_sign: what revealed the last slip; empty if there was none.
        slip_test, force_test, rigidity_test: states of the slip detectors.
        errors: estimated factors of the variances of the contacts' lasting errors.
        joined_time: when a further finger last touched, s.
        unsettled_time: the same, or when the best mode changed since, s.
        felt_time: when each source last touched, by its name, s.
        search: progress of the search for other modes.
        vision: record of the poses from vision.
        X_WP: the last pose of the palm, shape (3, 4); None if unknown.
        untouched: the belief as if nothing had been touched since this touch began; None once the touch is explained
            and, if it is the first one, no longer new.
    """

    time: float
    status: BeliefStatus
    history: MotionHistory
    remarks: tuple[str, ...] = ()
    mixture: GaussianMixture = dataclasses.field(default_factory=GaussianMixture.empty)
    explains_touch: NDArray[np.bool_] = dataclasses.field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    modes: TrackedModes = dataclasses.field(default_factory=TrackedModes.empty)
    keyframes: tuple[Keyframe, ...] = ()
    standing: PoseMeasurement | None = None
    sources: tuple[str, ...] = ()
    contacts: Contacts = dataclasses.field(default_factory=Contacts.empty)
    touch_time: float = -np.inf
    explained_time: float = -np.inf
    slip_time: float = -np.inf
    changed_time: float = -np.inf
    slip_sign: str = ""
    slip_test: SlipTest = dataclasses.field(default_factory=SlipTest)
    force_test: ForceTest = dataclasses.field(default_factory=ForceTest)
    rigidity_test: RigidityTest = dataclasses.field(default_factory=RigidityTest)
    errors: ErrorScales = dataclasses.field(default_factory=ErrorScales)
    joined_time: float = -np.inf
    unsettled_time: float = -np.inf
    felt_time: Mapping[str, float] = dataclasses.field(default_factory=dict)
    search: SearchState = dataclasses.field(default_factory=SearchState)
    vision: VisionRecord = dataclasses.field(default_factory=VisionRecord)
    X_WP: FloatArray | None = None
    untouched: PoseBelief | None = None

    def __repr__(self) -> str:
        best = f", best {self.probability[0]:.0%} at {numbers(1e3 * self.X_PO[0, :, 3], 1)} mm" if self.has_pose else ""
        return f"<PoseBelief at {self.time:.3f} s: {self.message}; {counted(len(self.mixture), 'mode', 'modes')}{best}>"

    def __deepcopy__(self, memo: Any) -> PoseBelief:
        return self

    @property
    def X_PO(self) -> FloatArray:
        """The modes' poses, shape (n, 3, 4)."""
        return self.mixture.X_PO

    @property
    def covariance(self) -> FloatArray:
        """Of the increments (w, v) from the poses, shape (n, 6, 6), rad and m."""
        return self.mixture.covariance

    @property
    def probability(self) -> FloatArray:
        """The modes' weights, shape (n,); they sum to 1."""
        return self.mixture.weights

    @property
    def has_pose(self) -> bool:
        """Whether there is a mode at all."""
        return len(self.mixture) > 0

    @property
    def message(self) -> str:
        """The status, and after a colon the remarks."""
        return f"{self.status}: {'; '.join(self.remarks)}" if self.remarks else self.status


class Explanation:
    """Tells which poses explain a touch up to noise; remembers the answer for the last poses."""

    def __init__(self, model: ObjectModel, evidence: Evidence, params: PlausibilityParams) -> None:
        self.evidence = evidence
        self._model, self._params = model, params
        self._X_PO, self._explained = np.zeros((0, 3, 4)), np.zeros(0, dtype=np.bool_)

    def of(self, X_PO: FloatArray) -> NDArray[np.bool_]:
        """Which of the poses (n, 3, 4) explain the touch, shape (n,)."""
        if not np.array_equal(X_PO, self._X_PO):
            self._X_PO, self._explained = X_PO, explain_touch(self._model, self.evidence, X_PO, self._params)
        return self._explained


def summarise(
    model: ObjectModel, params: PoseTrackerParams, belief: PoseBelief, explanation: Explanation, *, has_contact: bool
) -> PoseBelief:
    """The belief with mixture and status from its modes and the current touch."""
    weights = np.exp(belief.modes.log_weight - belief.modes.log_weight.max(initial=-np.inf))
    weights = weights / weights.sum()
    order = np.argsort(-weights, kind="stable")
    mixture = GaussianMixture(belief.modes.X_PO[order], weights[order], belief.modes.covariance[order])
    explains = explanation.of(mixture.X_PO) if has_contact else np.ones(len(mixture), dtype=np.bool_)
    explained_time = belief.time if has_contact and explains[:1].any() else belief.explained_time
    belief = copied(belief, mixture=mixture, explains_touch=explains, explained_time=explained_time)
    status, remarks = judge(belief, params, has_contact=has_contact)
    if status == "ok" and (reason := _left_open(model, params, belief, explanation.evidence)):
        status, remarks = "ambiguous", (reason,)
    if belief.vision.remark:
        remarks = (*remarks, belief.vision.remark)
    return copied(belief, status=status, remarks=remarks)


def _left_open(model: ObjectModel, params: PoseTrackerParams, belief: PoseBelief, evidence: Evidence) -> str:
    """Why the best mode is no answer although it carries the mass; empty if it is one.

    It is none if it is a whole family of poses. One direction may be free, such as the slide along a rod, and so may
    the object's symmetries. What the current touch determines must be known to the tolerance of an answer: a wider mode
    extends to where the touch has more information.
    """
    is_seen = belief.vision.accepted_time >= max(belief.unsettled_time, belief.slip_time)
    count, fewest = len(belief.contacts), DEFAULT_PARAMS.modes.fewest_contacts
    if count < fewest and not is_seen:
        return f"{counted(count, 'contact', 'contacts')}; {fewest} are needed, or vision since then"
    X_PO, covariance = belief.X_PO[:1], belief.covariance[0]
    turns = continuous_turns(model.symmetries, X_PO[0])
    most_turn, most_free = math.radians(params.answer_turn_deg), DEFAULT_PARAMS.modes.free_share * model.size
    widest = min(params.answer_distance, 0.5 * model.size * most_turn, most_free)
    if determined_variance(covariance, turns, model.size) < widest**2:
        return ""  # The variances of all directions together are below the limit.
    free = free_directions(inverses(covariance[None])[0], model.size, known=[turns])[0]
    if len(free) > 1 + len(turns):
        return f"{len(free)} directions are left open"
    information = SurfaceContact(model.grid, evidence.touch).normal_equations(X_PO).hessian
    untold = free_directions(information, model.size, known=[turns], params=ModeParams(free_share=params.untold_share))
    rows = determined_rows(covariance, untold[0], model.size)
    parts = np.stack([rows[:, :3].T @ rows[:, :3], rows[:, 3:].T @ rows[:, 3:]])
    turn, slide = np.sqrt(np.maximum(np.linalg.eigvalsh(parts)[:, -1], 0.0)).tolist()
    if turn > most_turn or slide > params.answer_distance:
        return f"known to {1e3 * slide:.0f} mm and {np.degrees(turn):.0f} degrees"
    return ""


def judge(belief: PoseBelief, params: PoseTrackerParams, *, has_contact: bool) -> tuple[BeliefStatus, tuple[str, ...]]:
    """The status of a belief with or without contacts, and the reason for it."""
    time = belief.time
    if not has_contact:
        if not belief.has_pose:
            return "lost", ("nothing is touched",)
        last = max(belief.touch_time, belief.vision.accepted_time)
        if has_exceeded(time, last, params.unobserved_time):
            return "lost", (f"nothing was touched or seen for {time - last:.1f} s",)
        return "no_contact", ()
    if not belief.has_pose or has_exceeded(time, belief.explained_time, params.lost_time):
        return "lost", ("no pose explains the touch",)
    if not has_passed(time, belief.slip_time, params.slip_time):
        return "slipping", (belief.slip_sign,)
    if not belief.explains_touch[0]:
        return "slipping", ("the best pose does not explain the touch",)
    if belief.probability[0] < params.answer_probability:
        return "ambiguous", (f"the likeliest of several poses carries less than {params.answer_probability:.0%}",)
    if not has_passed(time, belief.unsettled_time, params.settling_time):
        return "ambiguous", ("the touch is new",)
    return "ok", ()
