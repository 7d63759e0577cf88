"""What is found right and wrong with a hand's files."""

import logging
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tactopose_drake.core.surfaces.surface import random_directions
from tactopose_drake.hand.findings import Entry, fingers_yaml
from tactopose_drake.hand.hand_check import HandCheck, check_hand
from tactopose_drake.resources import model_path
from tests.hand.grippers import YAML, write_bending_gripper, write_gripper


def verdicts(check: HandCheck, part: str) -> list[tuple[str, str]]:
    return [(finding.verdict, finding.text) for finding in check.findings if finding.part == part]


@pytest.mark.parametrize("hand", ["shadow_like", "barrett_like"])
def test_the_package_s_own_hands_have_no_fault(hand: str) -> None:
    check = check_hand(hand)
    assert not check.faults
    assert check.parts is not None
    assert ("ok", "all shapes are compliant") in verdicts(check, "contact")


def test_a_gripper_is_usable_and_described(tmp_path: Path) -> None:
    check = check_hand(write_gripper(tmp_path))
    assert not check.faults
    assert verdicts(check, "joints") == [("ok", "order of joint_positions: left_slide, right_slide")]
    ((fit, text),) = (found for found in verdicts(check, "fingertip left") if "surface" in found[1])
    assert fit == "ok"
    assert text.startswith("of its surface 100%")
    ((verdict, text),) = verdicts(check, "grip")
    assert verdict == "ok"
    low, high = (int(number) for number in re.findall(r"x (-?\d+) to (-?\d+)", text)[0])
    assert -15 < low < 0 < high < 15  # between the fingers
    assert ("note", "5 shapes do not say whether they are compliant; the simulation takes them for hard rubber") in (
        verdicts(check, "contact")
    )


@pytest.mark.parametrize(("radius", "outside", "inside"), [(0.014, 2.0, 0.0), (0.0105, 0.0, 1.5)])
def test_how_far_a_surface_is_off_its_shape_is_said(
    tmp_path: Path, radius: float, outside: float, inside: float
) -> None:
    yaml = YAML.replace("radius: 0.012", f"radius: {radius}")
    (text, *_) = (text for _, text in verdicts(check_hand(write_gripper(tmp_path, yaml=yaml)), "fingertip left")[1:])
    assert f"up to {outside} mm outside of them and {inside} mm inside" in text


