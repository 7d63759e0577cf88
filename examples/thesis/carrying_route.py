"""The motion of an arm that carries the held object from place to place, and rests at each."""

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, EventStatus, State
from pydrake.trajectories import PiecewisePolynomial

from tactopose_drake.station import ArmParts, ArmSetup, AxisGoal, reach_axis, smooth_motion
from tactopose_drake.systems import CollectableSystem

Array = NDArray[np.float64]

REST = 1.0  # time at each place, s


class Route(CollectableSystem):
    """Moves the arm from place to place once the hand holds the object, with a rest at each place."""

    def __init__(self, motions: list[PiecewisePolynomial]) -> None:
        super().__init__()
        self._motions, self._count = motions, motions[0].rows()
        self._holding = self.DeclareVectorInputPort("holding", 1)
        self._start = self.DeclareAbstractState(AbstractValue.Make(np.inf))
        self._ends = np.cumsum([motion.end_time() + REST for motion in motions])
        self.DeclarePeriodicUnrestrictedUpdateEvent(0.05, 0.0, self._update)
        self.DeclareVectorOutputPort("arm_reference", 2 * self._count, self._calc)
        self.DeclareVectorOutputPort("rested", 1, self._calc_rested)

    @property
    def duration(self) -> float:
        """Time from the beginning to the end of the last rest, s."""
        return float(self._ends[-1])

    def _update(self, context: Context, state: State) -> EventStatus:
        start = context.get_abstract_state(self._start).get_value()
        if self._holding.Eval(context)[0] > 0.0 and not np.isfinite(start):
            state.get_mutable_abstract_state(self._start).set_value(context.get_time() + 0.5)
        return EventStatus.Succeeded()

    def _now(self, context: Context) -> tuple[PiecewisePolynomial, float]:
        """The current motion, and the time within it."""
        passed = max(0.0, context.get_time() - context.get_abstract_state(self._start).get_value())
        i = min(int(np.searchsorted(self._ends, passed)), len(self._motions) - 1)
        return self._motions[i], passed - (self._ends[i - 1] if i else 0.0)

    def _calc(self, context: Context, output: BasicVector) -> None:
        motion, passed = self._now(context)
        at = min(passed, motion.end_time())
        output.SetFromVector(np.concatenate([motion.value(at)[:, 0], motion.EvalDerivative(at, 1)[:, 0]]))

    def _calc_rested(self, context: Context, output: BasicVector) -> None:
        """Outputs for how long the arm has rested at a place, s."""
        motion, passed = self._now(context)
        output.SetFromVector([max(0.0, passed - motion.end_time())])


def plan_route(parts: ArmParts, setup: ArmSetup, places: Array) -> list[PiecewisePolynomial]:
    """Motions through the places, with the thumb up throughout."""
    X_FP = parts.plant.CalcRelativeTransform(
        parts.plant.CreateDefaultContext(), parts.arm.flange, parts.hand.palm_frame
    )
    q, motions = np.array(setup.q_start), []
    for place in places:
        goal = AxisGoal(
            p_FQ=X_FP.translation(),
            direction_F=X_FP.rotation().col(0),
            p_WQ=place,
            direction_W=np.array([0.0, 0.0, 1.0]),
            forward_F=X_FP.rotation().col(2),
            forward_W=np.array([*place[:2], 0.0]) / np.linalg.norm(place[:2]),
            most_turn=0.5,
        )
        found = reach_axis(parts.arm_plant, parts.arm_alone.flange, goal, q, [q])
        assert found is not None, place
        motions.append(smooth_motion(parts.arm_plant, np.array([q, found]), speed_share=0.4, most_acceleration=1.5))
        q = found
    return motions
