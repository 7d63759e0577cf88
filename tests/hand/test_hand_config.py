import copy
import dataclasses
import math
import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pydrake.geometry import Role
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import RevoluteJoint
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from tactopose_drake.core.surfaces import Capsule, Ellipsoid, Sphere, Superquadric
from tactopose_drake.errors import InvalidFileError, InvalidInputError, UnknownNameError
from tactopose_drake.hand.finger_chain import finger_chain, joints_towards
from tactopose_drake.hand.fingertip_surfaces import SphereSurface
from tactopose_drake.hand.hand_config import Coupling, FingerConfig, HandConfig, load_hand_config
from tactopose_drake.hand.hand_in_plant import add_hand, find_hand, make_hand_plant
from tactopose_drake.hand.touch_file import load_touch
from tactopose_drake.resources import model_path

FINGERS = ("first", "middle", "ring", "little", "thumb")
LIMITS_DEG = {
    "WRJ2": (-30, 10), "WRJ1": (-45, 35), "LFJ5": (0, 45), "THJ5": (-60, 60), "THJ4": (0, 70), "THJ3": (-12, 12),
    "THJ2": (-40, 40), "THJ1": (-15, 90),
    **{f"{f}{j}": range_ for f in ("FF", "MF", "RF", "LF")
       for j, range_ in {"J4": (-20, 20), "J3": (-15, 90), "J2": (0, 90), "J1": (0, 90)}.items()},
}  # fmt: skip


@pytest.fixture(scope="module")
def config():
    return load_hand_config("shadow_like")


@pytest.fixture(scope="module")
def hand_plant(config):
    return make_hand_plant(config)


def test_24_joints_with_the_published_limits(hand_plant):
    plant, hand = hand_plant
    joints = [plant.get_joint(i) for i in plant.GetJointIndices(hand.model_instance)]
    limits = {
        joint.name(): (joint.position_lower_limits()[0], joint.position_upper_limits()[0])
        for joint in joints
        if isinstance(joint, RevoluteJoint)
    }
    assert limits == {name: pytest.approx(np.radians(pair), abs=1e-6) for name, pair in LIMITS_DEG.items()}
    assert plant.num_positions() == 24
    assert plant.num_actuators() == 20


def test_every_link_has_a_physical_mass_and_inertia(hand_plant):
    plant, hand = hand_plant
    context = plant.CreateDefaultContext()
    for index in plant.GetBodyIndices(hand.model_instance):
        body = plant.get_body(index)
        assert body.get_mass(context) > 0, body.name()
        assert body.CalcSpatialInertiaInBodyFrame(context).IsPhysicallyValid(), body.name()


@pytest.mark.parametrize(("joint", "length"), [("FFJ2", 0.045), ("FFJ1", 0.025), ("THJ3", 0.038), ("THJ1", 0.032)])
def test_phalanges_have_the_published_lengths(hand_plant, joint, length):
    plant, _ = hand_plant
    assert np.linalg.norm(
        plant.GetJointByName(joint).frame_on_parent().GetFixedPoseInBodyFrame().translation()
    ) == pytest.approx(length)


@pytest.mark.parametrize(("finger", "last_joint", "length"), [("first", "FFJ1", 0.026), ("thumb", "THJ1", 0.0275)])
def test_hemisphere_stands_at_the_distal_length(hand_plant, finger, last_joint, length):
    plant, hand = hand_plant
    surface = hand.surfaces[finger]
    p_ST = surface.X_SF[:, 3] + 0.5 * surface.length * surface.X_SF[:, 2]
    distal = plant.GetJointByName(last_joint).child_body().body_frame()
    context = plant.CreateDefaultContext()
    p_DT = plant.CalcRelativeTransform(context, distal, hand.sensor_frames[finger]) @ p_ST
    np.testing.assert_allclose(p_DT, [0, 0, length], atol=1e-9)


