"""`estimate_pose`: from a touch to ranked hypotheses of the object's pose."""

import inspect
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from tactopose_drake.core.evidence.contact_doubt import SCEPTICAL, USUAL
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.evidence.force_balance import ForceBalance
from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.evidence.hand_geometry import HandGeometry
from tactopose_drake.core.evidence.plane_contact import PlaneContact
from tactopose_drake.core.plain_values import copied
from tactopose_drake.core.posterior.moved_origin import has_far_origin, prior_of_middle
from tactopose_drake.core.searches.pose_problem import check_mass
from tactopose_drake.core.sensing.patches import Patch
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import instance_of, known_name, positive_number, whole_number
from tactopose_drake.errors import InvalidInputError, TooFewContactsError
from tactopose_drake.estimation.contact_checks import check_contacts
from tactopose_drake.estimation.far_origins import with_near_origin
from tactopose_drake.estimation.inference import weigh_poses
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.estimation.question import Question
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.estimation.search_methods import GLOBAL_METHODS, METHODS
from tactopose_drake.estimation.shape_errors import log_dilution, with_shape_errors


def estimate_pose(
    model: ObjectModel,
    contacts: Contacts,
    patches: Sequence[Patch] = (),
    prior: PosePrior | None = None,
    hand: HandGeometry | None = None,
    method: str = "pair_search",
    seed: int = 0,
    max_hypotheses: int = 64,
    *,
    untouched: HandGeometry | None = None,
    balance: ForceBalance | None = None,
    friction: float | None = None,
    time_limit: float | None = None,
    outlier_probability: float = 0.02,
    planes: Sequence[PlaneContact] = (),
) -> PoseEstimate:
    """Finds the poses of an object that explain a touch.

    Args:
        model: the object.
        contacts: the touch at single points, in the palm frame; may be `Contacts.empty()` if a patch is felt.
        patches: what tactile arrays feel, in the palm frame; patches without contact count, too. A place that is given
            both as a contact and as a patch counts as two independent touches.
        prior: prior of the pose; None if the object may be anywhere.
        hand: the hand's volume, which the object does not occupy.
        method: the search. Those in `GLOBAL_METHODS` need no prior; the others start from it. Probabilities are
            relative to the poses that the search finds: without a prior, "monte_carlo", "direct" and
            "simulated_annealing" miss the true pose for a fifth to a half of all touches, and may report "ok" anyway.
        seed: seed of the search's random numbers.
        max_hypotheses: the largest number of hypotheses to keep. The others count for the status, but not for the
            probabilities, which are normalized again; `kept_share` is the mass that was kept.
        untouched: parts of the hand that feel no contact: the object neither occupies them nor presses into them.
        balance: states that the object is at rest under the contacts' forces and gravity alone. A pose that violates
            this by far more than the forces' noise does not explain the touch.
        friction: coefficient of friction; each force lies in its cone about the object's normal.
        time_limit: time after which the search ends with the best it has found, s; None: no limit. It is checked
            between iterations, of which at least one is made. If `finished` is False, "ok" refers only to the poses
            found by then, and may be wrong.
        outlier_probability: prior probability that a contact is not on this object, from 0 to 0.99. It also scales the
            probabilities of contacts on the object that are displaced, flipped, wrongly oriented, or useless; see
            `SCEPTICAL`. 0 trusts every contact, and only allows that all noise may be larger than stated, less than
            other values allow.
        planes: known planes of the world, in the palm frame, that the lowest point of the held object over each of them
            touches. A table on which it was set down tells how far it has slid in the hand. A pose that does not touch
            them does not explain the touch.

    Raises:
        TooFewContactsError: if there is no contact and no felt patch.
        UnknownNameError: if the method does not exist.
        InvalidInputError: if the method needs a prior and there is none; if friction or seed is below 0,
            `max_hypotheses` below 1, or the time limit not above 0; if an argument has a wrong type; if the touch is
            evidently not in metres, or its forces have the wrong sign (see `check_contacts`); if balance or friction is
            given without forces, or balance for an object whose mass is unknown or whose symmetries move its centre of
            mass.
    """
    asked = _asked(
        model,
        contacts,
        patches,
        prior,
        hand,
        method,
        seed,
        max_hypotheses,
        untouched,
        balance,
        friction,
        time_limit,
        outlier_probability,
        planes,
    )
    near = prior_of_middle(prior, model.middle) if prior is not None and has_far_origin(model) else prior
    felt = with_shape_errors(model, contacts)
    evidence = asked.evidence.with_parts(felt, near)
    found = with_near_origin(
        model, lambda each: weigh_poses(each, evidence, method, asked.seed, asked.max_hypotheses, asked.time_limit)
    )
    return copied(
        found,
        log_evidence=found.log_evidence - log_dilution(contacts, felt),
        question=Question(model, evidence if near is prior else copied(evidence, prior=prior)),
    )


def check_question(model: ObjectModel, contacts: Contacts, **options: Any) -> None:
    """Checks arguments of `estimate_pose`; raises what it raises for them before its search.

    Raises:
        TypeError: for an option that `estimate_pose` does not have.
    """
    try:
        given = _SIGNATURE.bind(model, contacts, **options)
    except TypeError as error:
        raise TypeError(f"estimate_pose() {error}") from None
    given.apply_defaults()
    _asked(**given.arguments)


_SIGNATURE = inspect.signature(estimate_pose)


class _Asked(NamedTuple):
    """Checked arguments of `estimate_pose`, those of the evidence combined."""

    evidence: Evidence
    seed: int
    max_hypotheses: int
    time_limit: float


def _asked(
    model: ObjectModel,
    contacts: Contacts,
    patches: Sequence[Patch],
    prior: PosePrior | None,
    hand: HandGeometry | None,
    method: str,
    seed: int,
    max_hypotheses: int,
    untouched: HandGeometry | None,
    balance: ForceBalance | None,
    friction: float | None,
    time_limit: float | None,
    outlier_probability: float,
    planes: Sequence[PlaneContact],
) -> _Asked:
    limit = math.inf if time_limit is None else positive_number("time_limit", time_limit)
    _check_kinds(model, contacts, method, prior)
    seed, most = whole_number("seed", seed, least=0), whole_number("max_hypotheses", max_hypotheses, least=1)
    evidence = Evidence(
        contacts, prior, hand, untouched, balance, friction, patches, outlier_probability, planes, SCEPTICAL
    )
    if evidence.outlier_probability == 0.0:
        evidence = copied(evidence, doubt=USUAL)
    if len(evidence.touch) < 1:
        raise TooFewContactsError("contacts must be at least 1 if no patch is felt, not 0.")
    check_contacts(evidence, model.size)
    if balance is not None:
        check_mass(model)
    return _Asked(evidence, seed, most, limit)


def _check_kinds(model: ObjectModel, contacts: Contacts, method: str, prior: PosePrior | None) -> None:
    known_name("method", method, METHODS)
    instance_of("model", model, ObjectModel)
    instance_of("contacts", contacts, Contacts)
    if prior is not None:
        if not isinstance(prior, GaussianPrior):  # The base class in `core` is accepted, too.
            instance_of("prior", prior, PosePrior)
    elif method not in GLOBAL_METHODS:
        raise InvalidInputError(
            f"prior must be a PosePrior for the method {method!r}, not None. Methods that need none are "
            f"{', '.join(sorted(GLOBAL_METHODS))}."
        )
