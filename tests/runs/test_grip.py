"""Grips of a hand with tactile pads: from the scenario to what the pads say of the object."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from pydrake.common.schema import Rotation, Transform
from pydrake.geometry import Meshcat, MeshcatParams
from pydrake.systems.analysis import Simulator

from tactopose_drake.core.poses import increments_between
from tactopose_drake.errors import InvalidFileError, InvalidInputError, UnknownNameError
from tactopose_drake.runs.grasp_simulation import GraspResult, simulate_grasp
from tactopose_drake.station.scenario import Grip, Scenario, load_scenario
from tactopose_drake.station.simulated import make_station
from tactopose_drake.systems.grip_controller import GripControllerParams

RADIUS = 0.0331  # of the can, m
PADS = ("finger_1", "finger_2", "finger_3", "palm")


def can_at(*p_PO: float) -> Scenario:
    """The can on its side, its axis along x of P."""
    scenario = load_scenario("barrett_like")
    X_PO = Transform(translation=list(p_PO), rotation=Rotation(value=Rotation.Rpy(deg=[0.0, 90.0, 0.0])))
    controller = GripControllerParams(fixed={"finger_1_spread_joint": 0.0}, closing_speed=2.5)
    scenario.grip = Grip(X_PO={"soda_can": X_PO}, controller=controller)
    scenario.check.hold_time = 0.3
    return scenario


@pytest.fixture(scope="module")
def result() -> GraspResult:
    meshcat = Meshcat(MeshcatParams(host="localhost"))
    result = simulate_grasp(can_at(-0.057, 0.0, 0.1101), meshcat=meshcat)
    assert meshcat.HasPath("/tactopose/patches/3/axes/2")
    assert meshcat.HasPath("/tactopose/estimate")
    # The simulated object is no solid in which the estimate would be hidden, but a cage of wires.
    assert meshcat.HasPath("/tactopose/truth")
    assert meshcat.HasPath("/drake/visualizer/barrett_like")
    assert not meshcat.HasPath("/drake/visualizer/soda_can")
    assert "set_animation" in meshcat.StaticHtml()
    return result


def port(result: GraspResult, name: str) -> object:
    return result.station.diagram.GetOutputPort(name).Eval(result.context)


def test_the_hand_holds_the_can_against_the_palm(result: GraspResult) -> None:
    assert result.stable
    assert result.reason == "ok"
    assert result.slip < 0.002
    np.testing.assert_allclose(result.X_PO.translation(), [-0.057, 0, 0.11], atol=0.002)
    q = port(result, "joint_positions")
    np.testing.assert_allclose(q[[0, 3]], 0.0, atol=0.01)
    np.testing.assert_allclose(q[[1, 4, 6]], 1.65, atol=0.05)
    assert port(result, "grasp_status") == "holding"
    assert port(result, "patch_status") == "ok"


def test_what_the_pads_carry_balances_the_weight(result: GraspResult) -> None:
    station = result.station
    assert set(result.truth.pads) == set(PADS)
    assert result.truth.tips == {}
    assert result.truth.other_contacts == ()
    plant_context = station.plant.GetMyContextFromRoot(result.context)
    mass = station.plant.CalcTotalMass(plant_context, [station.object_body.model_instance()])
    total = sum(pad.f_PC for pad in result.truth.pads.values())
    np.testing.assert_allclose(total, mass * station.plant.gravity_field().gravity_vector(), atol=0.05)


def test_every_pad_feels_the_can_where_it_is(result: GraspResult) -> None:
    patches = port(result, "patches")
    assert len(patches) == 4
    for name, patch in zip(PADS, patches, strict=True):
        assert patch.status == "area"
        p_OC = result.X_PO.inverse() @ patch.centroid
        radial = np.array([p_OC[0], p_OC[1], 0.0])
        # The mean of a bent patch lies within the can, by a third of the sagitta of its half-width of about 7 mm.
        assert RADIUS - 0.0015 < np.linalg.norm(radial) < RADIUS + 0.0005
        n_O = result.X_PO.rotation().inverse() @ patch.eigenvectors[:, 2]
        assert np.degrees(np.arccos(n_O @ radial / np.linalg.norm(radial))) < 3.0
        # Of the pad's own contact, not a neighbour's.
        assert np.linalg.norm(patch.centroid - result.truth.pads[name].p_PC) < 0.015
        assert patch.eigenvectors[:, 2] @ result.truth.pads[name].n_PC > np.cos(np.radians(5.0))


def test_touch_corrects_vision_but_for_the_cans_spin_and_slide(result: GraspResult) -> None:
    X_true = result.X_PO.GetAsMatrix34()
    estimate, prior = port(result, "hypotheses"), port(result, "prior")
    assert port(result, "status").split(":")[0] == estimate.status
    before, after = (increments_between(X, X_true) for X in (prior.mean, estimate.best.X_PO.GetAsMatrix34()))
    assert np.linalg.norm(before[3:]) > 0.02
    # Across the can's axis, which is along x of P.
    assert np.linalg.norm(after[4:]) < 0.5 * np.linalg.norm(before[4:])
    assert np.linalg.norm(after[:2]) < np.linalg.norm(before[:2])
    assert len(estimate.best.free_directions) >= 1


def test_what_is_not_caught_is_said_not_to_have_closed() -> None:
    scenario = can_at(0.3, 0.0, 0.2)
    scenario.duration = 0.06
    scenario.estimation.estimator.period = 1.0
    result = simulate_grasp(scenario)
    assert result.reason == "the fingers did not close in time"
    assert not result.stable
    np.testing.assert_allclose(
        result.X_PO.translation(), [0.3, 0.0, 0.2], atol=1e-6
    )  # in its place, until it is let go
    assert port(result, "grasp_status").startswith("closing: finger_1_proximal_joint")
    silent = "; ".join(f"{name}: no contact" for name in PADS)
    assert port(result, "patch_status") == silent
    assert port(result, "patches")[0].status == "no_contact"


def test_the_seed_draws_the_place_of_the_object_and_the_noise() -> None:
    scenario = load_scenario("barrett_like")
    starts = []
    for seed in (3, 3, 4):
        scenario.seed = seed
        station = make_station(scenario)
        simulator = Simulator(station.diagram)
        station.start(simulator.get_mutable_context())
        simulator.AdvanceTo(0.026)
        pressures = station.diagram.GetOutputPort("pressures_palm").Eval(simulator.get_context())
        starts.append((station.grasp_start.X_PO.GetAsMatrix34(), pressures))
    for one, same, other in zip(*starts, strict=True):
        np.testing.assert_array_equal(one, same)
        assert not np.allclose(one, other)
    p_PO = np.array([start[0][:, 3] for start in starts])
    assert np.all(np.abs(p_PO - [0.0, 0.0, 0.0770]) <= [0.004, 0.003, 1e-9])


def test_a_start_puts_followers_where_their_leaders_are() -> None:
    scenario = load_scenario("barrett_like")
    assert scenario.grip is not None
    scenario.grip.controller.fixed = {"finger_1_spread_joint": 0.4}
    station = make_station(scenario)
    angle = {name: station.plant.GetJointByName(name) for name in ("finger_1_spread_joint", "finger_2_spread_joint")}
    simulator = Simulator(station.diagram)
    station.start(simulator.get_mutable_context())
    plant_context = station.plant.GetMyContextFromRoot(simulator.get_context())
    assert [joint.get_angle(plant_context) for joint in angle.values()] == [0.4, 0.4]


def test_impossible_grips_are_refused() -> None:
    scenario = can_at(0.0, 0.0, 0.1)
    with pytest.raises(
        InvalidInputError, match=r"object must be one of the package's objects, .*soda.*, not 'sodacan'"
    ):
        make_station(dataclasses.replace(scenario, object="sodacan"))
    with pytest.raises(
        InvalidInputError, match=r"must be one that Scenario\.grip\.X_PO has a pose for in the hand 'barr.*, not 'mug'"
    ):
        make_station(dataclasses.replace(scenario, object="mug"))
    assert scenario.grip is not None
    for params, error, message in (
        (GripControllerParams(period=-1), InvalidInputError, "period must be .*, not -1"),
        (
            GripControllerParams(fixed={"elbow": 0.0}),
            UnknownNameError,
            "GripControllerParams.fixed must be one of .*, not 'elbow'",
        ),
    ):
        with pytest.raises(error, match=message):
            make_station(dataclasses.replace(scenario, grip=dataclasses.replace(scenario.grip, controller=params)))
    with pytest.raises(InvalidInputError, match="a force-torque sensor on 2 or more fingers, not on 0"):
        make_station(dataclasses.replace(scenario, grip=None))


def test_an_unknown_field_of_a_grip_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "grip.scenario.yaml"
    path.write_text("hand: barrett_like\nobject: mug\ngrip: {speed: 1}\n")
    with pytest.raises(InvalidFileError, match="speed"):
        load_scenario(path)
