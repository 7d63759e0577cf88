"""The likelihood of contacts that may be outliers, measured with noise of uncertain size.

A finger may touch something else: then its contact is anywhere. It may be elsewhere than its joints say: then its point
is displaced, and its normal about right. It may touch across an edge: then the point is as told, and the normal
arbitrary; or its force may have the wrong sign, and the normal is reversed. In the mixture of these with a contact as
told [HRM16] no single contact is decisive. One false contact, whichever it is, may be likelier than several: so the
product over independently false contacts is supplemented by the sum over which single one is false. The factor by which
the noise exceeds what is told, for points alone or for normals too, is marginalised: this makes the likelihood of all
contacts together heavy-tailed, like Student's t [LLT89].

Source: [LLT89] K. Lange, R. Little, J. Taylor, Robust statistical modeling using the t distribution, J. Am. Stat.
Assoc. 84, 1989. [HRM16] D. Hogg, J. Bovy, D. Lang, Data analysis recipes: fitting a model to data, 2010, section 3
(mixture for outliers).
"""

import functools
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.evidence.contact_doubt import USUAL, ContactDoubt, KindShares
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.geometry_checks import pose_batch
from tactopose_drake.core.kernels import contact_alternatives_kernels
from tactopose_drake.core.kernels.contact_judgement_kernels import Exact, Judged, judge
from tactopose_drake.core.kernels.contact_mixture_kernels import Doubts
from tactopose_drake.core.kernels.contact_odds_kernels import Measured, find_odds
from tactopose_drake.core.objectives.compiled_descent import CompiledDescent, CompiledObjective
from tactopose_drake.core.objectives.penetration import Penetration
from tactopose_drake.core.objectives.pose_prior import PriorObjective
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.objectives.surface_density import SurfaceDensity
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray

_LEAST_LOG = -500.0  # of a determinant, which may be 0 by rounding


class Judgement(NamedTuple):
    """The mixture's posterior over the contacts at given poses.

    Attributes:
        cost: negative log likelihoods, shape (B,).
        inlier_probability: that each contact is as told, shape (B, k).
        noise_scale: posterior mean of the factor of the standard deviations at exactly these poses, shape (B,).
        misfit: half the sum of squares of the contacts that are as told, in units of the estimated noise, shape (B,).
        factors: posterior probability of each pair of the variances' factors, shape (B, q).
        is_false: whether each contact's inlier probability is less than half of an exact contact's, shape (B, k).
    """

    cost: FloatArray
    inlier_probability: FloatArray
    noise_scale: FloatArray
    misfit: FloatArray
    factors: FloatArray
    is_false: NDArray[np.bool_]


class ContactMixture(CompiledObjective):
    """The mixture likelihood of contacts; like that of `SurfaceContact`, zero if all lie exactly on the surface."""

    def __init__(
        self, model: ObjectModel, contacts: Contacts, outlier_probability: float, doubt: ContactDoubt = USUAL
    ) -> None:
        self.touch = SurfaceContact(model.grid, contacts)
        self.density = SurfaceDensity(model, contacts)
        self._doubts, self._exact_inliers = _doubts(model, contacts, outlier_probability, doubt)
        self._reached, self._usual_odds = doubt.reached, _usual_odds(doubt.doublings)
        self._hand: Penetration | None = None
        self._compiled = CompiledDescent(self.touch.grid, self.touch.touch, doubts=self._doubts)

    def with_prior(self, prior: PriorObjective) -> "ContactMixture":
        """The sum with a prior, in the same compiled loops."""
        return self._with(_compiled=self._compiled._replace(prior=prior.kernel_view))

    def with_hand(self, hand: Penetration) -> "ContactMixture":
        """The sum with the hand's volume: it enters costs and descents, but not `judge`, which is of the contacts."""
        return self._with(_hand=hand, _compiled=self._compiled._replace(hand=hand.spheres))

    def _with(self, **parts: Any) -> "ContactMixture":
        both = object.__new__(ContactMixture)
        vars(both).update(vars(self), **parts)
        return both

    def cost(self, X_PO: FloatArray) -> FloatArray:
        """Costs (B,) of poses (B, 3, 4) by the distance field, smooth in the pose."""
        density = np.zeros((len(X_PO), len(self._doubts.closeness)))
        return self._with_overlap(self._judge(X_PO, density, -math.inf, whole=False).cost, X_PO)

    def _with_overlap(self, cost: FloatArray, X_PO: FloatArray) -> FloatArray:
        return cost if self._hand is None else cost + self._hand.cost(X_PO)

    def alternatives(self, X_PO: FloatArray, hessian: FloatArray) -> FloatArray:
        """The part of a cost's Hessians (B, 6, 6) that remains with one contact false, shape (B, 2 k, 6, 6)."""
        left = np.empty((len(X_PO), 2 * len(self._doubts.closeness), 6, 6))
        contact_alternatives_kernels.find_alternatives(
            self.touch.grid, self.touch.touch, self._doubts, pose_batch(X_PO), hessian, left
        )
        return left

    def judge(self, X_PO: FloatArray) -> Judgement:
        """The posterior over the contacts at poses (B, 3, 4) by the exact surface, see `SurfaceDensity`."""
        judged = self._judge(X_PO, self.density.densities(X_PO), self._reached, whole=True)
        return Judgement(*judged, judged.inlier_probability < 0.5 * self._exact_inliers)

    def noise_scale(self, X_PO: FloatArray, judgement: Judgement, known: FloatArray) -> FloatArray:
        """The factor of the points' standard deviations over all poses near some, shape (B,).

        At the pose that fits best, contacts leave less than their noise, as each number that tells the pose takes a
        residual away. So each factor counts by the volume of the poses that it allows; and with the odds of `USUAL`, as
        a sceptical prior alone would make the noise of a few contacts seem larger than told.

        Args:
            X_PO: the poses, minima of the cost or near them, shape (B, 3, 4).
            judgement: of these by `judge`.
            known: information on increments without the touch, positive definite, shape (6, 6).
        """
        _, J = self.touch.rows_of_contacts(X_PO)
        J = J[:, :, :4] * np.sqrt(judgement.inlier_probability)[:, :, None, None]
        by_distance, by_normal = (np.einsum("bkri,bkrj->bij", rows, rows) for rows in (J[:, :, :1], J[:, :, 1:]))
        doubts = self._doubts
        each = by_distance[:, None] * doubts.per_s[:, None, None] + by_normal[:, None] * doubts.per_t[:, None, None]
        log_volume = -0.5 * np.maximum(np.linalg.slogdet(each + known)[1], _LEAST_LOG)
        weight = judgement.factors * self._usual_odds * np.exp(log_volume - log_volume[:, :1])
        scale: FloatArray = (weight @ (1.0 / np.sqrt(doubts.per_s))) / weight.sum(axis=1)
        return scale

    def exact_cost(self, X_PO: FloatArray) -> FloatArray:
        """The costs (B,) of `judge` alone, which are faster to compute."""
        cost = self._judge(X_PO, self.density.densities(X_PO), self._reached, whole=False).cost
        return self._with_overlap(cost, X_PO)

    def _judge(self, X_PO: FloatArray, density: FloatArray, reached: float, whole: bool) -> Judged:
        """Evaluates the mixture with exact densities (B, k) as far as `reached`, and with the distance field beyond."""
        count = len(X_PO)
        pairs = np.empty((count, len(self._doubts.s)))
        judged = Judged(np.empty(count), np.empty(density.shape), np.empty(count), np.empty(count), pairs)
        touch, X_PO, exact = self.touch, pose_batch(X_PO), Exact(density, reached)
        judge(touch.grid, touch.touch, self._doubts, self._compiled.prior, exact, X_PO, judged, whole)
        return judged


