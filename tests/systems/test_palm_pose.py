"""Where the palm is, and with it where a tracked object is in the world."""

import numpy as np
from pydrake.common.schema import Rotation, Transform
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import FixedOffsetFrame
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import add_hand, make_hand_plant
from tactopose_drake.station.arms.arm import add_arm, load_arm_config, mount_hand
from tactopose_drake.station.arms.arm_station import ArmSetup
from tactopose_drake.station.scenario import load_scenario
from tactopose_drake.station.simulated import make_station
from tactopose_drake.systems.palm_on_base import PalmOnBase
from tactopose_drake.systems.palm_pose import PalmPose
from tactopose_drake.systems.pose_tracking import PoseTrackingParams


def test_on_an_arm_it_is_the_plants_own() -> None:
    builder, generator = DiagramBuilder(), np.random.default_rng(0)
    plant, _ = AddMultibodyPlant(MultibodyPlantConfig(time_step=0.001), builder)
    arm = add_arm(plant, load_arm_config("seven_axis"), RigidTransform([0.3, 0.1, 0.0]))
    hand = add_hand(plant, load_hand_config("shadow_like"))
    mount_hand(plant, arm, hand, ArmSetup().X_FBase.GetDeterministicValue())
    X_BP = RigidTransform(RollPitchYaw(0.4, -0.2, 0.9), [0.01, -0.02, 0.03])
    palm_frame = plant.AddFrame(FixedOffsetFrame("tilted_palm", hand.palm_frame, X_BP))
    plant.Finalize()
    palm = builder.AddNamedSystem("palm_pose", PalmPose(palm_frame))
    builder.Connect(plant.get_body_poses_output_port(), palm.GetInputPort("body_poses"))
    context = builder.Build().CreateDefaultContext()
    plant_context = plant.GetMyMutableContextFromRoot(context)
    for _ in range(3):
        plant.SetPositions(plant_context, generator.uniform(-0.5, 0.5, plant.num_positions()))
        X_WP = palm.GetOutputPort("palm_pose").Eval(palm.GetMyContextFromRoot(context))
        assert X_WP.IsNearlyEqualTo(palm_frame.CalcPoseInWorld(plant_context), 1e-12)


def test_on_a_base_that_stands_still_it_is_by_the_measured_joints() -> None:
    config, generator = load_hand_config("shadow_like"), np.random.default_rng(1)
    X_WBase = RigidTransform(RollPitchYaw(0.4, -0.8, 1.3), [0.3, -0.2, 0.9])
    there = MultibodyPlant(0.001)
    hand = add_hand(there, config, X_WBase)
    there.Finalize()
    palm = PalmOnBase(*make_hand_plant(config), X_WBase)
    context, in_plant = palm.CreateDefaultContext(), there.CreateDefaultContext()
    q = generator.uniform(-0.3, 0.3, there.num_positions())
    there.SetPositions(in_plant, q)
    palm.GetInputPort("joint_positions").FixValue(context, q)
    X_WP = palm.get_output_port().Eval(context)
    assert X_WP.IsNearlyEqualTo(hand.palm_frame.CalcPoseInWorld(in_plant), 1e-9)
    told = RigidTransform([1.0, 2.0, 3.0])  # by an arm
    palm.GetInputPort("palm_pose").FixValue(context, AbstractValue.Make(told))
    assert palm.get_output_port().Eval(context).IsExactlyEqualTo(told)


def test_in_a_station_it_tells_where_the_object_is_in_the_world() -> None:
    scenario = load_scenario("barrett_like_can")
    scenario.X_WBase = Transform(translation=[0.4, -0.2, 0.7], rotation=Rotation(value=Rotation.Rpy(deg=[50, 20, 70])))
    scenario.tracking, scenario.planner.grasps = PoseTrackingParams(), 1
    station = make_station(scenario)
    simulator = Simulator(station.diagram)
    root = simulator.get_mutable_context()
    station.start(root)
    simulator.AdvanceTo(0.05)
    plant_context = station.plant.GetMyContextFromRoot(root)
    X_WP = station.hand.palm_frame.CalcPoseInWorld(plant_context)
    X_PO, X_WO, belief = (
        station.diagram.GetOutputPort(f"tracked_{name}").Eval(root)
        for name in ("object_pose", "object_pose_in_world", "belief")
    )
    assert X_WO.IsNearlyEqualTo(X_WP @ X_PO, 1e-9)
    # In the world and not in the palm, which is far from it: as near to the true pose as vision is.
    truth = station.object_body.EvalPoseInWorld(plant_context).translation()
    assert belief.has_pose
    assert np.linalg.norm(X_WO.translation() - truth) < 3.0 * scenario.vision.model.translation_hidden
    assert np.linalg.norm(X_PO.translation() - truth) > 0.5
