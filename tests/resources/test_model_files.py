import dataclasses
from collections.abc import Callable
from pathlib import Path

import pytest
import trimesh
from pydrake.common.schema import Transform
from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant

from tactopose_drake.errors import InvalidFileError
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.resources import load_typed_yaml
from tactopose_drake.resources.model_files import add_model, make_parser
from tactopose_drake.station.arms.arm import load_arm_config
from tactopose_drake.station.scenario import scenario_file


@dataclasses.dataclass(kw_only=True, slots=True)
class Ball:
    radius: float = 0.01


@dataclasses.dataclass(kw_only=True, slots=True)
class Box:
    sides: list[float] = dataclasses.field(default_factory=list)


@dataclasses.dataclass(kw_only=True, slots=True)
class Toy:
    name: str = ""
    count: int = 1
    shape: Ball | Box = dataclasses.field(default_factory=Ball)
    spare: Ball | None = None
    parts: list[Ball] = dataclasses.field(default_factory=list)
    weights: dict[str, float] = dataclasses.field(default_factory=dict)
    X_WT: Transform = dataclasses.field(default_factory=Transform)


def load(folder: Path, text: str) -> Toy:
    (folder / "toy.yaml").write_text(text)
    return load_typed_yaml(Toy, folder / "toy.yaml")


def test_what_is_left_out_has_its_default(tmp_path: Path) -> None:
    text = "spare: {radius: 1e-2}\ncount: 0x20\nshape: !Box {sides: [1, 2.5]}\n"
    toy = load(tmp_path, text)
    assert (toy.spare, toy.count, toy.shape, toy.parts) == (Ball(radius=0.01), 32, Box(sides=[1.0, 2.5]), [])


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        (
            "name: a\ncuont: 2\n",
            "line 2: the content must have only the keys name, count, shape, spare, parts, weights, X_WT, not 'cuont'",
        ),
        ("parts:\n- radius: 1\n- raduis: 2\n", "line 3: parts[1] must have only the keys radius, not 'raduis'."),
        ("shape: !Box {radius: 1}", "line 1: shape must have only the keys sides, not 'radius'."),
        ("shape: !Cone {}", "line 1: shape must have one of the tags !Ball, !Box, not !Cone."),
        ("spare: null\ncount: many", "line 2: count must be an integer, not 'many'."),
        ("weights: {a: 1, b: [2]}", "line 1: weights.b must be a number, not a list or mapping."),
        ("name: a\nspare: 3\n", "line 2: spare must be a mapping, whose keys may be radius, not '3'."),
        ("parts: [{radius: ten}]", "line 1: parts[0].radius must be a number, not 'ten'."),
        ("X_WT: {translation: [1, 2]}", "line 1: X_WT must fit Drake's Transform, whose keys may be base_frame, "),
        ("- 1", "line 1: the content must be a mapping, whose keys may be name, count"),
        ("", "the file must not be empty."),
        ("name: [", "did not find expected node content"),
    ],
)
def test_a_fault_is_told_with_its_line_and_what_is_allowed(tmp_path: Path, text: str, fault: str) -> None:
    with pytest.raises(InvalidFileError) as caught:
        load(tmp_path, text)
    message = str(caught.value)
    assert message.startswith(f"{tmp_path / 'toy.yaml'}: ")
    assert fault in message
    assert "\n" not in message


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(InvalidFileError, match=r"no\.yaml cannot be read \(No such file"):
        load_typed_yaml(Toy, tmp_path / "no.yaml")


def test_a_model_that_is_not_there_is_told_so(tmp_path: Path) -> None:
    with pytest.raises(InvalidFileError, match=r"no\.urdf must be an SDF, URDF or MJCF, but there is no such file"):
        add_model(make_parser(MultibodyPlant(time_step=0.001)), tmp_path / "no.urdf")


def test_a_model_whose_numbers_are_none_is_told_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(
        '<robot name="arm"><link name="a"/><link name="b"/><joint name="j" type="continuous"><parent link="a"/>'
        '<child link="b"/><axis xyz="nan 0 0"/></joint></robot>'
    )
    plant = MultibodyPlant(time_step=0.001)
    with pytest.raises(InvalidFileError, match=r"arm\.urdf must be a model that Drake can read \(.*nan 0 0\)\.$"):
        add_model(make_parser(plant), tmp_path / "arm.urdf")


MODEL = """<robot name="stone"><link name="stone"><{role}><geometry><mesh filename="stone.stl"/></geometry></{role}>
<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link></robot>"""


def parse(folder: Path, role: str) -> None:
    """Reads a model with a mesh of a format that Drake does not collide with."""
    (folder / "stone.urdf").write_text(MODEL.format(role=role))
    trimesh.creation.box((0.1, 0.1, 0.1)).export(folder / "stone.stl")
    plant, scene = MultibodyPlant(time_step=0.001), SceneGraph()
    plant.RegisterAsSourceForSceneGraph(scene)
    add_model(make_parser(plant), folder / "stone.urdf")


def test_a_mesh_that_drake_does_not_collide_with_is_told_with_those_that_it_does(tmp_path: Path) -> None:
    parse(tmp_path, "visual")
    with pytest.raises(
        InvalidFileError, match=r"stone\.urdf must be .*stone\.stl\)\. Write meshes to collide with as OBJ, glTF"
    ):
        parse(tmp_path, "collision")


def test_an_unknown_package_is_told_with_those_that_are_known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder on ROS_PACKAGE_PATH is known by what its package.xml says, and not by its own name."""
    (tmp_path / "stones").mkdir()
    (tmp_path / "stones" / "package.xml").write_text("<package><name>stone_models</name></package>")
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path))
    parser = make_parser(MultibodyPlant(time_step=0.001))
    with pytest.raises(
        InvalidFileError, match=r"'stones'\)\. Known are drake, .*stone_models, tactopose_drake: of fold"
    ):
        add_model(parser, "package://stones/stone.urdf")


@pytest.mark.parametrize(
    ("read", "known"),
    [
        (load_hand_config, "hands, allegro"),
        (load_arm_config, "arms, seven_axis"),
        (scenario_file, "scenarios, "),
    ],
)
def test_a_file_of_the_package_that_is_not_there_is_told_with_those_that_are(
    read: Callable[[str], object], known: str, tmp_path: Path
) -> None:
    with pytest.raises(
        InvalidFileError,
        match=f"^nope must be a YAML file, or one of the package's {known}.*, but there is no such file",
    ):
        read("nope")
    with pytest.raises(InvalidFileError, match=f"must be a YAML file, or one of the package's {known}.*, not a folder"):
        read(str(tmp_path))