@pytest.mark.parametrize("finger", FINGERS)
def test_surface_of_the_descriptor_is_the_tip_of_the_model(config, finger):
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.001)
    hand = add_hand(plant, config, RigidTransform())
    plant.Finalize()
    inspector, context = scene_graph.model_inspector(), plant.CreateDefaultContext()
    tip = hand.welds[finger].child_body()
    (geometry,) = inspector.GetGeometries(plant.GetBodyFrameIdOrThrow(tip.index()), Role.kProximity)
    shape = inspector.GetShape(geometry)
    X_SG = plant.CalcRelativeTransform(
        context, hand.sensor_frames[finger], tip.body_frame()
    ) @ inspector.GetPoseInFrame(geometry)
    surface = hand.surfaces[finger]
    assert (shape.radius(), shape.length()) == pytest.approx((surface.radius, surface.length))
    np.testing.assert_allclose(X_SG.GetAsMatrix34(), surface.X_SF, atol=1e-12)
    # A rigid geometry has no modulus.
    assert inspector.GetProximityProperties(geometry).GetProperty("hydroelastic", "hydroelastic_modulus") > 1e7


def test_no_contact_within_the_hand(config):
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=0.001)
    hand = add_hand(plant, config, RigidTransform())
    plant.Finalize()
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    plant_context = plant.GetMyMutableContextFromRoot(context)
    for joint in (plant.get_joint(i) for i in plant.GetJointIndices(hand.model_instance)):
        if isinstance(joint, RevoluteJoint):
            joint.set_angle(plant_context, joint.position_upper_limits()[0])
    query = plant.get_geometry_query_input_port().Eval(plant_context)
    assert query.ComputePointPairPenetration() == []
    assert plant.num_collision_geometries() > 24


def test_coupled_joints_stay_together_under_torque(config):
    plant, hand = make_hand_plant(config)
    simulator = Simulator(plant)
    context = simulator.get_mutable_context()
    torque = np.zeros(20)
    torque[[plant.GetJointActuatorByName(f"{f}J2").input_start() for f in ("FF", "MF", "RF", "LF")]] = 0.06
    plant.get_actuation_input_port().FixValue(context, torque)
    simulator.AdvanceTo(0.25)
    for coupling in (c for finger in hand.config.fingers for c in finger.couplings):
        leader = plant.GetJointByName(coupling.follows).get_angle(context)
        assert leader > 0.1
        assert plant.GetJointByName(coupling.joint).get_angle(context) == pytest.approx(
            coupling.ratio * leader, abs=2e-3
        )


@pytest.mark.parametrize("finger", FINGERS)
def test_chain_agrees_with_the_plant(hand_plant, finger):
    plant, hand = hand_plant
    chain, config = finger_chain(plant, hand, finger), hand.config.finger(finger)
    context = plant.CreateDefaultContext()
    q = np.random.default_rng(1).uniform(chain.lower, chain.upper, (4, len(chain.lower)))
    for row, X_PS in zip(q, chain.sensor_poses(q), strict=True):
        for name, angle in zip(config.joints, row, strict=True):
            plant.GetJointByName(name).set_angle(context, angle)
        for coupling in config.couplings:
            leader = plant.GetJointByName(coupling.follows).get_angle(context)
            plant.GetJointByName(coupling.joint).set_angle(context, coupling.ratio * leader)
        X_expected = plant.CalcRelativeTransform(context, hand.palm_frame, hand.sensor_frames[finger])
        np.testing.assert_allclose(X_PS, X_expected.GetAsMatrix34(), atol=1e-12)


def test_hand_can_be_found_again(config):
    plant = MultibodyPlant(0.001)
    hand = add_hand(plant, config)
    again = find_hand(plant, config, hand.model_instance)
    assert again.fingers == FINGERS
    assert again.sensor_frames["ring"].index() == hand.sensor_frames["ring"].index()


GRIPPER_SDF = """<sdf version="1.9"><model name="gripper"><link name="base"/>
<link name="mount"><pose>0 0.03 0.02 0.3 0 0</pose></link>
<joint name="mount_weld" type="fixed"><parent>base</parent><child>mount</child></joint>
<link name="left"><pose>0 0.03 0.05 0 0 0</pose></link>
<joint name="left_hinge" type="revolute"><parent>mount</parent><child>left</child>
<axis><xyz>1 0 0</xyz><limit><lower>-1</lower><upper>1</upper></limit></axis></joint>
<link name="left_tip"><pose relative_to="left">0 0 0.04 0 0 0</pose></link>
<joint name="left_weld" type="fixed"><parent>left</parent><child>left_tip</child></joint>
</model></sdf>"""

