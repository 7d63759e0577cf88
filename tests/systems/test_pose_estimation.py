import math

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram, DiagramBuilder

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.plane_contact import PlaneContact
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.estimation.estimate import estimate_pose
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.hand.geometry import HandGeometry
from tactopose_drake.hand.hand_config import HandConfig, load_hand_config
from tactopose_drake.hand.hand_in_plant import add_hand, make_hand_plant
from tactopose_drake.systems.pose_estimation import AddPoseEstimation, MakePoseEstimation, PoseEstimationParams
from tactopose_drake.systems.pose_estimator import PoseEstimatorParams
from tactopose_drake.systems.pose_tracking import AddPoseTracking
from tests.core.models import globe
from tests.pressed_ball import SILENT, make_ball, press

n_S = np.array([0.6, 0.0, 0.8])
f_S = np.array([-1.1, 0.2, -1.7])


@pytest.fixture(scope="module")
def hand() -> HandConfig:
    return load_hand_config("shadow_like")


@pytest.fixture(scope="module")
def model() -> ObjectModel:
    return globe(0.04)


def positions(hand: HandConfig) -> np.ndarray:
    plant, _ = make_hand_plant(hand)
    return np.linspace(0.05, 0.6, plant.num_positions())


def expected_contacts(hand: HandConfig, fingers: tuple[str, ...]) -> Contacts:
    """The point of each fingertip that looks along n_S, moved into the palm by hand."""
    plant, parts = make_hand_plant(hand)
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, positions(hand))
    X_PW = parts.palm_frame.CalcPoseInWorld(context).inverse()
    rows = []
    for finger in fingers:
        X_PS = X_PW @ parts.sensor_frames[finger].CalcPoseInWorld(context)
        rows.append((X_PS @ touched_point(hand, finger), -(X_PS.rotation() @ n_S), X_PS.rotation() @ f_S))
    p_PC, n_PC, f_PC = np.array(rows).transpose(1, 0, 2)
    return Contacts(p_PC, n_PC, f_PC)


def touched_point(hand: HandConfig, finger: str) -> np.ndarray:
    surface = hand.finger(finger).surface
    X_SF = surface.X_SF.GetDeterministicValue()
    return X_SF @ np.array([0, 0, surface.length / 2]) + surface.radius * n_S


def wrench(hand: HandConfig, finger: str) -> np.ndarray:
    return np.concatenate([np.cross(touched_point(hand, finger), f_S), f_S])


def hand_volume(hand: HandConfig) -> HandGeometry:
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=0.001)
    palm_frame = add_hand(plant, hand, RigidTransform()).palm_frame
    plant.Finalize()
    context = plant.GetMyMutableContextFromRoot(builder.Build().CreateDefaultContext())
    plant.SetPositions(context, positions(hand))
    return HandGeometry.from_plant(plant, context, palm_frame)


def connect(diagram: Diagram, context: Context, hand: HandConfig, fingers: tuple[str, ...]) -> None:
    for finger in (config.name for config in hand.fingers):
        value = wrench(hand, finger) if finger in fingers else np.full(6, np.nan)
        diagram.GetInputPort(f"wrench_{finger}").FixValue(context, value)
    diagram.GetInputPort("joint_positions").FixValue(context, positions(hand))


def test_the_ports_are_those_that_are_promised(hand: HandConfig, model: ObjectModel) -> None:
    builder = DiagramBuilder()
    diagram = AddPoseEstimation(builder, hand, model, name="touch")
    assert diagram.get_name() == "touch"
    inputs = {diagram.get_input_port(i).get_name() for i in range(diagram.num_input_ports())}
    outputs = {diagram.get_output_port(i).get_name() for i in range(diagram.num_output_ports())}
    assert inputs == {f"wrench_{finger.name}" for finger in hand.fingers} | {"joint_positions", "prior", "planes"}
    assert outputs >= {"object_pose", "hypotheses", "status", "contacts"}


def test_the_diagram_does_what_its_parts_do_by_hand(hand: HandConfig, model: ObjectModel) -> None:
    fingers = ("first", "ring", "thumb")
    expected = expected_contacts(hand, fingers)
    prior = PosePrior(RigidTransform(expected.p_PC.mean(axis=0)), 0.02, math.radians(10))
    params = PoseEstimationParams(estimator=PoseEstimatorParams(period=0.1, seed=3), use_uncertainty=False)
    diagram = MakePoseEstimation(hand, model, params)
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    connect(diagram, context, hand, fingers)
    diagram.GetInputPort("prior").FixValue(context, AbstractValue.Make(prior))
    planes = (PlaneContact(prior.X_PO.translation() - [0.0, 0.0, 0.05], [0.0, 0.0, 1.0]),)
    diagram.GetInputPort("planes").FixValue(context, AbstractValue.Make(planes))
    simulator.AdvanceTo(0.01)

    contacts = diagram.GetOutputPort("contacts").Eval(context)
    assert diagram.GetOutputPort("fingers_in_contact").Eval(context) == fingers
    for name in ("p_PC", "n_PC", "f_PC"):
        np.testing.assert_allclose(getattr(contacts, name), getattr(expected, name), atol=1e-9)
    by_hand = estimate_pose(
        model,
        contacts,
        prior=prior,
        hand=hand_volume(hand),
        planes=planes,
        seed=3,
        max_hypotheses=PoseEstimatorParams().max_hypotheses,
    )
    estimate = diagram.GetOutputPort("hypotheses").Eval(context)
    assert estimate.best.X_PO.IsNearlyEqualTo(by_hand.best.X_PO, 1e-9)
    assert estimate.status == by_hand.status
    assert "middle: the wrench is not finite" in diagram.GetOutputPort("contact_status").Eval(context)


