"""Intrinsic contact sensing of all fingertips, as a system."""

import dataclasses
from collections.abc import Mapping

import numpy as np
from pydrake.systems.framework import Context, InputPort

from tactopose_drake.core.parameter_checks import params_of
from tactopose_drake.core.sensing.intrinsic_contact import MIN_FORCE, ContactSolution, FingertipSolver
from tactopose_drake.core.sensing.soft_layer import SoftLayer
from tactopose_drake.core.surfaces import Surface
from tactopose_drake.core.validation import FloatArray, instance_of, positive_number
from tactopose_drake.systems.collectable_system import CollectableSystem

_NO_READING = np.full(6, np.nan)


@dataclasses.dataclass(kw_only=True, slots=True)
class ContactSolverParams:
    """Thresholds that decide which wrenches count as a contact."""

    min_force: float = MIN_FORCE  # force below which a finger is not in contact, N
    friction_coefficient: float | None = None  # the largest that can occur; None: friction is not checked

    def validate(self) -> None:
        """Raises InvalidInputError if a value is out of its range."""
        positive_number("ContactSolverParams.min_force", self.min_force, allow_zero=True)
        if self.friction_coefficient is not None:
            positive_number("ContactSolverParams.friction_coefficient", self.friction_coefficient)


class ContactSolver(CollectableSystem):
    """Finds where and how each fingertip is touched, from its wrench alone.

    .. pydrake_system::

        name: ContactSolver
        input_ports:
        - wrench_<finger>
        output_ports:
        - contact_solutions

    - wrench_<finger>: one per finger, F_S = [m_x, m_y, m_z, f_x, f_y, f_z] that the environment exerts on the
      fingertip, about the origin of S, in S, N m and N. NaN where the sensor has no reading. May stay unconnected,
      which counts as no reading; the solution's reason says so.
    - contact_solutions: dict of `ContactSolution` in S by finger, for all fingers; changes with the wrenches. A finger
      without a reading or a contact has `valid` False and a reason.
    """

    def __init__(
        self,
        surfaces: Mapping[str, Surface],
        params: ContactSolverParams | None = None,
        layers: Mapping[str, SoftLayer] | None = None,
        biases: Mapping[str, FloatArray] | None = None,
    ) -> None:
        """Declares one input port per finger.

        Args:
            surfaces: the surface of each fingertip, placed in its S, by finger.
            params: thresholds.
            layers: soft layers on fingertips, by finger; the other fingertips are rigid.
            biases: wrenches that sensors read without a touch, shape (6,), N m and N, by finger; they are subtracted.
        """
        super().__init__()
        self._params = params_of(ContactSolverParams, params)
        instance_of("surfaces", surfaces, Mapping)
        layers, told = layers or {}, self._params
        self._solvers = {
            finger: FingertipSolver(surface, layers.get(finger), told.min_force, told.friction_coefficient)
            for finger, surface in surfaces.items()
        }
        self._biases = {} if biases is None else dict(biases)
        self._wrenches = {finger: self.DeclareVectorInputPort(f"wrench_{finger}", 6) for finger in self._solvers}
        needs = {port.ticket() for port in self._wrenches.values()}
        self.declare_output("contact_solutions", {}, self._contact_solutions, needs)

    def _contact_solutions(self, context: Context) -> dict[str, ContactSolution]:
        return {finger: self._solve(context, finger, port) for finger, port in self._wrenches.items()}

    def _solve(self, context: Context, finger: str, port: InputPort) -> ContactSolution:
        if not port.HasValue(context):
            return dataclasses.replace(self._solvers[finger].solve(_NO_READING), reason="no wrench is connected")
        return self._solvers[finger].solve(port.Eval(context) - self._biases.get(finger, 0.0))