@pytest.mark.parametrize(
    ("right", "wrong", "part", "text"),
    [
        ("sensor_frame: left_tip", "sensor_frame: left_top", "model", "not 'left_top'"),
        ("joints: [left_slide]", "joints: [right_slide]", "finger left", "'left_slide' must be one of its joints"),
        ("palm_frame: base", "palm_frame: left_finger", "finger right", "must be carried by the palm's link"),
        ("model: two_finger.urdf", "model: three_finger.urdf", "model", "three_finger.urdf"),
        ("surface: !SphereSurface {radius: 0.012}", "surface: !SphereSurface {radius: 0.03}", "fingertip left", "0%"),
        ("base_link: base", "base_lonk: base", "file", ", not 'base_lonk'"),
        (
            "fingers:",
            "rest_positions: {left: 0.01}\nfingers:",
            "file",
            "must be one of left_slide, right_slide, not 'left'",
        ),
        ("fingers:", "rest_positions: {left_slide: 2}\nfingers:", "joints", "at 2, beyond its limits, 0 to"),
        (
            "joints: [left_slide]",
            "joints: [1]",
            "file",
            "two_finger.hand.yaml: line 6: fingers[0].joints[0] must be text, in quotes if need be, not '1'",
        ),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, right: str, wrong: str, part: str, text: str) -> None:
    check = check_hand(write_gripper(tmp_path, yaml=YAML.replace(right, wrong)))
    assert any(fault.part == part and text in fault.text for fault in check.faults), check.faults


def test_a_joint_that_cannot_be_at_zero_where_it_would_rest_is_told(tmp_path: Path) -> None:
    path = write_gripper(tmp_path)
    model = tmp_path / "two_finger.urdf"
    model.write_text(model.read_text().replace('lower="0" upper="0.045"', 'lower="0.01" upper="0.045"'))
    told = {text for verdict, text in verdicts(check_hand(path), "joints") if verdict == "note"}
    assert told == {
        f"`rest_positions` lacks '{side}_slide', which rests at 0, beyond its limits, 0.01 to 0.045"
        for side in ("left", "right")
    }
    path.write_text(YAML + "rest_positions: {left_slide: 0.01, right_slide: 0.02}\n")
    assert {verdict for verdict, _ in verdicts(check_hand(path), "joints")} == {"ok"}


def test_a_model_in_other_units_is_told(tmp_path: Path) -> None:
    path = write_bending_gripper(tmp_path, 2)
    assert ("ok", "joint limits: f0_j0 -0.6 to 1.4 rad, f0_j1 -0.6 to 1.4 rad") in verdicts(
        check_hand(path), "finger f0"
    )
    model = tmp_path / "bending.urdf"
    text = model.read_text()
    model.write_text(text.replace('lower="-0.6" upper="1.4"', 'lower="-35" upper="80"'))
    assert any(
        "f0_j0 -35 to 80 rad" in found.text and "may be degrees" in found.text for found in check_hand(path).faults
    )
    model.write_text(text.replace("0.01 0.014 0.04", "10 14 40"))
    faults = [found.text for found in check_hand(path).faults if found.part == "model"]
    assert any("'f0_near' reach" in fault and "must be at most 1 m" in fault for fault in faults)


def test_a_fingertip_that_is_one_sphere_in_millimetres_is_told(tmp_path: Path) -> None:
    path = write_gripper(tmp_path)
    model = tmp_path / "two_finger.urdf"
    model.write_text(model.read_text().replace('sphere radius="0.012"', 'sphere radius="12"'))
    faults = check_hand(path).faults
    assert any(found.part == "model" and "must be at most 1 m" in found.text for found in faults)


def test_couplings_are_compared_with_the_model(tmp_path: Path) -> None:
    mimic = '<mimic joint="left_slide" multiplier="0.5" offset="0.01"/>'
    check = check_hand(write_gripper(tmp_path, mimic=mimic))
    assert [fault.part for fault in check.faults] == ["couplings"]
    assert "finger 'right': the model lets 'right_slide' follow 'left_slide'" in check.faults[0].text
    assert fingers_yaml(check.entries) == (
        "- name: right\n"
        "  joints: [left_slide]\n"
        "  couplings:\n"
        "  - {joint: right_slide, follows: left_slide, ratio: 0.5, offset: 0.01}"
    )

    both = YAML.replace("joints: [right_slide]", "joints: [left_slide]")
    coupled = both.replace(
        "  sensor_frame: right_tip", "  couplings: [{joint: right_slide, follows: left_slide, ratio: 0.5%s}]\n"
        "  sensor_frame: right_tip"
    )  # fmt: skip
    right = check_hand(write_gripper(tmp_path, mimic=mimic, yaml=coupled % ", offset: 0.01"))
    assert ("ok", "right_slide = 0.5 left_slide + 0.01, as the model has it") in verdicts(right, "couplings")
    # The joint on the way is told, although only the one that it follows is driven.
    assert ("ok", "its joints lead from the palm outwards: right_slide") in verdicts(right, "finger right")
    wrong = check_hand(write_gripper(tmp_path, mimic=mimic, yaml=coupled % ""))
    assert "the file says right_slide = 0.5 left_slide, the model right_slide = 0.5 left_slide + 0.01" in (
        wrong.faults[0].text
    )
    dangling = check_hand(write_gripper(tmp_path, yaml=coupled % ""))
    assert "the model has no mimic for it" in dangling.faults[0].text


def write_chain(folder: Path, first: str, second: str, yaml: str = YAML) -> Path:
    """The gripper with a link more behind the right finger, whose own joint slides too.

    Args:
        folder: receives the files.
        first: the mimic entry of the right finger's joint.
        second: of the joint behind it.
        yaml: of the hand.
    """
    path = write_gripper(folder, mimic=first, yaml=yaml)
    model = folder / "two_finger.urdf"
    weld = '<parent link="right_finger"/><child link="right_tip"/>'
    assert weld in model.read_text()
    behind = (
        '<link name="right_end"/><joint name="right_second" type="prismatic"><parent link="right_finger"/>'
        '<child link="right_end"/><axis xyz="-1 0 0"/><limit lower="0" upper="0.02" effort="40" velocity="1"/>'
        f"{second}</joint></robot>"
    )
    text = model.read_text().replace(weld, weld.replace("right_finger", "right_end"))
    model.write_text(text.replace("</robot>", behind))
    return path


def test_joints_that_follow_in_a_chain_are_coupled_to_the_one_that_leads(tmp_path: Path) -> None:
    chain = (
        '<mimic joint="left_slide" multiplier="0.5" offset="0.01"/>',
        '<mimic joint="right_slide" multiplier="0.4" offset="0.002"/>',
    )
    lines = (
        "  joints: [left_slide]\n"
        "  couplings:\n"
        "  - {joint: right_slide, follows: left_slide, ratio: 0.5, offset: 0.01}\n"
        "  - {joint: right_second, follows: left_slide, ratio: 0.2, offset: 0.006}\n"
    )
    check = check_hand(write_chain(tmp_path, *chain))
    assert fingers_yaml(check.entries) == f"- name: right\n{lines}".removesuffix("\n")
    right = check_hand(write_chain(tmp_path, *chain, YAML.replace("  joints: [right_slide]\n", lines)))
    assert not right.faults
    assert ("ok", "right_second = 0.2 left_slide + 0.006, as the model has it") in verdicts(right, "couplings")


def test_joints_that_follow_each_other_are_told(tmp_path: Path) -> None:
    circle = '<mimic joint="right_second"/>', '<mimic joint="right_slide"/>'
    (fault,) = (fault for fault in check_hand(write_chain(tmp_path, *circle)).faults if fault.part == "couplings")
    assert "two_finger.urdf: one of the joints right_slide, right_second must follow none" in fault.text


def test_a_model_of_visual_shapes_alone_is_told(tmp_path: Path) -> None:
    path = write_gripper(tmp_path)
    model = tmp_path / "two_finger.urdf"
    model.write_text(model.read_text().replace("<collision", "<visual").replace("</collision", "</visual"))
    check = check_hand(path)
    assert ("fault", "5 links with 0 collision shapes") in verdicts(check, "model")


def test_rigid_shapes_are_named(tmp_path: Path) -> None:
    hint = '<drake:mesh_resolution_hint value="0.003"/>'
    rigid = f"<drake:proximity_properties><drake:rigid_hydroelastic/>{hint}</drake:proximity_properties>"
    check = check_hand(write_gripper(tmp_path, property=rigid))
    (fault,) = check.faults
    assert "'left_ball' of link 'left_tip'" in fault.text


def test_overlapping_links_are_named(tmp_path: Path) -> None:
    path = write_gripper(tmp_path)
    model = tmp_path / "two_finger.urdf"
    model.write_text(model.read_text().replace('xyz="0.06 0 0.1"', 'xyz="-0.05 0 0.1"'))
    notes = [text for verdict, text in verdicts(check_hand(path), "contact") if verdict == "note"]
    assert any("left_tip and right_tip" in text for text in notes)


def test_a_mesh_that_drake_cannot_read_is_told(tmp_path: Path) -> None:
    path = write_gripper(tmp_path)
    model = tmp_path / "two_finger.urdf"
    model.write_text(model.read_text().replace('<sphere radius="0.012"/>', '<mesh filename="ball.stl"/>', 1))
    check = check_hand(path)
    assert any(finding.part == "model" and "ball.stl" in finding.text for finding in check.findings)


def test_a_surface_that_fits_far_better_is_named_and_then_taken(tmp_path: Path) -> None:
    path = write_gripper(tmp_path)
    model = tmp_path / "two_finger.urdf"
    model.write_text(model.read_text().replace('<sphere radius="0.012"/>', '<box size="0.02 0.024 0.04"/>'))
    (note,) = (text for verdict, text in verdicts(check_hand(path), "fingertip left") if "fitted" in text)
    better, own = (float(number) for number in re.findall(r"by (\d\.\d+) mm", note))
    assert better < 0.8
    assert own > 3.0 * better
    (entry,) = (entry for entry in check_hand(path).entries if entry.finger == "left")
    surface = entry.yaml.removeprefix("surface: ")
    assert surface.startswith("!SuperquadricSurface {semi_axes: [")
    path.write_text(YAML.replace("!SphereSurface {radius: 0.012}", surface))
    assert not [text for _, text in verdicts(check_hand(path), "fingertip left") if "fitted" in text]


def test_of_a_capsule_along_the_finger_the_surface_is_its_own(tmp_path: Path) -> None:
    path = write_gripper(tmp_path)
    model = tmp_path / "two_finger.urdf"
    capsule = (
        '<origin xyz="0 0 0.01" rpy="3.14159265 0 0"/><geometry><capsule radius="0.008" length="0.014"/></geometry>'
    )
    ball = '<geometry><sphere radius="0.012"/></geometry>'
    model.write_text(model.read_text().replace(ball, capsule, 1))
    (entry,) = (entry for entry in check_hand(path).entries if entry.finger == "left")
    place = "X_SF: {translation: [0, 0, 0.01], rotation: !Rpy {deg: [0, 0, 0]}}"
    assert entry.yaml == f"surface: !CapsuleSurface {{radius: 0.008, length: 0.014, {place}}}"
    path.write_text(YAML.replace("surface: !SphereSurface {radius: 0.012}", entry.yaml, 1))
    assert not [text for _, text in verdicts(check_hand(path), "fingertip left") if "fitted" in text]


def test_a_sensor_on_another_finger_s_link_is_told_and_no_surface_proposed(tmp_path: Path) -> None:
    swapped = (
        YAML.replace("weld: left", "weld: @").replace("weld: right", "weld: left").replace("weld: @", "weld: right")
    )
    check = check_hand(write_gripper(tmp_path, yaml=swapped))
    assert verdicts(check, "fingertip left") == [
        (
            "fault",
            "sensor frame 'left_tip' is on link 'left_tip', which the weld 'right_weld' does not carry; frames that it "
            "carries are right_tip",
        )
    ]
    assert check.entries == ()
    before = check_hand(write_gripper(tmp_path, yaml=YAML.replace("frame: left_tip", "frame: left_finger")))
    assert "'left_finger' at joint 'left_weld'" in verdicts(before, "fingertip left")[0][1]  # on the weld's other side


def test_a_surface_that_lies_across_the_finger_is_a_fault(tmp_path: Path) -> None:
    across = "!CapsuleSurface {radius: 0.007, length: 0.05, X_SF: {rotation: !Rpy {deg: [90, 0, 0]}}}"
    path = write_gripper(tmp_path, yaml=YAML.replace("!SphereSurface {radius: 0.012}", across, 1))
    model = tmp_path / "two_finger.urdf"
    model.write_text(model.read_text().replace('<sphere radius="0.012"/>', '<box size="0.014 0.024 0.06"/>', 1))
    check = check_hand(path)
    (fault,) = check.faults
    assert (fault.part, fault.entries) == ("fingertip left", check.entries)
    better, own = (float(number) for number in re.findall(r"by (\d+\.\d+) mm", fault.text))
    assert better < 1.0
    assert own > 5.0
    path.write_text(YAML.replace("surface: !SphereSurface {radius: 0.012}", check.entries[0].yaml, 1))
    assert not check_hand(path).faults


def test_a_reach_ends_at_no_negative_zero(tmp_path: Path) -> None:
    path, model = write_gripper(tmp_path), tmp_path / "two_finger.urdf"
    model.write_text(model.read_text().replace('xyz="0.06 0 0.1"', 'xyz="0.06 -0.0001 0.1"'))
    assert ("ok", "its fingertip reaches x 17 to 58, y 0 to 0, z 100 to 100 mm in the palm frame") in verdicts(
        check_hand(path), "finger right"
    )


def test_what_drake_says_of_many_lines_is_one_note(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # The command line lets each kind of message through once.
    monkeypatch.setattr(logging.getLogger("drake"), "filters", [lambda record: False])
    path = write_gripper(tmp_path)
    model = tmp_path / "two_finger.urdf"
    model.write_text(model.read_text().replace("<limit", '<dynamics friction="0.1"/><limit'))
    notes = [text for verdict, text in verdicts(check_hand(path), "model") if verdict == "note"]
    assert len(notes) == 1
    assert "Drake says of 2 places: two_finger.urdf:" in notes[0]
    assert "friction" in notes[0]


def test_a_tip_without_a_shape_gives_way_to_the_link_before_it_and_all_that_follows(tmp_path: Path) -> None:
    """A link that only marks the fingertip's place is named, as many models have one."""
    path = write_gripper(tmp_path, yaml=YAML.replace("surface: !SphereSurface {radius: 0.012}", "layer: null"))
    model = tmp_path / "two_finger.urdf"
    mark = (
        '<link name="{0}_mark"/><joint name="{0}_mark_weld" type="fixed">'
        '<parent link="{0}_tip"/><child link="{0}_mark"/></joint>'
    )
    marks = "".join(mark.format(name) for name in ("left", "right"))
    model.write_text(model.read_text().replace("</robot>", marks + "</robot>"))
    for name in ("left", "right"):
        path.write_text(path.read_text().replace(f"sensor_frame: {name}_tip", f"sensor_frame: {name}_mark"))
        path.write_text(path.read_text().replace(f"weld: {name}_weld", f"weld: {name}_mark_weld"))
    check = check_hand(path)
    assert [fault.part for fault in check.faults] == ["fingertip left", "fingertip right"]
    assert "the nearest one that has is 'left_tip' behind the joint 'left_weld'" in check.faults[0].text
    (surface,) = (entry.value for entry in check.entries if (entry.finger, entry.key) == ("left", "surface"))
    assert isinstance(surface, str)
    assert surface.startswith("!SphereSurface {radius: 0.012, X_SF: {translation: [0, 0, 0], rotation")
    assert fingers_yaml(check.entries).splitlines()[:3] == [
        "- name: left",
        "  sensor_frame: left_tip",
        "  weld: left_weld",
    ]
    taken = YAML.replace("!SphereSurface {radius: 0.012}", surface)
    path.write_text(taken)
    assert check_hand(path).entries == ()


def test_nothing_on_the_palm_is_named_for_a_fingertip(tmp_path: Path) -> None:
    path = write_gripper(tmp_path, yaml=YAML.replace("palm_frame: base", "palm_frame: palm_link"))
    model = tmp_path / "two_finger.urdf"
    palm = (
        '<link name="root"/><link name="palm_link"/>'
        '<joint name="root_weld" type="fixed"><parent link="root"/><child link="base"/></joint>'
        '<joint name="palm_weld" type="fixed"><parent link="base"/><child link="palm_link"/></joint></robot>'
    )
    bare = re.sub(r"<collision[^>]*><origin[^>]*/><geometry><box size=.0.008.*?</collision>", "", model.read_text())
    bare = re.sub(r"<collision name.*?</collision>", "", bare)
    model.write_text(bare.replace("</robot>", palm))
    path.write_text(path.read_text().replace("base_link: base", "base_link: root"))
    check = check_hand(path)
    assert [fault.part for fault in check.faults] == ["fingertip left", "fingertip right"]
    assert check.entries == ()


def test_wrong_joints_are_named_with_the_right_ones(tmp_path: Path) -> None:
    wrong = YAML.replace("joints: [left_slide]", "joints: [right_slide]")
    assert check_hand(write_gripper(tmp_path, yaml=wrong)).entries == (Entry("left", "joints", ("left_slide",)),)


def test_a_joint_that_does_not_move_its_finger_is_a_fault_with_the_right_ones(tmp_path: Path) -> None:
    more = YAML.replace("joints: [left_slide]", "joints: [left_slide, right_slide]")
    check = check_hand(write_gripper(tmp_path, yaml=more))
    (fault,) = check.faults
    assert (fault.part, fault.text) == (
        "finger left",
        "its joints have right_slide, by which its sensor frame 'left_tip' does not move; they are left_slide",
    )
    assert fingers_yaml(check.entries) == "- name: left\n  joints: [left_slide]"
    assert not any("rad" in text for _, text in verdicts(check, "finger left"))


def test_a_fault_names_its_finger_once(tmp_path: Path) -> None:
    wrong = YAML.replace("joints: [left_slide]", "joints: [right_slide]")
    (fault,) = check_hand(write_gripper(tmp_path, yaml=wrong)).faults
    assert f"{fault.part}: {fault.text}".startswith("finger left: joint 'left_slide' must be one of its joints")


def test_names_that_yaml_would_take_for_something_else_are_quoted() -> None:
    assert Entry("index", "joints", ("1", "off", "joint_1.0")).yaml == 'joints: ["1", "off", joint_1.0]'
    assert Entry("index", "weld", "3").yaml == 'weld: "3"'


def test_one_motor_for_two_fingers_is_told(tmp_path: Path) -> None:
    mimic = '<mimic joint="left_slide" multiplier="1"/>'
    coupled = "joints: [left_slide]\n  couplings: [{joint: right_slide, follows: left_slide}]"
    path = write_gripper(tmp_path, mimic=mimic, yaml=YAML.replace("joints: [right_slide]", coupled))
    (note,) = (text for verdict, text in verdicts(check_hand(path), "joints") if verdict == "note")
    assert note.startswith("'left_slide' moves the fingers left, right together; planned grasps take each by itself")


@pytest.mark.parametrize(
    "ignored",
    [
        r'<mimic joint="\1"><multiplier>\2</multiplier></mimic></axis>',
        r'<drake:mimic joint="\1" multiplier="\2" offset="0"/></axis>',
    ],
    ids=["of_sdformat", "in_an_axis"],
)
def test_couplings_that_drake_ignores_are_told(tmp_path: Path, ignored: str) -> None:
    folder = model_path("hands", "barrett_like")
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    yaml, model = tmp_path / "barrett_like.hand.yaml", tmp_path / "barrett_like.sdf"
    yaml.write_text(re.sub(r"model: .*", "model: barrett_like.sdf", yaml.read_text()))
    assert not check_hand(yaml).faults
    drakes = r'</axis><drake:mimic joint="(\w+)" multiplier="([\d.]+)" offset="0"/>'
    model.write_text(re.sub(drakes, ignored, model.read_text()))
    faults = [fault.text for fault in check_hand(yaml).faults]
    assert len(faults) == 4
    assert faults[3].endswith(
        "but Drake ignores the model's <mimic>: it would dangle; write directly in its <joint> "
        '<drake:mimic joint="finger_3_proximal_joint" multiplier="0.333333333" offset="0.0"/>, or in a URDF '
        '<mimic joint="finger_3_proximal_joint" multiplier="0.333333333" offset="0.0"/>'
    )


def test_a_mass_that_drake_has_made_up_is_told(tmp_path: Path) -> None:
    path = write_gripper(tmp_path)
    assert verdicts(check_hand(path), "dynamics") == [("ok", "all links have masses, 0.52 kg in all")]
    model = tmp_path / "two_finger.urdf"
    model.write_text(model.read_text().replace('<mass value="0.01"/>', '<mass value="0"/>', 1))
    ((verdict, text),) = verdicts(check_hand(path), "dynamics")
    assert verdict == "note"
    assert text.endswith("which Drake replaces by balls of 1 kg: left_tip")


def test_damping_that_needs_stiff_joints_is_told_with_the_keys_of_a_scenario(tmp_path: Path) -> None:
    path = write_gripper(tmp_path)
    model = tmp_path / "two_finger.urdf"
    model.write_text(model.read_text().replace("<limit", '<dynamics damping="10"/><limit'))
    (text,) = (text for verdict, text in verdicts(check_hand(path), "dynamics") if verdict == "note")
    assert text.endswith(
        "give the scenario `reach: {stiffness: 100}` and `controller: {finger_stiffness: 100}`, N m/rad"
    )


def test_a_link_without_a_mass_that_carries_one_is_simulated(tmp_path: Path) -> None:
    path = write_gripper(tmp_path)
    model = tmp_path / "two_finger.urdf"
    inertial = (
        '<inertial><mass value="{0}"/><inertia ixx="{1}" ixy="0" ixz="0" iyy="{1}" iyz="0" izz="{1}"/></inertial>'
    )
    model.write_text(model.read_text().replace(inertial.format("0.05", "2e-5"), "", 1))
    assert verdicts(check_hand(path), "dynamics") == [
        ("note", "links without a mass, which are simulated with that of what they carry: left_finger")
    ]
    model.write_text(model.read_text().replace(inertial.format("0.01", "1e-6"), "", 1))
    assert verdicts(check_hand(path), "dynamics") == [
        ("note", "links without a mass, which can be posed but not simulated: left_finger")
    ]


def test_of_a_shape_that_tapers_the_end_is_fitted(tmp_path: Path) -> None:
    """A wedge, 48 mm wide where it begins and 16 mm where its round end does: no surface lies on all of it."""
    x = np.repeat([-0.03, 0.025], 2 * 24)
    turn = np.tile(np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False), 4)
    wide = np.where(x < 0.0, 0.024, 0.009)
    end = 0.009 * random_directions(np.random.default_rng(0), 400) + [0.025, 0.0, 0.0]
    across = np.where(x < 0.0, 0.013, 0.009)
    points = np.concatenate([np.column_stack([x, wide * np.sign(np.cos(turn)), across * np.sin(turn)]), end])
    trimesh.convex.convex_hull(points).export(tmp_path / "wedge.obj")
    path = write_gripper(tmp_path, yaml=YAML.replace("{radius: 0.012}", "{radius: 0.002}"))
    model = tmp_path / "two_finger.urdf"
    ball = '<geometry><sphere radius="0.012"/></geometry>'
    wedge = '<origin rpy="0 -1.5708 0" xyz="0 0 0.03"/><geometry><mesh filename="wedge.obj"/></geometry>'
    model.write_text(model.read_text().replace(ball, wedge))
    (note,) = (text for _, text in verdicts(check_hand(path), "fingertip left") if "fitted" in text)
    (length, left) = re.findall(r"the last (\d+) mm of the shape .* is off by (\d\.\d+) mm", note)[0]
    assert 20 < int(length) < 30
    assert float(left) < 0.7


def test_what_drake_says_is_told_to_its_end(tmp_path: Path) -> None:
    path = write_gripper(tmp_path)
    model = tmp_path / "two_finger.urdf"
    model.write_text(model.read_text().replace('ixx="2e-5"', 'ixx="9e-5"', 1))
    (note,) = (text for verdict, text in verdicts(check_hand(path), "model") if verdict == "note")
    assert note.startswith("Drake says: two_finger.urdf:")
    assert note.endswith("do not satisfy the triangle inequality")


GRID = [[x, y, 0.012] for x in (-0.003, 0.0, 0.003) for y in (-0.003, 0.0, 0.003)]


def check_pad(folder: Path, points: list[list[float]], normal: tuple[int, int, int] = (0, 0, 1)) -> HandCheck:
    """Of the gripper with a tactile array on the left ball, whose top is at z = 12 mm."""
    pattern = f"{{points: {points}, normals: [{list(normal)}], cell: 0.003}}"
    (folder / "pad.yaml").write_text(f"pattern: !PointPattern {pattern}\n")
    pads = "pads: [{name: tip, frame: left_tip, array: pad.yaml, alpha: 1e-8}]\n"
    return check_hand(write_gripper(folder, yaml=YAML + pads))


def test_a_pad_on_its_link_has_no_fault(tmp_path: Path) -> None:
    check = check_pad(tmp_path, GRID)
    assert not check.faults
    text = "100% of its cells lie within 5 mm of the collision shapes of link 'left_tip'; the rest is up to "
    assert [finding.text.startswith(text) for finding in check.findings if finding.part == "pad tip"] == [False, True]


@pytest.mark.parametrize(
    ("alpha", "verdict", "text"),
    [
        ("2e-8", "ok", "at the array's range, 200000 Pa, it is pressed in by 4 mm by alpha = 2e-08 m/Pa"),
        ("2e-11", "note", "it is pressed in by 0.004 mm by alpha = 2e-11 m/Pa"),
        ("2e-5", "fault", "it is pressed in by 4e+03 mm by alpha = 2e-05 m/Pa, which must be at most 100 mm"),
    ],
)
def test_a_pad_that_is_softer_or_stiffer_than_pads_are_is_named(
    tmp_path: Path, alpha: str, verdict: str, text: str
) -> None:
    (tmp_path / "pad.yaml").write_text(f"pattern: !PointPattern {{points: {GRID}, cell: 0.003}}\nmodel: {{range: 2e5}}")
    pads = f"pads: [{{name: tip, frame: left_tip, array: pad.yaml, alpha: {alpha}}}]\n"
    findings = check_hand(write_gripper(tmp_path, yaml=YAML + pads)).findings
    (found,) = (finding for finding in findings if text in finding.text)
    assert (found.part, found.verdict) == ("pad tip", verdict)


@pytest.mark.parametrize(
    ("points", "normal", "text"),
    [
        (
            [[1e3 * x for x in point] for point in GRID],
            (0, 0, 1),
            "must be off its frame by at most 1 m, not",
        ),
        ([[x, y, z + 0.5] for x, y, z in GRID], (0, 0, 1), "is up to 500.0 mm outside of them and 0.0 mm inside"),
        ([*GRID, [0.0, 0.0, GRID[0][2] + 0.02]], (0, 0, 1), "the rest is up to 20.0 mm outside of them"),
        (GRID, (0, 0, -1), "the normals of 100% of its cells point into the link 'left_tip'"),
        ([*GRID, GRID[4]], (0, 0, 1), "pad.yaml: corners[9] must be elsewhere than cell 4, not in the same place"),
    ],
)
def test_a_pad_that_cannot_be_where_it_is_told_is_named(
    tmp_path: Path, points: list[list[float]], normal: tuple[int, int, int], text: str
) -> None:
    (fault,) = check_pad(tmp_path, points, normal).faults
    assert fault.part == "pad tip"
    assert text in fault.text


def test_a_pad_on_a_link_without_a_shape_is_noted(tmp_path: Path) -> None:
    check_pad(tmp_path, GRID)
    model, path = tmp_path / "two_finger.urdf", tmp_path / "two_finger.hand.yaml"
    mark = '<link name="mark"/><joint name="mark_weld" type="fixed"><parent link="base"/><child link="mark"/></joint>'
    model.write_text(model.read_text().replace("</robot>", mark + "</robot>"))
    path.write_text(path.read_text().replace("frame: left_tip, array", "frame: mark, array"))
    text = (
        "the link 'mark' has no collision shape, which its cells could be compared with, and that could be touched in "
        "simulation: there, its frame must be one of the link that has the shape"
    )
    assert ("note", text) in verdicts(check_hand(path), "pad tip")


def test_what_is_declared_of_the_hand_s_errors_is_said(tmp_path: Path) -> None:
    path = write_gripper(tmp_path)
    (silent,) = (finding for finding in check_hand(path).findings if finding.part == "uncertainty")
    assert silent.verdict == "note"
    assert silent.text.startswith("is not declared")
    path.write_text(path.read_text() + "uncertainty: {encoder_offset_deg: 2.0}\n")
    (told,) = (finding for finding in check_hand(path).findings if finding.part == "uncertainty")
    assert told.verdict == "ok"
    assert told.text == "encoders 2 deg; mounting 0.3 mm, 0.5 deg; fingertips 0.1 mm; sensors 0.05 N, 0.5 mN m"