GRIPPER_YAML = """
model: {model}
base_link: base
palm_frame: base
fingers:
- {{name: left, joints: [{joint}], sensor_frame: left_tip, weld: left_weld, surface: {surface}}}
"""


def write_gripper(folder: Path, joint: str = "left_hinge", surface: str = "!SphereSurface {radius: 0.01}") -> Path:
    (folder / "gripper.sdf").write_text(GRIPPER_SDF)
    path = folder / "gripper.hand.yaml"
    path.write_text(GRIPPER_YAML.format(model=folder / "gripper.sdf", joint=joint, surface=surface))
    return path


def test_another_hand_fits_the_same_description(tmp_path):
    config = load_hand_config(write_gripper(tmp_path))
    plant, hand = make_hand_plant(config)
    chain = finger_chain(plant, hand, "left")
    np.testing.assert_allclose(chain.sensor_poses(np.zeros((1, 1)))[0, :, 3], [0, 0.03, 0.09], atol=1e-12)
    assert isinstance(hand.surfaces["left"], Sphere)


def test_a_palm_may_be_a_link_that_is_fixed_to_the_base(tmp_path):
    path = write_gripper(tmp_path)
    path.write_text(path.read_text().replace("palm_frame: base", "palm_frame: palm_link"))
    palm = (
        '<link name="palm_link"><pose>0.01 0.02 0.03 0 0 0.5</pose></link>'
        '<joint name="palm_weld" type="fixed"><parent>base</parent><child>palm_link</child></joint></model>'
    )
    (tmp_path / "gripper.sdf").write_text(GRIPPER_SDF.replace("</model>", palm))
    plant, hand = make_hand_plant(load_hand_config(path))
    chain, context = finger_chain(plant, hand, "left"), plant.CreateDefaultContext()
    plant.GetJointByName("left_hinge").set_angle(context, 0.3)
    X_PS = plant.CalcRelativeTransform(context, hand.palm_frame, hand.sensor_frames["left"])
    np.testing.assert_allclose(chain.sensor_poses(np.array([[0.3]]))[0], X_PS.GetAsMatrix34(), atol=1e-12)
    assert joints_towards(plant, hand, hand.sensor_frames["left"], "palm_link") == ["left_hinge"]
    assert joints_towards(plant, hand, hand.palm_frame, "base") == []


@pytest.mark.parametrize(
    ("text", "surface"),
    [
        ("!SphereSurface {radius: 0.01}", Sphere(0.01)),
        ("!EllipsoidSurface {semi_axes: [0.01, 0.015, 0.02]}", Ellipsoid((0.01, 0.015, 0.02))),
        ("!CapsuleSurface {radius: 0.01, length: 0.02}", Capsule(0.01, 0.02)),
        (
            "!SuperquadricSurface {semi_axes: [0.01, 0.015, 0.02], exponents: [0.4, 0.6]}",
            Superquadric((0.01, 0.015, 0.02), (0.4, 0.6)),
        ),
    ],
)
def test_fingertip_surfaces_by_tag(tmp_path, text, surface):
    made = load_hand_config(write_gripper(tmp_path, surface=text)).fingers[0].surface.make()
    assert type(made) is type(surface)
    np.testing.assert_array_equal(made.shape, surface.shape)
    np.testing.assert_array_equal(made.X_SF, surface.X_SF)


def test_unknown_joint_is_named_with_the_valid_ones(tmp_path):
    config = load_hand_config(write_gripper(tmp_path, joint="right_hinge"))
    with pytest.raises(UnknownNameError, match=r"must be one of .*left_hinge.*, not 'right_hinge'"):
        make_hand_plant(config)