@functools.cache
def _scales(doublings: tuple[tuple[int, int, float], ...]) -> tuple[Any, ...]:
    """The noise scales in the form that kernels read: the first five fields of `Doubts`."""
    s, t, probability = zip(*doublings, strict=True)
    return (
        read_only(np.array(s, dtype=np.int64)),
        read_only(np.array(t, dtype=np.int64)),
        read_only(0.5 ** np.array(s)),
        read_only(0.5 ** np.array(t)),
        read_only(np.array(probability) / probability[0]),
    )


@functools.cache
def _usual_odds(doublings: tuple[tuple[int, int, float], ...]) -> FloatArray:
    """Odds of each pair of factors with a good hand, over those with these doublings, shape (q,); 1 for other pairs."""
    usual = {(s, t): probability for s, t, probability in USUAL.doublings}
    return np.asarray(read_only(np.array([usual.get((s, t), own) / own for s, t, own in doublings])))


def _doubts(
    model: ObjectModel, contacts: Contacts, outlier_probability: float, doubt: ContactDoubt
) -> tuple[Doubts, FloatArray]:
    """The mixture in the form that kernels read, and the inlier probability (k,) if all lie exactly on the surface."""
    count, has_normals = len(contacts), contacts.n_PC is not None
    volume = math.prod((model.grid.upper - model.grid.origin + 2.0 * doubt.surroundings).tolist())
    measured = Measured(
        sigma_p=read_only(np.asarray(contacts.sigma_position)),
        sigma_n=read_only(np.asarray(contacts.sigma_normal)),
        shares=_shares(doubt, outlier_probability, count, has_normals),
        per_sigma=model.area * math.sqrt(2.0 * math.pi) / volume,
        most_p=float(doubt.most_noise[0]),
        most_n=float(doubt.most_noise[1]),
        displacement=float(doubt.displacement),
        has_normals=has_normals,
    )
    # By kind; for independent doubt and for the single one; over inliers.
    odds, closeness, exact = np.empty((4, 2, count)), np.empty(count), np.empty(count)
    find_odds(measured, odds, closeness, exact)
    odds.flags.writeable = False
    return Doubts._make((*_scales(doubt.doublings), *odds, read_only(closeness), has_normals)), exact


@functools.lru_cache
def _shares(doubt: ContactDoubt, outlier_probability: float, count: int, has_normals: bool) -> FloatArray:
    """`KindShares` of `count` contacts, shape (6, 2): for independently false contacts, and for the single one."""
    nothing = KindShares(as_told=1.0, flipped=0.0, turned=0.0, displaced=0.0, other=0.0, lost=0.0)
    of_each, of_one = doubt.kinds.shares(outlier_probability), nothing
    if doubt.of_one is not None:  # Contacts with something else are covered by independent doubt.
        of_one = doubt.of_one.among(count).shares(outlier_probability)._replace(other=0.0)
    rows = [each if has_normals else each.without_normals() for each in (of_each, of_one)]
    return np.asarray(read_only(np.array(rows).T))
