"""Where an object is believed to be at one time: data, from which and a frame the next is made."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.plain_values import numbers
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture
from tactopose_drake.core.tracking.frame import PoseMeasurement
from tactopose_drake.core.tracking.keyframes import Keyframe
from tactopose_drake.core.tracking.motion_prediction import MotionHistory
from tactopose_drake.core.tracking.tracked_modes import TrackedModes
from tactopose_drake.core.validation import FloatArray

BeliefStatus = Literal["ok", "ambiguous", "slipping", "no_contact", "lost"]


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class VisionRecord:
    """What vision has said so far.

    Attributes:
        times: of the poses that were used or turned down lately, s.
        X_PO: the last of them, shape (3, 4); None before the first.
        accepted_time: when the best mode last took one for an inlier, s.
        remark: what is wrong with it; empty where nothing is.
    """

    times: tuple[float, ...] = ()
    X_PO: FloatArray | None = None
    accepted_time: float = -np.inf
    remark: str = ""


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class PoseBelief:
    """The belief at one time; frozen, so that copies are shared.

    Attributes:
        time: s.
        status: "ok"; "ambiguous" when no mode carries nearly all of the mass, or the touch is too new; "slipping" when
            the touch is not what the motion predicts, and the belief follows it; "no_contact" when nothing is touched,
            so that the pose is only predicted; "lost" when no pose is known that explains the touch, or nothing has
            been touched for long: what stands here is then no estimate.
        remarks: what else is to be known of the belief.
        mixture: the pose's modes by falling probability; none where nothing is known yet.
        explains_touch: which of them noise alone may separate from the touch, shape (n,).
        modes: what is carried on of them: the same without what bounds the pose at this time only.
        keyframes: touches of the past that told something new, oldest first.
        standing: what a prior and vision said, as of now; None where they said nothing, or of another grasp.
        sources: the names of the contacts' sources, in the order of the modes' biases.
        history: the latest motions.
        p_PC: the last contacts' points, shape (k, 3), m.
        touch_time, explained_time, slip_time: when something was last touched, and explained, and when it last slipped,
            s.
        unsettled_time: when another finger came to touch, or the best mode became another one, s.
        felt_time: of each source by its name, when it last touched, s.
        search_time: when modes were last searched for, s.
        searches: how many searches there were.
        vision: what vision has said.
        X_WP: where the palm was, shape (3, 4); None where that is not known.
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
    p_PC: FloatArray = dataclasses.field(default_factory=lambda: np.zeros((0, 3)))
    touch_time: float = -np.inf
    explained_time: float = -np.inf
    slip_time: float = -np.inf
    unsettled_time: float = -np.inf
    felt_time: Mapping[str, float] = dataclasses.field(default_factory=dict)
    search_time: float = -np.inf
    searches: int = 0
    vision: VisionRecord = dataclasses.field(default_factory=VisionRecord)
    X_WP: FloatArray | None = None

    def __repr__(self) -> str:
        best = f", best {self.probability[0]:.0%} at {numbers(1e3 * self.X_PO[0, :, 3], 1)} mm" if self.has_pose else ""
        return f"<PoseBelief at {self.time:.3f} s: {self.message}; {len(self.mixture)} modes{best}>"

    def __deepcopy__(self, memo: Any) -> PoseBelief:
        return self

    @property
    def X_PO(self) -> FloatArray:
        """The modes' poses, shape (n, 3, 4)."""
        return self.mixture.X_PO

    @property
    def covariance(self) -> FloatArray:
        """Of the increments (w, v) from them, shape (n, 6, 6), rad and m."""
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
