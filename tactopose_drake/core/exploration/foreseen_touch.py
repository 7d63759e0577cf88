"""Predictions of guarded motions by the modes of a belief, and the expected information of their outcomes.

Each mode predicts the outcome of a guarded motion: whether it meets the object, after which distance, and with which
normal. The prediction accounts for the mode's spread: the motion is evaluated at cubature points of the mode's Gaussian
[AH09], and the sensor's noise is added. By the chain rule, the information about the pose has two parts: that about
which mode is true, bounded from below by the pairwise Bhattacharyya coefficients of the predictions [KT17]; and that
about the pose within each mode, by the Gaussian's update. Where a mode is wide, the outcome is no linear function of
the pose, and one set of cubature points, on six axes, hardly tells one motion from another. There are therefore several
sets, turned against each other; as each has the Gaussian's covariance, predictions that are linear stay exact.

Sources: [AH09] I. Arasaratnam and S. Haykin, Cubature Kalman filters, IEEE Trans. Automatic Control 54, 2009. [KT17] A.
Kolchinsky and B. Tracey, Estimating mixture entropy with pairwise distances, Entropy 19, 2017.
"""

import dataclasses
import functools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.exploration.guarded_moves import GuardedMoves
from tactopose_drake.core.exploration.tolerance import Tolerance
from tactopose_drake.core.poses import retract
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray, positive_number

# Sets of cubature points in all, shared among the modes, and at least for each: more modes need more time.
_SETS, _LEAST_SETS = 6, 2


@dataclasses.dataclass(frozen=True, kw_only=True)
class TouchNoise:
    """The accuracy of a touch.

    Attributes:
        position: standard deviation of the contact along each axis, m.
        normal: standard deviation of a small rotation of the normal about each axis, rad; None if no normal is felt.
        least_facing: cosine between normal and motion below which the distance's error grows no further: touches at
            grazing incidence are inaccurate, but useful.

    Raises:
        InvalidInputError: a number that is not positive, or a cosine above 1.
    """

    position: float = 0.0009
    normal: float | None = math.radians(5.0)
    least_facing: float = 0.2

    def __post_init__(self) -> None:
        positive_number("TouchNoise.position", self.position)
        if self.normal is not None:
            positive_number("TouchNoise.normal", self.normal)
        positive_number("TouchNoise.least_facing", self.least_facing, most=1.0)


@dataclasses.dataclass(frozen=True, eq=False)
class Foreseen:
    """Predictions of m motions by n modes: the outcome is the distance and, if felt, the normal; d numbers.

    Attributes:
        hit: share of each mode's points with a touch, shape (n, m).
        chance: probability of a touch, shape (n, m): the share, smoothed, as what no point shows may still happen.
        mean: of the outcome over these points, shape (n, m, d), m and 1.
        covariance: of the outcome, including noise, shape (n, m, d, d).
        prior: covariance of each mode, shape (n, 6, 6), rad and m.
        given_miss: covariance of the mode's points without a touch, shape (n, m, 6, 6).
        given_hit: covariance of its points with a touch, shape (n, m, 6, 6).
        given_touch: covariance of the latter given the outcome, shape (n, m, 6, 6).
    """

    hit: FloatArray
    chance: FloatArray
    mean: FloatArray
    covariance: FloatArray
    prior: FloatArray
    given_miss: FloatArray
    given_hit: FloatArray
    given_touch: FloatArray


