"""The choice of the next touch: the one with the most expected information about the object's pose, or its identity.

For the pose, it is the information about which mode is true and about the pose within it, beyond a tolerance (see
`foreseen_touch.py`); so one wide mode may leave as much uncertainty as several narrow ones. For the identity, it is the
information about the object's name alone.

Source: [B16] J. Bimbo, thesis, 2016, sections 6.2.1 and 6.3.
"""

import dataclasses
import itertools
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.hand_geometry import HandGeometry
from tactopose_drake.core.exploration.foreseen_touch import (
    TouchNoise,
    entropy,
    foresee,
    join,
    told_of_mode,
    told_within_modes,
)
from tactopose_drake.core.exploration.guarded_moves import GuardedMoves
from tactopose_drake.core.exploration.tolerance import Tolerance, merged_modes
from tactopose_drake.core.grasping.quality import grasp_quality
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture, checked_mixture
from tactopose_drake.core.posterior.moved_origin import about_middle
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray, limited, positive_number
from tactopose_drake.errors import InvalidInputError


@dataclasses.dataclass(frozen=True, kw_only=True)
class TouchCriterion:
    """The criterion by which a touch is chosen.

    Attributes:
        tolerance: within which poses count as the same.
        noise: of a touch.
        likely: probability from which on the grasp must stay stable and collision-free in a mode; if the object's
            identity is uncertain, the joint probability of object and mode. 0 means every mode; the likeliest mode
            always counts.

    Raises:
        InvalidInputError: a probability below 0.
    """

    tolerance: Tolerance = Tolerance()
    noise: TouchNoise = TouchNoise()
    likely: float = 0.05

    def __post_init__(self) -> None:
        positive_number("TouchCriterion.likely", self.likely, allow_zero=True)


@dataclasses.dataclass(frozen=True, eq=False)
class Hold:
    """The grasp that holds the object.

    Attributes:
        contacts: k of them, in the palm frame.
        fingers: names of the fingers that make them, k of them.
        friction: coefficient of friction.

    Raises:
        InvalidInputError: as many names as contacts are needed.
    """

    contacts: Contacts
    fingers: Sequence[str]
    friction: float

    def __post_init__(self) -> None:
        if len(self.fingers) != len(self.contacts):
            raise InvalidInputError(
                f"fingers must be as many names as there are contacts, {len(self.contacts)}, not {len(self.fingers)}."
            )

    def is_stable_without(self, finger: str, model: ObjectModel, X_PO: FloatArray) -> bool:
        """Whether the others keep force closure at each of the poses (n, 3, 4); true for a finger without contact."""
        kept = np.array([name != finger for name in self.fingers], dtype=np.bool_)
        rest = self.contacts[kept]
        return bool(kept.all()) or all(
            grasp_quality(model, rest, X, friction=self.friction).force_closure for X in X_PO
        )


@dataclasses.dataclass(frozen=True, eq=False)
class NextTouch:
    """The best of the allowed motions.

    Attributes:
        finger: that makes it.
        move: index of the finger's motion.
        information: expected reduction of the entropy, at least between modes, nats.
        entropy: before the touch, nats.
        allowed: for each finger, which motions keep the grasp and touch with the fingertip alone, shape (m,).
        value: for each finger, the information of each motion, shape (m,), nats.
    """

    finger: str
    move: int
    information: float
    entropy: float
    allowed: Mapping[str, NDArray[np.bool_]]
    value: Mapping[str, FloatArray]

    @property
    def expected_entropy(self) -> float:
        """The expected entropy after the touch, nats."""
        return self.entropy - self.information


@dataclasses.dataclass(frozen=True, eq=False)
class Candidate:
    """An object that may be the one that is held.

    Attributes:
        model: the object.
        belief: of its pose, given that it is this one.
        probability: that it is this one.
    """

    model: ObjectModel
    belief: GaussianMixture
    probability: float


def choose_touch(
    model: ObjectModel,
    hold: Hold,
    belief: GaussianMixture,
    moves: Mapping[str, GuardedMoves],
    *,
    others: Mapping[str, HandGeometry] | None = None,
    criterion: TouchCriterion = TouchCriterion(),
) -> NextTouch | None:
    """Chooses the allowed motion with the most information about the pose; None if no motion is allowed.

    A finger that holds the object may leave it only if the others keep force closure at every likely mode.

    Args:
        model: the object.
        hold: the fingers that hold it.
        belief: of the object's pose; `PoseEstimate.modes`, or `PoseBelief.mixture`.
        moves: the possible motions of each finger.
        others: for each finger the rest of the hand, which it must not hit; None to leave that to the caller.
        criterion: how touches are chosen.

    Raises:
        InvalidInputError: a belief without a mode, or others that lack a finger.
    """
    model, belief = about_middle(model, checked_mixture("belief", belief))
    distinct = merged_modes(model, belief, criterion.tolerance)
    allowed = allowed_moves(model, hold, distinct, moves, others, criterion)
    value = {finger: information(model, distinct, options, criterion) for finger, options in moves.items()}
    return _best(value, allowed, entropy(distinct, criterion.tolerance))


