"""What the contacts' forces tell an estimator: friction, and that the object rests on the fingertips."""

import dataclasses

import numpy as np
import pytest
import trimesh
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.force_balance import ForceBalance
from tactopose_drake.core.sensing.intrinsic_contact import FingertipSolver
from tactopose_drake.core.sensing.patches import describe_patch
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.surfaces import Sphere
from tactopose_drake.core.synthetic.synthetic_patch import flat_pad, touch_with_pads
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.estimation.estimate import estimate_pose
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.hand.hand_config import PadConfig, load_hand_config
from tactopose_drake.hand.hand_in_plant import add_hand, make_hand_plant
from tactopose_drake.station.hardware import make_hardware_station
from tactopose_drake.station.scenario import Scenario
from tactopose_drake.station.simulated import make_station
from tactopose_drake.systems.palm_on_base import PalmOnBase
from tactopose_drake.systems.pose_estimation import AddPoseEstimation, MakePoseEstimation, PoseEstimationParams
from tactopose_drake.systems.pose_estimator import PoseEstimatorParams
from tests.core.models import brick
from tests.systems.pose_estimator_bench import X_PO, Bench

X_WP = RigidTransform(RollPitchYaw(0.3, 1.2, -0.7), [0.5, 0.2, 0.9])
PRIOR = PosePrior(X_PO, 0.02, 0.15)
p_OC = np.array([[0.03, 0.01, 0.0], [-0.03, -0.01, 0.03], [0.0, 0.05, 0.02]])
n_OC = np.array([[1.0, 0, 0], [-1.0, 0, 0], [0, 1.0, 0]])


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    return ObjectModel.from_mesh(trimesh.creation.box((0.06, 0.10, 0.14)), mass=0.2, cache=False)


def pressing() -> Contacts:
    """Contacts whose forces lean by 30 degrees."""
    n_PC = X_PO.rotation().multiply(n_OC.T).T
    return Contacts(X_PO.multiply(p_OC.T).T, n_PC, 2.0 * n_PC + X_PO.rotation().multiply([0.0, 0.0, 1.15]))


def best(bench: Bench) -> np.ndarray:
    return bench.step()[1].best.X_PO.GetAsMatrix34()


def expected(box: ObjectModel, **known: object) -> np.ndarray:
    return estimate_pose(box, pressing(), prior=PRIOR, max_hypotheses=16, **known).best.X_PO.GetAsMatrix34()


def test_friction_reaches_the_estimate(box: ObjectModel) -> None:
    bench = Bench(box, friction=0.2)
    bench.fix(contacts=pressing(), prior=PRIOR)
    np.testing.assert_array_equal(best(bench), expected(box, friction=0.2))
    assert not np.array_equal(best(bench), expected(box))
    # Without forces friction says nothing.
    bare = Contacts(pressing().p_PC, pressing().n_PC)
    bench.fix(contacts=bare)
    assert bench.step()[2] in ("ok", "ambiguous")


def test_gravity_is_the_worlds_in_the_palm(box: ObjectModel) -> None:
    assert not Bench(box).estimator.HasInputPort("palm_pose")
    bench = Bench(box, balance=True)
    bench.fix(contacts=pressing(), prior=PRIOR)
    alone = best(bench)
    np.testing.assert_array_equal(alone, expected(box))
    bench.fix(palm_pose=X_WP)
    gravity = X_WP.rotation().matrix().T @ [0.0, 0.0, -9.81]
    balanced = best(bench)
    np.testing.assert_allclose(balanced, expected(box, balance=ForceBalance(gravity)), atol=1e-12)
    assert not np.allclose(balanced, alone, atol=1e-6)
    bench.fix(palm_pose=RigidTransform(X_WP.rotation(), [np.nan, 0.0, 0.0]))
    np.testing.assert_array_equal(best(bench), alone)


