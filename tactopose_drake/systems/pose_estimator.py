"""The estimate of a held object's pose, as a system."""

import dataclasses

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, EventStatus, State

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.force_balance import ForceBalance
from tactopose_drake.core.evidence.hand_geometry import HandGeometry
from tactopose_drake.core.evidence.plane_contact import PlaneContact
from tactopose_drake.core.parameter_checks import params_of
from tactopose_drake.core.searches.pose_problem import check_mass
from tactopose_drake.core.sensing.force_torque import GRAVITY_W
from tactopose_drake.core.sensing.intrinsic_contact import ContactSolution
from tactopose_drake.core.sensing.patches import Patch
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import (
    MOST_FRICTION,
    MOST_OUTLIERS,
    FloatArray,
    flag,
    instance_of,
    known_name,
    positive_number,
    whole_number,
)
from tactopose_drake.estimation.estimate import estimate_pose
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.estimation.search_methods import METHODS
from tactopose_drake.hand.collision import HandCollision, keep_clear
from tactopose_drake.systems.collectable_system import CollectableSystem
from tactopose_drake.systems.collision_input import CollisionInput, PosedHandCollision
from tactopose_drake.systems.ports import (
    eval_items,
    eval_named,
    eval_optional_input,
    eval_touch,
    eval_touch_remarks,
    too_few,
)

_SIGMAS = 3.0  # standard deviations of the hand's surface by which the object may penetrate it


@dataclasses.dataclass(kw_only=True, slots=True)
class PoseEstimatorParams:
    """How and how often the pose is estimated."""

    period: float = 0.1  # s between two estimates
    method: str = "pair_search"  # a method of `estimate_pose`
    min_contacts: int = 2  # with fewer contacts and felt patches the pose is not updated
    max_hypotheses: int = 16  # kept at the most
    seed: int = 0  # of the search's random numbers, the same at each estimate
    max_duration: float | None = None  # s after which the search ends with the best it has found; None: no limit
    # Largest penetration of the hand that does not count as a collision, m. It is raised to three standard deviations
    # of the hand's surface where the input `hand` tells them.
    collision_tolerance: float = 0.003
    friction: float | None = None  # coefficient of friction, if no contact slips; None: unknown
    outlier_probability: float = 0.02  # probability that a contact is not on this object; 0: all contacts are trusted
    balance: bool = False  # whether the object rests on the sensing fingertips alone; its mass must be known

    def validate(self) -> None:
        """Raises InvalidInputError if a number is out of its range or the method is unknown."""
        known_name("PoseEstimatorParams.method", self.method, METHODS)
        whole_number("PoseEstimatorParams.seed", self.seed, least=0)
        positive_number("PoseEstimatorParams.period", self.period)
        positive_number("PoseEstimatorParams.collision_tolerance", self.collision_tolerance, allow_zero=True)
        flag("PoseEstimatorParams.balance", self.balance)
        if self.max_duration is not None:
            positive_number("PoseEstimatorParams.max_duration", self.max_duration)
        if self.friction is not None:
            positive_number("PoseEstimatorParams.friction", self.friction, allow_zero=True, most=MOST_FRICTION)
        positive_number(
            "PoseEstimatorParams.outlier_probability", self.outlier_probability, allow_zero=True, most=MOST_OUTLIERS
        )
        for name in ("min_contacts", "max_hypotheses"):
            whole_number(f"PoseEstimatorParams.{name}", getattr(self, name), least=1)


