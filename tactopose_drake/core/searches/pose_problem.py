"""Builds the optimisation problem from evidence: an objective, and the space to search."""

import functools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.objectives.contact_mixture import ContactMixture
from tactopose_drake.core.objectives.friction_cone import FrictionCone
from tactopose_drake.core.objectives.objective import (
    DoubtedObjective,
    LeastSquaresObjective,
    SmoothObjective,
    SumObjective,
)
from tactopose_drake.core.objectives.patch_contact import PatchContact
from tactopose_drake.core.objectives.patch_mixture import PatchMixture
from tactopose_drake.core.objectives.penetration import Penetration
from tactopose_drake.core.objectives.plane_support import PlaneSupport
from tactopose_drake.core.objectives.pose_prior import PriorObjective
from tactopose_drake.core.objectives.surface_contact import ContactsButOne, ContactSum, SurfaceContact
from tactopose_drake.core.objectives.wrench_balance import WrenchBalance
from tactopose_drake.core.poses import transform_points
from tactopose_drake.core.searches.search import PoseSpace, PriorSpace
from tactopose_drake.core.searches.touch_space import TouchSpace, TurnSpace
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.errors import InvalidInputError

# Overlap with the hand that costs nothing, in standard deviations of the hand's geometry: contacts, whose noise is of
# that size too, and yielding skin may leave the object that deep.
_TOUCHING = 2.0

# Fewer contacts than this leave whole families of poses, which planes narrow: the search then descends by planes from
# the first step on. Otherwise nearly all poses would still be far from the planes when most of them are dropped.
_FEW_CONTACTS = 3

# Tolerance for symmetries to keep the centre of mass in place, as a share of the object's size.
_SAME_CENTER = 1e-3


class PoseProblem(NamedTuple):
    """The search for an object's pose from evidence.

    Attributes:
        touch: the contacts' objective alone.
        determining: the objective of the evidence that holds the pose from both sides: contacts, patches, balance and
            planes. Its curvature tells what is determined. The hand's volume, pads that feel nothing and friction bound
            the pose on one side only, which curvature does not show.
        likelihood: the objective of all the evidence except the prior.
        objective: the objective of all the evidence.
        bounding: the terms of `objective` that are not determining, including the prior.
        space: the possible poses.
        mixture: the contacts' likelihood if each may be an outlier; None if there is no contact. Searches use `touch`,
            which has fewer spurious minima; beliefs use this.
        pads: the objective of the pads that feel the object, alone; None if there is none.
        pad_mixture: their likelihood if each may feel something else; None if none may.
        prior: the prior's objective alone; None if there is none.
        hand: the objective of the hand's volume alone; None if there is none.
        but_for_one: see `DoubtedObjective`.
    """

    touch: SurfaceContact
    determining: LeastSquaresObjective
    likelihood: LeastSquaresObjective
    objective: LeastSquaresObjective
    bounding: tuple[LeastSquaresObjective, ...]
    space: PoseSpace
    mixture: ContactMixture | None
    pads: PatchContact | None = None
    pad_mixture: PatchMixture | None = None
    prior: PriorObjective | None = None
    hand: Penetration | None = None
    but_for_one: ContactsButOne | None = None

    def false_ones(self, X_PO: FloatArray) -> NDArray[np.bool_]:
        """Which contacts, and then which pads that feel the object, poses (B, 3, 4) take for false, shape (B, k)."""
        of_contacts = np.empty((len(X_PO), 0), dtype=np.bool_)
        of_pads = of_contacts
        if self.mixture is not None:
            of_contacts = self.mixture.judge(X_PO).is_false
        if self.pad_mixture is not None:
            of_pads = self.pad_mixture.inlier_probability(X_PO) < 0.5
        return np.concatenate([of_contacts, of_pads], axis=1)

    def doubted(self, objective: LeastSquaresObjective) -> DoubtedObjective:
        """The robust form of one of the objectives, in which contacts and pads may be outliers."""
        terms = (objective,) if objective is self.pads else objective.terms
        doubted: dict[int, SmoothObjective] = {}
        if self.pads is not None and self.pad_mixture is not None:
            doubted[id(self.pads)] = self.pad_mixture
        if self.mixture is not None:
            mixture = self.mixture
            if self.touch in terms:  # Evaluated in one compiled loop.
                if self.prior is not None and self.prior in terms:
                    mixture = mixture.with_prior(self.prior)
                if self.hand is not None and self.hand in terms:
                    mixture = mixture.with_hand(self.hand)
                terms = tuple(term for term in terms if term not in (self.prior, self.hand))
            doubted[id(self.touch)] = mixture
        return DoubtedObjective([doubted.get(id(term), term) for term in terms], objective, self.but_for_one)


