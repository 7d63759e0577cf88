"""Which forces a fingertip's own acceleration explains, and that the belief takes none of them for a touch."""

import re
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import PdControllerGains
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from tactopose_drake.errors import InvalidInputError
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.hand.fingertip_weights import fingertip_mass
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import Hand, add_hand, make_hand_plant
from tactopose_drake.systems.fingertip_inertia import FingertipInertia, FingertipInertiaParams
from tactopose_drake.systems.object_tracker import ObjectTracker
from tactopose_drake.systems.pose_tracking import AddPoseTracking
from tests.core.tracking.boxes import make_box
from tests.hand.grippers import write_gripper

Array = NDArray[np.float64]
CONFIG = load_hand_config("shadow_like")
PLANT, HAND = make_hand_plant(CONFIG)
COUNT = PLANT.num_positions()
EXACT = FingertipInertiaParams(margin=1.0, encoder_noise_deg=0.0)
STEP = 0.01


class Loop:
    """A system that is told joints, one reading after the other, as a loop does."""

    def __init__(self, params: FingertipInertiaParams = EXACT, hand: Hand = HAND) -> None:
        self.system = FingertipInertia(PLANT, hand, params)
        self.context = self.system.CreateDefaultContext()

    def tell(self, time: float, q: Array, v: Array | None = None) -> dict[str, Array]:
        """The forces by a reading, which is then remembered."""
        self.context.SetTime(time)
        self.system.GetInputPort("joint_positions").FixValue(self.context, q)
        if v is not None:
            self.system.GetInputPort("joint_velocities").FixValue(self.context, v)
        forces = self.forces()
        self.system.advance(self.context)
        return forces

    def forces(self) -> dict[str, Array]:
        return self.system.GetOutputPort("inertial_forces").Eval(self.context)


@cache
def mass_and_centre(finger: str) -> tuple[float, Array]:
    return fingertip_mass(PLANT, HAND.welds[finger], HAND.sensor_frames[finger])


def centre(finger: str, q: Array) -> Array:
    """p_PTip, m."""
    context = PLANT.CreateDefaultContext()
    PLANT.SetPositions(context, q)
    X_PS = PLANT.CalcRelativeTransform(context, HAND.palm_frame, HAND.sensor_frames[finger])
    return X_PS @ mass_and_centre(finger)[1]


def swing(time: float) -> tuple[Array, Array]:
    """Joints that start from rest, at several rad/s^2 each, and their velocities."""
    rates = 20.0 + 3.0 * np.arange(COUNT)
    return 0.2 + 0.5 * rates * time**2, rates * time


def true_force(finger: str, motion: Callable[[float], tuple[Array, Array]], time: float) -> Array:
    """-m a by central differences."""
    p, h = [centre(finger, motion(time + k * 1e-4)[0]) for k in (-1, 0, 1)], 1e-4
    return -mass_and_centre(finger)[0] * (p[0] - 2.0 * p[1] + p[2]) / h**2


@pytest.mark.parametrize("tells_velocities", [True, False])
def test_the_force_is_the_mass_times_the_acceleration_against_it(tells_velocities: bool) -> None:
    loop, step = Loop(), STEP
    for k in range(4):
        q, v = swing(k * step)
        forces = loop.tell(k * step, q, v if tells_velocities else None)
    # Of a motion whose acceleration hardly changes, the mean is that of the middle of what it was computed from.
    late = 0.5 * step if tells_velocities else step
    for finger, force in forces.items():
        for row, back in ((1, 0.0), (0, step)):
            expected = true_force(finger, swing, 3 * step - late - back)
            assert np.linalg.norm(force[row] - expected) < 0.1 * np.linalg.norm(expected)


def test_a_hand_at_rest_and_one_that_moves_steadily_explain_no_force() -> None:
    loop = Loop(FingertipInertiaParams())
    for k in range(5):
        assert all(not force.any() for force in loop.tell(k * STEP, np.full(COUNT, 0.3)).values())
    for k in range(5, 12):
        forces = loop.tell(k * STEP, np.full(COUNT, 0.3 + 0.002 * (k - 4)))
    assert all(not force.any() for force in forces.values())


