from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.geometry import AddContactMaterial, AddRigidHydroelasticProperties, Box, ProximityProperties
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import AddMultibodyPlant, CoulombFriction, MultibodyPlant, MultibodyPlantConfig
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder
from pydrake.systems.primitives import AddRandomInputs

from tactopose_drake.core.sensing.patches import Patch, describe_patch
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.contact_uncertainty import PadUncertainty
from tactopose_drake.hand.hand_config import HandUncertainty, load_hand_config
from tactopose_drake.hand.hand_in_plant import Hand, add_hand, make_hand_plant
from tactopose_drake.hand.kinematics import HandKinematics
from tactopose_drake.hand.tactile_pads import load_tactile_pad
from tactopose_drake.systems.patch_descriptor import PatchDescriptor, PatchDescriptorParams
from tactopose_drake.systems.random_sources import seed_random_sources
from tactopose_drake.systems.simulated_array import TactileArray
from tests.hand.grippers import YAML, write_gripper

PADS = ("finger_1", "finger_2", "finger_3", "palm")


@pytest.fixture(scope="module")
def hand_plant() -> tuple[MultibodyPlant, Hand]:
    return make_hand_plant(load_hand_config("barrett_like"))


def fixed(
    hand_plant: tuple[MultibodyPlant, Hand], q: np.ndarray, pressures: dict[str, np.ndarray]
) -> tuple[Any, Context]:
    """The system with its inputs."""
    system = PatchDescriptor(*hand_plant)
    context = system.CreateDefaultContext()
    system.GetInputPort("joint_positions").FixValue(context, q)
    for name, pressure in pressures.items():
        system.GetInputPort(f"pressures_{name}").FixValue(context, pressure)
    return system, context


def patches_of(system: PatchDescriptor, context: Context) -> tuple[Patch, ...]:
    patches: tuple[Patch, ...] = system.GetOutputPort("patches").Eval(context)
    return patches


def some_pressures(seed: int = 0) -> dict[str, np.ndarray]:
    generator = np.random.default_rng(seed)
    return {name: np.where(generator.random(24) < 0.5, generator.uniform(2e3, 9e4, 24), 0.0) for name in PADS}


def test_each_patch_is_that_of_its_cells_in_the_palm(hand_plant: tuple[MultibodyPlant, Hand]) -> None:
    plant, hand = hand_plant
    q = np.random.default_rng(2).uniform(0.0, 1.2, 8)
    pressures = some_pressures()
    system, context = fixed(hand_plant, q, pressures)
    assert system.GetOutputPort("status").Eval(context) == "ok"
    plant_context = plant.CreateDefaultContext()
    plant.SetPositions(plant_context, q)
    for name, config, patch in zip(PADS, hand.config.pads, patches_of(system, context), strict=True):
        X_PT = plant.CalcRelativeTransform(plant_context, hand.palm_frame, hand.pad_frames[name])
        layout = load_tactile_pad(config.array).layout
        p_PT = np.array([X_PT @ p for p in layout.p_TC])
        n_PT = np.array([X_PT.rotation() @ n for n in layout.n_T])
        threshold = 0.15 * pressures[name].max()
        expected = describe_patch(p_PT, pressures[name], alpha=config.alpha, n_PT=n_PT, threshold=threshold)
        np.testing.assert_allclose(patch.p_PT, p_PT, atol=1e-12)
        np.testing.assert_allclose(patch.covariance, expected.covariance, atol=1e-15)
        np.testing.assert_allclose(patch.centroid, expected.centroid, atol=1e-12)
        assert patch.saturation == pytest.approx(159960.9375)


