from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    ExternallyAppliedSpatialForce,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import Frame, Joint, RevoluteJoint, SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from pydrake.systems.primitives import AddRandomInputs, LogVectorOutput

from tactopose_drake.core.sensing.force_torque import ForceTorqueModel
from tactopose_drake.errors import InvalidFileError, InvalidInputError, UnknownNameError
from tactopose_drake.systems.force_torque_sensor import (
    ForceTorqueSensor,
    load_force_torque_model,
    sufficient_calibration,
)
from tactopose_drake.systems.random_sources import seed_random_sources

F_W = np.array([0.4, -1.5, 0.7])
p_TipQ = np.array([0.002, -0.004, 0.011])


@dataclass
class FingerBehindJoint:
    builder: DiagramBuilder
    plant: MultibodyPlant
    weld: Joint
    sensor_frame: Frame


def make_sensor(finger, model: ForceTorqueModel) -> ForceTorqueSensor:
    sensor = finger.builder.AddNamedSystem(
        "sensor", ForceTorqueSensor(finger.plant, finger.weld, finger.sensor_frame, model, period=0.01)
    )
    finger.builder.Connect(finger.plant.get_reaction_forces_output_port(), sensor.GetInputPort("reaction_forces"))
    finger.builder.Connect(finger.plant.get_body_poses_output_port(), sensor.GetInputPort("body_poses"))
    return sensor


def push(finger, context: Context, scale: float = 1.0) -> np.ndarray:
    """Pushes the fingertip at Q; returns the wrench about the sensor's origin, in S."""
    force = ExternallyAppliedSpatialForce()
    force.body_index = finger.plant.GetBodyByName("tip").index()
    force.p_BoBq_B = p_TipQ
    force.F_Bq_W = SpatialForce(np.zeros(3), scale * F_W)
    plant_context = finger.plant.GetMyContextFromRoot(context)
    finger.plant.get_applied_spatial_force_input_port().FixValue(plant_context, [force])
    X_WS = finger.sensor_frame.CalcPoseInWorld(plant_context)
    X_WTip = finger.plant.EvalBodyPoseInWorld(plant_context, finger.plant.GetBodyByName("tip"))
    p_SQ = X_WS.inverse() @ X_WTip @ p_TipQ
    f_S = X_WS.rotation().inverse() @ (scale * F_W)
    return np.concatenate([np.cross(p_SQ, f_S), f_S])


def simulate(diagram: Diagram, context: Context, duration: float = 0.05) -> None:
    simulator = Simulator(diagram, context)
    simulator.Initialize()
    simulator.AdvanceTo(duration)


def test_reads_the_applied_force_exactly_and_not_the_weight(finger) -> None:
    sensor = make_sensor(finger, ForceTorqueModel())
    diagram = finger.builder.Build()
    context = diagram.CreateDefaultContext()
    expected = push(finger, context)
    simulate(diagram, context)
    sensor_context = sensor.GetMyContextFromRoot(context)
    np.testing.assert_allclose(sensor.GetOutputPort("wrench").Eval(sensor_context), expected, atol=1e-12)
    assert sensor.GetOutputPort("status").Eval(sensor_context) == "ok"


def test_a_joint_that_was_removed_again_leaves_the_reaction_its_place() -> None:
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlant(MultibodyPlantConfig(time_step=0.002), builder)
    inertia = SpatialInertia.SolidSphereWithMass(0.05, 0.01)
    base, tip, table = (plant.AddRigidBody(name, inertia) for name in ("base", "tip", "table"))
    plant.RemoveJoint(plant.AddJoint(RevoluteJoint("turn", plant.world_frame(), base.body_frame(), [0.0, 0.0, 1.0])))
    plant.WeldFrames(plant.world_frame(), base.body_frame())
    weld = plant.WeldFrames(base.body_frame(), tip.body_frame(), RigidTransform([0.1, 0.0, 0.0]))
    plant.WeldFrames(plant.world_frame(), table.body_frame(), RigidTransform([1.0, 0.0, 0.0]))  # 0.5 N
    plant.Finalize()
    finger = FingerBehindJoint(builder, plant, weld, tip.body_frame())
    sensor = make_sensor(finger, ForceTorqueModel())
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    expected = push(finger, context)
    simulate(diagram, context)
    measured = sensor.GetOutputPort("wrench").Eval(sensor.GetMyContextFromRoot(context))
    np.testing.assert_allclose(measured, expected, atol=1e-12)


def test_there_is_no_reading_before_the_first_sample(finger) -> None:
    sensor = make_sensor(finger, ForceTorqueModel())
    diagram = finger.builder.Build()
    context = diagram.CreateDefaultContext()
    simulate(diagram, context, duration=0.005)
    sensor_context = sensor.GetMyContextFromRoot(context)
    assert np.all(np.isnan(sensor.GetOutputPort("wrench").Eval(sensor_context)))
    assert sensor.GetOutputPort("status").Eval(sensor_context) == "no sample yet"


