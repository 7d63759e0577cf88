"""The belief over time where the one-shot estimate is put to work: does it follow a grasp as it comes about?

python examples/belief_study.py --objects bust mug spray_bottle tea_box light_bulb wine_glass --placements 10

A hand closes on an object that was laid into it, in Drake's physics: contacts arrive one by one, and the object moves
by centimetres meanwhile. Each grasp is felt with a prior of where the object was laid, and without. From half a second
after the last finger's first contact the belief's best pose is compared with the truth at those instants at which the
one-shot estimate of the same instant is right: within 10 mm and 10 degrees, up to what the touch leaves free. Where two
poses are about as probable the estimate is right by chance at every second instant, or so; therefore those instants are
also counted apart at which it says "ok". Of all instants it is asked whether the belief says "ok" while it is off by 20
mm or 20 degrees.
"""

import argparse
import dataclasses
from typing import NamedTuple

import numpy as np
import pydrake.all as drake
from nearest_images import least_error
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track

import tactopose_drake as tp
from tactopose_drake.core.objectives import SurfaceContact
from tactopose_drake.core.posterior import free_directions
from tactopose_drake.hand import Hand, add_hand, load_hand_config
from tactopose_drake.resources import model_path
from tactopose_drake.systems import AddPoseEstimation, AddPoseTracking, PoseEstimationParams

Array = NDArray[np.float64]
PERIOD, DURATION, SETTLED = 0.02, 1.5, 0.5  # s
RIGHT, WRONG = (0.010, 10.0), (0.020, 20.0)  # m, deg
FIST = np.radians([0, 0] + 3 * [0, 63, 68] + [0, 0, 63, 68] + [10, 30, 0, 20, 50])


class Sensor(drake.LeafSystem):
    """An ideal force-torque sensor, which gives the reaction at a weld."""

    def __init__(self, weld: drake.WeldJoint) -> None:
        super().__init__()
        self.weld = weld.index()
        self.reactions = self.DeclareAbstractInputPort("reactions", drake.Value[list[drake.SpatialForce]]())
        self.DeclareVectorOutputPort("wrench", 6, self.calc)

    def calc(self, context: drake.Context, F_S: drake.BasicVector) -> None:
        F_S.SetFromVector(-self.reactions.Eval(context)[self.weld].get_coeffs())


@dataclasses.dataclass(frozen=True)
class Instant:
    """What was felt and said at one time; errors are [m, deg], up to what the touch leaves free, and the probability is
    what the estimate gives its best pose.
    """

    time: float
    fingers: tuple[str, ...]
    status: str
    belief_error: Array
    estimate_error: Array
    estimate_is_sure: bool
    estimate_probability: float


def lay(model: tp.ObjectModel, generator: np.random.Generator) -> drake.RigidTransform:
    """A pose across the open hand, with the object's middle about where that of the bust lies."""
    middle = 0.5 * (model.vertices.min(axis=0) + model.vertices.max(axis=0))
    across = drake.RotationMatrix(drake.RollPitchYaw(np.pi / 2, 0, np.pi / 2))
    turned = drake.RotationMatrix.MakeXRotation(np.pi * generator.integers(2))
    spun = drake.RotationMatrix.MakeZRotation(generator.uniform(-np.pi, np.pi))
    tilt = drake.RotationMatrix(drake.RollPitchYaw(0.2 * generator.normal(size=3)))
    R = tilt @ across @ turned @ spun
    return drake.RigidTransform(R, [0.02, -0.05, 0.065] + 0.012 * generator.normal(size=3) - R @ middle)


def clear_of_the_hand(
    plant: drake.MultibodyPlant,
    context: drake.Context,
    body: drake.RigidBody,
    X_WP: drake.RigidTransform,
    X_PO: drake.RigidTransform,
) -> drake.RigidTransform:
    """The pose, raised until the object is in no part of the hand; the object is put there."""
    own = plant.GetCollisionGeometriesForBody(body)
    for _ in range(60):
        plant.SetFreeBodyPose(context, body, X_WP @ X_PO)
        pairs = plant.get_geometry_query_input_port().Eval(context).ComputePointPairPenetration()
        if not any(pair.id_A in own or pair.id_B in own for pair in pairs):
            break
        up_P = X_WP.rotation().inverse() @ np.array([0.0, 0.0, 0.002])
        X_PO = drake.RigidTransform(X_PO.rotation(), X_PO.translation() + up_P)
    return X_PO


def error(model: tp.ObjectModel, X_hat: Array, X_true: Array, free: Array) -> Array:
    """[m, deg] to the nearest image of the truth, without the part along the free directions."""
    u = least_error(model, X_hat, X_true, free)
    return np.array([np.linalg.norm(u[3:]), np.degrees(np.linalg.norm(u[:3]))])


def add_plant(builder: drake.DiagramBuilder, name: str) -> tuple[drake.MultibodyPlant, Hand]:
    """The hand, its palm up, which closes until something stops it, and the object."""
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


