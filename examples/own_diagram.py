"""Pose estimation in your own diagram: a hand closes on a bust that lies in it, and estimates where it has moved."""

import numpy as np
import pydrake.all as drake

import tactopose_drake as tp
from tactopose_drake.hand import add_hand, load_hand_config
from tactopose_drake.resources import model_path
from tactopose_drake.systems import AddPoseEstimation

# Your plant and controller: the palm is up, and the fingers close until they are stopped.
builder = drake.DiagramBuilder()
plant, _ = drake.AddMultibodyPlant(drake.MultibodyPlantConfig(time_step=0.004), builder)
palm_up = drake.RotationMatrix.MakeXRotation(-np.pi / 2)
hand = add_hand(plant, load_hand_config("shadow_like"), drake.RigidTransform(palm_up))
drake.Parser(plant).AddModels(str(model_path("objects", "bust.sdf")))
plant.set_gravity_enabled(hand.model_instance, False)
for index in plant.GetJointActuatorIndices():
    plant.get_joint_actuator(index).set_controller_gains(drake.PdControllerGains(p=1.0, d=0.05))
plant.Finalize()
fist = np.radians([0, 0] + 3 * [0, 63, 68] + [0, 0, 63, 68] + [10, 30, 0, 20, 50])
posture = builder.AddSystem(drake.ConstantVectorSource(np.append(fist, np.zeros(20))))
builder.Connect(posture.get_output_port(), plant.get_desired_state_input_port(hand.model_instance))

# The estimation: joint positions and fingertip wrenches come from the plant; a camera has seen the bust in the open
# hand.
model = tp.ObjectModel.from_mesh(model_path("objects", "bust.obj"))
estimation = AddPoseEstimation(builder, hand.config, model, plant=plant)
X_PO_seen = drake.RigidTransform(drake.RollPitchYaw(np.pi / 2, 0, np.pi / 2), [-0.05, -0.05, 0.065])
camera = builder.AddSystem(drake.ConstantValueSource(drake.Value(tp.PosePrior(X_PO_seen))))
builder.Connect(camera.get_output_port(), estimation.GetInputPort("prior"))

simulator = drake.Simulator(builder.Build())
plant_context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
bust, X_WP = plant.GetBodyByName("bust"), hand.palm_frame.CalcPoseInWorld(plant_context)
plant.SetFreeBodyPose(plant_context, bust, X_WP @ X_PO_seen)
simulator.AdvanceTo(1.0)
X_PO = plant.CalcRelativeTransform(plant_context, hand.palm_frame, bust.body_frame())
X_PO_hat = estimation.GetOutputPort("object_pose").Eval(estimation.GetMyContextFromRoot(simulator.get_context()))
for name, X in (("seen", X_PO_seen), ("felt", X_PO_hat), ("true", X_PO)):
    turn = X_PO.rotation().InvertAndCompose(X.rotation()).ToAngleAxis().angle()
    print(f"{name}: p_PO = {X.translation().round(4)} m, turned by {np.degrees(turn):.1f} deg from the truth")
