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
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.evidence.contact_doubt import USUAL, ContactDoubt, KindShares
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.kernels import contact_alternatives_kernels
from tactopose_drake.core.kernels.contact_judgement_kernels import Exact, Judged, judge
from tactopose_drake.core.kernels.contact_mixture_kernels import Doubts
from tactopose_drake.core.kernels.least_squares_kernels import DescentRule
from tactopose_drake.core.objectives.compiled_descent import CompiledDescent
from tactopose_drake.core.objectives.objective import Descent, NormalEquations, SmoothObjective
from tactopose_drake.core.objectives.penetration import Penetration
from tactopose_drake.core.objectives.pose_prior import PriorObjective
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.objectives.surface_density import SurfaceDensity
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray

# Keeps the density of other objects' contacts above 0, so that its logarithm is finite.
_LEAST_DENSITY = 1e-250


class Judgement(NamedTuple):
    """The mixture's posterior over the contacts at given poses.

    Attributes:
        cost: negative log likelihoods, shape (B,).
        inlier_probability: that each contact is as told, shape (B, k).
        noise_scale: posterior mean of the factor of the standard deviations, shape (B,).
        misfit: half the sum of squares of the contacts that are as told, in units of the estimated noise, shape (B,).
        is_false: whether each contact's inlier probability is less than half of an exact contact's, shape (B, k).
    """

    cost: FloatArray
    inlier_probability: FloatArray
    noise_scale: FloatArray
    misfit: FloatArray
    is_false: NDArray[np.bool_]


class ContactMixture(SmoothObjective):
    """The mixture likelihood of contacts; like that of `SurfaceContact`, zero if all lie exactly on the surface."""

    def __init__(
        self, model: ObjectModel, contacts: Contacts, outlier_probability: float, doubt: ContactDoubt = USUAL
    ) -> None:
        self.touch = SurfaceContact(model.grid, contacts)
        self.density = SurfaceDensity(model, contacts)
        self._doubts = _doubts(model, contacts, outlier_probability, doubt)
        self._reached = doubt.reached
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

    def normal_equations(self, X_PO: FloatArray) -> NormalEquations:
        """Cost, gradient and Gauss-Newton Hessian at poses (B, 3, 4), by the distance field."""
        return self._compiled.normal_equations(X_PO)

    @property
    def descent(self) -> Callable[[DescentRule, FloatArray], Descent]:
        """Levenberg-Marquardt from each of the poses (B, 3, 4) in one compiled loop."""
        return self._compiled.descend

    def alternatives(self, X_PO: FloatArray, hessian: FloatArray) -> FloatArray:
        """The part of a cost's Hessians (B, 6, 6) that remains with one contact false, shape (B, 2 k, 6, 6)."""
        left = np.empty((len(X_PO), 2 * len(self._doubts.closeness), 6, 6))
        contact_alternatives_kernels.find_alternatives(
            self.touch.grid, self.touch.touch, self._doubts, np.ascontiguousarray(X_PO), hessian, left
        )
        return left

    def judge(self, X_PO: FloatArray) -> Judgement:
        """The posterior over the contacts at poses (B, 3, 4) by the exact surface, see `SurfaceDensity`."""
        judged = self._judge(X_PO, self.density.densities(X_PO), self._reached, whole=True)
        of_exact_ones = _exact_inliers(self._doubts)
        return Judgement(*judged, judged.inlier_probability < 0.5 * of_exact_ones)

    def exact_cost(self, X_PO: FloatArray) -> FloatArray:
        """The costs (B,) of `judge` alone, which are faster to compute."""
        cost = self._judge(X_PO, self.density.densities(X_PO), self._reached, whole=False).cost
        return self._with_overlap(cost, X_PO)

    def _judge(self, X_PO: FloatArray, density: FloatArray, reached: float, whole: bool) -> Judged:
        """Evaluates the mixture with exact densities (B, k) as far as `reached`, and with the distance field beyond."""
        count = len(X_PO)
        judged = Judged(np.empty(count), np.empty(density.shape), np.empty(count), np.empty(count))
        touch, X_PO, exact = self.touch, np.ascontiguousarray(X_PO), Exact(density, reached)
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


def _exact_inliers(doubts: Doubts) -> FloatArray:
    """The inlier probability (k,) of each contact if all lie exactly on the surface."""
    own, one = 1.0 + doubts.normal[0] + doubts.displaced[0] + doubts.other[0], doubts.normal[1] + doubts.displaced[1]
    odds = (one + doubts.other[1]) / own
    return np.asarray((1.0 + odds.sum() - odds) / (own * (1.0 + odds.sum())))


def _doubts(model: ObjectModel, contacts: Contacts, outlier_probability: float, doubt: ContactDoubt) -> Doubts:
    """The mixture in the form that kernels read."""
    sigma_p, sigma_n = np.asarray(contacts.sigma_position), np.asarray(contacts.sigma_normal)
    has_normals = contacts.n_PC is not None
    # The density of a contact as told is uniform by area and Gaussian across the surface; that of one with something
    # else is uniform by volume. The density of a normal as told is Gaussian on the sphere; of any normal, uniform.
    volume = math.prod((model.grid.upper - model.grid.origin + 2.0 * doubt.surroundings).tolist())
    per_sigma = model.area * math.sqrt(2.0 * math.pi) / volume
    most_p, most_n = doubt.most_noise
    any_point = np.minimum(per_sigma * sigma_p, 1.0)
    lost_point = np.minimum(any_point, per_sigma * most_p)
    any_normal = np.minimum(0.5 * sigma_n**2, 1.0) if has_normals else np.ones(len(sigma_n))
    lost_normal = np.minimum(any_normal, 0.5 * most_n**2) if has_normals else any_normal
    displaced = np.minimum(sigma_p / doubt.displacement, 1.0)
    as_told, flipped, turned, moved, other, lost = _shares(doubt, outlier_probability, len(sigma_p), has_normals)
    rows = np.empty((4, 2, len(sigma_n)))  # By kind; for independent doubt and for the single one; over inliers.
    rows[0], rows[1], rows[2] = flipped, turned * any_normal, moved * displaced
    rows[3] = lost * lost_point * lost_normal + other * any_point * any_normal
    rows /= as_told
    rows[3, 0] = np.maximum(rows[3, 0], _LEAST_DENSITY)
    rows.flags.writeable = False
    return Doubts._make((*_scales(doubt.doublings), *rows, read_only(displaced**2), has_normals))


@functools.lru_cache
def _shares(doubt: ContactDoubt, outlier_probability: float, count: int, has_normals: bool) -> FloatArray:
    """`KindShares` of `count` contacts, shape (6, 2, 1): for independently false contacts, and for the single one."""
    nothing = KindShares(as_told=1.0, flipped=0.0, turned=0.0, displaced=0.0, other=0.0, lost=0.0)
    of_each, of_one = doubt.kinds.shares(outlier_probability), nothing
    if doubt.of_one is not None:  # Contacts with something else are covered by independent doubt.
        of_one = doubt.of_one.among(count).shares(outlier_probability)._replace(other=0.0)
    rows = [each if has_normals else each.without_normals() for each in (of_each, of_one)]
    return np.array(rows).T[:, :, None]