def test_balance_is_left_out_where_a_force_is_missing(box: ObjectModel) -> None:
    patches = touch_with_pads(box, X_PO.GetAsMatrix34(), 1, np.random.default_rng(0))
    assert patches[0].is_felt
    found = []
    for balance in (True, False):
        bench = Bench(box, balance=balance)
        bench.fix(contacts=pressing(), patches=tuple(patches), prior=PRIOR)
        if balance:
            bench.fix(palm_pose=X_WP)
        found.append(best(bench))
    np.testing.assert_array_equal(*found)


def test_balance_is_left_out_while_a_pad_gives_no_reading(box: ObjectModel) -> None:
    silent = describe_patch(flat_pad() + np.array([1.0, 0.0, 0.0]), np.zeros(24), alpha=1e-7)
    bench = Bench(box, balance=True, pads=2)
    bench.fix(contacts=pressing(), prior=PRIOR, palm_pose=X_WP)
    gravity = X_WP.rotation().matrix().T @ [0.0, 0.0, -9.81]
    for patches, known in (
        ((silent,), {}),
        ((silent, silent), {"balance": ForceBalance(gravity), "patches": (silent, silent)}),
    ):
        bench.fix(patches=patches)
        np.testing.assert_allclose(best(bench), expected(box, **known), atol=1e-12)


def test_the_estimation_of_a_hand_knows_how_many_pads_it_has(box: ObjectModel, monkeypatch: pytest.MonkeyPatch) -> None:
    balances = []

    def estimate(*args: object, **known: object) -> object:
        balances.append(known["balance"])
        return estimate_pose(*args, **known)

    monkeypatch.setattr("tactopose_drake.systems.pose_estimator.estimate_pose", estimate)
    hand = load_hand_config("shadow_like")
    pad = PadConfig(name="palm", frame=hand.palm_frame, array="bh280_palm", alpha=2e-8)
    params = PoseEstimationParams(estimator=PoseEstimatorParams(balance=True, min_contacts=1), check_collisions=False)
    estimation = MakePoseEstimation(dataclasses.replace(hand, pads=[pad]), box, params)
    simulator = Simulator(estimation)
    context = simulator.get_mutable_context()
    for finger in hand.fingers:
        pressed = finger is hand.fingers[0]
        wrench = np.array([0.0, 0.0, 0.0, 0.0, 0.0, -2.0 if pressed else 0.0])
        estimation.GetInputPort(f"wrench_{finger.name}").FixValue(context, wrench)
    joints = estimation.GetInputPort("joint_positions")
    joints.FixValue(context, np.zeros(joints.size()))
    estimation.GetInputPort("prior").FixValue(context, AbstractValue.Make(PRIOR))
    estimation.GetInputPort("palm_pose").FixValue(context, AbstractValue.Make(X_WP))
    simulator.AdvanceTo(0.05)
    estimation.GetInputPort("pressures_palm").FixValue(context, np.zeros(24))
    simulator.AdvanceTo(0.15)
    assert [balance is None for balance in balances] == [True, False]


@pytest.mark.parametrize(
    ("wrench", "is_used"),
    [
        (np.zeros(6), True),
        (np.full(6, np.nan), False),  # no reading
        ([0.0, 0.0, 0.0, 0.0, 0.0, 2.0], False),  # a pull, which no single contact explains
        ([0.0, 0.0, 0.0, 0.0, 0.0, -2.0], False),  # a contact that is not among those given, as of unknown joints
    ],
)
def test_balance_is_left_out_while_a_fingers_force_is_unknown(
    box: ObjectModel, wrench: list[float], is_used: bool
) -> None:
    solvers = {name: FingertipSolver(Sphere(radius=0.01)) for name in ("thumb", "first", "middle", "ring")}
    felt = {name: [0.0, 0.0, 0.0, 0.0, 0.0, -2.0] for name in ("thumb", "first", "middle")}
    solutions = {name: solver.solve(np.array(felt.get(name, wrench))) for name, solver in solvers.items()}
    bench = Bench(box, balance=True)
    bench.fix(contacts=pressing(), prior=PRIOR, palm_pose=X_WP, contact_solutions=solutions)
    gravity = X_WP.rotation().matrix().T @ [0.0, 0.0, -9.81]
    known = {"balance": ForceBalance(gravity)} if is_used else {}
    np.testing.assert_allclose(best(bench), expected(box, **known), atol=1e-12)