def run_grasp(name: str, model: tp.ObjectModel, seed: int, with_prior: bool) -> list[Instant]:
    """Lays an object into the hand, closes it, and asks belief and estimate at each period."""
    builder = drake.DiagramBuilder()
    plant, hand = add_plant(builder, name)
    joints = builder.AddSystem(drake.Demultiplexer([24, 24]))
    builder.Connect(plant.get_state_output_port(hand.model_instance), joints.get_input_port())
    often = PoseEstimationParams()
    often.estimator.period = PERIOD
    estimation = AddPoseEstimation(builder, hand.config, model, often)
    tracking = AddPoseTracking(builder, hand.config, model)
    parts = (estimation, tracking)
    builder.Connect(joints.get_output_port(1), tracking.GetInputPort("joint_velocities"))
    sensors = {finger: builder.AddSystem(Sensor(weld)) for finger, weld in hand.welds.items()}
    for sensor in sensors.values():
        builder.Connect(plant.get_reaction_forces_output_port(), sensor.get_input_port())
    for part in parts:
        builder.Connect(joints.get_output_port(0), part.GetInputPort("joint_positions"))
        for finger, sensor in sensors.items():
            builder.Connect(sensor.get_output_port(), part.GetInputPort(f"wrench_{finger}"))
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
        contacts, free = tracking.GetOutputPort("contacts").Eval(belief), np.zeros((0, 6))
        if len(contacts):
            information = SurfaceContact(model.grid, contacts).normal_equations(X_true[None]).hessian
            free = free_directions(information, model.size)[0]
        felt, found = (
            error(model, part.GetOutputPort("object_pose").Eval(own).GetAsMatrix34(), X_true, free)
            for part, own in ((tracking, belief), (estimation, estimate))
        )
        status = tracking.GetOutputPort("status").Eval(belief).split(":")[0]
        fingers = tracking.GetOutputPort("fingers_in_contact").Eval(belief)
        is_sure = estimation.GetOutputPort("status").Eval(estimate).split(":")[0] == "ok"
        hypotheses = estimation.GetOutputPort("hypotheses").Eval(estimate)
        probability = hypotheses.best.probability if hypotheses else 0.0
        instants.append(Instant(float(time), fingers, status, felt, found, is_sure, probability))
    return instants


class Counts(NamedTuple):
    """Of instants: how many there are, and how many are "ok" while wrong; at how many settled ones estimate and belief
    are right; those at which the estimate is and with it the belief, both again where the estimate is sure, and the sum
    of the probabilities that it gives its pose there.
    """

    instants: float = 0.0
    wrong: float = 0.0
    settled: float = 0.0
    settled_right: float = 0.0
    counted: float = 0.0
    right: float = 0.0
    sure: float = 0.0
    sure_right: float = 0.0
    probability: float = 0.0

    def plus(self, more: "Counts") -> "Counts":
        """Both together."""
        return Counts(*(mine + its for mine, its in zip(self, more, strict=True)))


def counts(instants: list[Instant]) -> Counts:
    """Counts the instants of one grasp."""
    first: dict[str, float] = {}
    for instant in instants:
        for finger in instant.fingers:
            first.setdefault(finger, instant.time)
    begin = max(first.values(), default=DURATION) + SETTLED
    settled = [i for i in instants if i.time > begin]
    counted = [i for i in settled if np.all(i.estimate_error < RIGHT)]
    right = [i for i in counted if np.all(i.belief_error < RIGHT)]
    return Counts(
        instants=len(instants),
        wrong=sum(i.status == "ok" and bool(np.any(i.belief_error > WRONG)) for i in instants),
        settled=len(settled),
        settled_right=sum(bool(np.all(i.belief_error < RIGHT)) for i in settled),
        counted=len(counted),
        right=len(right),
        sure=sum(i.estimate_is_sure for i in counted),
        sure_right=sum(i.estimate_is_sure for i in right),
        probability=sum(i.estimate_probability for i in counted),
    )


def main() -> None:
    """Prints a line for each object, and for all, with a prior and without."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--objects", nargs="+", default=["bust", "mug", "spray_bottle"])
    parser.add_argument("--placements", type=int, default=5)
    parser.add_argument("--first-seed", type=int, default=0)
    arguments = parser.parse_args()
    for with_prior in (True, False):
        total = Counts()
        for name in arguments.objects:
            model = tp.ObjectModel.from_mesh(model_path("objects", f"{name}.obj"))
            seeds = range(arguments.first_seed, arguments.first_seed + arguments.placements)
            of_object = Counts()
            for seed in track(seeds, description=name):
                of_object = of_object.plus(counts(run_grasp(name, model, seed, with_prior)))
            total = total.plus(of_object)
            print_line(name, of_object)
        print_line("all, with a prior" if with_prior else "all, without", total)


def print_line(name: str, of: Counts) -> None:
    """The counts in words."""
    counted, settled = max(of.counted, 1.0), max(of.settled, 1.0)
    Console().print(
        f"{name}: the belief is right at {of.right / counted:.1%} of {of.counted:.0f} instants at which the estimate "
        f"is (asked 98%; the estimate gives its pose {of.probability / counted:.1%} there), at "
        f"{of.sure_right / max(of.sure, 1.0):.1%} of {of.sure:.0f} at which it is sure as well; of {of.settled:.0f} "
        f"settled instants the belief is right at {of.settled_right / settled:.1%}, the estimate at "
        f'{of.counted / settled:.1%}; "ok" while wrong at {of.wrong / of.instants:.2%} of {of.instants:.0f}'
    )


if __name__ == "__main__":
    main()