def test_bad_descriptors_are_refused(tmp_path):
    with pytest.raises(InvalidFileError, match=r"no_such_hand must be .* hands, .*barrett_like, shadow_like"):
        load_hand_config("no_such_hand")
    with pytest.raises(InvalidInputError, match=r"HandConfig\.fingers\[left\]\.surface\.radius must be .*, not -1"):
        load_hand_config(write_gripper(tmp_path, surface="!SphereSurface {radius: -1}"))
    with pytest.raises(InvalidInputError, match=r"surface\.radius must be at most .*, not 11.* what is in millimetres"):
        load_hand_config(write_gripper(tmp_path, surface="!SphereSurface {radius: 11}"))
    path = write_gripper(tmp_path)
    path.write_text(path.read_text().replace("name: left,", "name: '',"))
    with pytest.raises(InvalidFileError, match=r"HandConfig\.fingers\[0\]\.name must be a name, not empty"):
        load_hand_config(path)
    path = write_gripper(tmp_path)
    path.write_text(path.read_text() + "thumbs: 2\n")
    with pytest.raises(InvalidFileError, match="thumbs"):
        load_hand_config(path)


@pytest.mark.parametrize(
    ("tip", "weld", "message"),
    [
        (
            "left_tip",
            "left_end",
            r"fingers\[again\]\.sensor_frame must differ from that of the finger 'left', but both are 'left_tip'",
        ),
        (
            "left_end",
            "left_weld",
            r"fingers\[again\]\.weld must differ from that of the finger 'left', but both are 'left_weld'",
        ),
    ],
)
def test_a_finger_under_two_names_is_refused(tmp_path, tip, weld, message):
    path = write_gripper(tmp_path)
    again = f"- {{name: again, joints: [left_hinge], sensor_frame: {tip}, weld: {weld}}}\n"
    path.write_text(path.read_text() + again)
    with pytest.raises(InvalidFileError, match=message):
        load_hand_config(path)


@pytest.mark.parametrize(
    ("right", "wrong", "error", "message"),
    [
        (
            "base_link: base",
            "base_link: bass",
            UnknownNameError,
            r"HandConfig\.base_link must be one of .*base, left.*, not 'bass'",
        ),
        (
            "palm_frame: base",
            "palm_frame: bass",
            UnknownNameError,
            r"HandConfig\.palm_frame must be one of .*base, left.*, not 'bass'",
        ),
        (
            "weld: left_weld",
            "weld: left_hinge",
            InvalidInputError,
            r"weld must be a joint that is fixed \(left_weld.*, not 'left_hinge', which moves",
        ),
        (
            "base_link: base",
            "base_link: left",
            InvalidInputError,
            "base_link must be the model's root, 'base', not 'left', which the joint 'left_hinge' carries",
        ),
        (
            "gripper.sdf",
            "griper.sdf",
            InvalidFileError,
            r"griper\.sdf must be an SDF, URDF or MJCF, but there is no such file",
        ),
    ],
)
def test_what_the_model_does_not_hold_is_refused(tmp_path, right, wrong, error, message):
    path = write_gripper(tmp_path)
    path.write_text(path.read_text().replace(right, wrong))
    with pytest.raises(error, match=message):
        make_hand_plant(load_hand_config(path))


def test_a_model_that_drake_would_end_the_process_for_is_named(tmp_path):
    path = write_gripper(tmp_path)
    swapped = '<robot name="a"><link name="base"/><link name="left"/><joint name="left_hinge" type="revolute">'
    swapped += '<parent link="base"/><child link="left"/><limit lower="1" upper="-1" effort="1" velocity="1"/></joint>'
    (tmp_path / "gripper.urdf").write_text(swapped + "</robot>")
    path.write_text(path.read_text().replace("gripper.sdf", "gripper.urdf"))
    with pytest.raises(InvalidFileError, match=r"gripper\.urdf must be a model that Drake can read .*lower_limits"):
        make_hand_plant(load_hand_config(path))


def test_a_file_of_two_models_is_no_hand(tmp_path):
    path = write_gripper(tmp_path)
    model = GRIPPER_SDF[GRIPPER_SDF.index("<model") : GRIPPER_SDF.index("</sdf>")]
    second = model.replace('name="gripper"', 'name="second"')
    assert second != model
    (tmp_path / "gripper.sdf").write_text(f'<sdf version="1.9"><world name="two">{model}{second}</world></sdf>')
    with pytest.raises(InvalidFileError, match="must hold 1 model, not 2"):
        make_hand_plant(load_hand_config(path))


