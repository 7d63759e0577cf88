"""Whether noise alone explains the residuals that a touch leaves at a pose."""

import functools
import math

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.evidence.contact_doubt import ContactKinds
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.objectives.contact_mixture import Judgement
from tactopose_drake.core.objectives.patch_contact import PatchContact
from tactopose_drake.core.objectives.plane_support import PlaneSupport
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.objectives.surface_density import SurfaceDensity
from tactopose_drake.core.objectives.wrench_balance import WrenchBalance
from tactopose_drake.core.posterior.chi_square import chi_square_limit
from tactopose_drake.core.posterior.posterior_params import DEFAULT_PARAMS, PlausibilityParams
from tactopose_drake.core.searches.pose_problem import PoseProblem
from tactopose_drake.core.sensing.patches import Patch
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray

# Smaller densities come from discs that were not integrated to their ends.
_LEAST_DENSITY = 1e-6
# Fewer contacts than these explain a touch only if none of them is false.
_FEWEST_THAT_AGREE = 3
_MISPLACEMENTS = 6  # degrees of freedom of a pad's misplacement, at the true pose
_OF_A_POSE = 6  # degrees of freedom that fitting a pose takes from the contacts' residuals
_OF_A_WRENCH = 6  # components of a wrench
# Adjacent noise scales have variances in the ratio 2; each stands for those up to their geometric mean, so its variance
# may be too low by this factor.
_OF_A_SCALE = math.sqrt(2.0)
_REACH_SIGMAS = 6.0  # standard deviations from its believed place beyond which the object cannot be


def degrees_of_freedom(evidence: Evidence) -> int:
    """How many scalars the touch measures; half of that is the expected cost of noise at the true pose."""
    return _of_contacts(evidence) + sum(_of_patch(patch) for patch in evidence.patches)


def explain_touch(
    model: ObjectModel, evidence: Evidence, X_PO: FloatArray, params: PlausibilityParams = DEFAULT_PARAMS.plausibility
) -> NDArray[np.bool_]:
    """Which poses (B, 3, 4) leave residuals that noise explains: of all contacts together, and of each pad alone.

    Pads are tested one by one, as one that noise does not explain would hide among the many cells of the others. At the
    true pose, a pad's cost is at most that of its true misplacement and the cells' noise, as it is minimised over
    misplacements.
    """
    explained = np.ones(len(X_PO), dtype=np.bool_)
    if len(evidence.contacts):
        limit = _limit(_of_contacts(evidence), params.least_contact_chance)
        touch = SurfaceContact(model.grid, evidence.contacts)
        explained &= touch.cost(X_PO) <= limit
        if not explained.all():
            explained[~explained] = _exact_cost(model, touch, evidence.contacts, X_PO[~explained]) <= limit
    return np.asarray(explained & _by_pad(model, evidence, X_PO, params.least_pad_chance).all(axis=1))


def _exact_cost(model: ObjectModel, touch: SurfaceContact, contacts: Contacts, X_PO: FloatArray) -> FloatArray:
    """Costs (B,) of contacts at poses (B, 3, 4), by the exact surface where it is near enough to matter.

    At edges and thin walls the smooth residuals exceed noise; far off, only they tell the distance.
    """
    smooth = 0.5 * np.square(touch.residuals(X_PO).reshape(len(X_PO), len(contacts), -1)).sum(axis=2)
    density = SurfaceDensity(model, contacts).densities(X_PO)
    exact = -np.log(np.maximum(density, _LEAST_DENSITY))
    return np.asarray(np.where(density > _LEAST_DENSITY, exact, smooth).sum(axis=1))


def explain_with_doubt(
    model: ObjectModel,
    evidence: Evidence,
    judgement: Judgement | None,
    X_PO: FloatArray,
    params: PlausibilityParams = DEFAULT_PARAMS.plausibility,
) -> NDArray[np.bool_]:
    """Which of the poses (B, 3, 4) explain the touch except for a plausible number of false contacts and pads.

    That number is the one of a good hand, by `outlier_probability`: a more sceptical setting widens what is concluded,
    but does not make a touch of which only half fits one of this object.

    Args:
        model: the object.
        evidence: the touch.
        judgement: the classification of the contacts by `ContactMixture` at the poses; None if there is no contact.
        X_PO: the poses.
        params: what counts as an explanation.
    """
    explained, false = np.ones(len(X_PO), dtype=np.bool_), np.zeros(len(X_PO), dtype=np.int64)
    if evidence.patches:
        by_pad = _by_pad(model, evidence, X_PO, params.least_pad_chance)
        felt = np.array([patch.is_felt for patch in evidence.patches], dtype=np.bool_)
        explained &= by_pad[:, ~felt].all(axis=1)
        false += (~by_pad[:, felt]).sum(axis=1)
    if judgement is not None:
        false += judgement.is_false.sum(axis=1)
        freedom = _of_contacts(evidence)
        # With many contacts, the chi-square quantile is less than the resolution of the noise scales.
        limit = max(_limit(freedom, params.least_doubted_chance), 0.5 * _OF_A_SCALE * freedom)
        explained &= judgement.misfit <= limit
        explained &= judgement.noise_scale <= params.most_noise
    count = len(evidence.contacts) + len(evidence.felt)
    allowed = most_false_contacts(count, _false_share(evidence.outlier_probability), params.usual_false_contacts)
    return np.asarray(explained & (false <= allowed))


