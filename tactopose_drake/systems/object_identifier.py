"""The identification of a held object, as a system."""

import dataclasses
from collections.abc import Sequence
from concurrent.futures import Executor

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, EventStatus, State

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.kernel_library import make_kernels_ready
from tactopose_drake.core.parameter_checks import params_of
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import instance_of, positive_number, whole_number
from tactopose_drake.estimation.identification import check_objects, check_prior, identify
from tactopose_drake.estimation.object_library import ObjectLibrary
from tactopose_drake.estimation.ranking import Likelihood, check_likelihood
from tactopose_drake.systems.collectable_system import CollectableSystem
from tactopose_drake.systems.ports import eval_touch, too_few


@dataclasses.dataclass(kw_only=True, slots=True)
class ObjectIdentifierParams:
    """How and how often the object is identified."""

    period: float = 0.5  # s between two identifications
    min_contacts: int = 3  # with fewer contacts and felt patches the identities are not updated
    likelihood: str = "evidence"  # a likelihood of `identify`
    candidates: int = 16  # objects of a library whose poses are estimated
    seed: int = 0  # of the search's random numbers, the same each time
    unknown_prior: float = 1.0 / 3.0  # prior probability that it is none of the objects; 0 to below 1

    def validate(self) -> None:
        """Raises InvalidInputError if a number is out of its range, or the likelihood is unknown."""
        positive_number("ObjectIdentifierParams.period", self.period)
        for name, least in (("min_contacts", 1), ("candidates", 1), ("seed", 0)):
            whole_number(f"ObjectIdentifierParams.{name}", getattr(self, name), least=least)
        check_likelihood("ObjectIdentifierParams.likelihood", self.likelihood)
        check_prior("ObjectIdentifierParams.unknown_prior", self.unknown_prior)


class ObjectIdentifier(CollectableSystem):
    """Identifies the held object among many by the contacts and tactile patches of one instant; it may be none of them.

    .. pydrake_system::

        name: ObjectIdentifier
        input_ports:
        - contacts
        - patches
        output_ports:
        - identities
        - status

    Inputs are read at each period.

    - contacts: `Contacts` in P; may stay unconnected where patches are connected.
    - patches: tuple of `Patch` in P, including those that feel nothing; may stay unconnected.
    - identities: `Identification`, the objects by falling likelihood, with their poses X_PO and probabilities, and the
      probability that it is none of them; None before the first. Held between updates, and while there are too few
      contacts.
    - status: str, `Identification.status` for identities of this period; else "held: " and why. Changes with
      `identities`.
    """

    def __init__(
        self,
        models: Sequence[ObjectModel] | ObjectLibrary,
        params: ObjectIdentifierParams | None = None,
        executor: Executor | None = None,
    ) -> None:
        """Keeps references to the objects and to the executor, which is not shut down; prepares models and kernels.

        Args:
            models: the candidate objects; those of a library are loaded when they are needed.
            params: how and how often to identify.
            executor: estimates several objects at a time; None: one after the other.
        """
        check_objects(models)
        if executor is not None:
            instance_of("executor", executor, Executor)
        super().__init__()
        self._params = params_of(ObjectIdentifierParams, params)
        self._models, self._executor = models, executor
        make_kernels_ready()
        for model in () if isinstance(models, ObjectLibrary) else models:
            model.make_ready()
        self._contacts = self.DeclareAbstractInputPort("contacts", AbstractValue.Make(Contacts.empty()))
        self._patches = self.DeclareAbstractInputPort("patches", AbstractValue.Make(()))
        self._identities = self.DeclareAbstractState(AbstractValue.Make(None))
        self._status = self.DeclareAbstractState(AbstractValue.Make("held: no identification yet"))
        self.DeclarePeriodicUnrestrictedUpdateEvent(self._params.period, 0.0, self._update)
        self.DeclareStateOutputPort("identities", self._identities)
        self.DeclareStateOutputPort("status", self._status)

    def _update(self, context: Context, state: State) -> EventStatus:
        contacts, patches = eval_touch(self._contacts, self._patches, context)
        touches = len(contacts) + sum(patch.is_felt for patch in patches)
        status = state.get_mutable_abstract_state(self._status)
        if touches < self._params.min_contacts:
            status.set_value(f"held: {too_few(touches, self._params.min_contacts)}")
            return EventStatus.Succeeded()
        likelihood: Likelihood = check_likelihood("likelihood", self._params.likelihood)
        found = identify(
            self._models,
            contacts,
            patches,
            self._executor,
            likelihood=likelihood,
            candidates=self._params.candidates,
            seed=self._params.seed,
            unknown_prior=self._params.unknown_prior,
        )
        state.get_mutable_abstract_state(self._identities).set_value(found)
        status.set_value(found.status)
        return EventStatus.Succeeded()
