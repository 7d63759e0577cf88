"""Inverse kinematics for the axis of a held rod, and smooth time-optimal motions."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.multibody.inverse_kinematics import InverseKinematics
from pydrake.multibody.optimization import CalcGridPointsOptions, Toppra, ToppraDiscretization
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame
from pydrake.solvers import SnoptSolver
from pydrake.trajectories import PathParameterizedTrajectory, PiecewisePolynomial

from tactopose_drake.core.validation import FloatArray

# Tolerances of a solution.
_POSITION, _ANGLE = 1e-4, 1e-3  # m, rad
# Distance from the joints' limits, rad.
_MARGIN = 0.05
# Time between samples of a motion, s.
_STEP = 0.01
# Joint positions that differ by less are the same, rad.
_SAME = 1e-6


@dataclass(frozen=True, eq=False)
class AxisGoal:
    """A goal in the world for an axis fixed on the flange F; rotation about the axis is free up to `most_turn`.

    Attributes:
        p_FQ: a point of the axis, shape (3,), m.
        direction_F: direction of the axis, shape (3,).
        p_WQ: goal of the point, shape (3,), m.
        direction_W: goal of the direction, shape (3,).
        forward_F: a direction on the flange, shape (3,), that stays within `most_turn` of `forward_W`.
        forward_W: its reference in the world, shape (3,).
        most_turn: largest angle between them, rad.
    """

    p_FQ: FloatArray
    direction_F: FloatArray
    p_WQ: FloatArray
    direction_W: FloatArray
    forward_F: FloatArray
    forward_W: FloatArray
    most_turn: float


def reach_axis(
    plant: MultibodyPlant, flange: Frame, goal: AxisGoal, q_near: FloatArray, guesses: Sequence[FloatArray]
) -> FloatArray | None:
    """Solves the inverse kinematics; returns the solution nearest to `q_near`, shape (nq,), rad, or None.

    Args:
        plant: finalized plant of the arm alone.
        flange: F.
        goal: the goal.
        q_near: preferred joint positions, shape (nq,), rad.
        guesses: initial guesses of the solver, shape (nq,) each, rad.
    """
    world = plant.world_frame()
    best: FloatArray | None = None
    for guess in guesses:
        ik = InverseKinematics(plant, with_joint_limits=False)
        q = ik.q()
        program = ik.get_mutable_prog()
        program.AddBoundingBoxConstraint(
            plant.GetPositionLowerLimits() + _MARGIN, plant.GetPositionUpperLimits() - _MARGIN, q
        )
        ik.AddPositionConstraint(flange, goal.p_FQ, world, goal.p_WQ - _POSITION, goal.p_WQ + _POSITION)
        ik.AddAngleBetweenVectorsConstraint(flange, goal.direction_F, world, goal.direction_W, 0.0, _ANGLE)
        ik.AddAngleBetweenVectorsConstraint(flange, goal.forward_F, world, goal.forward_W, 0.0, goal.most_turn)
        program.AddQuadraticErrorCost(np.eye(len(q)), q_near, q)
        result = SnoptSolver().Solve(program, guess)
        if not result.is_success():
            continue
        found = result.GetSolution(q)
        if best is None or np.linalg.norm(found - q_near) < np.linalg.norm(best - q_near):
            best = found
    return best


def smooth_motion(
    plant: MultibodyPlant,
    q: FloatArray,
    *,
    speed_share: float,
    most_acceleration: float,
    most_speed: tuple[Frame, float] | None = None,
) -> PiecewisePolynomial:
    """The fastest motion along a smooth path through joint positions, from rest to rest, starting at time 0.

    Args:
        plant: finalized plant of the arm alone, with limits of the joints' speeds.
        q: joint positions, shape (n, nq), rad; n >= 1. Successive ones that are the same count once.
        speed_share: share of the joints' speed limits that may be used.
        most_acceleration: acceleration limit of all joints, rad/s^2.
        most_speed: a frame, and the speed limit of its origin in the world, m/s; None: no such limit.

    Returns:
        A piecewise cubic trajectory, which can be copied as part of a system's state; a short rest if all positions are
        the same.
    """
    q = np.array([q[0], *(to for at, to in itertools.pairwise(q) if np.abs(to - at).max() > _SAME)])
    if len(q) == 1:
        return PiecewisePolynomial.CubicHermite([0.0, _STEP], np.repeat(q, 2, axis=0).T, np.zeros((q.shape[1], 2)))
    if len(q) == 2:  # The interpolation needs three points.
        q = np.insert(q, 1, q.mean(axis=0), axis=0)
    lengths = np.linalg.norm(np.diff(q, axis=0), axis=1)
    path = PiecewisePolynomial.CubicShapePreserving(
        np.concatenate([[0.0], np.cumsum(lengths)]), q.T, zero_end_point_derivatives=False
    )
    toppra = Toppra(path, plant, Toppra.CalcGridPoints(path, CalcGridPointsOptions()))
    toppra.AddJointVelocityLimit(
        speed_share * plant.GetVelocityLowerLimits(), speed_share * plant.GetVelocityUpperLimits()
    )
    acceleration = np.full(plant.num_velocities(), most_acceleration)
    # With interpolation, which is more exact, Toppra finds no motion along about one path in forty.
    toppra.AddJointAccelerationLimit(-acceleration, acceleration, ToppraDiscretization.kCollocation)
    if most_speed is not None:
        toppra.AddFrameTranslationalSpeedLimit(*most_speed)
    timing = toppra.SolvePathParameterization()
    motion = PathParameterizedTrajectory(path, timing)
    times = np.linspace(motion.start_time(), motion.end_time(), max(3, int(np.ceil(motion.end_time() / _STEP))))
    rates = np.hstack([motion.EvalDerivative(t, 1) for t in times])
    rates[:, [0, -1]] = 0.0
    positions = np.hstack([motion.value(t) for t in times])
    # Toppra keeps the limits only at its grid points.
    slower = max(1.0, np.sqrt(_highest_acceleration(times, positions, rates) / most_acceleration))
    return PiecewisePolynomial.CubicHermite(slower * times, positions, rates / slower)


def _highest_acceleration(times: FloatArray, positions: FloatArray, rates: FloatArray) -> float:
    """The highest acceleration of any joint on the cubics through positions (nq, n) with rates (nq, n) at times (n,).

    It is linear in time on each cubic, and so highest at an end.
    """
    steps = np.diff(times)
    chords, before, after = np.diff(positions) / steps, rates[:, :-1], rates[:, 1:]
    ends = (6.0 * chords - 4.0 * before - 2.0 * after) / steps, (4.0 * after + 2.0 * before - 6.0 * chords) / steps
    return float(np.abs(ends).max())
