"""The quality of the current grasp, as a system."""

import dataclasses
import functools
import math
from typing import cast, get_args

from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, EventStatus, State

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.grasping.quality import (
    MOST_EDGES,
    MOST_SAMPLES,
    ClosureProbability,
    force_closure_probability,
    grasp_quality,
)
from tactopose_drake.core.grasping.wrench_space import Norm
from tactopose_drake.core.parameter_checks import params_of
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import MOST_FRICTION, instance_of, known_name, positive_number, whole_number
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.systems.collectable_system import CollectableSystem
from tactopose_drake.systems.ports import eval_input, eval_optional_input

_NOTHING_HELD = (0.0, 0.0, 0.0, math.nan)  # radius, volume, force closure, probability


@dataclasses.dataclass(kw_only=True, slots=True)
class GraspQualityParams:
    """How and how often grasps are evaluated."""

    period: float = 0.1  # s between two evaluations
    friction: float = 0.6  # coefficient between fingertips and object
    norm: str = "L1"  # norm that bounds the forces, "L1" or "Linf"
    edges: int = 8  # of the pyramid that approximates a friction cone
    samples: int = 200  # poses drawn from the hypotheses for the probability of force closure
    seed: int = 0  # of the draws, the same at each evaluation

    def validate(self) -> None:
        """Raises InvalidInputError if a number is out of its range or the norm unknown."""
        known_name("GraspQualityParams.norm", self.norm, get_args(Norm))
        positive_number("GraspQualityParams.period", self.period)
        positive_number("GraspQualityParams.friction", self.friction, allow_zero=True, most=MOST_FRICTION)
        whole_number("GraspQualityParams.edges", self.edges, least=3, most=MOST_EDGES)
        whole_number("GraspQualityParams.samples", self.samples, least=1, most=MOST_SAMPLES)
        whole_number("GraspQualityParams.seed", self.seed, least=0)


class GraspQualityEvaluator(CollectableSystem):
    """Evaluates how well the current contacts hold the object at its estimated pose.

    .. pydrake_system::

        name: GraspQualityEvaluator
        input_ports:
        - contacts
        - object_pose
        - hypotheses
        output_ports:
        - quality
        - radius
        - volume
        - force_closure
        - probability

    All inputs are read, and all outputs change, at each period. Before the first, and while the hypotheses are None or
    their status is "no_solution", outputs are those without contacts: `object_pose`, which may be held or that of
    nothing known, is then not an estimate.

    - contacts: `Contacts` in P.
    - object_pose: `RigidTransform` X_PO.
    - hypotheses: `PoseEstimate`, or None while there is none; may stay unconnected.
    - quality: `GraspQuality` at the object's pose; None before the first evaluation, and while there is no estimate.
    - radius: radius of the largest ball in the wrench space, shape (1,), N.
    - volume: volume of the wrench space, shape (1,), N^6; NaN for the norm "Linf", where it takes too long.
    - force_closure: shape (1,), 1 or 0.
    - probability: probability of force closure over the hypotheses, shape (1,); NaN without hypotheses, and at first.
    """

    def __init__(self, model: ObjectModel, params: GraspQualityParams | None = None) -> None:
        """Keeps a reference to the model."""
        instance_of("model", model, ObjectModel)
        super().__init__()
        self._params = params_of(GraspQualityParams, params)
        self._model = model
        self._contacts = self.DeclareAbstractInputPort("contacts", AbstractValue.Make(Contacts.empty()))
        self._pose = self.DeclareAbstractInputPort("object_pose", AbstractValue.Make(RigidTransform()))
        self._hypotheses = self.DeclareAbstractInputPort("hypotheses", AbstractValue.Make(None))
        self._quality = self.DeclareAbstractState(AbstractValue.Make(None))
        self._numbers = self.DeclareDiscreteState(_NOTHING_HELD)
        self.DeclarePeriodicUnrestrictedUpdateEvent(self._params.period, 0.0, self._update)
        self.DeclareStateOutputPort("quality", self._quality)
        numbers = {self.discrete_state_ticket(self._numbers)}
        for index, name in enumerate(("radius", "volume", "force_closure", "probability")):
            self.declare_output(name, 1, functools.partial(self._number, index), numbers)

    def _update(self, context: Context, state: State) -> EventStatus:
        contacts = eval_input(self._contacts, context, Contacts)
        estimate = eval_optional_input(self._hypotheses, context, PoseEstimate)
        is_estimate = estimate is not None and estimate.status != "no_solution"
        if self._hypotheses.HasValue(context) and not is_estimate:
            state.get_mutable_abstract_state(self._quality).set_value(None)
            state.get_mutable_discrete_state(self._numbers).SetFromVector(_NOTHING_HELD)
            return EventStatus.Succeeded()
        params = self._params
        quality = grasp_quality(
            self._model,
            contacts,
            eval_input(self._pose, context, RigidTransform),
            friction=params.friction,
            norm=cast(Norm, params.norm),
            edges=params.edges,
        )
        volume = quality.volume if params.norm == "L1" else math.nan
        closure = float(quality.force_closure)
        probability = self._probability(contacts, estimate)
        state.get_mutable_abstract_state(self._quality).set_value(quality)
        state.get_mutable_discrete_state(self._numbers).SetFromVector(
            [quality.radius, volume, closure, probability.value]
        )
        return EventStatus.Succeeded()

    def _probability(self, contacts: Contacts, estimate: PoseEstimate | None) -> ClosureProbability:
        if estimate is None:
            return ClosureProbability(math.nan, math.nan)
        return force_closure_probability(
            self._model,
            contacts,
            estimate.modes,
            friction=self._params.friction,
            edges=self._params.edges,
            samples=self._params.samples,
            seed=self._params.seed,
        )

    def _number(self, index: int, context: Context) -> list[float]:
        return [context.get_discrete_state(self._numbers).GetAtIndex(index)]