def test_patches_say_by_how_much_a_hand_may_misplace_them(hand_plant: tuple[MultibodyPlant, Hand]) -> None:
    errors = PadUncertainty(*hand_plant, HandUncertainty(encoder_offset_deg=2.0, mounting=0.001))
    system, kinematics = (
        PatchDescriptor(*hand_plant, uncertainty=errors),
        HandKinematics(hand_plant[0], hand_plant[1].palm_frame),
    )
    context, q = system.CreateDefaultContext(), np.full(8, 0.4)
    system.GetInputPort("joint_positions").FixValue(context, q)
    for name, pressure in some_pressures().items():
        system.GetInputPort(f"pressures_{name}").FixValue(context, pressure)
    kinematics.move(q)
    for name, pad, patch in zip(PADS, hand_plant[1].config.pads, patches_of(system, context), strict=True):
        expected = errors.covariance(name, load_tactile_pad(pad.array).layout, kinematics)
        np.testing.assert_allclose(patch.misplacement, expected, atol=1e-15)
        assert (np.trace(patch.misplacement[:3, :3]) > 5e-6) == (name != "palm")
    assert patches_of(*fixed(hand_plant, q, some_pressures()))[0].misplacement is None


def test_a_moved_joint_moves_the_patches_of_its_finger_only(hand_plant: tuple[MultibodyPlant, Hand]) -> None:
    plant, _ = hand_plant
    q = np.full(8, 0.4)
    system, context = fixed(hand_plant, q, some_pressures())
    before = patches_of(system, context)
    q[plant.GetJointByName("finger_3_proximal_joint").position_start()] += 0.1
    system.GetInputPort("joint_positions").FixValue(context, q)
    after = patches_of(system, context)
    for name, old, new in zip(PADS, before, after, strict=True):
        assert np.allclose(old.p_PT, new.p_PT) == (name != "finger_3")
    np.testing.assert_allclose(before[2].eigenvalues, after[2].eigenvalues, rtol=1e-9)


def test_a_pad_without_a_reading_gives_no_patch_and_nothing_old(hand_plant: tuple[MultibodyPlant, Hand]) -> None:
    pressures = some_pressures()
    system, context = fixed(hand_plant, np.zeros(8), pressures)
    assert len(patches_of(system, context)) == 4
    system.GetInputPort("pressures_finger_2").FixValue(context, np.full(24, np.nan))
    assert len(patches_of(system, context)) == 3
    assert system.GetOutputPort("status").Eval(context) == "finger_2: no reading"
    system.GetInputPort("joint_positions").FixValue(context, np.full(8, np.nan))
    (palm,) = patches_of(system, context)
    assert np.linalg.norm(palm.centroid[:2]) < 0.06
    assert system.GetOutputPort("status").Eval(context).startswith("finger_1: a joint position is not known; finger_2")


def test_untouched_pads_and_dead_cells_are_said_and_unconnected_pads_are_none(
    hand_plant: tuple[MultibodyPlant, Hand],
) -> None:
    pressure = np.full(24, 900.0)  # below the threshold
    pressure[5] = np.nan
    system, context = fixed(hand_plant, np.zeros(8), {"palm": pressure})
    (patch,) = patches_of(system, context)
    assert patch.status == "no_contact"
    np.testing.assert_array_equal(np.flatnonzero(patch.dead), [5])
    expected = [f"{name}: no reading" for name in PADS[:3]] + ["palm: no contact"]
    assert system.GetOutputPort("status").Eval(context) == "; ".join(expected)


def test_an_old_frame_counts_for_nothing_until_a_new_one_comes(hand_plant: tuple[MultibodyPlant, Hand]) -> None:
    system, context = fixed(hand_plant, np.zeros(8), some_pressures())
    limit = PatchDescriptorParams().max_age
    for age, status in (
        (limit, "ok"),
        (0.31, "palm: stale: 0.31 s old"),
        (np.inf, "palm: no reading"),
        (0.0, "ok"),
        (-5.0, "palm: stale: 5.00 s in the future, and may be at most 0.15 s"),
        (-1e-9, "ok"),
    ):
        system.GetInputPort("age_palm").FixValue(context, [age])
        assert system.GetOutputPort("status").Eval(context) == status
        assert len(patches_of(system, context)) == (4 if status == "ok" else 3)
    system.GetInputPort("age_palm").FixValue(context, [np.nan])
    assert system.GetOutputPort("status").Eval(context) == "palm: no reading"


