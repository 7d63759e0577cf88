"""The one call: from touch to ranked hypotheses of the object's pose."""

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
        contacts: the touch at single points, in the palm frame; may be `Contacts.empty()` where a patch is felt.
        patches: what tactile arrays feel, in the palm frame; those that feel nothing count too. Where they and contacts
            feel the same place twice, the estimate takes that for two touches.
        prior: what is known without touch; None where the object may be anywhere.
        hand: the hand's volume, where the object is not.
        method: the search. Those of `GLOBAL_METHODS` need no prior; the others start from it. Probabilities are among
            what it finds: "monte_carlo", "direct" and "simulated_annealing" miss the pose in a fifth to a half of
            touches without a prior, and may then be "ok" all the same.
        seed: of the search's random numbers.
        max_hypotheses: how many hypotheses are kept at the most. What the others carry counts for the status, and is
            left out of the probabilities; `kept_share` says how much is left.
        untouched: parts of the hand that feel no contact: the object is not in them, nor presses into them.
        balance: that the object is at rest under the contacts' forces and gravity alone. A pose at which it is not, by
            far more than these forces err, explains no touch.
        friction: coefficient of friction; each force lies in its cone about the object's normal.
        time_limit: after so long, s, the search ends with the best that it has; None for as long as it takes. It is
            asked between rounds, and at least one is made. Where `finished` says that it has cut the search short, "ok"
            is of what was found by then, and may be wrong.
        outlier_probability: that a contact is not of this object at all, before the touch, from 0 to 0.99. With it go
            contacts of the object that are displaced, flipped, have any normal, or tell nothing: see `SCEPTICAL`. 0
            takes every contact as told; all their noise may be larger than told then too, as rarely as a good hand's.
        planes: known planes of the world, in the palm frame, that the held object touches with its lowest point over
            each; a table that it was set upon says how far it has slid in the hand. A pose that
            is not at them explains no touch.

    Raises:
        TooFewContactsError: no contact, and no patch that is felt.
        UnknownNameError: a method that does not exist.
        InvalidInputError: no prior for a method that starts from one, a friction or a seed below 0, `max_hypotheses`
            below 1, a time limit that is not above 0, or a value of another type; a touch that is evidently not in
            metres, or whose forces are of the wrong sign (see `check_contacts`); balance or friction without forces, or
            balance of an object whose mass is not known or whose centre of mass is moved by its symmetries.
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
    """Raises what `estimate_pose` raises of such arguments before it searches.

    Raises:
        TypeError: an option that `estimate_pose` does not have.
    """
    try:
        given = _SIGNATURE.bind(model, contacts, **options)
    except TypeError as error:
        raise TypeError(f"estimate_pose() {error}") from None
    given.apply_defaults()
    _asked(**given.arguments)


_SIGNATURE = inspect.signature(estimate_pose)


class _Asked(NamedTuple):
    """Arguments of `estimate_pose` that were checked, and those of the evidence together."""

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
        raise TooFewContactsError("contacts: there are 0; the estimate needs at least 1, or a patch that is felt.")
    check_contacts(evidence, model.size)
    if balance is not None:
        check_mass(model)
    return _Asked(evidence, seed, most, limit)


def _check_kinds(model: ObjectModel, contacts: Contacts, method: str, prior: PosePrior | None) -> None:
    known_name("method", method, METHODS)
    instance_of("model", model, ObjectModel)
    instance_of("contacts", contacts, Contacts)
    if prior is not None:
        if not isinstance(prior, GaussianPrior):  # That of `core` will do.
            instance_of("prior", prior, PosePrior)
    elif method not in GLOBAL_METHODS:
        raise InvalidInputError(
            f"prior: is None; the method {method!r} starts from one. Without: {', '.join(sorted(GLOBAL_METHODS))}."
        )
