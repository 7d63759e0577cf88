"""Your own diagram gets `object_pose`: a hand closes on a bust that was laid into it, and feels where it has moved."""

import numpy as np
import pydrake.all as drake

import tactopose_drake as tp
from tactopose_drake.hand import add_hand, load_hand_config
from tactopose_drake.resources import model_path
from tactopose_drake.systems import AddPoseEstimation


class Sensor(drake.LeafSystem):  # Your force-torque sensor; an ideal one here, that gives the reaction at a weld.
    def __init__(self, weld: drake.WeldJoint) -> None:
        super().__init__()
        self.weld = weld.index()
        self.reactions = self.DeclareAbstractInputPort("reactions", drake.Value[list[drake.SpatialForce]]())
        self.DeclareVectorOutputPort("wrench", 6, self.calc)

    def calc(self, context: drake.Context, F_S: drake.BasicVector) -> None:
        F_S.SetFromVector(-self.reactions.Eval(context)[self.weld].get_coeffs())


# Your plant and controller: the palm looks up, and the fingers bend until something stops them.
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
joints = builder.AddSystem(drake.Demultiplexer([24, 24]))  # positions, velocities
builder.Connect(plant.get_state_output_port(hand.model_instance), joints.get_input_port())

# The estimation: the joints' positions, each fingertip's wrench, and where a camera saw the bust in the open hand.
estimation = AddPoseEstimation(builder, hand.config, tp.ObjectModel.from_mesh(model_path("objects", "bust.obj")))
builder.Connect(joints.get_output_port(0), estimation.GetInputPort("joint_positions"))
for finger, weld in hand.welds.items():
    sensor = builder.AddSystem(Sensor(weld))
    builder.Connect(plant.get_reaction_forces_output_port(), sensor.get_input_port())
    builder.Connect(sensor.get_output_port(), estimation.GetInputPort(f"wrench_{finger}"))
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