def test_zero_frames_are_no_contact(hand_plant: tuple[MultibodyPlant, Hand]) -> None:
    system, context = fixed(hand_plant, np.zeros(8), {name: np.zeros(24) for name in PADS})
    assert [patch.status for patch in patches_of(system, context)] == ["no_contact"] * 4
    assert system.GetOutputPort("status").Eval(context) == "; ".join(f"{name}: no contact" for name in PADS)


@pytest.mark.parametrize("value", [1.8e5, 5e6, 1e15, np.inf])
def test_a_cell_beyond_its_range_is_not_known_and_is_named(
    hand_plant: tuple[MultibodyPlant, Hand], value: float
) -> None:
    stuck, dead = some_pressures(), some_pressures()
    stuck["palm"][[3, 20]], dead["palm"][[3, 20]] = value, np.nan
    system, context = fixed(hand_plant, np.zeros(8), stuck)
    assert system.GetOutputPort("status").Eval(context) == "palm: cells beyond the range, 159961 Pa: 3, 20"
    patch, expected = patches_of(system, context)[3], patches_of(*fixed(hand_plant, np.zeros(8), dead))[3]
    np.testing.assert_array_equal(patch.pressure, expected.pressure)
    np.testing.assert_array_equal(patch.centroid, expected.centroid)
    assert patch.threshold == expected.threshold


def test_where_only_cells_beyond_their_range_are_left_a_pad_feels_nothing(
    hand_plant: tuple[MultibodyPlant, Hand],
) -> None:
    pressure = np.zeros(24)
    pressure[3] = 1e6
    system, context = fixed(hand_plant, np.zeros(8), dict.fromkeys(PADS, pressure))
    assert [patch.status for patch in patches_of(system, context)] == ["no_contact"] * 4
    assert "palm: no contact, cells beyond the range, 159961 Pa: 3" in system.GetOutputPort("status").Eval(context)
    system.GetInputPort("pressures_palm").FixValue(context, np.full(24, 1e6))
    assert system.GetOutputPort("pads").Eval(context) == PADS[:3]
    assert "palm: cells beyond the range, 159961 Pa: 0, 1, 2" in system.GetOutputPort("status").Eval(context)


def test_a_cell_at_the_end_of_its_range_is_saturated_however_it_is_rounded(
    hand_plant: tuple[MultibodyPlant, Hand],
) -> None:
    pressure = np.zeros(24)
    pressure[[3, 4, 5]] = 159_960.9375, 159_961.0, 150_000.0
    system, context = fixed(hand_plant, np.zeros(8), dict.fromkeys(PADS, pressure))
    assert system.GetOutputPort("status").Eval(context) == "ok"
    np.testing.assert_array_equal(np.flatnonzero(patches_of(system, context)[0].saturated), [3, 4])


def gripper_with(tmp_path: Path, array: str) -> tuple[MultibodyPlant, Hand]:
    """A gripper one of whose fingertips has two by two cells of 4 mm, and what else the array's file says."""
    points = "[[0, 0, 0.012], [0.004, 0, 0.012], [0, 0.004, 0.012], [0.004, 0.004, 0.012]]"
    (tmp_path / "pad.yaml").write_text(f"pattern: !PointPattern {{points: {points}, cell: 0.004}}\n{array}")
    pads = "pads: [{name: tip, frame: left_tip, array: pad.yaml, alpha: 1e-8}]\n"
    return make_hand_plant(load_hand_config(write_gripper(tmp_path, yaml=YAML + pads)))