def test_a_finger_may_have_no_sensor_and_a_hand_pads(tmp_path):
    path = write_gripper(tmp_path)
    text = path.read_text().replace("sensor_frame: left_tip, weld: left_weld, ", "")
    path.write_text(text + "pads:\n- {name: tip, frame: left_tip, array: bh280_palm, alpha: 1.0e-8}\n")
    _, hand = make_hand_plant(load_hand_config(path))
    assert hand.fingers == ("left",)
    assert not hand.sensor_frames
    assert not hand.welds
    assert not hand.surfaces
    assert hand.pad_frames["tip"].name() == "left_tip"


@pytest.mark.parametrize(
    ("pads", "message"),
    [
        ("- {name: a, frame: left_tip, alpha: 0}", r"pads\[a\].alpha must be .*, not 0"),
        ("- {name: a, frame: left_tip, alpha: 2}", r"pads\[a\].alpha must be a number from 0 to 1, not 2"),
        ("- {name: a, frame: base, alpha: 1}\n- {name: a, frame: left, alpha: 1}", "pads must have different names"),
        ("- {frame: left_tip, alpha: 1}", "pads must have different names"),
        (
            "- {name: a, frame: thumb, alpha: 1}",
            r"HandConfig\.pads\[a\]\.frame must be one of .*left_tip.*, not 'thumb'",
        ),
    ],
)
def test_impossible_pads_are_refused(tmp_path, pads, message):
    path = write_gripper(tmp_path)
    path.write_text(path.read_text() + f"pads:\n{pads}\n")
    with pytest.raises(InvalidInputError, match=message):
        make_hand_plant(load_hand_config(path))


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ({"fingers": [{"name": "left"}]}, r"HandConfig\.fingers\[0\] must be a FingerConfig, not a dict"),
        (
            {"fingers": [FingerConfig(name="left", joints=["left_slide"], surface=Sphere(0.01))]},
            r"HandConfig\.fingers\[left\]\.surface must be a SphereSurface, .*, not a Sphere",
        ),
        ({"pads": ["palm"]}, r"HandConfig\.pads\[0\] must be a PadConfig, not a str"),
    ],
    ids=["finger", "surface", "pad"],
)
def test_parts_of_another_type_are_named(tmp_path, parts, message):
    config = load_hand_config(write_gripper(tmp_path))
    with pytest.raises(InvalidInputError, match=f"^{message}"):
        dataclasses.replace(config, **parts).validate()


def test_half_a_sensor_is_refused(tmp_path):
    path = write_gripper(tmp_path)
    path.write_text(path.read_text().replace("weld: left_weld, ", ""))
    with pytest.raises(
        InvalidInputError,
        match=r"fingers\[left\] must have both sensor_frame and weld, or neither, not sensor_frame alone",
    ):
        load_hand_config(path)
    path = write_gripper(tmp_path)
    text = path.read_text()
    path.write_text(text.replace(text[text.index("model:") : text.index("\n", text.index("model:"))], ""))
    with pytest.raises(InvalidInputError, match=r"HandConfig\.model must be the path of the hand's SDF, .*, not empty"):
        load_hand_config(path)


def test_a_joint_stands_once_in_a_finger_and_may_be_of_several(tmp_path):
    path = write_gripper(tmp_path)
    twice = path.read_text().replace("joints: [left_hinge]", "joints: [left_hinge, left_hinge]")
    assert "hinge, left" in twice
    path.write_text(twice)
    with pytest.raises(
        InvalidInputError, match=r"fingers\[left\].joints must be different names, not \['left_hinge', 'left_hinge'\]"
    ):
        load_hand_config(path)
    config = load_hand_config("shadow_like")
    config.finger("middle").joints.insert(0, config.finger("first").joints[0])
    config.validate()


