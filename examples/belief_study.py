"""Comparison of the belief over time with the one-shot estimate while a grasp is established.

python examples/belief_study.py --objects bust mug spray_bottle tea_box light_bulb wine_glass --placements 10

A hand closes on an object that lies in it, simulated with Drake's physics: contacts arrive one by one, while the object
moves by centimetres. Each grasp is run with a prior of the object's initial pose, and without.

From half a second after the last finger's first contact, the belief's best pose is compared with the truth at the
instants at which the one-shot estimate is right: within 10 mm and 10 degrees, apart from the directions that the touch
leaves free. If two poses are about equally probable, the estimate is right by chance at about every second instant.
Therefore, the instants at which the estimate's status is "ok" are also counted separately, and the belief is compared
with the estimate of the next period: the share of right estimates that are followed by another right one is the most
that can be expected of any estimator. Likewise, a direction that the touch determines only to 12 mm is not free, and
right only by chance. So the belief is also counted with all directions as free that the touch determines no better than
10 mm. The probability that both give to right poses does not depend on chance. Finally, over all instants, it is
counted how often the belief's status is "ok" while it is off by 20 mm or 20 degrees.

`--late-wrenches 0.04` or `--late-joints 0.04` delays these by 40 ms against the others, which nobody tells the belief.
"""

import argparse
import functools
from collections.abc import Mapping
from typing import Any

import numpy as np
import pydrake.all as drake
from belief_summary import DURATION, RIGHT, Counts, Instant, counts, print_line
from laid_objects import clear_of_the_hand, lay
from nearest_images import least_error
from numpy.typing import NDArray
from rich.progress import track

import tactopose_drake as tp
from tactopose_drake.core.objectives import SurfaceContact
from tactopose_drake.core.posterior import ModeParams, free_directions
from tactopose_drake.hand import Hand, add_hand, load_hand_config
from tactopose_drake.resources import model_path
from tactopose_drake.systems import AddPoseEstimation, AddPoseTracking, CollectableSystem, PoseEstimationParams

Array = NDArray[np.float64]
PERIOD = 0.02  # s
FIST = np.radians([0, 0] + 3 * [0, 63, 68] + [0, 0, 63, 68] + [10, 30, 0, 20, 50])


class Sensor(CollectableSystem):
    """An ideal force-torque sensor, which gives the reaction at a weld."""

    def __init__(self, weld: drake.WeldJoint) -> None:
        super().__init__()
        self.weld = weld.index()
        self.reactions = self.DeclareAbstractInputPort("reactions", drake.Value[list[drake.SpatialForce]]())
        self.DeclareVectorOutputPort("wrench", 6, self.calc)

    def calc(self, context: drake.Context, F_S: drake.BasicVector) -> None:
        F_S.SetFromVector(-self.reactions.Eval(context)[self.weld].get_coeffs())


def error(model: tp.ObjectModel, X_hat: Array, X_true: Array, free: Array) -> Array:
    """Error [m, deg] to the nearest symmetry image of the truth, without the part along the free directions."""
    u = least_error(model, X_hat, X_true, free)
    return np.array([np.linalg.norm(u[3:]), np.degrees(np.linalg.norm(u[:3]))])


def probability_of_right(
    model: tp.ObjectModel, X_PO: list[Array], probability: list[float], X_true: Array, free: Array
) -> float:
    """Total probability of the poses (n, 3, 4) that are right apart from the free directions."""
    errors = (error(model, X, X_true, free) for X in X_PO)
    return sum(share for share, off in zip(probability, errors, strict=True) if np.all(off < RIGHT))


def add_plant(builder: drake.DiagramBuilder, name: str) -> tuple[drake.MultibodyPlant, Hand]:
    """The hand with its palm up, which closes until it is stopped, and the object."""
    plant, _ = drake.AddMultibodyPlant(drake.MultibodyPlantConfig(time_step=0.004), builder)
    palm_up = drake.RigidTransform(drake.RotationMatrix.MakeXRotation(-np.pi / 2))
    hand = add_hand(plant, load_hand_config("shadow_like"), palm_up)
    drake.Parser(plant).AddModels(str(model_path("objects", f"{name}.sdf")))
    plant.set_gravity_enabled(hand.model_instance, False)
    for index in plant.GetJointActuatorIndices():
        plant.get_joint_actuator(index).set_controller_gains(drake.PdControllerGains(p=1.0, d=0.05))
    plant.Finalize()
    posture = builder.AddSystem(drake.ConstantVectorSource(np.append(FIST, np.zeros(20))))
    builder.Connect(posture.get_output_port(), plant.get_desired_state_input_port(hand.model_instance))
    return plant, hand


def add_senses(
    builder: drake.DiagramBuilder, plant: drake.MultibodyPlant, hand: Hand, late: Mapping[str, float]
) -> dict[str, drake.OutputPort]:
    """The ports by the names of the belief's inputs, those of joints and wrenches late by this time, s."""
    joints = builder.AddSystem(drake.Demultiplexer([24, 24]))
    builder.Connect(plant.get_state_output_port(hand.model_instance), joints.get_input_port())
    senses = {name: joints.get_output_port(i) for i, name in enumerate(("joint_positions", "joint_velocities"))}
    for finger, weld in hand.welds.items():
        sensor = builder.AddSystem(Sensor(weld))
        builder.Connect(plant.get_reaction_forces_output_port(), sensor.get_input_port())
        senses[f"wrench_{finger}"] = sensor.get_output_port()
    for name, port in senses.items():
        steps = round(late[name.split("_")[0]] / plant.time_step())
        if steps:
            delay = builder.AddSystem(drake.DiscreteTimeDelay(plant.time_step(), steps, port.size()))
            builder.Connect(port, delay.get_input_port())
            senses[name] = delay.get_output_port()
    return senses