def choose_telling_touch(
    candidates: Sequence[Candidate],
    hold: Hold,
    moves: Mapping[str, GuardedMoves],
    *,
    others: Mapping[str, HandGeometry] | None = None,
    criterion: TouchCriterion = TouchCriterion(),
) -> NextTouch | None:
    """Chooses the allowed motion with the most information about which object it is; None if no motion is allowed.

    It must be allowed at each likely mode of each candidate; entropy and information are those of the name.

    Args:
        candidates: the objects that it may be; their probabilities need not sum to 1.
        hold: the fingers that hold it.
        moves: the possible motions of each finger.
        others: as for `choose_touch`.
        criterion: how touches are chosen.

    Raises:
        InvalidInputError: no candidate, probabilities that are negative or all 0, a belief without a mode, or others
            that lack a finger.
    """
    weights = _shares_of(candidates)
    near = [about_middle(each.model, each.belief) for each in candidates]
    distinct = [
        Candidate(model, merged_modes(model, belief, criterion.tolerance), weight)
        for (model, belief), weight in zip(near, weights, strict=True)
    ]
    allowed = {finger: np.ones(len(options), dtype=np.bool_) for finger, options in moves.items()}
    most = np.array([each.probability * each.belief.weights.max() for each in distinct])
    likely = min(criterion.likely, most.max())
    for each in itertools.compress(distinct, (most >= likely) & (most > 0.0)):
        of_poses = dataclasses.replace(criterion, likely=likely / each.probability)
        for finger, may in allowed_moves(each.model, hold, each.belief, moves, others, of_poses).items():
            allowed[finger] &= may
    value = {finger: name_information(distinct, options, criterion) for finger, options in moves.items()}
    share = weights[weights > 0.0]
    return _best(value, allowed, float(-np.sum(share * np.log(share))))


def _shares_of(candidates: Sequence[Candidate]) -> FloatArray:
    """The candidates' probabilities, scaled to sum to 1."""
    given = limited("candidates.probability", [each.probability for each in candidates], (len(candidates),), most=1e100)
    if not len(given) or given.min() < 0.0 or not given.sum() > 0.0:
        raise InvalidInputError(f"candidates.probability must be numbers >= 0, one of them > 0, not {given}.")
    shares: FloatArray = given / given.sum()
    return shares


def _best(
    value: Mapping[str, FloatArray], allowed: Mapping[str, NDArray[np.bool_]], entropy_before: float
) -> NextTouch | None:
    best: tuple[str, int] | None = None
    for finger, mask in allowed.items():
        if mask.any():
            move = int(np.where(mask, value[finger], -np.inf).argmax())
            if best is None or value[finger][move] > value[best[0]][best[1]]:
                best = finger, move
    if best is None:
        return None
    finger, move = best
    return NextTouch(finger, move, float(value[finger][move]), entropy_before, allowed, value)


def allowed_moves(
    model: ObjectModel,
    hold: Hold,
    belief: GaussianMixture,
    moves: Mapping[str, GuardedMoves],
    others: Mapping[str, HandGeometry] | None,
    criterion: TouchCriterion,
) -> dict[str, NDArray[np.bool_]]:
    """For each finger, which of its motions are allowed, see `is_allowed`; for the arguments see `choose_touch`."""
    rest = dict.fromkeys(moves) if others is None else others
    if lacking := [finger for finger in moves if finger not in rest]:
        raise InvalidInputError(f"others must have an entry for each finger that may move, also for {lacking[0]!r}.")
    return {
        finger: is_allowed(model, hold, belief, finger, options, others=rest[finger], likely=criterion.likely)
        for finger, options in moves.items()
    }


def is_allowed(
    model: ObjectModel,
    hold: Hold,
    belief: GaussianMixture,
    finger: str,
    moves: GuardedMoves,
    *,
    others: HandGeometry | None = None,
    likely: float = TouchCriterion.likely,
) -> NDArray[np.bool_]:
    """Which motions of a finger leave a stable grasp and touch with the fingertip alone, at all likely modes, (m,).

    If `others`, the rest of the hand, is given, the finger must not hit that before its motion ends either.
    """
    belief = checked_mixture("belief", belief)
    X_likely = belief.X_PO[belief.likely(likely)]
    if not hold.is_stable_without(finger, model, X_likely):
        return np.zeros(len(moves), dtype=np.bool_)
    clear: NDArray[np.bool_] = np.logical_and.reduce(moves.are_clear(model, X_likely))
    if others is not None:
        clear[clear] = moves.take(np.flatnonzero(clear)).stay_apart(others, model, X_likely)
    return clear


def information(
    model: ObjectModel, belief: GaussianMixture, moves: GuardedMoves, criterion: TouchCriterion = TouchCriterion()
) -> FloatArray:
    """Expected reduction of the pose's entropy by each motion, shape (m,), nats."""
    foreseen = foresee(model, belief, moves, criterion.noise)
    return told_of_mode(belief.weights, foreseen) + told_within_modes(belief.weights, foreseen, criterion.tolerance)


def name_information(
    candidates: Sequence[Candidate], moves: GuardedMoves, criterion: TouchCriterion = TouchCriterion()
) -> FloatArray:
    """Expected reduction by each motion of the entropy of which candidate it is, shape (m,), nats.

    By the chain rule, this is the information about candidate and mode minus that about the mode given the candidate.
    As a difference of two lower bounds it is itself no bound. The information within modes does not count here, and
    more than one set of cubature points chooses no better.
    """
    parts = [foresee(each.model, each.belief, moves, criterion.noise, sets=1) for each in candidates]
    shares = [each.probability * each.belief.weights for each in candidates]
    told = told_of_mode(np.concatenate(shares), join(parts))
    for each, part in zip(candidates, parts, strict=True):
        told = told - each.probability * told_of_mode(each.belief.weights, part)
    return np.maximum(told, 0.0)