class PoseEstimator(CollectableSystem):
    """Estimates the pose of a held object from the contacts and tactile patches of one instant.

    .. pydrake_system::

        name: PoseEstimator
        input_ports:
        - contacts
        - contact_status
        - patches
        - patch_status
        - prior
        - hand
        - untouched
        - planes
        - joint_positions
        - palm_pose
        - contact_solutions
        output_ports:
        - object_pose
        - hypotheses
        - status

    All inputs are read at each period.

    - contacts: `Contacts` in P; may stay unconnected if patches are connected.
    - contact_status, patch_status: str, "ok", or which fingers and pads do not feel the object and why; repeated in the
      remarks of the status. May stay unconnected.
    - patches: tuple of `Patch` in P, including those that feel nothing; may stay unconnected.
    - prior: `PosePrior` X_PO, or None while there is none yet. May stay unconnected if the method needs no prior.
    - hand: `HandGeometry` in P, space that the object does not occupy, or None; may stay unconnected.
    - untouched: `HandGeometry` in P, the parts of the hand that feel no contact, or None; may stay unconnected.
    - planes: tuple of `PlaneContact` in P, planes of the world that the held object rests against now or has rested
      against since it was grasped; may stay unconnected.
    - joint_positions: of the hand, shape (nq,), rad; the port exists only if collisions are checked.
    - palm_pose: `RigidTransform` X_WP, z of the world upwards; the port exists only with `balance`. The balance, with a
      gravity of 9.81 m/s^2, is used while the pose is finite, a contact is felt, and every pad of the hand has a patch
      and none is felt, since the force on a pad is unknown.
    - contact_solutions: dict of `ContactSolution` by finger; the port exists only with `balance`, and may stay
      unconnected. While a finger gives neither a contact nor says that nothing touches it, its force is unknown, and
      the balance is not used.
    - object_pose: `RigidTransform` X_PO, the most probable hypothesis; held between updates, and while the touch gives
      no solution. Before the first estimate it is the prior's pose, and the identity before the first prior.
    - hypotheses: `PoseEstimate`, the last one; None before the first. Hypotheses that collide with the hand are
      removed, and the others' probabilities normalized; if all that explain the touch collide, all are kept.
    - status: str, "ok" or "ambiguous" for a pose of this period, possibly with ": " and remarks (the search was cut
      short; every hypothesis collides; which fingers and pads feel nothing); else "held: ", the reason, and the
      remarks. Changes with `object_pose`.
    """

    def __init__(
        self,
        model: ObjectModel,
        params: PoseEstimatorParams | None = None,
        collision: HandCollision | None = None,
        pads: int = 0,
    ) -> None:
        """Keeps references to the model and to the collision checker.

        Args:
            model: the object.
            params: method and period.
            collision: checks the hypotheses against the hand; None: not checked.
            pads: number of tactile pads of the hand; one of which there is no patch may be pressed, too.

        Raises:
            InvalidInputError: if an argument has a wrong type, a parameter is out of its range, or `balance` is set for
                an object whose mass is unknown or whose symmetries move its centre of mass.
        """
        instance_of("model", model, ObjectModel)
        super().__init__()
        self._params = params_of(PoseEstimatorParams, params)
        self._model, self._pads = model, whole_number("pads", pads, least=0)
        if self._params.balance:
            check_mass(model)
        model.make_ready()
        self._contacts = self.DeclareAbstractInputPort("contacts", AbstractValue.Make(Contacts.empty()))
        self._patches = self.DeclareAbstractInputPort("patches", AbstractValue.Make(()))
        self._touch_statuses = [
            self.DeclareAbstractInputPort(name, AbstractValue.Make("")) for name in ("contact_status", "patch_status")
        ]
        self._prior = self.DeclareAbstractInputPort("prior", AbstractValue.Make(None))
        self._hand = self.DeclareAbstractInputPort("hand", AbstractValue.Make(None))
        self._untouched = self.DeclareAbstractInputPort("untouched", AbstractValue.Make(None))
        self._planes = self.DeclareAbstractInputPort("planes", AbstractValue.Make(()))
        self._palm_pose = (
            self.DeclareAbstractInputPort("palm_pose", AbstractValue.Make(RigidTransform()))
            if self._params.balance
            else None
        )
        if self._params.balance:
            self._solutions = self.DeclareAbstractInputPort("contact_solutions", AbstractValue.Make({}))
        self._collision = None if collision is None else CollisionInput(self, collision)
        self._pose = self.DeclareAbstractState(AbstractValue.Make(RigidTransform()))
        self._hypotheses = self.DeclareAbstractState(AbstractValue.Make(None))
        self._status = self.DeclareAbstractState(AbstractValue.Make("held: no estimate yet"))
        self.DeclarePeriodicUnrestrictedUpdateEvent(self._params.period, 0.0, self._update)
        self.DeclareStateOutputPort("object_pose", self._pose)
        self.DeclareStateOutputPort("hypotheses", self._hypotheses)
        self.DeclareStateOutputPort("status", self._status)

    def _update(self, context: Context, state: State) -> EventStatus:
        outcome, remarks = self._renew(context, state)
        remarks += eval_touch_remarks(self._touch_statuses, context)
        text = f"{outcome}: {'; '.join(remarks)}" if remarks else outcome
        state.get_mutable_abstract_state(self._status).set_value(text)
        return EventStatus.Succeeded()

    def _renew(self, context: Context, state: State) -> tuple[str, list[str]]:
        """Updates the estimate; returns the first word of the status, and the remarks that follow it."""
        contacts, patches = eval_touch(self._contacts, self._patches, context)
        planes = eval_items(self._planes, context, PlaneContact)
        prior = eval_optional_input(self._prior, context, PosePrior)
        if prior is not None and context.get_abstract_state(self._hypotheses).get_value() is None:
            state.get_mutable_abstract_state(self._pose).set_value(prior.X_PO)

        touches = len(contacts) + sum(patch.is_felt for patch in patches)
        if touches < self._params.min_contacts:
            return "held", [too_few(touches, self._params.min_contacts)]
        if prior is None and self._prior.HasValue(context):
            return "held", ["no prior yet"]
        estimate = self._estimate(context, contacts, patches, prior, planes)
        check = None if self._collision is None else self._collision.posed(context)
        is_clear, unchecked = True, self._collision is not None and check is None
        if check is not None and estimate.status != "no_solution":
            estimate, is_clear = self._keep_clear(context, estimate, check)
        state.get_mutable_abstract_state(self._hypotheses).set_value(estimate)
        if estimate.status == "no_solution":
            return "held", ["no pose explains the touch"]
        state.get_mutable_abstract_state(self._pose).set_value(estimate.best.X_PO)
        remarks = [] if estimate.finished else ["the search was cut short"]
        remarks += [] if is_clear else ["every hypothesis collides with the hand"]
        remarks += ["collisions are not checked: a joint position is not known"] if unchecked else []
        return estimate.status, remarks

    def _estimate(
        self,
        context: Context,
        contacts: Contacts,
        patches: tuple[Patch, ...],
        prior: PosePrior | None,
        planes: tuple[PlaneContact, ...],
    ) -> PoseEstimate:
        return estimate_pose(
            self._model,
            contacts,
            patches=patches,
            prior=prior,
            hand=eval_optional_input(self._hand, context, HandGeometry),
            untouched=eval_optional_input(self._untouched, context, HandGeometry),
            balance=self._balance(context, contacts, patches),
            friction=None if contacts.f_PC is None else self._params.friction,
            method=self._params.method,
            seed=self._params.seed,
            max_hypotheses=self._params.max_hypotheses,
            time_limit=self._params.max_duration,
            outlier_probability=self._params.outlier_probability,
            planes=planes,
        )

    def _balance(self, context: Context, contacts: Contacts, patches: tuple[Patch, ...]) -> ForceBalance | None:
        """The balance of forces, if the felt forces are known to be all that carry the object; else None."""
        if self._palm_pose is None or not len(contacts) or contacts.f_PC is None:
            return None
        X_WP = eval_optional_input(self._palm_pose, context, RigidTransform)
        is_known = X_WP is not None and np.isfinite(X_WP.translation()).all()
        if X_WP is None or not is_known or not self._knows_all_forces(context, contacts, patches):
            return None
        gravity_P: FloatArray = X_WP.rotation().inverse() @ GRAVITY_W
        return ForceBalance(gravity_P)

    def _knows_all_forces(self, context: Context, contacts: Contacts, patches: tuple[Patch, ...]) -> bool:
        """Whether every finger either is among the contacts or is untouched, and every pad is untouched."""
        if len(patches) < self._pads or any(patch.is_felt for patch in patches):
            return False
        if not self._solutions.HasValue(context):
            return True
        solutions = eval_named(self._solutions, context, ContactSolution).values()
        return sum(not solution.is_untouched for solution in solutions) == len(contacts)

    def _keep_clear(
        self, context: Context, estimate: PoseEstimate, check: PosedHandCollision
    ) -> tuple[PoseEstimate, bool]:
        """The estimate without colliding hypotheses, and whether any is left."""
        hand = eval_optional_input(self._hand, context, HandGeometry)
        tolerance = max(self._params.collision_tolerance, 0.0 if hand is None else _SIGMAS * hand.sigma)
        X_PO = np.array([hypothesis.X_PO.GetAsMatrix34() for hypothesis in estimate.hypotheses])
        return keep_clear(estimate, check.check(X_PO, tolerance), tolerance)