@pytest.mark.parametrize("shown", [0.0, 1.2e5, 9e5, -3.0])
def test_what_a_cell_shows_that_its_file_calls_dead_does_not_count(tmp_path: Path, shown: float) -> None:
    gripper = gripper_with(tmp_path, "model: {range: 2e5, dead_cells: [2]}")
    system, context = fixed(gripper, np.zeros(2), {"tip": np.array([0.0, 9e3, shown, 8e3])})
    assert system.GetOutputPort("status").Eval(context) == "ok"
    (patch,) = patches_of(system, context)
    np.testing.assert_array_equal(patch.pressure, [0.0, 9e3, np.nan, 8e3])
    assert patch.threshold == pytest.approx(0.15 * 9e3)
    system.GetInputPort("pressures_tip").FixValue(context, [np.nan, np.nan, shown, np.nan])
    assert patches_of(system, context) == ()
    assert system.GetOutputPort("status").Eval(context) == "tip: no reading"


def test_what_an_arrays_noise_shows_is_no_contact(tmp_path: Path) -> None:
    gripper = gripper_with(tmp_path, "model: {range: 2e5, noise: 2e3}")
    system, context = fixed(gripper, np.zeros(2), {"tip": np.array([0.0, 1.5e3, 5e3, 7.9e3])})
    assert system.GetOutputPort("status").Eval(context) == "tip: no contact"
    assert patches_of(system, context)[0].threshold == 8e3
    with pytest.raises(
        InvalidInputError, match=r"noise must be below a quarter of the range of pad 'tip', .*, not 60000 Pa"
    ):
        PatchDescriptor(*gripper_with(tmp_path, "model: {range: 2e5, noise: 6e4}"))


def test_an_array_that_is_read_less_often_than_frames_count_is_refused(tmp_path: Path) -> None:
    slow = gripper_with(tmp_path, "period: 0.5")
    with pytest.raises(
        InvalidInputError, match=r"max_age must be at least the period of pad 'tip', 0\.5 s, not 0\.15 s"
    ):
        PatchDescriptor(*slow)
    PatchDescriptor(*slow, PatchDescriptorParams(max_age=0.5))


@pytest.mark.parametrize("value", [-1.0, -np.inf])
def test_an_impossible_pressure_makes_its_pad_no_patch_and_is_named(
    hand_plant: tuple[MultibodyPlant, Hand], value: float
) -> None:
    pressures = some_pressures()
    pressures["finger_2"][7] = value
    system, context = fixed(hand_plant, np.zeros(8), pressures)
    assert len(patches_of(system, context)) == 3
    assert system.GetOutputPort("pads").Eval(context) == ("finger_1", "finger_3", "palm")
    status = system.GetOutputPort("status").Eval(context)
    assert status.startswith("finger_2: unusable: pressure")
    assert not status.endswith(".")


def test_a_frame_with_the_wrong_number_of_cells_is_refused(hand_plant: tuple[MultibodyPlant, Hand]) -> None:
    with pytest.raises((RuntimeError, ValueError), match="23"):
        fixed(hand_plant, np.zeros(8), {"palm": np.zeros(23)})


def test_what_the_soft_layer_spreads_is_no_contact(hand_plant: tuple[MultibodyPlant, Hand]) -> None:
    pressure = np.zeros(24)
    pressure[[6, 7, 8]], pressure[[3, 4, 5, 9, 10, 11]] = 5e4, 6e3
    system, context = fixed(hand_plant, np.zeros(8), {"finger_1": pressure})
    (patch,) = patches_of(system, context)
    np.testing.assert_array_equal(np.flatnonzero(patch.active), [6, 7, 8])
    assert patch.threshold == pytest.approx(7.5e3)


def test_impossible_descriptors_are_refused(hand_plant: tuple[MultibodyPlant, Hand]) -> None:
    with pytest.raises(InvalidInputError, match=r"threshold must be .*, not -1"):
        PatchDescriptor(*hand_plant, PatchDescriptorParams(threshold=-1))
    with pytest.raises(InvalidInputError, match=r"threshold_share must be .*, not 1"):
        PatchDescriptor(*hand_plant, PatchDescriptorParams(threshold_share=1.0))
    with pytest.raises(InvalidInputError, match=r"max_age must be .*, not 0"):
        PatchDescriptor(*hand_plant, PatchDescriptorParams(max_age=0.0))
    with pytest.raises(
        InvalidInputError, match=r"threshold must be below the range of pad 'finger_1', 159961 Pa, not 1e\+06 Pa"
    ):
        PatchDescriptor(*hand_plant, PatchDescriptorParams(threshold=1e6))
    with pytest.raises(InvalidInputError, match="hand must have at least one tactile pad, not none"):
        PatchDescriptor(*make_hand_plant(load_hand_config("shadow_like")))