def lies_on_planes(
    model: ObjectModel, evidence: Evidence, X_PO: FloatArray, params: PlausibilityParams = DEFAULT_PARAMS.plausibility
) -> NDArray[np.bool_]:
    """At which of the poses (B, 3, 4) the object touches the planes it rests on, up to their noise."""
    if not evidence.planes:
        return np.ones(len(X_PO), dtype=np.bool_)
    limit = _limit(len(evidence.planes), params.least_contact_chance)
    return np.asarray(PlaneSupport(model, evidence.planes).cost(X_PO) <= limit)


def is_at_rest(
    model: ObjectModel, evidence: Evidence, X_PO: FloatArray, params: PlausibilityParams = DEFAULT_PARAMS.plausibility
) -> NDArray[np.bool_]:
    """At which of the poses (B, 3, 4) the contacts' forces balance the object's weight, if they are said to.

    The tolerance is their noise, which may be underestimated as much as that of the points.
    """
    if evidence.balance is None:
        return np.ones(len(X_PO), dtype=np.bool_)
    balance = WrenchBalance(evidence.contacts, evidence.balance, model.mass, model.center_of_mass)
    limit = params.most_noise**2 * _limit(_OF_A_WRENCH, params.least_contact_chance)
    return np.asarray(balance.cost(np.ascontiguousarray(X_PO)) <= limit)


@functools.cache
def _false_share(outlier_probability: float) -> float:
    return ContactKinds().shares(outlier_probability).false


@functools.cache
def most_false_contacts(count: int, share: float, chance: float) -> int:
    """The number of false ones among `count` contacts that is not exceeded with this chance; at least 3 stay true."""
    most = max(count - _FEWEST_THAT_AGREE, 0)
    # The probability of exactly so many false ones, as a logarithm because it may underflow, and of at most so many.
    log_just, passed = count * math.log1p(-share), 0.0
    for false in range(most):
        passed += math.exp(log_just)
        if passed >= chance:
            return false
        log_just += math.log((count - false) / (false + 1) * share / (1.0 - share))
    return most


def is_comfortable(model: ObjectModel, evidence: Evidence, problem: PoseProblem, X_PO: FloatArray) -> bool:
    """Whether any of the poses (B, 3, 4) explains the touch so well that no contact or pad needs to be doubted."""
    params = DEFAULT_PARAMS.plausibility
    chance = params.comfortable_chance
    if evidence.patches:
        X_PO = X_PO[_by_pad(model, evidence, X_PO, chance, params.comfortable_variance).all(axis=1)]
    if not len(X_PO) or problem.mixture is None:
        return len(X_PO) > 0
    limit = params.comfortable_variance * _limit(max(_of_contacts(evidence) - _OF_A_POSE, 1), chance)
    return bool(problem.touch.cost(X_PO).min() <= limit or problem.mixture.density.cost(X_PO).min() <= limit)


def _by_pad(
    model: ObjectModel, evidence: Evidence, X_PO: FloatArray, least_chance: float, variance: float = 1.0
) -> NDArray[np.bool_]:
    """Which of k pads each pose (B, 3, 4) explains, shape (B, k), with the told variance times `variance`."""
    if not evidence.patches:
        return np.ones((len(X_PO), 0), dtype=np.bool_)
    limits = np.array([_limit(_MISPLACEMENTS + _of_patch(patch), least_chance) for patch in evidence.patches])
    return np.asarray(PatchContact(model.grid, evidence.patches).pad_costs(X_PO) <= variance * limits)


def may_be_touched(
    model: ObjectModel,
    X_PO: FloatArray,
    covariance: FloatArray,
    contacts: Contacts,
) -> bool:
    """Whether an object of roughly known pose can be what is touched: whether any contact is within its reach.

    Args:
        model: the object.
        X_PO: its present or recent pose, shape (3, 4).
        covariance: of the increment (w, v) from this pose, shape (6, 6), rad and m; v is that of a point of the object,
            or near it.
        contacts: in P, at least one.
    """
    spread = np.trace(covariance[3:, 3:]) + model.size**2 * np.trace(covariance[:3, :3])
    # The size allows for rotations about that point, and for motion in the hand meanwhile.
    reach = model.size + _REACH_SIGMAS * np.sqrt(spread)
    p_OC = (contacts.p_PC - X_PO[:, 3]) @ X_PO[:, :3]
    out_of_box = p_OC - np.clip(p_OC, model.grid.origin, model.grid.upper)
    return bool(np.square(out_of_box).sum(axis=1).min() < reach**2)


@functools.cache
def _limit(count: int, least_chance: float) -> float:
    return 0.5 * chi_square_limit(count, least_chance)


def _of_contacts(evidence: Evidence) -> int:
    return len(evidence.contacts) * (1 if evidence.contacts.n_PC is None else 3)


def _of_patch(patch: Patch) -> int:
    """The active cells' depths, and the two angles of the surface if any cell is active."""
    return int(np.count_nonzero(patch.active)) + (2 if patch.is_felt else 0)