@pytest.mark.parametrize("start", [16.0, 16.004, 1.7e9])
def test_there_is_no_reading_before_the_plant_s_first_step_whenever_it_starts(finger, start: float) -> None:
    sensor = make_sensor(finger, ForceTorqueModel())
    simulator = Simulator(finger.builder.Build())
    context = simulator.get_mutable_context()
    expected = push(finger, context)
    context.SetTime(start)
    own, read = sensor.GetMyContextFromRoot(context), []
    for k in range(25):
        simulator.AdvanceTo(start + 0.0005 + 0.001 * k)
        read.append(np.array(sensor.GetOutputPort("wrench").Eval(own)))
    known = [wrench for wrench in read if not np.any(np.isnan(wrench))]
    assert np.all(np.isnan(read[:10]))
    assert len(known) > 5
    np.testing.assert_allclose(known, np.broadcast_to(expected, (len(known), 6)), atol=1e-12)


def test_a_sample_is_forgotten_once_the_clock_is_set_back_but_not_by_another_initialization(finger) -> None:
    sensor = make_sensor(finger, ForceTorqueModel())
    simulator = Simulator(finger.builder.Build())
    context = simulator.get_mutable_context()
    expected = push(finger, context)

    def reading() -> tuple[np.ndarray, str]:
        own = sensor.GetMyContextFromRoot(context)
        return sensor.GetOutputPort("wrench").Eval(own), sensor.GetOutputPort("status").Eval(own)

    simulator.AdvanceTo(0.025)
    simulator.Initialize()
    np.testing.assert_allclose(reading()[0], expected, atol=1e-12)
    context.SetTime(0.0)
    simulator.Initialize()
    simulator.AdvanceTo(0.005)
    wrench, status = reading()
    assert np.all(np.isnan(wrench))
    assert status == "no sample yet"
    simulator.AdvanceTo(0.015)
    np.testing.assert_allclose(reading()[0], expected, atol=1e-12)


def test_a_bad_model_is_refused(finger) -> None:
    with pytest.raises(InvalidInputError, match=r"^ForceTorqueModel\.noise\[\d\] must be .*, not -1"):
        make_sensor(finger, ForceTorqueModel(noise=[-1.0] * 6))


def test_a_frame_that_does_not_move_with_the_fingertip_is_refused() -> None:
    plant = MultibodyPlant(1e-3)
    inertia = SpatialInertia.SolidSphereWithMass(0.05, 0.01)
    link, tip = (plant.AddRigidBody(name, inertia) for name in ("link", "tip"))
    joint = plant.AddJoint(RevoluteJoint("hinge", link.body_frame(), tip.body_frame(), [1.0, 0.0, 0.0]))
    plant.Finalize()
    message = r"^the sensor frame 'link' of the weld 'hinge' must be on one of the links tip, not on 'link'\.$"
    with pytest.raises(InvalidInputError, match=message):
        ForceTorqueSensor(plant, joint, link.body_frame(), ForceTorqueModel())


def test_an_overload_saturates_and_says_so(finger) -> None:
    sensor = make_sensor(finger, load_force_torque_model())
    diagram = finger.builder.Build()
    context = diagram.CreateDefaultContext()
    push(finger, context, scale=30.0)
    simulate(diagram, context)
    sensor_context = sensor.GetMyContextFromRoot(context)
    assert sensor.GetOutputPort("status").Eval(sensor_context).startswith("saturated: m_x")
    assert np.all(np.isnan(sensor.GetOutputPort("wrench").Eval(sensor_context)))  # as a board's driver has it


@pytest.mark.parametrize(
    ("force", "moment", "calibration"),
    [
        (12.0, 0.12, "SI-12-0.12"),
        (8.0, 0.13, "SI-25-0.25"),
        (26.0, 0.1, "SI-50-0.5"),
        (8.0, 0.9, "SI-50-0.5"),
    ],
)
def test_the_least_range_that_bears_a_load_is_taken(force: float, moment: float, calibration: str) -> None:
    assert sufficient_calibration(force, moment) == calibration


def log_of(finger, seed: int) -> np.ndarray:
    sensor = make_sensor(finger, load_force_torque_model())
    logger = LogVectorOutput(sensor.GetOutputPort("wrench"), finger.builder, 0.01)
    AddRandomInputs(0.01, finger.builder)
    diagram = finger.builder.Build()
    context = diagram.CreateDefaultContext()
    push(finger, context)
    assert seed_random_sources(diagram, context, seed) == 1
    simulate(diagram, context, duration=2.0)
    return np.array(logger.FindLog(context).data())[:, 2:]