@pytest.mark.parametrize(
    ("finger", "joint", "follows", "message"),
    [
        (
            "first",
            "FFJ1",
            "FFJ3",
            r"fingers\[first\].couplings: the coupling of 'FFJ1' must be the same in all fingers",
        ),
        ("first", "MFJ1", "FFJ2", r"the coupling of 'MFJ1' must be the same in all fingers"),
        ("first", "FFJ3", "FFJ2", r"the coupling of 'FFJ3' must be of a joint that is not among .*'FFJ3' to 'FFJ2'"),
        (
            "ring",
            "FFJ3",
            "RFJ2",
            r"fingers\[ring\].couplings: the coupling of 'FFJ3' must be of a joint .*'FFJ3' to 'RFJ2'",
        ),
    ],
)
def test_a_joint_follows_in_one_way_and_has_no_actuator(finger, joint, follows, message):
    config = load_hand_config("shadow_like")
    config.finger(finger).couplings.append(Coupling(joint=joint, follows=follows))
    with pytest.raises(InvalidInputError, match=message):
        config.validate()


def test_fingers_that_share_a_coupled_joint_repeat_its_coupling():
    config = load_hand_config("shadow_like")
    config.finger("first").couplings *= 2
    config.validate()
    assert len(config.couplings) == 4


@pytest.mark.parametrize(
    ("low", "high", "message"),
    [
        ([0.0, 0.0, 0.0], [], r"must have both grip_low and grip_high, or neither, not \[0.0, 0.0, 0.0\] and \[\]"),
        ([], [0.0, 0.0, 0.0], r"must have both .*, or neither, not \[\] and \[0.0, 0.0, 0.0\]"),
        ([0.1, 0.0, 0.1], [0.2, 0.0, 0.2], r"grip_low must be less than grip_high .*, not \[0.1, 0.0, 0.1\]"),
        ([0.0, 0.0, 50.0], [20.0, 20.0, 80.0], "grip_low.* must have coordinates from -10 to 10 m, not"),
        ([0.0, 0.0], [0.1, 0.1, 0.1], "grip_low must have the shape .*"),
    ],
)
def test_a_grip_region_has_two_corners_in_metres(low, high, message):
    config = load_hand_config("barrett_like")
    config.grip_low, config.grip_high = low, high
    with pytest.raises(InvalidInputError, match=message):
        config.validate()


def test_unknown_finger_is_named(config):
    with pytest.raises(UnknownNameError, match=r"must be one of first.*, not 'pinky'"):
        config.finger("pinky")


def test_model_file_is_what_the_generator_writes():
    folder = model_path("hands", "shadow_like")
    namespace: dict[str, object] = {"__name__": "generate", "__file__": str(folder / "generate.py")}
    exec(compile((folder / "generate.py").read_text(), "generate.py", "exec"), namespace)
    text = namespace["model_text"]
    assert callable(text)
    assert text() == (folder / "shadow_like.sdf").read_text()
    assert math.isclose(float(namespace["TIP_RADIUS"]), 0.009)  # type: ignore[arg-type]


@pytest.mark.parametrize("hand", ["shadow_like", "barrett_like", "allegro"])
def test_a_hand_is_pickled(hand: str) -> None:
    config = load_hand_config(hand)
    again = pickle.loads(pickle.dumps(config))
    assert repr(again) == repr(config)
    assert type(again.fingers[0].surface) is type(config.fingers[0].surface)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda config: pickle.loads(pickle.dumps(config))])
def test_a_copy_is_equal_until_a_fingertip_is_elsewhere(copied: Callable[[HandConfig], HandConfig]) -> None:
    config = load_hand_config("shadow_like")
    other = copied(config)
    assert other == config
    assert config.fingers[0].surface != SphereSurface()
    X_SF = other.fingers[0].surface.X_SF
    X_SF.translation = X_SF.translation + np.array([1e-15, 0.0, 0.0])
    assert other != config
    other = copied(config)
    other.fingers[0].surface.radius = math.nextafter(other.fingers[0].surface.radius, 1.0)
    assert other != config


@pytest.mark.parametrize("wrong", [None, 3])
def test_a_file_that_is_no_path_is_one_clear_error(wrong: object) -> None:
    with pytest.raises(InvalidInputError, match=f"^name_or_path must be a path, not {wrong}"):
        load_hand_config(wrong)  # type: ignore[arg-type]
    with pytest.raises(InvalidInputError, match=f"^path must be a path, not {wrong}"):
        load_touch(wrong)  # type: ignore[arg-type]