@pytest.mark.parametrize("tilt", [0.0, 0.05, 0.1])
def test_a_pressed_surface_is_found_where_it_is(hand_plant: tuple[MultibodyPlant, Hand], tilt: float) -> None:
    """A finger presses a wide board with its shipped, noisy array."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlant(MultibodyPlantConfig(time_step=0.002, contact_model="hydroelastic"), builder)
    hand = add_hand(plant, load_hand_config("barrett_like"), RigidTransform())
    properties = ProximityProperties()
    AddContactMaterial(dissipation=5.0, friction=CoulombFriction(0.9, 0.9), properties=properties)
    AddRigidHydroelasticProperties(0.05, properties)
    # On the straight part of the finger's pad when its proximal joint is at 0.6 rad; z is the pad's normal there.
    kinematics, hand_alone = hand_plant
    at_touch = kinematics.CreateDefaultContext()
    for part, angle in (("proximal", 0.6), ("distal", 0.2)):
        kinematics.GetJointByName(f"finger_3_{part}_joint").set_angle(at_touch, angle)
    X_WT = hand_alone.pad_frames["finger_3"].CalcPoseInWorld(at_touch)
    X_WFace = X_WT @ RigidTransform(RollPitchYaw(np.pi / 2, 0, 0), [0.037, -0.0095, 0])
    X_WFace = X_WFace @ RigidTransform(RollPitchYaw(0, tilt, 0), np.zeros(3))
    X_WBoard = X_WFace @ RigidTransform([0, 0, 0.005])
    plant.RegisterCollisionGeometry(plant.world_body(), X_WBoard, Box(0.044, 0.1, 0.01), "board", properties)
    plant.Finalize()
    array = builder.AddNamedSystem(
        "array", TactileArray(plant, hand.pad_frames["finger_3"], load_tactile_pad("bh280_finger"))
    )
    builder.Connect(plant.get_contact_results_output_port(), array.GetInputPort("contact_results"))
    builder.Connect(plant.get_body_poses_output_port(), array.GetInputPort("body_poses"))
    descriptor = builder.AddNamedSystem("descriptor", PatchDescriptor(*hand_plant))
    builder.Connect(array.GetOutputPort("pressures"), descriptor.GetInputPort("pressures_finger_3"))
    builder.ExportInput(descriptor.GetInputPort("joint_positions"), "joint_positions")
    AddRandomInputs(0.025, builder)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    seed_random_sources(diagram, context, 0)
    plant_context = plant.GetMyMutableContextFromRoot(context)
    actuation = np.zeros(4)
    actuation[plant.GetJointActuatorByName("finger_3_proximal_joint").input_start()] = 0.8
    plant.get_actuation_input_port().FixValue(plant_context, actuation)
    diagram.GetInputPort("joint_positions").FixValue(context, np.zeros(8))
    Simulator(diagram, context).AdvanceTo(0.5)
    diagram.GetInputPort("joint_positions").FixValue(context, plant.GetPositions(plant_context))
    (patch,) = descriptor.GetOutputPort("patches").Eval(descriptor.GetMyContextFromRoot(context))
    p_FaceC = X_WFace.inverse() @ patch.centroid
    n_Face = X_WFace.rotation().inverse() @ patch.eigenvectors[:, 2]
    assert patch.status == "area"
    assert abs(p_FaceC[2]) < 2e-4
    assert np.degrees(np.arccos(-n_Face[2])) < 1.0
