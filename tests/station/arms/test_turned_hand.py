"""Simulated sensors of a hand that an arm turns over: they do not feel what their own fingertips weigh."""

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from tactopose_drake.core.sensing.force_torque import ForceTorqueModel
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import add_hand
from tactopose_drake.station.arms.arm import add_arm, load_arm_config, mount_hand
from tactopose_drake.station.arms.arm_station import ArmSetup
from tactopose_drake.systems.plant_senses import add_touch_sensors


def test_fingertips_that_touch_nothing_weigh_nothing_however_the_arm_turns_them() -> None:
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlant(MultibodyPlantConfig(time_step=0.001), builder)
    arm = add_arm(plant, load_arm_config("seven_axis"), RigidTransform())
    hand = add_hand(plant, load_hand_config("shadow_like"))
    mount_hand(plant, arm, hand, ArmSetup().X_FBase.GetDeterministicValue())
    plant.Finalize()
    models = dict.fromkeys(hand.sensor_frames, ForceTorqueModel())
    sensors = add_touch_sensors(builder, plant, hand, models, period=0.001)
    for name, port in sensors.items():
        builder.ExportOutput(port, name)
    builder.ExportOutput(plant.get_reaction_forces_output_port(), "reactions")
    diagram = builder.Build()
    start, loads = np.array(ArmSetup().q_start), []
    for wrist in (0.0, 1.6, 3.1):  # the last axis turns the hand about its own, the fourth before tilts it
        simulator = Simulator(diagram)
        context = simulator.get_mutable_context()
        plant_context = plant.GetMyMutableContextFromRoot(context)
        q = start.copy()
        q[-1] += wrist
        q[3] -= 0.5 * wrist
        plant.SetPositions(plant_context, arm.model_instance, q)
        for index in (*plant.GetJointIndices(arm.model_instance), *plant.GetJointIndices(hand.model_instance)):
            if plant.get_joint(index).num_velocities():
                plant.get_joint(index).Lock(plant_context)
        simulator.AdvanceTo(0.003)
        for name in sensors:
            np.testing.assert_allclose(diagram.GetOutputPort(name).Eval(context), np.zeros(6), atol=1e-9)
        reactions = diagram.GetOutputPort("reactions").Eval(context)
        loads.append([reactions[int(weld.index())].translational() for weld in hand.welds.values()])
    # The fingers bear the weights, in other directions each time.
    assert np.linalg.norm(np.ptp(loads, axis=0), axis=1).min() > 0.05
