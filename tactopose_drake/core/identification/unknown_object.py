"""The probability that a touch is of none of the known objects.

The evidence of each known object tells how well it explains the touch; that of an unknown object must be guessed. Two
guesses are combined by their geometric mean:

- From the touch alone: normally distributed places of unknown size and centre, stretched along an unknown axis by an
  unknown ratio, with normals that tend to point outwards. It does not know that objects consist of faces and of
  surfaces of revolution.
- From the other known objects: on average they explain the touch of an unknown object about as well as that of each
  other. All but the best one stand for the objects that might be held instead.

Both are rough, so the best object must exceed them by a margin. It grows with the numbers that the touch measures: with
those beyond one contact, which fits any object, up to five contacts; then with those beyond the six of a pose. The
margin, and the factor by which the difference is scaled, come from logistic regressions [P99] on 1460 random touches of
90 objects: by two to twelve contacts, with normals and without, from a tenth to five times the usual noise, each
against many libraries of 5 to 30 of these objects with and without the touched one. The noise of points does not matter
to the margin. It is linear in the logarithm of that of normals: by precise normals, the right object and the best of
the wrong ones exceed the guesses by more. `examples/unknown_objects.py` shows the performance on other objects.

However well a known object explains a touch, an unknown one may have the same shape where it was touched: this is
assumed for a small share of the touches of unknown objects.

Source: [P99] J. Platt, Probabilistic outputs for support vector machines, Advances in Large Margin Classifiers, 1999.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.patch_contacts import tell_normals
from tactopose_drake.core.validation import FloatArray

# Log volume of all rotations, which an object's evidence is integrated over.
_LOG_ROTATIONS = math.log(8.0 * math.pi**2)
_OF_A_POSE = 6  # numbers


@dataclasses.dataclass(frozen=True, kw_only=True)
class UnknownObjectParams:
    """What is assumed of unknown objects.

    Attributes:
        sizes: range of the standard deviation of touched places, across their longest axis, m; log-uniform.
        size_steps: number of steps in this range.
        aspects: ratios by which places are stretched along that axis, each with its probability.
        axis_steps: number of steps of that axis' angles, a multiple of 4.
        outwardness: concentration of a normal about that of the ellipsoid through its place, for each standard
            deviation of its distance from the centre; 0 for uniform normals.
        library_share: weight of the guess by the other objects in the mean, in the limit of many of them.
        trust: factor of the difference of logarithms.
        least_surplus: margin for each measured number (one of a point, two of a normal) beyond those of one contact.
        surplus_beyond_pose: margin for each number beyond those of a pose, where this makes more.
        usual_noise: noise of normals at which these hold, rad.
        surplus_of_noise: increase of the margin for each of a normal's numbers, per logarithm of how many times as
            precise it is.
        lookalikes: share of the touches of unknown objects that the best known one explains as well.
    """

    sizes: tuple[float, float] = (0.012, 0.09)
    size_steps: int = 14
    aspects: tuple[tuple[float, float], ...] = ((1.0, 0.4), (2.0, 0.3), (4.0, 0.3))
    axis_steps: int = 12
    outwardness: float = 1.3
    library_share: float = 0.5
    trust: float = 0.7
    least_surplus: float = 0.6
    surplus_beyond_pose: float = 0.8
    usual_noise: float = math.radians(5.0)
    surplus_of_noise: float = 0.4
    lookalikes: float = 0.03


def unknown_probability(
    log_evidence: Sequence[float],
    objects: int,
    touch: Contacts,
    prior: float,
    params: UnknownObjectParams = UnknownObjectParams(),
) -> float:
    """The probability that a touch is of none of the known objects.

    Args:
        log_evidence: of the known objects, one for each shape, by `model_evidence.log_evidence`; objects that are ruled
            out may be omitted.
        objects: number of known shapes, including those omitted.
        touch: the contacts, and the patches as contacts.
        prior: the probability before the touch.
        params: what is assumed of unknown objects.
    """
    # One contact fits any object: differences would only come from numerical errors of the evidence.
    if prior in (0.0, 1.0) or len(touch) < 2:
        return prior
    evidence = np.sort(np.asarray(log_evidence))[::-1]
    best, expected = float(evidence[0]) - _LOG_ROTATIONS, log_evidence_of_any(touch, params)
    if len(evidence) > 1:
        others = float(np.logaddexp.reduce(evidence[1:])) - math.log(objects - 1) - _LOG_ROTATIONS
        expected += params.library_share * (1.0 - 1.0 / objects) * (others - expected)
    surplus = params.trust * (best - expected) - _least_surplus(touch, params)
    log_odds = math.log(prior / (1.0 - prior)) + float(np.logaddexp(-surplus, math.log(params.lookalikes)))
    return 1.0 / (1.0 + math.exp(-log_odds)) if log_odds > -500.0 else 0.0


def _least_surplus(touch: Contacts, params: UnknownObjectParams) -> float:
    """The margin by which the best object must exceed the guesses."""
    sigma_n = np.broadcast_to(touch.sigma_normal, len(touch))[tell_normals(touch)]
    numbers, beyond_one = len(touch) + 2 * len(sigma_n), 1.0 - 1.0 / len(touch)
    usual = max(params.least_surplus * numbers * beyond_one, params.surplus_beyond_pose * (numbers - _OF_A_POSE))
    # Normals that tell nothing leave a margin for the points alone.
    precise = np.maximum(params.surplus_of_noise * np.log(params.usual_noise / sigma_n), -params.least_surplus)
    return max(usual + 2.0 * beyond_one * float(precise.sum()), 0.0)


def log_evidence_of_any(touch: Contacts, params: UnknownObjectParams = UnknownObjectParams()) -> float:
    """Log likelihood of a touch of an unknown object, from the touch alone.

    It is in the units of `model_evidence.log_evidence` over all rotations: for one contact it equals any object's.
    """
    count, noise = len(touch), math.sqrt(2.0 * math.pi) * np.broadcast_to(touch.sigma_position, len(touch))
    if touch.n_PC is not None:
        noise = noise * np.minimum(0.5 * np.broadcast_to(touch.sigma_normal, count) ** 2, 1.0)
    each = [math.log(share) + _log_density(touch, aspect, params) for aspect, share in params.aspects]
    return float(np.logaddexp.reduce(each) + np.log(noise).sum())


def _log_density(touch: Contacts, aspect: float, params: UnknownObjectParams) -> float:
    """Log density of places, and of normals relative to uniform ones, with the axis stretched by `aspect`."""
    sizes = np.geomspace(*params.sizes, params.size_steps)[:, None, None]
    p_MC, count = touch.p_PC - touch.p_PC.mean(axis=0), len(touch)
    axes, share = _axes(p_MC, params.axis_steps)
    along = axes @ p_MC.T  # For every axis and contact, like all that follows.
    across = np.sum(p_MC**2, axis=1) - along**2
    distance = np.sqrt(np.maximum(across + (along / aspect) ** 2, 0.0)) / sizes
    # Normally distributed places with a marginalised centre.
    log_density = -0.5 * np.sum(distance**2, axis=2) - 1.5 * math.log(count)
    log_density -= (count - 1) * (1.5 * np.log(2.0 * np.pi * sizes[:, 0] ** 2) + math.log(aspect))
    if touch.n_PC is not None:
        # The von Mises-Fisher density on the sphere, relative to the uniform one.
        length = np.sqrt(np.maximum(across + (along / aspect**2) ** 2, 0.0))
        outward = np.sum(p_MC * touch.n_PC, axis=1) - (1.0 - 1.0 / aspect**2) * along * (axes @ touch.n_PC.T)
        concentration = params.outwardness * distance
        agreement = outward / np.maximum(length, 1e-12)
        log_outward = concentration * agreement - _log_sinhc(concentration)
        log_density += np.sum(log_outward, axis=2, where=tell_normals(touch))
    return float(np.logaddexp.reduce(log_density + np.log(share), axis=None) - math.log(params.size_steps))


def _axes(p_MC: FloatArray, steps: int) -> tuple[FloatArray, FloatArray]:
    """Directions (n, 3) over a hemisphere, and the weight (n,) of each, as quadrature over the longest axis.

    They rotate with the places: from their longest principal axis to across it, and around it, in equal steps.
    """
    principal = np.linalg.eigh(p_MC.T @ p_MC)[1][:, ::-1]
    angle, around = (np.arange(steps) + 0.5) * (0.5 * math.pi / steps), (np.arange(steps) + 0.5) * (2 * math.pi / steps)
    angle, around = (each.ravel() for each in np.meshgrid(angle, around))
    axes = np.stack([np.cos(angle), np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around)], axis=1)
    return axes @ principal.T, np.sin(angle) / np.sin(angle).sum()


def _log_sinhc(x: FloatArray) -> FloatArray:
    """Logarithm of sinh(x) / x for x >= 0, which is 0 at 0."""
    x = np.maximum(x, 1e-6)
    result: FloatArray = x + np.log(-np.expm1(-2.0 * x)) - np.log(2.0 * x)
    return result