def test_an_object_of_unknown_mass_is_refused_at_once() -> None:
    light = brick(0.06, 0.10, 0.14)
    with pytest.raises(InvalidInputError, match=r"model must have a mass for the balance, but that of .* is not known"):
        Bench(light, balance=True)
    with pytest.raises(InvalidInputError, match=r"friction must be .*, not -0\.1"):
        PoseEstimatorParams(friction=-0.1).validate()


@pytest.mark.parametrize("gravity", [[0.0, 0.0, -1.62], [0.0, -9.81, 0.0], [0.0, 0.0, -9.83]])
def test_a_plant_with_another_gravity_than_the_balances_is_refused(box: ObjectModel, gravity: list[float]) -> None:
    config, builder = load_hand_config("shadow_like"), DiagramBuilder()
    plant = builder.AddSystem(MultibodyPlant(time_step=0.001))
    add_hand(plant, config, RigidTransform())
    plant.mutable_gravity_field().set_gravity_vector(gravity)
    plant.Finalize()
    params = PoseEstimationParams(estimator=PoseEstimatorParams(balance=True))
    if gravity[2] < -9.0:
        AddPoseEstimation(builder, config, box, params, plant=plant)
        return
    with pytest.raises(InvalidInputError, match=r"plant must have a gravity of \[0\.00, 0\.00, -9\.81\] m/s\^2 with"):
        AddPoseEstimation(builder, config, box, params, plant=plant)
    AddPoseEstimation(builder, config, box, plant=plant)


def test_the_palm_on_a_fixed_base_is_where_the_plant_has_it() -> None:
    config = load_hand_config("shadow_like")
    plant, hand = make_hand_plant(config)
    X_WBase = RigidTransform(RollPitchYaw(0.4, -0.2, 0.9), [0.1, -0.2, 0.3])
    system = PalmOnBase(plant, hand, X_WBase)
    context = system.CreateDefaultContext()
    world = MultibodyPlant(time_step=0.001)
    there = add_hand(world, config, X_WBase)
    world.Finalize()
    own = world.CreateDefaultContext()
    q = np.random.default_rng(0).uniform(0.0, 0.5, plant.num_positions())
    system.GetInputPort("joint_positions").FixValue(context, q)
    world.SetPositions(own, q)
    X_WP = system.get_output_port().Eval(context)
    assert isinstance(X_WP, RigidTransform)
    assert X_WP.IsNearlyEqualTo(there.palm_frame.CalcPoseInWorld(own), 1e-12)
    system.GetInputPort("palm_pose").FixValue(context, AbstractValue.Make(X_WP_moved := X_WBase @ X_WBase))
    assert system.get_output_port().Eval(context).IsExactlyEqualTo(X_WP_moved)


def test_stations_know_the_mass_and_the_palm() -> None:
    estimator = PoseEstimatorParams(friction=0.9, balance=True)
    scenario = Scenario(object="spray_bottle", estimation=PoseEstimationParams(estimator=estimator))
    model = scenario.object_model()
    assert model.mass_is_known
    assert f"<mass>{model.mass:g}</mass>" in scenario.object_sdf().read_text()
    for station in (make_station(scenario, model=model), make_hardware_station(scenario, model=model)):
        estimation = station.diagram.GetSubsystemByName("pose_estimation")
        context = station.diagram.CreateDefaultContext()
        assert estimation.GetInputPort("palm_pose").HasValue(estimation.GetMyContextFromRoot(context))
    scenario.estimation.estimator.balance = False
    assert not scenario.object_model().mass_is_known
