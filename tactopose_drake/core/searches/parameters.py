"""Parametrisations of local searches: six increments, or the thesis' quaternion and translation.

A parametrisation converts poses to states (B, ...) and back, gives the objective's normal equations in its own
parameters, and moves a state by a step.
"""

from typing import Protocol

import numpy as np

from tactopose_drake.core.kernels import pose_kernels
from tactopose_drake.core.objectives.objective import LeastSquaresObjective, NormalEquations, form_normal_equations
from tactopose_drake.core.poses import compose, inverse, make_poses, matrix_from_quaternion
from tactopose_drake.core.validation import FloatArray

_FORWARD_STEP = 1e-6


class Parameters(Protocol):
    """A parametrisation of the pose, for the problem that starts at the poses X_start (B, 3, 4)."""

    def start(self, X_start: FloatArray) -> FloatArray:
        """The states of the starting poses."""
        ...

    def poses(self, state: FloatArray, X_start: FloatArray) -> FloatArray:
        """The poses (B, 3, 4) of states."""
        ...

    def normal_equations(
        self, objective: LeastSquaresObjective, state: FloatArray, X_start: FloatArray
    ) -> NormalEquations:
        """Cost (B,), gradient (B, n) and Gauss-Newton Hessian (B, n, n) with respect to the parameters."""
        ...

    def move(self, state: FloatArray, step: FloatArray) -> FloatArray:
        """The states after steps (B, n)."""
        ...

    def scales(self, length: float) -> FloatArray:
        """The change (n,) of each parameter that moves a point at distance `length` by about `length`."""
        ...


class IncrementParameters:
    """Six increments (w, v) about the current pose: the state is the pose itself, and derivatives are analytic."""

    def start(self, X_start: FloatArray) -> FloatArray:
        """The poses themselves."""
        return X_start

    def poses(self, state: FloatArray, X_start: FloatArray) -> FloatArray:
        """The states themselves."""
        return state

    def normal_equations(
        self, objective: LeastSquaresObjective, state: FloatArray, X_start: FloatArray
    ) -> NormalEquations:
        """The objective's own normal equations."""
        return objective.normal_equations(state)

    def move(self, state: FloatArray, step: FloatArray) -> FloatArray:
        """R exp(w), p + v."""
        out = np.empty_like(state)
        pose_kernels.retract(state, step, out)
        return out

    def scales(self, length: float) -> FloatArray:
        """1 rad for rotations, `length` for translations."""
        return np.repeat([1.0, length], 3)


class QuaternionParameters:
    """The thesis' seven parameters x = [q, t]: a transformation of the contacts at the start pose.

    Its inverse moves the object; derivatives are forward differences. J. Bimbo, thesis, 2016, section 3.1, eqs. 2.28
    and 3.1.
    """

    def start(self, X_start: FloatArray) -> FloatArray:
        """No transformation: q = 1, t = 0."""
        return np.tile(np.eye(1, 7), (len(X_start), 1))

    def poses(self, state: FloatArray, X_start: FloatArray) -> FloatArray:
        """The start pose, moved by the inverse of the contacts' transformation."""
        moves_contacts = make_poses(matrix_from_quaternion(state[:, :4]), state[:, 4:])
        return compose(inverse(moves_contacts), X_start)

    def normal_equations(
        self, objective: LeastSquaresObjective, state: FloatArray, X_start: FloatArray
    ) -> NormalEquations:
        """From forward differences of the residuals."""
        here = objective.residuals(self.poses(state, X_start))
        moved = [objective.residuals(self.poses(state + step, X_start)) for step in np.eye(7) * _FORWARD_STEP]
        return form_normal_equations(here, (np.stack(moved, axis=-1) - here[..., None]) / _FORWARD_STEP)

    def move(self, state: FloatArray, step: FloatArray) -> FloatArray:
        """x + step, the quaternion normalised."""
        moved: FloatArray = state + step
        moved[:, :4] /= np.linalg.norm(moved[:, :4], axis=-1, keepdims=True)
        return moved

    def scales(self, length: float) -> FloatArray:
        """1 for the quaternion, `length` for the translation."""
        return np.array([1.0, 1.0, 1.0, 1.0, length, length, length])
