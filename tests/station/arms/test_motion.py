"""Inverse kinematics and motions of the arm."""

import numpy as np
import pytest
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant

from tactopose_drake.station.arms.arm import Arm, load_arm_config, make_arm_plant
from tactopose_drake.station.arms.motion import AxisGoal, reach_axis, smooth_motion

Q = np.array([0.0, 0.3, 0.0, 1.4, 0.0, -0.13, 0.0])


@pytest.fixture(scope="module")
def arm_plant() -> tuple[MultibodyPlant, Arm]:
    return make_arm_plant(load_arm_config("seven_axis"), RigidTransform())


def goal(p_WQ: list[float]) -> AxisGoal:
    return AxisGoal(
        p_FQ=np.array([0.0, 0.05, 0.3]),
        direction_F=np.array([1.0, 0.0, 0.0]),
        p_WQ=np.array(p_WQ),
        direction_W=np.array([0.0, 0.0, -1.0]),
        forward_F=np.array([0.0, 0.0, 1.0]),
        forward_W=np.array([1.0, 0.0, 0.0]),
        most_turn=1.0,
    )


def test_the_axis_gets_where_it_should(arm_plant: tuple[MultibodyPlant, Arm]) -> None:
    plant, arm = arm_plant
    wanted = goal([0.6, -0.3, 0.3])
    q = reach_axis(plant, arm.flange, wanted, Q, [Q, Q + 0.3])
    assert q is not None
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, q)
    X_WF = arm.flange.CalcPoseInWorld(context)
    np.testing.assert_allclose(X_WF @ wanted.p_FQ, wanted.p_WQ, atol=2e-4)
    assert (X_WF.rotation() @ wanted.direction_F) @ wanted.direction_W > np.cos(2e-3)
    assert (X_WF.rotation() @ wanted.forward_F) @ wanted.forward_W > np.cos(1.0 + 1e-3)
    assert np.all(np.abs(q) < plant.GetPositionUpperLimits())


def test_out_of_reach_is_none(arm_plant: tuple[MultibodyPlant, Arm]) -> None:
    plant, arm = arm_plant
    assert reach_axis(plant, arm.flange, goal([2.0, 0.0, 0.3]), Q, [Q]) is None


def test_a_motion_goes_from_rest_to_rest_within_the_limits(arm_plant: tuple[MultibodyPlant, Arm]) -> None:
    plant, _ = arm_plant
    ways = Q + np.array([7 * [0.0], [0.5, 0.2, -0.3, 0.4, 0.1, 0.0, 0.6], [0.9, 0.1, -0.3, 0.2, 0.4, 0.2, 0.9]])
    for q in (ways, ways[:2]):
        motion = smooth_motion(plant, q, speed_share=0.5, most_acceleration=2.0)
        times = np.linspace(0.0, motion.end_time(), 400)
        np.testing.assert_allclose(motion.value(0.0)[:, 0], q[0], atol=1e-9)
        np.testing.assert_allclose(motion.value(motion.end_time())[:, 0], q[-1], atol=1e-9)
        speed = np.array([motion.EvalDerivative(t, 1)[:, 0] for t in times])
        assert np.abs(speed[[0, -1]]).max() < 1e-9
        assert np.all(np.abs(speed) < 0.5 * plant.GetVelocityUpperLimits() + 0.02)
        assert max(np.abs(motion.EvalDerivative(t, 2)).max() for t in times) < 2.0 + 1e-6
        # As fast as the limits let it: something is at its limit for most of the way.
        used = np.abs(speed) / (0.5 * plant.GetVelocityUpperLimits())
        assert used.max() > 0.5
    motion = smooth_motion(plant, ways, speed_share=0.5, most_acceleration=2.0)
    passed = np.array([motion.value(t)[:, 0] for t in np.linspace(0.0, motion.end_time(), 2000)])
    assert np.linalg.norm(passed - ways[1], axis=1).min() < 0.01


@pytest.mark.parametrize("seed", [0, 1, 2, 11])
def test_any_path_has_a_motion_within_the_limits(arm_plant: tuple[MultibodyPlant, Arm], seed: int) -> None:
    plant, _ = arm_plant
    generator = np.random.default_rng(seed)
    q = Q + np.cumsum(generator.normal(scale=generator.choice([0.001, 0.05, 0.5]), size=(5, 7)), axis=0)
    motion = smooth_motion(plant, q, speed_share=0.5, most_acceleration=2.0)
    speed, acceleration = (
        np.array([motion.EvalDerivative(t, order)[:, 0] for t in np.linspace(0.0, motion.end_time(), 1000)])
        for order in (1, 2)
    )
    assert np.all(np.abs(speed) < 0.5 * plant.GetVelocityUpperLimits() * 1.02)
    assert np.abs(acceleration).max() < 2.0 + 1e-6


def test_a_frame_is_no_faster_than_it_may_be(arm_plant: tuple[MultibodyPlant, Arm]) -> None:
    plant, arm = arm_plant
    limits = {"speed_share": 0.5, "most_acceleration": 2.0}
    ways = Q + np.array([7 * [0.0], [0.3, 0.2, -0.3, 0.4, 0.1, 0.0, 0.6]])
    fast = smooth_motion(plant, ways, **limits)
    slow = smooth_motion(plant, ways, **limits, most_speed=(arm.flange, 0.02))
    assert slow.end_time() > 3.0 * fast.end_time()
    context, speeds = plant.CreateDefaultContext(), []
    for time in np.linspace(0.0, slow.end_time(), 60):
        plant.SetPositions(context, slow.value(time)[:, 0])
        plant.SetVelocities(context, slow.EvalDerivative(time, 1)[:, 0])
        speeds.append(np.linalg.norm(arm.flange.CalcSpatialVelocityInWorld(context).translational()))
    assert 0.018 < max(speeds) < 0.0205
