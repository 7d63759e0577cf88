"""The result of an estimate: hypotheses of the object's pose, with a status."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, Self, overload

import numpy as np

from tactopose_drake.core.plain_values import PlainValue, counted, numbers
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture
from tactopose_drake.core.posterior.posterior_params import DEFAULT_PARAMS
from tactopose_drake.core.statuses import Status as Status
from tactopose_drake.core.validation import flag, instance_of, whole_number
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.estimation.plain_data import (
    Readers,
    number_or,
    read_amount,
    read_fields,
    read_parts,
    read_share,
    read_status,
)
from tactopose_drake.estimation.pose_hypothesis import PoseHypothesis, whole_sigmas
from tactopose_drake.estimation.question import Presentable, Question

_OF_ESTIMATE: Readers = {
    "status": read_status,
    "duration": read_amount,
    "finished": flag,
    "log_evidence": number_or(-math.inf),
    "noise_scale": read_amount,
    "standard_error": number_or(math.inf, read_amount),
    "undetermined": flag,
    "kept_share": read_share,
}

_ROUNDED = 1e-3  # tolerance of the sum of probabilities in plain data, which may have been written with few digits


@dataclasses.dataclass(frozen=True, eq=False)
class PoseEstimate(PlainValue, Presentable):
    """The pose hypotheses that one touch leaves.

    All numbers of the hypotheses are finite, whatever the status. With "no_solution" the hypotheses are the poses that
    come nearest to explaining the touch; their probabilities sum to 1 as well, and their covariances say how well the
    touch would determine them.

    Attributes:
        hypotheses: the hypotheses by falling probability; never empty.
        status: "ok"; "ambiguous" if the best hypothesis has a probability below 90 %, or the pose is undetermined;
            "no_solution" if the hypotheses that explain the touch, with a plausible number of false contacts, have a
            probability of no more than 10 %.
        duration: computing time, s.
        finished: whether the search ended by itself rather than at the time limit. If not, status and probabilities
            refer only to the poses found by then.
        log_evidence: natural logarithm of the marginal likelihood of the touch over all poses of the object; see
            `core.identification.model_evidence`. It compares objects for the same touch, and has no meaning by itself.
            `identify`, which doubts contacts less, distinguishes objects better.
        noise_scale: ratio of the apparent noise of the contacts' points to the stated noise under the best hypothesis,
            from 1 to 4; near 1 if they agree. Few contacts tell little of it: by three it is about 1.4 if they agree,
            and 2 if the noise is three times as large.
        standard_error: the largest sampling error of the hypotheses' probabilities; infinite if the time limit left no
            time for sampling.
        undetermined: whether the touch, without a prior, does not determine a pose: if there are fewer than three
            contacts, or without normals fewer than six, less one for each continuous symmetry; or if for the best
            hypothesis all directions are free, or all contacts are more probably false than not.
        kept_share: total probability of the hypotheses, from 0 to 1; the rest belonged to hypotheses beyond
            `max_hypotheses`.
        question: the inputs of `estimate_pose`, with which the estimate can be shown; None if unknown.
    """

    hypotheses: tuple[PoseHypothesis, ...]
    status: Status
    duration: float = dataclasses.field(compare=False)
    finished: bool = True
    log_evidence: float = -math.inf
    noise_scale: float = 1.0
    standard_error: float = math.inf
    undetermined: bool = False
    kept_share: float = 1.0
    question: Question | None = dataclasses.field(default=None, repr=False)

    def __len__(self) -> int:
        return len(self.hypotheses)

    def __iter__(self) -> Iterator[PoseHypothesis]:
        return iter(self.hypotheses)

    @overload
    def __getitem__(self, index: int) -> PoseHypothesis: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[PoseHypothesis, ...]: ...
    def __getitem__(self, index: int | slice) -> PoseHypothesis | tuple[PoseHypothesis, ...]:
        return self.hypotheses[index]

    def __repr__(self) -> str:
        many = counted(len(self), "hypothesis", "hypotheses")
        many += "" if self.finished else " of a search cut short"
        return f"<PoseEstimate {self.status!r}: {many} in {1e3 * self.duration:.1f} ms, best {self.best!r}>"

    def table(self, most: int = 8) -> str:
        """The most probable hypotheses as text, one line each.

        The columns "±" hold the standard deviations of position and angle over all directions together: the square
        roots of the sums of the coordinates' variances. If the touch leaves directions free (the column "free" gives
        their number), these include the prior's uncertainty along them; pages and the command line exclude it.

        Args:
            most: the largest number of lines; another line says how many hypotheses are left.

        Raises:
            InvalidInputError: if `most` is no integer >= 0.
        """
        most = whole_number("most", most, least=0)
        head = (
            "probability",
            "p_PO, mm",
            "quaternion wxyz",
            "± mm, all directions",
            "± deg, all directions",
            "free",
            "cost",
        )
        rows = [head, *(_row(hypothesis) for hypothesis in self.hypotheses[:most])]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = ["  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in rows]
        hidden = len(self) - most
        return "\n".join([f"status: {self.status}", *lines, *([f"and {hidden} less probable"] if hidden > 0 else [])])

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Restores the value that `to_dict` converted, to the last bit.

        Raises:
            InvalidInputError: for an unknown or missing name, or an invalid value.
        """
        given = read_fields(cls, data, _OF_ESTIMATE)
        given["hypotheses"] = read_parts(cls, "hypotheses", given.get("hypotheses", ()), PoseHypothesis)
        _check_together(given["hypotheses"])
        return super().from_dict(given)

    @property
    def best(self) -> PoseHypothesis:
        """The most probable hypothesis."""
        return self.hypotheses[0]

    @property
    def modes(self) -> GaussianMixture:
        """The hypotheses as a Gaussian mixture with read-only arrays."""
        return GaussianMixture(
            np.array([hypothesis.X_PO.GetAsMatrix34() for hypothesis in self.hypotheses]),
            np.array([hypothesis.probability for hypothesis in self.hypotheses]),
            np.array([hypothesis.covariance for hypothesis in self.hypotheses]),
        )

    def first(self, count: int) -> PoseEstimate:
        """The estimate with only the `count` most probable hypotheses; the status does not change.

        Raises:
            InvalidInputError: if `count` is below 1.
        """
        if len(self) <= whole_number("count", count, least=1):
            return self
        hypotheses, mass = _weighed_among_themselves(self.hypotheses[:count])
        return dataclasses.replace(self, hypotheses=hypotheses, kept_share=min(self.kept_share * mass, 1.0))

    def keep(self, kept: Sequence[bool]) -> PoseEstimate:
        """The estimate given that only some hypotheses are possible, with their probabilities normalized.

        Args:
            kept: whether each hypothesis is possible; at least one must be.

        Raises:
            InvalidInputError: if none is kept, if the length differs from the number of hypotheses, or if an entry is
                neither True nor False.
        """
        instance_of("kept", kept, Collection)
        if len(kept) != len(self):
            raise InvalidInputError(f"kept must have an entry for each of {len(self)} hypotheses, not {len(kept)}.")
        hypotheses, mass = _weighed_among_themselves(
            [
                each
                for i, (each, stays) in enumerate(zip(self.hypotheses, kept, strict=True))
                if flag(f"kept[{i}]", stays)
            ]
        )
        # The hypotheses beyond `max_hypotheses` may be possible, too.
        left = self.kept_share * mass + 1.0 - self.kept_share
        kept_share = self.kept_share * mass / left if left else 1.0
        return dataclasses.replace(
            self,
            hypotheses=hypotheses,
            status=status_of(hypotheses, self.undetermined, kept_share),
            log_evidence=self.log_evidence + (math.log(left) if left else -math.inf),
            kept_share=kept_share,
        )