def make_problem(model: ObjectModel, evidence: Evidence) -> PoseProblem:
    """Builds the objectives of the evidence, which has at least one contact, or a patch that is felt.

    Raises:
        InvalidInputError: balance of an object of unknown mass, or whose symmetries move its centre of mass.
    """
    contacts, prior = evidence.contacts, evidence.prior
    mixture = None
    if len(contacts):
        mixture = ContactMixture(model, contacts, evidence.outlier_probability, evidence.doubt)
    touch = SurfaceContact(model.grid, contacts) if mixture is None else mixture.touch
    terms: list[LeastSquaresObjective] = [touch] if len(contacts) else []
    pads = PatchContact(model.grid, evidence.felt) if evidence.felt else None
    pad_mixture = None
    if pads is not None:
        terms.append(pads)
        if evidence.outlier_probability > 0.0:
            pad_mixture = PatchMixture(model, evidence.felt, evidence.outlier_probability)
    if evidence.balance is not None:
        terms.append(_balance_term(model, evidence))
    planes = PlaneSupport(model, evidence.planes) if evidence.planes else None
    if planes is not None:
        terms.append(planes)
    determining = _sum(terms)
    bounding, hand = _bounding_terms(model, evidence), _hand_term(model, evidence)
    if hand is not None:
        bounding.append(hand)
    known = None if prior is None else PriorObjective(prior)
    is_compiled = terms == [touch] and all(term is hand for term in bounding)
    likelihood = ContactSum(touch, hand=hand) if is_compiled and hand is not None else _sum([*terms, *bounding])
    touch_and_pads = SurfaceContact(model.grid, evidence.touch) if pads else touch
    quick_planes = planes if len(evidence.touch) < _FEW_CONTACTS else None
    if known is None or prior is None:
        space: PoseSpace = TouchSpace(model, evidence.touch)
        objective = likelihood
        if quick_planes is not None:
            objective = SumObjective([*terms, *bounding], quick=SumObjective([touch_and_pads, quick_planes]))
    else:
        space = PriorSpace(prior) if prior.tells_position else TurnSpace(model, evidence.touch, prior)
        quick: LeastSquaresObjective = ContactSum(touch, known)
        if quick_planes is not None:
            quick = SumObjective([quick, quick_planes])
        bounding.append(known)
        objective = quick
        if is_compiled and hand is not None:
            objective = ContactSum(touch, known, hand, quick)
        elif not is_compiled:
            objective = SumObjective([*terms, *bounding], quick=quick if len(contacts) else None)
    but_for_one = None
    if len(evidence.touch) > 1 and evidence.outlier_probability > 0.0:
        but_for_one = ContactsButOne(touch_and_pads, known)
    return PoseProblem(
        touch=touch,
        determining=determining,
        likelihood=likelihood,
        objective=objective,
        bounding=tuple(bounding),
        space=space,
        mixture=mixture,
        pads=pads,
        pad_mixture=pad_mixture,
        prior=known,
        hand=hand,
        but_for_one=but_for_one,
    )


def _bounding_terms(model: ObjectModel, evidence: Evidence) -> list[LeastSquaresObjective]:
    """The objectives that bound the pose on one side, except the hand's volume: unfelt pads, and friction."""
    terms: list[LeastSquaresObjective] = []
    unfelt = [patch for patch in evidence.patches if not patch.is_felt]
    if unfelt:
        terms.append(PatchContact(model.grid, unfelt))
    if evidence.friction is not None:
        terms.append(FrictionCone(model.grid, evidence.contacts, evidence.friction))
    return terms


def _hand_term(model: ObjectModel, evidence: Evidence) -> Penetration | None:
    """The objective of the hand's volume, and of its parts without contact."""
    volumes = []
    if evidence.hand is not None:
        volumes.append(Penetration(model.grid, evidence.hand, _TOUCHING * evidence.hand.sigma))
    if evidence.untouched is not None:
        volumes.append(Penetration(model.grid, evidence.untouched))
    return functools.reduce(Penetration.joined, volumes) if volumes else None


def _sum(terms: list[LeastSquaresObjective]) -> LeastSquaresObjective:
    return terms[0] if len(terms) == 1 else SumObjective(terms)


def _balance_term(model: ObjectModel, evidence: Evidence) -> LeastSquaresObjective:
    """The objective of the balance of forces, which the evidence must have.

    Raises:
        InvalidInputError: an object of unknown mass, or whose symmetries move its centre of mass.
    """
    assert evidence.balance is not None
    check_mass(model)
    return WrenchBalance(evidence.contacts, evidence.balance, model.mass, model.center_of_mass)


def check_mass(model: ObjectModel) -> None:
    """Checks that the balance of forces is usable: the mass must be known, and symmetries keep the centre of mass.

    Raises:
        InvalidInputError: an object of unknown mass, or whose symmetries move its centre of mass.
    """
    if not model.mass_is_known:
        raise InvalidInputError(
            f"model must have a mass for the balance, but that of {model.name!r} is not known. Give it by "
            "`ObjectModel.from_mesh(mass=...)`."
        )
    images = transform_points(model.symmetry_turns, model.center_of_mass[None])
    moved = float(np.linalg.norm(images - model.center_of_mass, axis=-1).max())
    if moved > _SAME_CENTER * model.size:
        raise InvalidInputError(
            f"model must have only symmetries that keep its centre of mass for the balance, not those of "
            f"{model.name!r}, which move it by {1e3 * moved:.2g} mm. Choose them by "
            "`ObjectModel.from_mesh(symmetry=...)`."
        )