@pytest.fixture
def logs(new_finger) -> list[np.ndarray]:
    """Logs of three diagrams, seeds 1, 1 and 2."""
    return [log_of(new_finger(), seed) for seed in (1, 1, 2)]


def test_the_same_seed_gives_the_same_log_and_another_seed_another(logs) -> None:
    np.testing.assert_array_equal(logs[0], logs[1])
    assert not np.array_equal(logs[0], logs[2])


def test_the_noise_has_the_sensors_standard_deviation(logs) -> None:
    # Quantisation adds a twelfth of the squared step, and the noise is one step.
    expected = np.array([1 / 64e3] * 3 + [1 / 320] * 3) * np.sqrt(1 + 1 / 12)
    np.testing.assert_allclose(logs[0].std(axis=1), expected, rtol=0.2)


def test_a_nan_reaction_is_no_signal(finger) -> None:
    sensor = ForceTorqueSensor(finger.plant, finger.weld, finger.sensor_frame, ForceTorqueModel())
    context = sensor.CreateDefaultContext()
    sensor.GetInputPort("reaction_forces").FixValue(context, [SpatialForce(np.full(6, np.nan))] * 2)
    sensor.GetInputPort("body_poses").FixValue(context, [RigidTransform()] * 3)
    simulate(sensor, context)
    assert np.all(np.isnan(sensor.GetOutputPort("wrench").Eval(context)))
    assert sensor.GetOutputPort("status").Eval(context) == "no signal"


@pytest.mark.parametrize("calibration", ["SI-12-0.12", "SI-25-0.25", "SI-50-0.5"])
def test_every_shipped_calibration_loads(calibration: str) -> None:
    model = load_force_torque_model(calibration)
    assert model.range[3] == float(calibration.split("-")[1])
    assert model.range[0] == float(calibration.split("-")[2])


def test_an_unknown_calibration_is_named_with_the_valid_ones() -> None:
    with pytest.raises(UnknownNameError, match=r"calibration must be one of SI-12-0\.12.*, not 'SI-1-1'"):
        load_force_torque_model("SI-1-1")


@pytest.mark.parametrize("text", ["calibrations: 3", "calibrations: {a: {rnge: [1]}}", "calibrations: [", "{}: {}", ""])
def test_a_broken_file_is_named(tmp_path: Path, text: str) -> None:
    path = tmp_path / "sensor.yaml"
    path.write_text(text)
    with pytest.raises(InvalidFileError, match=r"sensor\.yaml"):
        load_force_torque_model("a", path)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(
        InvalidFileError, match=r"none\.yaml must be .* of this kind, nano17, but there is no such file\."
    ):
        load_force_torque_model("a", tmp_path / "none.yaml")


@pytest.mark.parametrize("torque", [0.0, 0.02])
def test_a_sensor_behind_a_joint_that_moves_reads_the_fingertip_s_load_too(torque: float) -> None:
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlant(MultibodyPlantConfig(time_step=1e-3), builder)
    link = plant.AddRigidBody("link", SpatialInertia.SolidSphereWithMass(0.05, 0.01))
    tip = plant.AddRigidBody("tip", SpatialInertia.SolidSphereWithMass(0.02, 0.01))
    plant.WeldFrames(plant.world_frame(), link.body_frame(), RigidTransform([0.0, 0.0, 0.3]))
    joint = plant.AddJoint(RevoluteJoint("hinge", link.body_frame(), tip.body_frame(), [1.0, 0.0, 0.0]))
    plant.AddJointActuator("motor", joint)
    plant.Finalize()
    hinge = FingerBehindJoint(builder, plant, joint, tip.body_frame())
    sensor = make_sensor(hinge, ForceTorqueModel())
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    plant_context = plant.GetMyContextFromRoot(context)
    # A pure couple about the joint balances the motor, so the fingertip stays where it is.
    couple = ExternallyAppliedSpatialForce()
    couple.body_index, couple.p_BoBq_B = tip.index(), np.zeros(3)
    couple.F_Bq_W = SpatialForce(np.array([-torque, 0.0, 0.0]), np.array([0.3, 0.0, 0.5]))
    plant.get_applied_spatial_force_input_port().FixValue(plant_context, [couple])
    plant.get_actuation_input_port().FixValue(plant_context, [torque])
    simulate(diagram, context, 0.02)
    reading = sensor.GetOutputPort("wrench").Eval(sensor.GetMyContextFromRoot(context))
    np.testing.assert_allclose(reading, [-torque, 0.0, 0.0, 0.3, 0.0, 0.5], atol=1e-9)
