"""Which touch to make next: the one that tells most about which of several poses is the true one.

Each mode of a belief predicts what a guarded move would feel: whether it meets the object, after which way, and with
which normal. The prediction is spread as the mode is: the move is made at the cubature points of the mode's Gaussian
[AH09], and the sensor's noise is added. How much the answer is expected to tell is bounded from below by how well the
predictions can be told apart in pairs, by their Bhattacharyya coefficients [KT17]; no random numbers are needed.

Sources: [B16] J. Bimbo, thesis, 2016, section 6.3. [AH09] I. Arasaratnam and S. Haykin, Cubature Kalman filters, IEEE
Trans. Automatic Control 54, 2009. [KT17] A. Kolchinsky and B. Tracey, Estimating mixture entropy with pairwise
distances, Entropy 19, 2017.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.hand_geometry import HandGeometry
from tactopose_drake.core.exploration.guarded_moves import GuardedMoves
from tactopose_drake.core.grasping.quality import grasp_quality
from tactopose_drake.core.poses import retract
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture, checked_mixture
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.errors import InvalidInputError


@dataclasses.dataclass(frozen=True, kw_only=True)
class TouchNoise:
    """How exactly a touch is felt.

    Attributes:
        position: standard deviation of the contact along each axis, m.
        normal: of a small rotation of the normal about each axis, rad; None where no normal is felt.
        least_facing: cosine between normal and way, beyond which the way's error grows no further: surfaces that a
            fingertip grazes are not felt exactly, but they are felt.
    """

    position: float = 0.0009
    normal: float | None = math.radians(5.0)
    least_facing: float = 0.2


@dataclasses.dataclass(frozen=True, kw_only=True)
class SafetyParams:
    """What a motion must be safe for."""

    likely: float = 0.05  # probability from which on a mode must be left stable and uncollided


@dataclasses.dataclass(frozen=True, eq=False)
class Hold:
    """What holds the object.

    Attributes:
        contacts: k of them, in the palm frame.
        fingers: the names of those that make them, k of them.
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
                f"fingers: are {len(self.fingers)} names; allowed are as many as contacts, {len(self.contacts)}."
            )

    def is_stable_without(self, finger: str, model: ObjectModel, X_PO: FloatArray) -> bool:
        """Whether the others keep force closure at each of the poses (n, 3, 4); a finger that holds nothing may go."""
        kept = np.array([name != finger for name in self.fingers], dtype=np.bool_)
        rest = Contacts(self.contacts.p_PC[kept])
        return bool(kept.all()) or all(
            grasp_quality(model, rest, X, friction=self.friction).force_closure for X in X_PO
        )


@dataclasses.dataclass(frozen=True, eq=False)
class NextTouch:
    """The best motion that is allowed.

    Attributes:
        finger: that makes it.
        move: which of the finger's motions.
        information: by how much it is expected to reduce the entropy over the modes, at least, nats.
        entropy: before it, nats.
        allowed: for each finger which motions keep the grasp and touch with the fingertip alone, shape (m,).
        value: for each finger the information of each motion, shape (m,), nats.
    """

    finger: str
    move: int
    information: float
    entropy: float
    allowed: Mapping[str, NDArray[np.bool_]]
    value: Mapping[str, FloatArray]

    @property
    def expected_entropy(self) -> float:
        """After the touch, at most, nats."""
        return self.entropy - self.information


def choose_touch(
    model: ObjectModel,
    hold: Hold,
    belief: GaussianMixture,
    moves: Mapping[str, GuardedMoves],
    *,
    noise: TouchNoise | None = None,
    others: Mapping[str, HandGeometry] | None = None,
    safety: SafetyParams = SafetyParams(),
) -> NextTouch | None:
    """The motion that tells most of those that are allowed; None if none is.

    A finger that holds the object may leave it only if the others keep force closure at every likely mode.

    Args:
        model: the object.
        hold: the fingers that hold it.
        belief: of the object's pose; `PoseEstimate.modes`, or `PoseBelief.mixture`.
        moves: what each finger could do.
        noise: of a touch.
        others: for each finger the rest of the hand, which it must not meet; None to leave that to the caller.
        safety: which modes are likely.

    Raises:
        InvalidInputError: a belief without a mode.
    """
    belief = checked_mixture("belief", belief)
    value = {finger: information(model, belief, options, noise) for finger, options in moves.items()}
    allowed = {
        finger: is_allowed(
            model, hold, belief, finger, options, others=None if others is None else others[finger], safety=safety
        )
        for finger, options in moves.items()
    }
    best: tuple[str, int] | None = None
    for finger, mask in allowed.items():
        if mask.any():
            move = int(np.where(mask, value[finger], -np.inf).argmax())
            if best is None or value[finger][move] > value[best[0]][best[1]]:
                best = finger, move
    if best is None:
        return None
    finger, move = best
    return NextTouch(finger, move, float(value[finger][move]), belief.entropy, allowed, value)