def run_grasp(
    name: str, model: tp.ObjectModel, seed: int, with_prior: bool, late: Mapping[str, float]
) -> list[Instant]:
    """Lays an object into the hand, closes the hand, and evaluates belief and estimate at each period."""
    builder = drake.DiagramBuilder()
    plant, hand = add_plant(builder, name)
    often = PoseEstimationParams()
    often.estimator.period = PERIOD
    estimation = AddPoseEstimation(builder, hand.config, model, often)
    tracking = AddPoseTracking(builder, hand.config, model)
    parts = (estimation, tracking)
    for sense, port in add_senses(builder, plant, hand, late).items():
        for part in parts:
            if part.HasInputPort(sense):
                builder.Connect(port, part.GetInputPort(sense))
    simulator = drake.Simulator(builder.Build())
    root = simulator.get_mutable_context()
    context, body = plant.GetMyMutableContextFromRoot(root), plant.GetBodyByName(name)
    X_WP = hand.palm_frame.CalcPoseInWorld(context)
    X_PO = clear_of_the_hand(plant, context, body, X_WP, lay(model, np.random.default_rng(seed)))
    if with_prior:
        for part in parts:
            part.GetInputPort("prior").FixValue(part.GetMyMutableContextFromRoot(root), drake.Value(tp.PosePrior(X_PO)))
    instants = []
    for time in np.arange(PERIOD, DURATION, PERIOD):
        simulator.AdvanceTo(time + 1e-3)
        X_true = plant.CalcRelativeTransform(context, hand.palm_frame, body.body_frame()).GetAsMatrix34()
        belief, estimate = tracking.GetMyContextFromRoot(root), estimation.GetMyContextFromRoot(root)
        instants.append(compare(model, float(time), X_true, (tracking, belief), (estimation, estimate)))
    return instants


def compare(
    model: tp.ObjectModel,
    time: float,
    X_true: Array,
    tracking: tuple[drake.System, drake.Context],
    estimation: tuple[drake.System, drake.Context],
) -> Instant:
    """Compares the belief and the estimate, each with its context, with the truth at one time."""
    said, found = (functools.partial(_output, *each) for each in (tracking, estimation))
    contacts, free, open_directions = said("contacts"), np.zeros((0, 6)), np.zeros((0, 6))
    if len(contacts):
        information = SurfaceContact(model.grid, contacts).normal_equations(X_true[None]).hessian
        free = free_directions(information, model.size)[0]
        share = min(ModeParams().free_share, RIGHT[0] / model.size)
        open_directions = free_directions(information, model.size, params=ModeParams(free_share=share))[0]
    X_belief, X_estimate = (said("object_pose").GetAsMatrix34(), found("object_pose").GetAsMatrix34())
    modes, hypotheses = said("belief"), found("hypotheses") or ()
    return Instant(
        time,
        said("fingers_in_contact"),
        said("status").split(":")[0],
        belief_error=error(model, X_belief, X_true, free),
        estimate_error=error(model, X_estimate, X_true, free),
        belief_open_error=error(model, X_belief, X_true, open_directions),
        estimate_is_sure=found("status").split(":")[0] == "ok",
        belief_probability=probability_of_right(model, list(modes.X_PO), list(modes.probability), X_true, free),
        estimate_probability=probability_of_right(
            model,
            [hypothesis.X_PO.GetAsMatrix34() for hypothesis in hypotheses],
            [hypothesis.probability for hypothesis in hypotheses],
            X_true,
            free,
        ),
    )


def _output(system: drake.System, context: drake.Context, name: str) -> Any:
    return system.GetOutputPort(name).Eval(context)


def main() -> None:
    """Prints a line for each object, and for all, with a prior and without."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--objects", nargs="+", default=["bust", "mug", "spray_bottle"])
    parser.add_argument("--placements", type=int, default=5)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--late-joints", type=float, default=0.0, help="delay of the joints, s")
    parser.add_argument("--late-wrenches", type=float, default=0.0, help="delay of the wrenches, s")
    arguments = parser.parse_args()
    late = {"joint": arguments.late_joints, "wrench": arguments.late_wrenches}
    for with_prior in (True, False):
        total = Counts()
        for name in arguments.objects:
            model = tp.ObjectModel.from_mesh(model_path("objects", f"{name}.obj"))
            seeds = range(arguments.first_seed, arguments.first_seed + arguments.placements)
            of_object = Counts()
            for seed in track(seeds, description=name):
                of_object = of_object.plus(counts(run_grasp(name, model, seed, with_prior, late)))
            total = total.plus(of_object)
            print_line(name, of_object)
        print_line("all, with a prior" if with_prior else "all, without", total)


if __name__ == "__main__":
    main()
