"""What an estimate says: the hypotheses of the object's pose, and how far they can be trusted."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
from pydrake.math import RigidTransform

from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture
from tactopose_drake.core.posterior.posterior_params import DEFAULT_PARAMS
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.estimation.question import Presentable, Question

Status = Literal["ok", "ambiguous", "no_solution"]


@dataclasses.dataclass(frozen=True, eq=False)
class PoseHypothesis:
    """One pose that explains the touch.

    Attributes:
        X_PO: the object's pose in the palm frame: the mean of its mode, as far as that explains the touch about as
            well as the mode's minimum does (its cost is higher by 0.3 at the most).
        cost: its negative log likelihood up to a constant: half the sum of squared whitened residuals.
        probability: posterior weight among the hypotheses.
        covariance: (6, 6) of the increment (w, v): R_PO = R_hat exp(w), p_PO = p_hat + v; rad, m (v in P).
        free_directions: increments that the touch does not determine, orthonormal rows (f, 6); f = 0 where the pose is
            determined. Along them the pose is the prior's, or arbitrary.
        explains_touch: whether noise alone may leave the contacts' residuals as large as this pose does.
    """

    X_PO: RigidTransform
    cost: float
    probability: float
    covariance: FloatArray
    free_directions: FloatArray
    explains_touch: bool = True


@dataclasses.dataclass(frozen=True, eq=False)
class PoseEstimate(Presentable):
    """The hypotheses that one touch leaves.

    All numbers are finite, whatever the status. With "no_solution" the hypotheses are the poses that come nearest to
    explaining the touch, weighed among themselves; their covariances say how well the touch would determine them.

    Attributes:
        hypotheses: by falling probability; never empty.
        status: "ok"; "ambiguous" when the best hypothesis carries less than half of the mass, or when fewer than three
            contacts stand against no prior; "no_solution" when even the best one does not explain the touch within its
            noise.
        duration: s.
        finished: whether the search ended by itself, rather than at the time limit.
        log_evidence: the natural logarithm of how well the object explains the touch in all its poses together; see
            `core.identification.model_evidence`. It compares objects for one touch, and means nothing by itself.
        question: what `estimate_pose` was asked, by which the estimate can show itself; None where it is not known.
    """

    hypotheses: tuple[PoseHypothesis, ...]
    status: Status
    duration: float
    finished: bool = True
    log_evidence: float = -math.inf
    question: Question | None = dataclasses.field(default=None, repr=False)

    @property
    def best(self) -> PoseHypothesis:
        """The most probable hypothesis."""
        return self.hypotheses[0]

    @property
    def modes(self) -> GaussianMixture:
        """The hypotheses as arrays."""
        return GaussianMixture(
            np.array([hypothesis.X_PO.GetAsMatrix34() for hypothesis in self.hypotheses]),
            np.array([hypothesis.probability for hypothesis in self.hypotheses]),
            np.array([hypothesis.covariance for hypothesis in self.hypotheses]),
        )

    def keep(self, kept: Sequence[bool]) -> PoseEstimate:
        """The estimate by some of the hypotheses alone, weighed among themselves.

        Args:
            kept: for each hypothesis whether it stays; at least one does.

        Raises:
            InvalidInputError: if none stays.
        """
        chosen = [hypothesis for hypothesis, stays in zip(self.hypotheses, kept, strict=True) if stays]
        if not chosen:
            raise InvalidInputError("kept: keeps no hypothesis; the least is 1.")
        mass = sum(hypothesis.probability for hypothesis in chosen)
        hypotheses = tuple(
            dataclasses.replace(hypothesis, probability=hypothesis.probability / mass if mass else 1.0 / len(chosen))
            for hypothesis in chosen
        )
        undetermined = self.status == "ambiguous" and self.best.probability >= DEFAULT_PARAMS.modes.answer_share
        return dataclasses.replace(
            self,
            hypotheses=hypotheses,
            status=status_of(hypotheses, undetermined),
            log_evidence=self.log_evidence + (math.log(mass) if mass else -math.inf),
        )


def status_of(hypotheses: Sequence[PoseHypothesis], undetermined: bool) -> Status:
    """Of hypotheses by falling probability; `undetermined`: however they are weighed."""
    if not hypotheses[0].explains_touch:
        return "no_solution"
    if undetermined or hypotheses[0].probability < DEFAULT_PARAMS.modes.answer_share:
        return "ambiguous"
    return "ok"