def foresee(
    model: ObjectModel, belief: GaussianMixture, moves: GuardedMoves, noise: TouchNoise, sets: int | None = None
) -> Foreseen:
    """Predicts the outcome of each motion under each mode.

    Args:
        model: the object.
        belief: of its pose.
        moves: the motions.
        noise: of a touch.
        sets: number of sets of cubature points for each mode; None: the fewer, the more modes there are.
    """
    points = _points(max(_SETS // len(belief), _LEAST_SETS) if sets is None else sets)
    increments = points @ np.swapaxes(belief.roots(), 1, 2)
    X_PO = retract(np.repeat(belief.X_PO, len(points), axis=0), increments.reshape(-1, 6))
    felt = moves.feel(model, X_PO)
    shape = (len(belief), len(points), len(moves))
    is_hit, facing = felt.is_hit.reshape(shape), np.maximum(felt.facing.reshape(shape), noise.least_facing)
    z = felt.way.reshape(shape)[..., None]
    if noise.normal is not None:
        z = np.concatenate([z, felt.n_PC.reshape(*shape, 3)], axis=-1)
    share = _shares(is_hit)
    mean = np.einsum("nbm,nbmi->nmi", share, z)
    off = z - mean[:, None]
    covariance = np.einsum("nbm,nbmi,nbmj->nmij", share, off, off)
    covariance[..., 0, 0] += np.sum(share * np.square(noise.position / facing), axis=1)
    # A mode without a touch predicts no outcome; any positive variance will do.
    covariance[..., 0, 0] += ~is_hit.any(axis=1)
    if noise.normal is not None:
        covariance[..., 1:, 1:] += noise.normal**2 * np.eye(3)
    given_hit, about = _scatter(increments, share)
    cross = np.einsum("nbm,nbmi,nbmj->nmij", share, about, off)
    given_touch = given_hit - cross @ np.linalg.solve(covariance, np.swapaxes(cross, -1, -2))
    given_miss, _ = _scatter(increments, _shares(~is_hit))
    hit = is_hit.mean(axis=1)
    chance = (hit * len(points) + 0.5) / (len(points) + 1.0)
    return Foreseen(hit, chance, mean, covariance, belief.covariance, given_miss, given_hit, given_touch)


@functools.cache
def _points(sets: int) -> FloatArray:
    """The mean and cubature points of a standard Gaussian, shape (1 + 12 sets, 6); a single set lies on the axes."""
    turns = np.eye(6) if sets == 1 else np.linalg.qr(np.random.default_rng(0).normal(size=(sets, 6, 6))).Q
    turns = turns.reshape(-1, 6)
    # [AH09] eq. 23 with the mean added, so that the others lie farther out for the same covariance.
    spread = math.sqrt(0.5 * (1 + 2 * len(turns)) / sets) * turns
    return np.concatenate([np.zeros((1, 6)), spread, -spread])


def join(parts: Sequence[Foreseen]) -> Foreseen:
    """Concatenates the modes of several predictions of the same motions."""
    names = (field.name for field in dataclasses.fields(Foreseen))
    return Foreseen(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def _shares(chosen: NDArray[np.bool_]) -> FloatArray:
    """Equal weights for the chosen ones of points (n, b, m); zeros if none is chosen."""
    share: FloatArray = chosen / np.maximum(chosen.sum(axis=1, keepdims=True), 1)
    return share


def _scatter(increments: FloatArray, share: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Covariance (n, m, 6, 6) of points (n, b, 6) with weights (n, b, m), and the points minus their mean."""
    mean = np.einsum("nbm,nbi->nmi", share, increments)
    about = increments[:, :, None] - mean[:, None]
    covariance: FloatArray = np.einsum("nbm,nbmi,nbmj->nmij", share, about, about)
    return covariance, about


def told_of_mode(weights: FloatArray, foreseen: Foreseen) -> FloatArray:
    """A lower bound on the expected information about which mode is true, shape (m,), nats."""
    overlap = _overlap(foreseen.mean, foreseen.covariance)  # (n, n, m)
    unknown = ~(foreseen.hit[:, None] * foreseen.hit[None] > 0.0)
    overlap = np.where(unknown, 1.0, overlap)
    chance = foreseen.chance
    both = np.sqrt(chance[:, None] * chance[None]) * overlap
    neither = np.sqrt((1.0 - chance[:, None]) * (1.0 - chance[None]))
    same = np.einsum("j,ijm->im", weights, np.minimum(both + neither, 1.0))
    told: FloatArray = -np.einsum("i,im->m", weights, np.log(same))  # [KT17] eq. 10, alpha = 1/2
    return told


def told_within_modes(weights: FloatArray, foreseen: Foreseen, tolerance: Tolerance) -> FloatArray:
    """The expected information about the pose within its mode, shape (m,), nats.

    That of whether there is a touch is at most its entropy; that of the outcome is by how much the Gaussian shrinks.
    Only uncertainty beyond the tolerance counts, as in `entropy`.
    """
    before = _resolved_entropy(foreseen.prior, tolerance)[:, None]
    miss, hit, touch = (
        _resolved_entropy(part, tolerance) for part in (foreseen.given_miss, foreseen.given_hit, foreseen.given_touch)
    )
    p = foreseen.chance
    by_hit = np.clip(before - p * hit - (1.0 - p) * miss, 0.0, -p * np.log(p) - (1.0 - p) * np.log(1.0 - p))
    # If all points agree, the smoothed probability must not create information.
    by_hit = np.where((foreseen.hit == 0.0) | (foreseen.hit == 1.0), 0.0, by_hit)
    told: FloatArray = weights @ (by_hit + foreseen.hit * np.maximum(hit - touch, 0.0))
    return told


def entropy(belief: GaussianMixture, tolerance: Tolerance) -> float:
    """The entropy of the pose, nats, over the modes and within them, resolved to the tolerance.

    Modes are assumed not to overlap. A Gaussian's entropy is that of its sum with one as wide as the tolerance, minus
    that of the latter alone: about 0 if the mode is narrower.
    """
    return belief.entropy + float(belief.weights @ _resolved_entropy(belief.covariance, tolerance))


def _resolved_entropy(covariance: FloatArray, tolerance: Tolerance) -> FloatArray:
    """Resolved entropy of Gaussians (..., 6, 6), shape (...)."""
    scaled = covariance / (tolerance.sigmas[:, None] * tolerance.sigmas)
    half: FloatArray = 0.5 * np.linalg.slogdet(np.eye(6) + scaled)[1]
    return half


def _overlap(mean: FloatArray, covariance: FloatArray) -> FloatArray:
    """Bhattacharyya coefficients of Gaussians (n, m, d), (n, m, d, d) for pairs of modes, shape (n, n, m)."""
    between = 0.5 * (covariance[:, None] + covariance[None])
    off = mean[:, None] - mean[None]
    square = np.einsum("abmi,abmi->abm", off, np.linalg.solve(between, off[..., None])[..., 0])
    log_single = np.linalg.slogdet(covariance)[1]
    log_between = np.linalg.slogdet(between)[1]
    log_ratio = log_between - 0.5 * (log_single[:, None] + log_single[None])
    coefficient: FloatArray = np.exp(-0.125 * square - 0.5 * log_ratio)
    return coefficient
