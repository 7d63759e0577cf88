from pathlib import Path

import numpy as np
import pytest
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from tactopose_drake.errors import InvalidFileError
from tactopose_drake.hand import HandGeometry, add_hand, load_hand_config, load_hand_volume, make_hand_plant
from tests.hand.grippers import write_gripper


def write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "volume.yaml"
    path.write_text(text)
    return path


def test_spheres_are_read(tmp_path: Path) -> None:
    text = """
    spheres: [{center: [0.0, 0.01, 0.02], radius: 0.008}, {center: [0.1, 0.0, 0.0], radius: 0.02}]
    untouched: [{center: [0.0, 0.0, 0.3], radius: 0.007}]
    sigma: 0.002
    """
    volumes = load_hand_volume(write(tmp_path, text))
    assert volumes.hand == HandGeometry(np.array([[0.0, 0.01, 0.02], [0.1, 0.0, 0.0]]), np.array([0.008, 0.02]), 0.002)
    assert volumes.untouched == HandGeometry(np.array([[0.0, 0.0, 0.3]]), np.array([0.007]), 0.002)
    assert load_hand_volume(write(tmp_path, "untouched: [{center: [0, 0, 0], radius: 1}]")).hand is None


def test_a_hand_is_filled_where_its_joints_put_it(tmp_path: Path) -> None:
    config = load_hand_config("barrett_like")
    plant, hand = make_hand_plant(config)
    joints = {plant.get_joint(index).name(): 0.3 for index in plant.GetJointIndices(hand.model_instance)}
    given = {name: value for name, value in joints.items() if plant.GetJointByName(name).num_positions() == 1}
    volumes = load_hand_volume(write(tmp_path, f"hand: barrett_like\njoints: {given}"))
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=0.001)
    hand = add_hand(plant, config, RigidTransform())
    plant.Finalize()
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    own = plant.GetMyMutableContextFromRoot(context)
    plant.SetPositions(own, np.full(plant.num_positions(), 0.3))
    expected = HandGeometry.from_plant(plant, own, hand.palm_frame)
    assert volumes.hand is not None
    np.testing.assert_allclose(volumes.hand.p_PH, expected.p_PH, atol=1e-12)
    np.testing.assert_array_equal(volumes.hand.radius, expected.radius)
    assert volumes.untouched is None


def test_readings_of_a_calibrated_hand_are_corrected(tmp_path: Path) -> None:
    plain = write_gripper(tmp_path)
    calibrated = tmp_path / "calibrated.hand.yaml"
    calibrated.write_text(plain.read_text() + "calibration: calibration.yaml\n")
    offset = "joint_offsets: {left_slide: {value: 0.002, sigma: 0.0001}}\n"
    (tmp_path / "calibration.yaml").write_text(offset)
    volumes = []
    for hand, left in ((plain, 0.010), (calibrated, 0.012)):
        path = tmp_path / "volume.yaml"
        path.write_text(f"hand: {hand.name}\njoints: {{left_slide: {left}, right_slide: 0.02}}\nuntouched: [left]\n")
        volumes.append(load_hand_volume(path))
    for of_plain, of_calibrated in zip(*volumes, strict=True):
        assert of_plain is not None
        assert of_calibrated is not None
        np.testing.assert_allclose(of_calibrated.p_PH, of_plain.p_PH, atol=1e-12)


def test_a_link_behind_a_joint_that_is_not_given_is_not_known(tmp_path: Path) -> None:
    hand = write_gripper(tmp_path)
    plant, parts = make_hand_plant(load_hand_config(hand))
    names = [plant.get_joint(index).name() for index in plant.GetJointIndices(parts.model_instance)]
    names = [name for name in names if plant.GetJointByName(name).num_positions() == 1]
    volumes = [
        load_hand_volume(write(tmp_path, f"hand: {hand.name}\njoints: {joints}\nuntouched: {untouched}"))
        for joints, untouched in (({}, []), (dict.fromkeys(names, 0.01), ["left"]))
    ]
    assert volumes[0].hand is not None
    assert volumes[1].hand is not None
    assert volumes[1].untouched is not None
    assert len(volumes[0].hand.radius) < len(volumes[1].hand.radius)
    assert len(volumes[1].untouched.radius) < len(volumes[1].hand.radius)
    nowhere = load_hand_volume(write(tmp_path, f"hand: {hand.name}\njoints: {{}}\nuntouched: [left]"))
    assert nowhere.untouched is None


def test_a_hand_s_own_file_is_told_from_one_that_names_it(tmp_path: Path) -> None:
    with pytest.raises(InvalidFileError, match=r"\.hand\.yaml must name a hand's file by its key `hand`, not be one"):
        load_hand_volume(write_gripper(tmp_path))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("3", "the content must be a mapping with the keys spheres, untouched, sigma, not 3"),
        ("sigma: 0.001", "must have at least one of hand, spheres and untouched, but has none"),
        ("spheres: []", r"spheres must be a list of at least one sphere, not \[\]"),
        ("spheres: [{center: [0, 0, 0]}]", r"spheres\[0\] must have the key 'radius', but lacks it"),
        ("spheres: [{center: [0, 0], radius: 1}]", r"spheres\[0\].center must have the shape .*, not \(2,\)"),
        ("spheres: [{center: [0, 0, 0], radius: -1}]", r"spheres\[0\].radius must be a number > 0, not -1"),
        ("{hand: shadow_like}", "the content must have the key 'joints', but lacks it"),
        (
            "{hand: no_such_hand, joints: {}}",
            r"^[^:]*volume\.yaml: hand: no_such_hand must be .* one of the package's hands, .*, but there is no such",
        ),
        ("{hand: 5, joints: {}}", "hand must be a name or a path, not 5"),
        ("{hand: shadow_like, joints: 5}", "joints must be a mapping of names to positions, not 5"),
        ("{hand: shadow_like, joints: {elbow: 0.1}}", "joints.*'elbow'"),
        (
            "{hand: shadow_like, joints: {FFJ3: 34}}",
            r"joints\[FFJ3\] must be from .* limits, -0.26\d* and 1.57.*, not 34\.",
        ),
        (
            "{hand: barrett_like, joints: {finger_1_spread_joint: 0.3, finger_2_spread_joint: 0.1}}",
            r"\[finger_2_spread_joint\] must be .* 0.3 rad, by the coupling with finger_1_spread_joint, not 0.1 rad",
        ),
        ("{hand: shadow_like, joints: {elbow: x}}", "^[^:]*: joints.elbow must be a number, not 'x'"),
        ("{hand: shadow_like, joints: {FFJ3: .nan}}", r"^[^:]*: joints.FFJ3 must be .*, not nan"),
        ("{hand: shadow_like, joints: {}, untouched: [toe]}", r"untouched must be a list of fingers .*, not \['toe'\]"),
    ],
)
def test_each_fault_is_one_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InvalidFileError, match=message) as caught:
        load_hand_volume(write(tmp_path, text))
    assert "\n" not in str(caught.value)