def _check_together(hypotheses: Sequence[PoseHypothesis]) -> None:
    """Raises InvalidInputError if the probabilities do not sum to 1, or the numbers of contacts differ."""
    mass = sum(hypothesis.probability for hypothesis in hypotheses)
    if abs(mass - 1.0) > _ROUNDED:
        raise InvalidInputError(f"hypotheses must have probabilities that sum to 1, not {mass:g}.")
    count = len(hypotheses[0].inlier_probability)
    for i, hypothesis in enumerate(hypotheses):
        if len(hypothesis.inlier_probability) != count:
            raise InvalidInputError(
                f"hypotheses[{i}].inlier_probability must have the length of that of hypotheses[0], {count}, not "
                f"{len(hypothesis.inlier_probability)}."
            )


def _weighed_among_themselves(hypotheses: Sequence[PoseHypothesis]) -> tuple[tuple[PoseHypothesis, ...], float]:
    """Hypotheses with normalized probabilities, and the sum of their former ones."""
    if not hypotheses:
        raise InvalidInputError("kept must keep at least one hypothesis, not none.")
    mass = sum(hypothesis.probability for hypothesis in hypotheses)
    return tuple(
        dataclasses.replace(hypothesis, probability=hypothesis.probability / mass if mass else 1.0 / len(hypotheses))
        for hypothesis in hypotheses
    ), mass


def _row(hypothesis: PoseHypothesis) -> tuple[str, ...]:
    """A row of `PoseEstimate.table`."""
    turn, move = whole_sigmas(hypothesis.covariance)
    return (
        f"{hypothesis.probability:.1%}",
        numbers(1e3 * hypothesis.X_PO.translation(), 1),
        numbers(hypothesis.X_PO.rotation().ToQuaternion().wxyz(), 3),
        f"{1e3 * move:.1f}",
        f"{math.degrees(turn):.1f}",
        str(len(hypothesis.free_directions)),
        f"{hypothesis.cost:.2f}",
    )


def status_of(hypotheses: Sequence[PoseHypothesis], undetermined: bool, kept_share: float = 1.0) -> Status:
    """The status of hypotheses by falling probability, as `PoseEstimate` defines it."""
    share = DEFAULT_PARAMS.modes.answer_share
    best, explained = hypotheses[0], sum(each.probability for each in hypotheses if each.explains_touch)
    # If whole families of poses are left, the mean of a family need not explain the touch although its members do.
    if explained <= (0.0 if undetermined else 1.0 - share):
        return "no_solution"
    if undetermined or kept_share * best.probability < share or not best.explains_touch:
        return "ambiguous"
    return "ok"
