import numpy as np
import pytest
from pydrake.math import RigidTransform

from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.systems.fingertip_velocities import FingertipVelocities


@pytest.fixture(scope="module")
def parts():  # type: ignore[no-untyped-def]
    return make_hand_plant(load_hand_config("shadow_like"))


def test_velocities_are_those_of_the_moving_fingertips(parts) -> None:  # type: ignore[no-untyped-def]
    plant, hand = parts
    system = FingertipVelocities(plant, hand.sensor_frames, hand.palm_frame)
    context, generator = system.CreateDefaultContext(), np.random.default_rng(0)
    q, v = 0.3 * generator.random(plant.num_positions()), generator.normal(size=plant.num_velocities())
    system.GetInputPort("joint_positions").FixValue(context, q)
    system.GetInputPort("joint_velocities").FixValue(context, v)
    velocities = system.GetOutputPort("tip_velocities").Eval(context)
    plant_context, step = plant.CreateDefaultContext(), 1e-6

    def pose(finger: str, q: np.ndarray) -> RigidTransform:
        plant.SetPositions(plant_context, q)
        return plant.CalcRelativeTransform(plant_context, hand.palm_frame, hand.sensor_frames[finger])

    assert set(velocities) == set(hand.sensor_frames)
    for finger, velocity in velocities.items():
        here = pose(finger, q)
        for p_FQ in generator.normal(size=(3, 3)) * 0.02:
            p_PQ = here @ p_FQ
            moved = (pose(finger, q + step * v) @ p_FQ - pose(finger, q - step * v) @ p_FQ) / (2 * step)
            np.testing.assert_allclose(velocity[3:] + np.cross(velocity[:3], p_PQ), moved, atol=1e-6)


def test_readings_that_are_not_finite_give_none(parts) -> None:  # type: ignore[no-untyped-def]
    plant, hand = parts
    system = FingertipVelocities(plant, hand.sensor_frames, hand.palm_frame)
    context = system.CreateDefaultContext()
    v = np.zeros(plant.num_velocities())
    v[3] = np.nan
    system.GetInputPort("joint_positions").FixValue(context, np.zeros(plant.num_positions()))
    system.GetInputPort("joint_velocities").FixValue(context, v)
    assert system.GetOutputPort("tip_velocities").Eval(context) is None


def test_what_was_known_is_not_shown_once_a_reading_is_lost(parts) -> None:  # type: ignore[no-untyped-def]
    plant, hand = parts
    system = FingertipVelocities(plant, hand.sensor_frames, hand.palm_frame)
    context = system.CreateDefaultContext()
    known = {"joint_positions": np.zeros(plant.num_positions()), "joint_velocities": np.ones(plant.num_velocities())}
    for name, reading in known.items():
        for port, value in known.items():
            system.GetInputPort(port).FixValue(context, value)
        assert system.GetOutputPort("tip_velocities").Eval(context) is not None
        lost = reading.copy()
        lost[-1] = np.nan
        system.GetInputPort(name).FixValue(context, lost)
        assert system.GetOutputPort("tip_velocities").Eval(context) is None