@pytest.mark.parametrize("tells_velocities", [True, False])
def test_joints_that_are_read_less_often_than_updates_come_do_not_seem_to_stop_and_go(tells_velocities: bool) -> None:
    loop, v = Loop(FingertipInertiaParams()), np.full(COUNT, 1.0)
    for k in range(30):
        forces = loop.tell(k * STEP, 0.3 + v * STEP * (k // 2) * 2, v if tells_velocities else None)
        if k > 7:
            assert all(np.linalg.norm(force, axis=1).max() < 0.05 for force in forces.values())
    for _ in range(10):  # They stand still.
        k += 1
        forces = loop.tell(k * STEP, 0.3 + v * STEP * 28, 0.0 * v if tells_velocities else None)
    assert all(not force.any() for force in forces.values())
    # A start from rest is a start from the last update.
    forces = loop.tell((k + 1) * STEP, 0.3 + v * STEP * 29, v if tells_velocities else None)
    assert all(np.linalg.norm(force[1]) > 0.05 for force in forces.values())


def test_noise_of_the_encoders_hides_no_light_touch() -> None:
    """A touch of 0.06 N against any finger, from any side."""
    params, generator = FingertipInertiaParams(), np.random.default_rng(0)
    loop, hidden = Loop(params), []
    for k in range(300):
        q = 0.3 + np.radians(params.encoder_noise_deg) * generator.normal(size=COUNT)
        for force in loop.tell(k * STEP, q).values():
            f = 0.06 * (u := generator.normal(size=3)) / np.linalg.norm(u)
            hidden.append(f @ f <= np.max(force @ f))
    assert np.mean(hidden) < 0.03


def test_updates_that_come_often_are_compared_over_as_long_a_time() -> None:
    often, seldom = Loop(), Loop()
    for k in range(31):
        forces = often.tell(k * 1e-3, *swing(k * 1e-3))
        if k % 10 == 0:
            expected = seldom.tell(k * 1e-3, *swing(k * 1e-3))
    for finger, force in forces.items():
        np.testing.assert_allclose(force, expected[finger], rtol=1e-9)


def test_after_a_pause_and_a_clock_that_goes_back_nothing_is_known_of_the_acceleration() -> None:
    for then in (1.0, 0.005):
        loop = Loop()
        for k in range(4):
            loop.tell(k * STEP, *swing(k * STEP))
        assert all(force.any() for force in loop.forces().values())
        assert all(not force.any() for force in loop.tell(then, *swing(4 * STEP)).values())
        assert all(force[1].any() for force in loop.tell(then + STEP, *swing(5 * STEP)).values())


def test_a_finger_whose_joint_is_not_known_explains_no_force_until_it_was_known_for_a_while() -> None:
    loop, lost = Loop(), PLANT.GetJointByName("FFJ3", HAND.model_instance).position_start()
    for k in range(7):
        q = swing(k * STEP)[0]
        if k == 3:
            q[lost] = np.nan
        forces = loop.tell(k * STEP, q, np.full(COUNT, np.nan))
        assert all(np.isfinite(force).all() for force in forces.values())
        assert forces["first"][1].any() == (k in (1, 2, 6))
        assert forces["thumb"][1].any() == (k > 0)


def test_a_copy_of_the_context_goes_on_as_the_context_does() -> None:
    loop, other = Loop(), Loop()
    for k in range(3):
        loop.tell(k * STEP, *swing(k * STEP))
    other.system, other.context = loop.system, loop.context.Clone()
    for k in range(3, 6):
        forces, again = (each.tell(k * STEP, *swing(k * STEP)) for each in (loop, other))
        for finger in forces:
            np.testing.assert_array_equal(forces[finger], again[finger])


def test_fingers_that_slide_have_a_force_and_fingertips_without_a_mass_have_none(tmp_path: Path) -> None:
    path = write_gripper(tmp_path)
    urdf = tmp_path / "two_finger.urdf"
    tip = '<link name="right_tip">\n    <inertial>.*?</inertial>'
    urdf.write_text(re.sub(tip, '<link name="right_tip">', urdf.read_text()))
    plant, hand = make_hand_plant(load_hand_config(path))
    system = FingertipInertia(plant, hand, EXACT)
    context = system.CreateDefaultContext()
    for k in range(4):
        context.SetTime(k * STEP)
        system.GetInputPort("joint_positions").FixValue(context, np.full(2, 0.5 * 20.0 * (k * STEP) ** 2))
        forces = system.GetOutputPort("inertial_forces").Eval(context)
        system.advance(context)
    np.testing.assert_allclose(forces["left"][1], [-0.01 * 20.0, 0.0, 0.0], atol=1e-9)
    np.testing.assert_array_equal(forces["right"], 0.0)


@pytest.mark.parametrize("params", [{"margin": -1.0}, {"encoder_noise_deg": np.nan}])
def test_parameters_out_of_their_range_are_refused(params: dict[str, float]) -> None:
    with pytest.raises(InvalidInputError, match=next(iter(params))):
        FingertipInertia(PLANT, HAND, FingertipInertiaParams(**params))


def inertial_wrench(finger: str, q: Array, f_P: Array) -> Array:
    """F_S of a force at the fingertip's centre of mass."""
    context = PLANT.CreateDefaultContext()
    PLANT.SetPositions(context, q)
    X_PS = PLANT.CalcRelativeTransform(context, HAND.palm_frame, HAND.sensor_frames[finger])
    f_S = X_PS.rotation().inverse() @ f_P
    return np.concatenate([np.cross(mass_and_centre(finger)[1], f_S), f_S])


@pytest.mark.parametrize("tells_velocities", [True, False])
def test_a_free_finger_that_is_set_going_is_not_touched_and_nor_is_it_known_to_be_untouched(
    tells_velocities: bool,
) -> None:
    tracker = ObjectTracker(CONFIG, make_box())
    moved = PLANT.GetJointByName("FFJ3", HAND.model_instance).position_start()
    X_PO = RigidTransform([0.0, -0.3, 0.1])

    def motion(time: float) -> tuple[Array, Array]:
        """The finger unbends from rest, so that its own weight seems to push on its inside."""
        q, v = np.zeros(COUNT), np.zeros(COUNT)
        q[moved], v[moved] = 0.8 - 0.5 * 400.0 * time**2, -400.0 * time
        return q, v

    for k in range(5):
        q, v = motion(k * STEP)
        wrenches = {finger: np.zeros(6) for finger in HAND.sensor_frames}
        wrenches["first"] = F_S = (
            inertial_wrench("first", q, true_force("first", motion, k * STEP)) if k else np.zeros(6)
        )
        vision = PosePrior(X_PO) if k == 0 else None
        belief = tracker.update(wrenches, q, k * STEP, joint_velocities=v if tells_velocities else None, vision=vision)
        if k:
            outputs = {
                name: tracker.diagram.GetOutputPort(name).Eval(tracker.context)
                for name in ("contact_solutions", "fingers_in_contact", "contact_status")
            }
            assert outputs["contact_solutions"]["first"].valid
            assert outputs["fingers_in_contact"] == ()
            assert "first: its own acceleration explains the force" in outputs["contact_status"]
            untouched = tracker.diagram.GetSubsystemByName("contacts_in_palm").GetOutputPort("fingers_untouched")
            context = untouched.get_system().GetMyContextFromRoot(tracker.context)
            assert set(untouched.Eval(context)) == {*HAND.sensor_frames} - {"first"}
            assert (belief.status, len(belief.contacts)) == ("no_contact", 0)
            assert "first: its own acceleration explains the force" in belief.message
    np.testing.assert_allclose(belief.X_PO[0, :, 3], X_PO.translation(), atol=0.02)
    # The same force on a finger at rest is a touch, as soon as it has been for two updates.
    for k in range(5, 8):
        wrenches["first"] = F_S
        belief = tracker.update(wrenches, q, k * STEP, joint_velocities=0.0 * v)
    assert len(belief.contacts) == 1


def test_a_simulated_hand_that_makes_a_fist_feels_nothing_in_its_free_fingers() -> None:
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlant(MultibodyPlantConfig(time_step=0.004), builder)
    hand = add_hand(plant, CONFIG)
    plant.set_gravity_enabled(hand.model_instance, False)
    for index in plant.GetJointActuatorIndices():
        plant.get_joint_actuator(index).set_controller_gains(PdControllerGains(p=1.0, d=0.05))
    plant.Finalize()
    fist = np.radians([0, 0, *3 * [0, 63, 68], 0, 0, 63, 68, 10, 30, 0, 20, 50])
    posture = builder.AddSystem(ConstantVectorSource(np.append(fist, np.zeros(20))))
    builder.Connect(posture.get_output_port(), plant.get_desired_state_input_port(hand.model_instance))
    tracking = AddPoseTracking(builder, CONFIG, make_box(), plant=plant)
    simulator, seemed = Simulator(builder.Build()), 0
    context = tracking.GetMyContextFromRoot(simulator.get_context())
    for time in np.arange(STEP, 0.1, STEP):
        simulator.AdvanceTo(time)
        seemed += sum(s.valid for s in tracking.GetOutputPort("contact_solutions").Eval(context).values())
        assert tracking.GetOutputPort("fingers_in_contact").Eval(context) == ()
    assert seemed >= 5