def is_allowed(
    model: ObjectModel,
    hold: Hold,
    belief: GaussianMixture,
    finger: str,
    moves: GuardedMoves,
    *,
    others: HandGeometry | None = None,
    safety: SafetyParams = SafetyParams(),
) -> NDArray[np.bool_]:
    """Which motions of a finger leave a stable grasp and touch with the fingertip alone, at all likely modes, (m,).

    With the rest of the hand given, the finger must not meet `others` either before its motion ends.
    """
    belief = checked_mixture("belief", belief)
    X_likely = belief.X_PO[belief.likely(safety.likely)]
    if not hold.is_stable_without(finger, model, X_likely):
        return np.zeros(len(moves), dtype=np.bool_)
    clear: NDArray[np.bool_] = np.logical_and.reduce(moves.are_clear(model, X_likely))
    if others is not None:
        clear[clear] = moves.take(np.flatnonzero(clear)).stay_apart(others, model, X_likely)
    return clear


def information(
    model: ObjectModel, belief: GaussianMixture, moves: GuardedMoves, noise: TouchNoise | None = None
) -> FloatArray:
    """How much each motion is expected to tell about which mode is true, at least, shape (m,), nats."""
    noise = TouchNoise() if noise is None else noise
    hit, mean, covariance = predict(model, belief, moves, noise)
    overlap = _overlap(mean, covariance)  # (n, n, m)
    unknown = ~(hit[:, None] * hit[None] > 0.0)
    overlap = np.where(unknown, 1.0, overlap)
    # A touch that a mode does not foresee may happen all the same, and the other way round.
    points = 1 + 2 * 6
    chance = (hit * points + 0.5) / (points + 1.0)
    both = np.sqrt(chance[:, None] * chance[None]) * overlap
    neither = np.sqrt((1.0 - chance[:, None]) * (1.0 - chance[None]))
    w = belief.weights
    same = np.einsum("j,ijm->im", w, np.minimum(both + neither, 1.0))
    gained: FloatArray = -np.einsum("i,im->m", w, np.log(same))  # [KT17] eq. 10, alpha = 1/2
    return gained


def predict(
    model: ObjectModel, belief: GaussianMixture, moves: GuardedMoves, noise: TouchNoise
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What each mode foresees of each motion.

    Returns:
        Share of the mode's cubature points where there is a touch, shape (n, m); mean of the way and the normal of
        those, shape (n, m, 4), or (n, m, 1) without normals; covariance with noise, shape (n, m, 4, 4) or (n, m, 1, 1).
    """
    spread = math.sqrt(6.0) * np.swapaxes(belief.roots(), 1, 2)  # rows, [AH09] eq. 23
    increments = np.concatenate([np.zeros((len(belief), 1, 6)), spread, -spread], axis=1)
    X_PO = retract(np.repeat(belief.X_PO, increments.shape[1], axis=0), increments.reshape(-1, 6))
    felt = moves.feel(model, X_PO)
    shape = (len(belief), -1, len(moves))
    is_hit, facing = felt.is_hit.reshape(shape), np.maximum(felt.facing.reshape(shape), noise.least_facing)
    z = felt.way.reshape(shape)[..., None]
    if noise.normal is not None:
        z = np.concatenate([z, felt.n_PC.reshape(*shape, 3)], axis=-1)
    share = is_hit / np.maximum(is_hit.sum(axis=1, keepdims=True), 1)
    mean = np.einsum("nbm,nbmi->nmi", share, z)
    off = z - mean[:, None]
    covariance = np.einsum("nbm,nbmi,nbmj->nmij", share, off, off)
    covariance[..., 0, 0] += np.sum(share * np.square(noise.position / facing), axis=1)
    # A mode without a touch foresees nothing; any numbers do.
    covariance[..., 0, 0] += ~is_hit.any(axis=1)
    if noise.normal is not None:
        covariance[..., 1:, 1:] += noise.normal**2 * np.eye(3)
    return is_hit.mean(axis=1), mean, covariance


def _overlap(mean: FloatArray, covariance: FloatArray) -> FloatArray:
    """Bhattacharyya coefficients of Gaussians (n, m, d), (n, m, d, d) by pairs of modes, shape (n, n, m)."""
    between = 0.5 * (covariance[:, None] + covariance[None])
    off = mean[:, None] - mean[None]
    square = np.einsum("abmi,abmi->abm", off, np.linalg.solve(between, off[..., None])[..., 0])
    log_single = np.linalg.slogdet(covariance)[1]
    log_between = np.linalg.slogdet(between)[1]
    log_ratio = log_between - 0.5 * (log_single[:, None] + log_single[None])
    coefficient: FloatArray = np.exp(-0.125 * square - 0.5 * log_ratio)
    return coefficient