def test_without_a_reading_the_diagram_says_so(hand: HandConfig, model: ObjectModel) -> None:
    diagram = MakePoseEstimation(hand, model)
    simulator = Simulator(diagram)
    connect(diagram, simulator.get_mutable_context(), hand, ())
    simulator.AdvanceTo(0.01)
    silent = "; ".join(f"{finger.name}: the wrench is not finite" for finger in hand.fingers)
    status = diagram.GetOutputPort("status").Eval(simulator.get_context())
    assert status == f"held: 0 touches; 2 are needed; {silent}"


@pytest.mark.parametrize(("use_hand_volume", "check_collisions"), [(True, False), (False, True), (False, False)])
def test_the_hands_volume_and_the_collision_check_are_switched(
    hand: HandConfig, model: ObjectModel, use_hand_volume: bool, check_collisions: bool
) -> None:
    params = PoseEstimationParams(use_hand_volume=use_hand_volume, check_collisions=check_collisions)
    diagram = MakePoseEstimation(hand, model, params)
    estimator = diagram.GetSubsystemByName("pose_estimator")
    assert estimator.HasInputPort("joint_positions") == check_collisions
    assert diagram.HasSubsystemNamed("hand_volume") == use_hand_volume
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    connect(diagram, context, hand, ("first", "middle", "thumb"))
    diagram.GetInputPort("wrench_ring").FixValue(context, np.zeros(6))
    simulator.AdvanceTo(0.01)
    own = estimator.GetMyContextFromRoot(context)
    values = {name: estimator.GetInputPort(name) for name in ("hand", "untouched")}
    assert {name: port.HasValue(own) for name, port in values.items()} == dict.fromkeys(values, use_hand_volume)
    if use_hand_volume:
        hand_spheres, untouched = (port.Eval(own) for port in values.values())
        assert 0 < len(untouched) < len(hand_spheres) / 10
    assert not diagram.GetOutputPort("status").Eval(context).startswith("held: no estimate")


def test_a_bad_parameter_of_any_part_is_named(hand: HandConfig, model: ObjectModel) -> None:
    params = PoseEstimationParams(estimator=PoseEstimatorParams(period=-1.0))
    with pytest.raises(InvalidInputError, match=r"PoseEstimatorParams\.period must be .*, not -1"):
        MakePoseEstimation(hand, model, params)


def test_the_pads_of_a_hand_without_other_sensors_find_a_ball() -> None:
    estimator = PoseEstimatorParams(period=0.1, min_contacts=1)
    diagram = MakePoseEstimation(
        load_hand_config("barrett_like"), make_ball(), PoseEstimationParams(estimator=estimator)
    )
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    p_PO = press(diagram, context, "prior")
    simulator.AdvanceTo(0.01)

    assert diagram.GetOutputPort("patch_status").Eval(context) == SILENT
    patches = diagram.GetOutputPort("patches").Eval(context)
    assert [patch.is_felt for patch in patches] == [False, False, False, True]
    assert diagram.GetOutputPort("status").Eval(context) in (f"ok: {SILENT}", f"ambiguous: {SILENT}")
    found = diagram.GetOutputPort("object_pose").Eval(context).translation()
    assert np.linalg.norm(found - p_PO) < 0.002
    # The same frames, when they are old, count for nothing.
    diagram.GetInputPort("age_palm").FixValue(context, [0.5])
    simulator.AdvanceTo(0.11)
    assert diagram.GetOutputPort("status").Eval(context) == (
        f"held: 0 touches; 1 is needed; {SILENT}; palm: stale: 0.50 s old"
    )
    assert [patch.is_felt for patch in diagram.GetOutputPort("patches").Eval(context)] == [False] * 3


@pytest.mark.parametrize("add", [AddPoseEstimation, AddPoseTracking])
def test_parts_of_another_type_are_named_before_anything_is_added(hand: HandConfig, model: ObjectModel, add) -> None:  # type: ignore[no-untyped-def]
    builder = DiagramBuilder()
    with pytest.raises(InvalidInputError, match=r"^hand must be a HandConfig, not a str"):
        add(builder, "shadow_like", model)
    with pytest.raises(InvalidInputError, match=r"^model must be an ObjectModel, not a str"):
        add(builder, hand, "bust")
    with pytest.raises(InvalidInputError, match=r"^params must be a Pose\w+Params, not a PoseEstimatorParams"):
        add(builder, hand, model, PoseEstimatorParams())
    assert builder.empty()
