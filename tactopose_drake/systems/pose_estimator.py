"""The estimate of a held object's pose, as a system."""

import dataclasses

from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, EventStatus, LeafSystem, State

from tactopose_drake.core.contacts import Contacts
from tactopose_drake.core.objects import ObjectModel
from tactopose_drake.core.prior import PosePrior
from tactopose_drake.core.validation import positive_number
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.estimates import PoseEstimate
from tactopose_drake.estimation import estimate_pose
from tactopose_drake.systems.ports import eval_input, eval_optional_input


@dataclasses.dataclass(kw_only=True, slots=True)
class PoseEstimatorParams:
    """How and how often the pose is estimated."""

    period: float = 0.1  # s between two estimates
    method: str = "pair_search"  # a method of `estimate_pose`
    min_contacts: int = 2  # fewer contacts leave the pose as it is
    max_hypotheses: int = 16  # kept at the most
    seed: int = 0  # of the search's random numbers, the same at each estimate

    def validate(self) -> None:
        """Raises InvalidInputError if a number is out of its range; an unknown method is named by `estimate_pose`."""
        positive_number("PoseEstimatorParams.period", self.period)
        for name in ("min_contacts", "max_hypotheses"):
            if getattr(self, name) < 1:
                raise InvalidInputError(
                    f"PoseEstimatorParams.{name}: is {getattr(self, name)}; allowed are numbers >= 1."
                )


class PoseEstimator(LeafSystem):
    """Estimates the pose of a held object from the contacts of one instant.

    .. pydrake_system::

        name: PoseEstimator
        input_ports:
        - contacts
        - prior
        output_ports:
        - object_pose
        - hypotheses
        - status

    - contacts: `Contacts` in P; read at each period.
    - prior: `PosePrior` X_PO, or None while there is none yet; read at each period. May stay unconnected where the
      method needs no prior.
    - object_pose: `RigidTransform` X_PO, the most probable hypothesis; held between updates, and while the touch gives
      no better one. Before the first estimate the prior's, before the first prior the identity.
    - hypotheses: `PoseEstimate`, the last one made; None before the first.
    - status: str, "ok" or "ambiguous" for a pose of this period; else "held: " and why; changes with `object_pose`.
    """

    def __init__(self, model: ObjectModel, params: PoseEstimatorParams | None = None) -> None:
        """Keeps a reference to the model.

        Args:
            model: the object.
            params: method and period.
        """
        super().__init__()
        self._params = PoseEstimatorParams() if params is None else params
        self._params.validate()
        self._model = model
        self._contacts = self.DeclareAbstractInputPort("contacts", AbstractValue.Make(Contacts.empty()))
        self._prior = self.DeclareAbstractInputPort("prior", AbstractValue.Make(None))
        self._pose = self.DeclareAbstractState(AbstractValue.Make(RigidTransform()))
        self._hypotheses = self.DeclareAbstractState(AbstractValue.Make(None))
        self._status = self.DeclareAbstractState(AbstractValue.Make("held: no estimate yet"))
        self.DeclarePeriodicUnrestrictedUpdateEvent(self._params.period, 0.0, self._update)
        self.DeclareStateOutputPort("object_pose", self._pose)
        self.DeclareStateOutputPort("hypotheses", self._hypotheses)
        self.DeclareStateOutputPort("status", self._status)

    def _update(self, context: Context, state: State) -> EventStatus:
        contacts = eval_input(self._contacts, context, Contacts)
        prior = eval_optional_input(self._prior, context, PosePrior)
        if prior is not None and context.get_abstract_state(self._hypotheses).get_value() is None:
            state.get_mutable_abstract_state(self._pose).set_value(RigidTransform(prior.X_PO))

        if len(contacts) < self._params.min_contacts:
            return self._hold(state, f"{len(contacts)} contacts, {self._params.min_contacts} needed")
        if prior is None and self._prior.HasValue(context):
            return self._hold(state, "no prior yet")
        estimate = self._estimate(contacts, prior)
        state.get_mutable_abstract_state(self._hypotheses).set_value(estimate)
        if estimate.status == "no_solution":
            return self._hold(state, "no pose explains the touch")
        state.get_mutable_abstract_state(self._pose).set_value(estimate.best.X_PO)
        state.get_mutable_abstract_state(self._status).set_value(str(estimate.status))
        return EventStatus.Succeeded()

    def _estimate(self, contacts: Contacts, prior: PosePrior | None) -> PoseEstimate:
        return estimate_pose(
            self._model,
            contacts,
            prior=prior,
            method=self._params.method,
            seed=self._params.seed,
            max_hypotheses=self._params.max_hypotheses,
        )

    def _hold(self, state: State, reason: str) -> EventStatus:
        state.get_mutable_abstract_state(self._status).set_value(f"held: {reason}")
        return EventStatus.Succeeded()
